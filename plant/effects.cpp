// The switch of each effect follows from its size: 0 (or infinite, where that is neutral) is off.
#include "effects.hpp"

#include <cmath>

namespace vgroove {

static std::uint32_t when(bool on, std::uint32_t effect) { return on ? effect : 0u; }

static bool has_two_bodies(const Parameters &p) {
    const double ratio = p.gearbox_ratio;
    const double output = p.gearbox_output_inertia / (ratio * ratio) + p.coupler_inertia_kg_m2;
    const bool split = std::isfinite(p.coupler_stiffness) || p.backlash_play_rad > 0.0;
    return split && output > 0.0;
}

std::uint32_t effects_of(const Parameters &p) {
    const bool split = has_two_bodies(p);
    return when(p.droop_volt_per_coulomb != 0.0 || p.droop_polarisation_ohm != 0.0, EFFECT_DROOP)
           | when(p.dead_time_s != 0.0, EFFECT_DEAD_TIME)
           | when(p.heating_kelvin_per_joule != 0.0, EFFECT_HEATING)
           | when(p.brush_voltage_v != 0.0, EFFECT_BRUSH)
           | when(std::isfinite(p.saturation_a), EFFECT_SATURATION)
           | when(p.stribeck_breakaway_nm != 0.0, EFFECT_STRIBECK)
           | when(p.quadratic_drag != 0.0, EFFECT_DRAG)
           | when(p.directional_viscous != 0.0, EFFECT_DIRECTIONAL)
           | when(p.cogging_nm != 0.0, EFFECT_COGGING)
           | when(p.grease_nm_s_per_rad != 0.0, EFFECT_GREASE)
           | when(p.load_friction_relative != 0.0, EFFECT_LOAD_FRICTION)
           | when(p.eccentricity_nm != 0.0, EFFECT_ECCENTRICITY)
           | when(split, EFFECT_TWO_BODIES)
           | when(split && p.backlash_play_rad > 0.0, EFFECT_PLAY)
           | when(p.current_lag_s > 0.0, EFFECT_CURRENT_LAG)
           | when(p.speed_lag_s > 0.0 && p.speed_lag_delay_form == 0.0, EFFECT_SPEED_LAG)
           | when(p.hall_amplitude_rad != 0.0, EFFECT_HALL)
           | when(p.transport_delay_s > 0.0 || (p.clock_skew_relative != 0.0 && p.clock_skew_command != 0.0), EFFECT_COMMAND_SHIFT);
}

}  // namespace vgroove
