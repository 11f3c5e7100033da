// The switch of each effect follows from its size: 0 (or infinite, where that is neutral) is off.
#include "components/effects.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

namespace vgroove {

static std::uint32_t when(bool on, std::uint32_t effect) {
    return on ? effect : 0u;
}

static bool has_two_bodies(const Parameters &p) {
    const double ratio = p.gearbox_ratio;
    const double output = p.gearbox_output_inertia / (ratio * ratio) + p.coupler_inertia_kg_m2;
    const bool split = std::isfinite(p.coupler_stiffness) || p.backlash_play_rad > 0.0;
    return split && output > 0.0;
}

std::uint32_t effects_of(const Parameters &p) {
    const bool split = has_two_bodies(p);
    return when(p.droop_volt_per_coulomb != 0.0 || p.droop_polarisation_ohm != 0.0, EFFECT_DROOP) |
           when(p.dead_time_s != 0.0, EFFECT_DEAD_TIME) |
           when(p.heating_kelvin_per_joule != 0.0, EFFECT_HEATING) |
           when(p.brush_voltage_v != 0.0, EFFECT_BRUSH) |
           when(std::isfinite(p.saturation_a), EFFECT_SATURATION) |
           when(p.stribeck_breakaway_nm != 0.0, EFFECT_STRIBECK) |
           when(p.quadratic_drag != 0.0, EFFECT_DRAG) |
           when(p.directional_viscous != 0.0, EFFECT_DIRECTIONAL) |
           when(p.cogging_nm != 0.0, EFFECT_COGGING) |
           when(p.grease_nm_s_per_rad != 0.0, EFFECT_GREASE) |
           when(p.load_friction_relative != 0.0, EFFECT_LOAD_FRICTION) |
           when(p.eccentricity_nm != 0.0, EFFECT_ECCENTRICITY) | when(split, EFFECT_TWO_BODIES) |
           when(split && p.backlash_play_rad > 0.0, EFFECT_PLAY) |
           when(p.current_lag_s > 0.0, EFFECT_CURRENT_LAG) |
           when(p.speed_lag_s > 0.0 && p.speed_lag_delay_form == 0.0, EFFECT_SPEED_LAG) |
           when(p.hall_amplitude_rad != 0.0, EFFECT_HALL) |
           when(p.transport_delay_s > 0.0 ||
                    (p.clock_skew_relative != 0.0 && p.clock_skew_command != 0.0),
                EFFECT_COMMAND_SHIFT);
}

struct Rate {
    const char *name;
    double value, per_second;
};

static std::vector<Rate> drivetrain_rates(const Parameters &p) {
    const double inductance = p.motor_inductance_h * (1.0 + p.inductance_relative);
    const double inertia = p.motor_inertia_kg_m2 + p.added_inertia_kg_m2;
    const double total = inertia + p.gearbox_output_inertia / (p.gearbox_ratio * p.gearbox_ratio);
    const double ohm = p.motor_resistance_ohm * (1.0 + p.winding_relative) +
                       p.supply_resistance_ohm + p.added_supply_ohm + p.bridge_resistance_ohm;
    const double usual_ohm = 1.0, usual_henry = 1e-4;  // of tools: which of the two is the odd one
    const bool odd = std::fabs(std::log10(std::max(ohm, 1e-300) / usual_ohm)) >
                     std::fabs(std::log10(std::max(inductance, 1e-300) / usual_henry));
    return {
        {odd ? "motor.resistance_ohm" : "motor.inductance_h",
         odd ? p.motor_resistance_ohm : p.motor_inductance_h, ohm / inductance},
        {"motor.inertia_kg_m2", p.motor_inertia_kg_m2,
         std::max(std::fabs(p.motor_torque_constant) / std::sqrt(inductance * total),
                  (p.motor_viscous + p.viscous) / total)},
        {"effects.brush_drop.voltage_v", p.brush_voltage_v, p.brush_voltage_v / (0.3 * inductance)},
        {"effects.current_lag.time_constant_s", p.current_lag_s,
         p.current_lag_s > 0.0 ? 1.0 / p.current_lag_s : 0.0},
        {"effects.speed_lag.time_constant_s", p.speed_lag_s,
         p.speed_lag_s > 0.0 ? 1.0 / p.speed_lag_s : 0.0},
        {"effects.cold_grease.nm_s_per_rad", p.grease_nm_s_per_rad, p.grease_nm_s_per_rad / total},
        {"effects.cogging_torque.periods_per_rev", p.cogging_periods,
         p.cogging_nm != 0.0 ? p.cogging_periods * p.supply_voltage_v /
                                   std::max(std::fabs(p.motor_torque_constant), 1e-9)
                             : 0.0},
        {"effects.coupler_compliance.stiffness_nm_per_rad", p.coupler_stiffness,
         std::isfinite(p.coupler_stiffness) ? std::sqrt(p.coupler_stiffness / total) : 0.0},
    };
}

// Of hammer, anvil, joint and arm, each on its own.
static std::vector<Rate> mechanism_rates(const Parameters &p) {
    const double lug = p.lug_radius_m * p.lug_radius_m *
                       (1.0 / p.hammer_inertia_kg_m2 + 1.0 / p.anvil_inertia_kg_m2);
    return {
        {"mechanism.contact_stiffness_n_per_m", p.contact_stiffness,
         std::sqrt(p.contact_stiffness * lug)},
        {"mechanism.contact_damping_n_s_per_m", p.contact_damping,
         p.contact_damping * (1.0 + p.impact_damping_relative) * lug},
        {"mechanism.spring_rate_n_per_m", p.spring_rate_n_per_m,
         std::sqrt(p.spring_rate_n_per_m / p.hammer_mass_kg)},
        {"mechanism.arm_stiffness_nm_per_rad", p.arm_stiffness,
         std::sqrt(p.arm_stiffness / p.arm_inertia_kg_m2)},
        {"mechanism.arm_damping_nm_s_per_rad", p.arm_damping, p.arm_damping / p.arm_inertia_kg_m2},
        {"load.stiffness_nm_per_rad", p.joint_stiffness,
         std::sqrt(p.joint_stiffness / p.anvil_inertia_kg_m2)},
        {"load.damping_nm_s_per_rad", p.joint_damping,
         std::max(p.joint_damping / p.anvil_inertia_kg_m2,
                  p.joint_stiffness / std::max(p.joint_damping, 1e-300))},
    };
}

std::string fastest_parameter(const Parameters &p) {
    std::vector<Rate> rates = drivetrain_rates(p);
    if (p.hammer_inertia_kg_m2 > 0.0)
        for (const Rate &rate : mechanism_rates(p))
            rates.push_back(rate);
    const Rate *fastest = &rates.front();
    for (const Rate &rate : rates)
        fastest = std::fabs(rate.per_second) > std::fabs(fastest->per_second) ? &rate : fastest;
    char text[160];
    std::snprintf(text, sizeof text,
                  "the fastest rate of the model, %.3g per second, comes from %s = %.6g",
                  fastest->per_second, fastest->name, fastest->value);
    return text;
}

}  // namespace vgroove
