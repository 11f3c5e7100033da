// Names of the parameter vector, and the physical ranges of the parameters.
#include "components/parameters.hpp"

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace vgroove {

static const char *const RIG_KEY_NAMES[RIG_KEY_COUNT] = {
#define VGROOVE_PLANT_NAME(member, name, value) name,
    VGROOVE_PLANT_PARAMETERS(VGROOVE_PLANT_NAME)
#undef VGROOVE_PLANT_NAME
};

const char *parameter_name(int n) {
    return n < RIG_KEY_COUNT ? RIG_KEY_NAMES[n] : LOAD_AND_EFFECT_NAMES[n - RIG_KEY_COUNT];
}

Parameters parameters_from(const double *theta) {
    Parameters p;
    std::memcpy(&p.supply_voltage_v, theta, sizeof p);
    return p;
}

void require_parameter(bool holds, const char *message) {
    if (!holds)
        throw std::invalid_argument(std::string("plant parameter out of range: ") + message);
}

void check_parameters(const Parameters &p, bool electrical) {
    const double *values = reinterpret_cast<const double *>(&p);
    for (int n = 0; n < PARAMETER_COUNT; ++n)
        require_parameter(!std::isnan(values[n]), parameter_name(n));
    require_parameter(p.motor_inertia_kg_m2 + p.effects.added_inertia.kg_m2 > 0.0,
                      "motor.inertia_kg_m2 (with added_inertia) must be positive");
    require_parameter(p.gearbox_ratio != 0.0, "gearbox.ratio must not be 0");
    require_parameter(p.gearbox_output_inertia >= 0.0,
                      "gearbox.output_inertia_kg_m2 must not be negative");
    check_effects(p.effects, require_parameter);
    require_parameter(std::fabs(p.effects.clock_skew.relative) < 0.5,
                      "effects.clock_skew.relative");
    require_parameter(p.load.breakaway_ratio >= 1.0, "load.breakaway_ratio must be at least 1");
    require_parameter(p.load.breakaway_rad_s > 0.0, "load.breakaway_rad_s must be positive");
    require_parameter(p.load.threshold_rad_s > 0.0, "load.threshold_rad_s must be positive");
    if (!electrical)
        return;
    require_parameter(p.motor_inductance_h * (1.0 + p.effects.inductance.relative) > 0.0,
                      "motor.inductance_h must be positive");
    require_parameter(p.motor_resistance_ohm * (1.0 + p.effects.winding_resistance.relative) >= 0.0,
                      "motor.resistance_ohm must not be negative");
    require_parameter(p.bridge_pwm_hz > 0.0, "bridge.pwm_hz must be positive");
}

}  // namespace vgroove
