// Switches of the effects from the parameters, and the fastest rate of the model.
#include "components/effects.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

namespace vgroove {

static bool has_two_bodies(const Parameters &p, double load_inertia_kg_m2) {
    const double output =
        p.gearbox_output_inertia + load_inertia_kg_m2 + p.effects.coupler_compliance.inertia_kg_m2;
    const bool split = std::isfinite(p.effects.coupler_compliance.stiffness_nm_per_rad) ||
                       p.effects.gear_backlash.play_rad > 0.0;
    return split && output > 0.0;
}

static bool shifts_command(const EffectParameters &e) {
    return e.transport_delay.delay_s > 0.0 ||
           (e.clock_skew.relative != 0.0 && e.clock_skew.command_clock != 0.0);
}

std::uint32_t effects_of(const Parameters &p, double load_inertia_kg_m2) {
    const EffectParameters &e = p.effects;
    const bool split = has_two_bodies(p, load_inertia_kg_m2);
    std::uint32_t on = effect_switches(e);
    on |= split ? EFFECT_TWO_BODIES : 0u;
    on |= split && e.gear_backlash.play_rad > 0.0 ? EFFECT_PLAY : 0u;
    on |= e.speed_lag.time_constant_s > 0.0 && e.speed_lag.lag_form == LAG_FILTER ? EFFECT_SPEED_LAG
                                                                                  : 0u;
    on |= shifts_command(e) ? EFFECT_COMMAND_SHIFT : 0u;
    return on;
}

// A rate of the model and the parameter that determines it
struct Rate {
    const char *name;
    double value, per_second;
};

static std::vector<Rate> drivetrain_rates(const Parameters &p) {
    const double inductance = p.motor_inductance_h * (1.0 + p.effects.inductance.relative);
    const double inertia = p.motor_inertia_kg_m2 + p.effects.added_inertia.kg_m2;
    const double total = inertia + p.gearbox_output_inertia / (p.gearbox_ratio * p.gearbox_ratio);
    const double ohm = p.motor_resistance_ohm * (1.0 + p.effects.winding_resistance.relative) +
                       p.supply_resistance_ohm + p.effects.supply_resistance.resistance_ohm +
                       p.effects.bridge_resistance.resistance_ohm;
    // R / L is fast because of one of the two: the one whose value differs more, on a logarithmic
    // scale, from that of a usual tool.
    const double usual_ohm = 1.0, usual_henry = 1e-4;
    const bool unusual_ohm = std::fabs(std::log10(std::max(ohm, 1e-300) / usual_ohm)) >
                             std::fabs(std::log10(std::max(inductance, 1e-300) / usual_henry));
    return {
        {unusual_ohm ? "motor.resistance_ohm" : "motor.inductance_h",
         unusual_ohm ? p.motor_resistance_ohm : p.motor_inductance_h, ohm / inductance},
        {"motor.inertia_kg_m2", p.motor_inertia_kg_m2,
         std::max(std::fabs(p.motor_torque_constant) / std::sqrt(inductance * total),
                  (p.motor_viscous + p.effects.viscous_friction.nm_s_per_rad) / total)},
        // 0.3 A: BRUSH_CURRENT_A of components/motor.hpp
        {"effects.brush_drop.voltage_v", p.effects.brush_drop.voltage_v,
         p.effects.brush_drop.voltage_v / (0.3 * inductance)},
        {"effects.current_lag.time_constant_s", p.effects.current_lag.time_constant_s,
         p.effects.current_lag.time_constant_s > 0.0 ? 1.0 / p.effects.current_lag.time_constant_s
                                                     : 0.0},
        {"effects.speed_lag.time_constant_s", p.effects.speed_lag.time_constant_s,
         p.effects.speed_lag.time_constant_s > 0.0 ? 1.0 / p.effects.speed_lag.time_constant_s
                                                   : 0.0},
        {"effects.cold_grease.nm_s_per_rad", p.effects.cold_grease.nm_s_per_rad,
         p.effects.cold_grease.nm_s_per_rad / total},
        {"effects.cogging_torque.periods_per_rev", p.effects.cogging_torque.periods_per_rev,
         p.effects.cogging_torque.torque_nm != 0.0
             ? p.effects.cogging_torque.periods_per_rev * p.supply_voltage_v /
                   std::max(std::fabs(p.motor_torque_constant), 1e-9)
             : 0.0},
        {"effects.coupler_compliance.stiffness_nm_per_rad",
         p.effects.coupler_compliance.stiffness_nm_per_rad,
         std::isfinite(p.effects.coupler_compliance.stiffness_nm_per_rad)
             ? std::sqrt(p.effects.coupler_compliance.stiffness_nm_per_rad / total)
             : 0.0},
    };
}

// Rates of hammer, anvil, joint and arm, each with the other bodies at rest
static std::vector<Rate> mechanism_rates(const Parameters &p) {
    const double inverse_mass = p.lug_radius_m * p.lug_radius_m *
                                (1.0 / p.hammer_inertia_kg_m2 + 1.0 / p.anvil_inertia_kg_m2);
    return {
        {"mechanism.contact_stiffness_n_per_m", p.contact_stiffness,
         std::sqrt(p.contact_stiffness * inverse_mass)},
        {"mechanism.contact_damping_n_s_per_m", p.contact_damping,
         p.contact_damping * (1.0 + p.effects.impact_damping.relative) * inverse_mass},
        {"mechanism.spring_rate_n_per_m", p.spring_rate_n_per_m,
         std::sqrt(p.spring_rate_n_per_m / p.hammer_mass_kg)},
        {"mechanism.arm_stiffness_nm_per_rad", p.arm_stiffness,
         std::sqrt(p.arm_stiffness / p.arm_inertia_kg_m2)},
        {"mechanism.arm_damping_nm_s_per_rad", p.arm_damping, p.arm_damping / p.arm_inertia_kg_m2},
        {"load.stiffness_nm_per_rad", p.load.stiffness_nm_per_rad,
         std::sqrt(p.load.stiffness_nm_per_rad / p.anvil_inertia_kg_m2)},
        {"load.damping_nm_s_per_rad", p.load.damping_nm_s_per_rad,
         std::max(p.load.damping_nm_s_per_rad / p.anvil_inertia_kg_m2,
                  p.load.stiffness_nm_per_rad / std::max(p.load.damping_nm_s_per_rad, 1e-300))},
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
