// Constants of the drivetrain from the flat parameters: where effects that change a coefficient are
// folded in.
#include "drivetrain/model.hpp"

#include <algorithm>
#include <cmath>

namespace vgroove {

template <class V> static void set_electrical(Drivetrain<V> &m, int lane, const Parameters &p) {
    const double inductance = p.motor_inductance_h * (1.0 + p.inductance_relative);
    set(m.supply.open_circuit_v, lane, p.supply_voltage_v);
    set(m.supply.resistance_ohm, lane, p.supply_resistance_ohm + p.added_supply_ohm);
    set(m.supply.volt_per_coulomb, lane, p.droop_volt_per_coulomb);
    set(m.supply.polarisation_ohm, lane, p.droop_polarisation_ohm);
    set(m.supply.polarisation_rate, lane, 1.0 / p.droop_polarisation_s);
    set(m.bridge.resistance_ohm, lane, p.bridge_resistance_ohm);
    set(m.bridge.ripple_a_per_v, lane,
        inductance > 0.0 ? 1.0 / (2.0 * inductance * p.bridge_pwm_hz) : 0.0);
    set(m.bridge.at_edges, lane, p.dead_time_at_edges);
    set(m.dead_share, lane, 2.0 * p.dead_time_s * p.bridge_pwm_hz);
    set(m.motor.resistance_ohm, lane, p.motor_resistance_ohm * (1.0 + p.winding_relative));
    set(m.motor.inductance_inverse, lane, inductance > 0.0 ? 1.0 / inductance : 0.0);
    set(m.motor.constant, lane, p.motor_torque_constant * (1.0 + p.torque_constant_relative));
    set(m.motor.saturation_inverse, lane, 1.0 / p.saturation_a);
    set(m.motor.kelvin_per_joule, lane, p.heating_kelvin_per_joule);
    set(m.motor.cooling_rate, lane, 1.0 / p.heating_cooling_s);
    set(m.motor.brush_v, lane, p.brush_voltage_v);
}

template <class V> static void set_friction(Friction<V> &f, int lane, const Parameters &p) {
    set(f.viscous, lane, p.motor_viscous + p.viscous);
    set(f.coulomb_nm, lane, p.motor_coulomb_nm + p.coulomb_nm);
    set(f.forward_nm, lane, p.asymmetric_forward_nm);
    set(f.backward_nm, lane, p.asymmetric_backward_nm);
    set(f.breakaway_nm, lane, p.stribeck_breakaway_nm);
    set(f.stribeck_inverse, lane, 1.0 / p.stribeck_speed_rad_s);
    set(f.drag, lane, p.quadratic_drag);
    set(f.directional, lane, p.directional_viscous);
    set(f.grease, lane, p.grease_nm_s_per_rad);
    set(f.grease_rate, lane, 1.0 / p.grease_time_s);
    set(f.cogging_nm, lane, p.cogging_nm);
    set(f.cogging_periods, lane, p.cogging_periods);
    set(f.cogging_phase, lane, p.cogging_phase_rad);
    set(f.eccentricity_nm, lane, p.eccentricity_nm);
    set(f.eccentricity_phase, lane, p.eccentricity_phase_rad);
    set(f.ratio_inverse, lane, 1.0 / p.gearbox_ratio);
    set(f.load_relative, lane, p.load_friction_relative);
}

// Two bodies: the coupler's stiffness, or the contact's where there is play alone; c = 2
// damping_ratio sqrt(stiffness J2) or of the reduced inertia.
template <class V> static void set_gear(Drivetrain<V> &m, int lane, const Parameters &p) {
    const double ratio2 = p.gearbox_ratio * p.gearbox_ratio;
    const double pendulum = m.load.kind == LoadKind::PENDULUM
                                ? p.load_mass_kg * p.load_length_m * p.load_length_m
                                : 0.0;
    const double motor = p.motor_inertia_kg_m2 + p.added_inertia_kg_m2;
    const bool split = (m.effects & EFFECT_TWO_BODIES) != 0u;
    const bool coupler = std::isfinite(p.coupler_stiffness);
    const double output =
        (p.gearbox_output_inertia + pendulum) / ratio2 + (coupler ? p.coupler_inertia_kg_m2 : 0.0);
    const double reduced = motor * output / (motor + output);
    const double stiffness =
        coupler ? p.coupler_stiffness : CONTACT_RAD_S * CONTACT_RAD_S * reduced;
    const double damping = coupler ? 2.0 * p.coupler_damping_ratio * std::sqrt(stiffness * output)
                                   : 2.0 * CONTACT_DAMPING_RATIO * std::sqrt(stiffness * reduced);
    set(m.gear.ratio_inverse, lane, 1.0 / p.gearbox_ratio);
    set(m.gear.inertia_inverse, lane, 1.0 / (split ? motor : motor + output));
    set(m.gear.output_inertia_inverse, lane, split ? 1.0 / output : 0.0);
    set(m.gear.stiffness, lane, split ? stiffness : 0.0);
    set(m.gear.damping, lane, split ? damping : 0.0);
    set(m.gear.half_play, lane,
        split ? 0.5 * p.backlash_play_rad * std::fabs(p.gearbox_ratio) : 0.0);
}

template <class V>
static void set_load_and_sensors(Drivetrain<V> &m, int lane, const Parameters &p) {
    set(m.load.ratio_inverse, lane, 1.0 / p.gearbox_ratio);
    set(m.load.pendulum_nm, lane, p.load_mass_kg * GRAVITY_M_S2 * p.load_length_m);
    set(m.load.zero_rad, lane, p.load_zero_rad);
    set(m.load.law.breakaway_nm, lane, p.free_nm * p.free_breakaway_ratio);
    set(m.load.law.coulomb_nm, lane, p.free_nm);
    set(m.load.law.viscous, lane, p.free_viscous);
    set(m.load.law.breakaway_rad_s, lane, p.free_breakaway_rad_s);
    set(m.load.law.threshold_rad_s, lane, p.free_threshold_rad_s);
    set(m.load.law.decay_s_per_rad, lane, p.free_decay_s_per_rad);
    set(m.load.exponential, lane, p.free_exponential);
    set(m.sensors.current_lag_rate, lane, p.current_lag_s > 0.0 ? 1.0 / p.current_lag_s : 0.0);
    set(m.sensors.speed_lag_rate, lane, p.speed_lag_s > 0.0 ? 1.0 / p.speed_lag_s : 0.0);
    set(m.sensors.hall_amplitude, lane, p.hall_amplitude_rad);
    set(m.sensors.hall_phase, lane, p.hall_phase_rad);
}

// Errors are measured against the stall current and the free speed at the largest voltage of the
// run, or, with the current as input, against the speed gained in one row at the largest current.
template <class V>
static void set_scales(Drivetrain<V> &m, int lane, const Parameters &p, double command_peak,
                       double mean_interval_s) {
    const double k = std::fabs(p.motor_torque_constant * (1.0 + p.torque_constant_relative));
    const double volts =
        std::max(m.input == InputKind::DUTY ? p.supply_voltage_v : command_peak, 1e-3);
    const double amperes = m.input == InputKind::CURRENT
                               ? std::max(command_peak, 1e-6)
                               : volts / std::max(get(m.motor.resistance_ohm, lane), 1e-3);
    const double gained = k * amperes * get(m.gear.inertia_inverse, lane) * mean_interval_s;
    const double free =
        m.input == InputKind::CURRENT ? gained : std::min(volts / std::max(k, 1e-9), 1e3 * gained);
    set(m.current_scale, lane, amperes);
    set(m.speed_scale, lane, std::max(free, 1e-12));
    set(m.torque_scale, lane, std::max(k * amperes, 1e-12));
}

template <class V>
void drivetrain_set_lane(Drivetrain<V> &m, int lane, const Parameters &p, double command_peak,
                         double mean_interval_s) {
    set_electrical(m, lane, p);
    set_friction(m.friction, lane, p);
    set_gear(m, lane, p);
    set_load_and_sensors(m, lane, p);
    set_scales(m, lane, p, command_peak, mean_interval_s);
}

template void drivetrain_set_lane<double>(Drivetrain<double> &, int, const Parameters &, double,
                                          double);
template void drivetrain_set_lane<Lanes8>(Drivetrain<Lanes8> &, int, const Parameters &, double,
                                          double);

}  // namespace vgroove
