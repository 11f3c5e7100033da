// Names of the parameter vector and the checks of their physical range.
#include "components/parameters.hpp"

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace vgroove {

const char *const PARAMETER_NAMES[PARAMETER_COUNT] = {
#define VGROOVE_PLANT_NAME(member, name, value) name,
    VGROOVE_PLANT_PARAMETERS(VGROOVE_PLANT_NAME)
#undef VGROOVE_PLANT_NAME
};

Parameters parameters_from(const double *theta) {
    Parameters p;
    std::memcpy(&p.supply_voltage_v, theta, sizeof p);
    return p;
}

static void require(bool holds, const char *what) {
    if (!holds)
        throw std::invalid_argument(std::string("plant parameter out of range: ") + what);
}

void check_parameters(const Parameters &p, bool electrical) {
    const double *values = reinterpret_cast<const double *>(&p);
    for (int n = 0; n < PARAMETER_COUNT; ++n)
        require(!std::isnan(values[n]), PARAMETER_NAMES[n]);
    require(p.motor_inertia_kg_m2 + p.added_inertia_kg_m2 > 0.0,
            "motor.inertia_kg_m2 (with added_inertia) must be positive");
    require(p.gearbox_ratio != 0.0, "gearbox.ratio must not be 0");
    require(p.gearbox_output_inertia >= 0.0, "gearbox.output_inertia_kg_m2 must not be negative");
    require(p.droop_polarisation_s > 0.0, "effects.supply_droop.polarisation_s must be positive");
    require(p.heating_cooling_s > 0.0, "effects.winding_heating.cooling_s must be positive");
    require(p.saturation_a > 0.0, "effects.magnetic_saturation.saturation_a must be positive");
    require(p.stribeck_speed_rad_s > 0.0, "effects.stribeck_friction.speed_rad_s must be positive");
    require(p.grease_time_s > 0.0, "effects.cold_grease.time_s must be positive");
    require(p.coupler_stiffness > 0.0,
            "effects.coupler_compliance.stiffness_nm_per_rad must be positive");
    require(p.current_lag_s >= 0.0, "effects.current_lag.time_constant_s must not be negative");
    require(p.speed_lag_s >= 0.0, "effects.speed_lag.time_constant_s must not be negative");
    require(p.transport_delay_s >= 0.0, "effects.transport_delay.delay_s must not be negative");
    require(std::fabs(p.clock_skew_relative) < 0.5, "effects.clock_skew.relative");
    require(p.free_breakaway_ratio >= 1.0, "load.breakaway_ratio must be at least 1");
    require(p.free_breakaway_rad_s > 0.0, "load.breakaway_rad_s must be positive");
    require(p.free_threshold_rad_s > 0.0, "load.threshold_rad_s must be positive");
    if (!electrical)
        return;
    require(p.motor_inductance_h * (1.0 + p.inductance_relative) > 0.0,
            "motor.inductance_h must be positive");
    require(p.motor_resistance_ohm * (1.0 + p.winding_relative) >= 0.0,
            "motor.resistance_ohm must not be negative");
    require(p.bridge_pwm_hz > 0.0, "bridge.pwm_hz must be positive");
}

}  // namespace vgroove
