// The flat parameter vector of the plant: rig keys, then the parameters of the effects, each a
// double named as the gap contract names it.
#ifndef VGROOVE_PLANT_COMPONENTS_PARAMETERS_HPP
#define VGROOVE_PLANT_COMPONENTS_PARAMETERS_HPP

#include <limits>

namespace vgroove {

constexpr double OFF_AT_INFINITY = std::numeric_limits<double>::infinity();

// X(member, name, default). SI units; the defaults are the neutral values: every effect off.
// clang-format off
#define VGROOVE_PLANT_PARAMETERS(X) \
    X(supply_voltage_v,            "supply.voltage_v", 0.0) \
    X(supply_resistance_ohm,       "supply.resistance_ohm", 0.0) \
    X(bridge_pwm_hz,               "bridge.pwm_hz", 20000.0) \
    X(motor_resistance_ohm,        "motor.resistance_ohm", 0.0) \
    X(motor_inductance_h,          "motor.inductance_h", 0.0) \
    X(motor_torque_constant,       "motor.torque_constant_nm_per_a", 0.0) \
    X(motor_inertia_kg_m2,         "motor.inertia_kg_m2", 0.0) \
    X(motor_viscous,               "motor.viscous_nm_s_per_rad", 0.0) \
    X(motor_coulomb_nm,            "motor.coulomb_nm", 0.0) \
    X(gearbox_ratio,               "gearbox.ratio", 1.0) \
    X(gearbox_output_inertia,      "gearbox.output_inertia_kg_m2", 0.0) \
    X(load_mass_kg,                "load.mass_kg", 0.0) \
    X(load_length_m,               "load.length_m", 0.0) \
    X(load_zero_rad,               "load.zero_rad", 0.0) \
    X(hammer_inertia_kg_m2,        "mechanism.hammer_inertia_kg_m2", 0.0) \
    X(hammer_mass_kg,              "mechanism.hammer_mass_kg", 0.0) \
    X(groove_lead_m_per_rad,       "mechanism.groove_lead_m_per_rad", 0.0) \
    X(groove_radius_m,             "mechanism.groove_radius_m", 0.0) \
    X(hammer_groove_lead,          "mechanism.hammer_groove_lead_m_per_rad", 0.0) \
    X(hammer_groove_radius,        "mechanism.hammer_groove_radius_m", 0.0) \
    X(vertex_rad,                  "mechanism.vertex_rad", 0.05) \
    X(travel_rad,                  "mechanism.travel_rad", 0.0) \
    X(spring_preload_n,            "mechanism.spring_preload_n", 0.0) \
    X(spring_rate_n_per_m,         "mechanism.spring_rate_n_per_m", 0.0) \
    X(lug_count,                   "mechanism.lug_count", 2.0) \
    X(lug_height_m,                "mechanism.lug_height_m", 0.0) \
    X(lug_radius_m,                "mechanism.lug_radius_m", 0.0) \
    X(lug_overlap_rad,             "mechanism.lug_overlap_rad", 0.0) \
    X(contact_stiffness,           "mechanism.contact_stiffness_n_per_m", 0.0) \
    X(contact_damping,             "mechanism.contact_damping_n_s_per_m", 0.0) \
    X(contact_ramp_m,              "mechanism.contact_ramp_m", 1e-5) \
    X(contact_exponent,            "mechanism.contact_exponent", 1.0) \
    X(friction_static,             "mechanism.friction_static", 0.0) \
    X(friction_kinetic,            "mechanism.friction_kinetic", 0.0) \
    X(friction_speed_m_per_s,      "mechanism.friction_speed_m_per_s", 0.05) \
    X(anvil_inertia_kg_m2,         "mechanism.anvil_inertia_kg_m2", 0.0) \
    X(hammer_start_rad,            "mechanism.hammer_start_rad", -1.0) \
    X(arm_inertia_kg_m2,           "mechanism.arm_inertia_kg_m2", 4e-3) \
    X(arm_stiffness,               "mechanism.arm_stiffness_nm_per_rad", 25.0) \
    X(arm_damping,                 "mechanism.arm_damping_nm_s_per_rad", 0.25) \
    X(free_nm,                     "load.torque_nm", 0.0) \
    X(free_breakaway_ratio,        "load.breakaway_ratio", 1.2) \
    X(free_breakaway_rad_s,        "load.breakaway_rad_s", 0.1) \
    X(free_viscous,                "load.viscous_nm_s_per_rad", 0.0) \
    X(free_exponential,            "load.exponential", 0.0) \
    X(free_threshold_rad_s,        "load.threshold_rad_s", 0.01) \
    X(free_decay_s_per_rad,        "load.decay_s_per_rad", 10.0) \
    X(joint_stiffness,             "load.stiffness_nm_per_rad", 3000.0) \
    X(joint_damping,               "load.damping_nm_s_per_rad", 0.3) \
    X(joint_run_nm,                "load.run_torque_nm", 0.0) \
    X(joint_slope,                 "load.slip_slope_nm_per_rad", 0.0) \
    X(joint_loosen_ratio,          "load.loosen_ratio", 0.75) \
    X(screw_start_nm,              "load.start_nm", 0.0) \
    X(screw_end_nm,                "load.end_nm", 0.0) \
    X(screw_turns,                 "load.turns", 1.0) \
    X(screw_seat_nm,               "load.seat_nm", 0.0) \
    X(screw_seat_deg,              "load.seat_deg", 90.0) \
    X(screw_stripped_ratio,        "load.stripped_ratio", 0.35) \
    X(joint_from_turns,            "load.from_turns", 0.0) \
    X(disc_parallel,               "load.parallel", 1.0) \
    X(disc_series,                 "load.series", 1.0) \
    X(disc_outer_m,                "load.disc_outer_m", 40e-3) \
    X(disc_inner_m,                "load.disc_inner_m", 20.4e-3) \
    X(disc_thickness_m,            "load.disc_thickness_m", 1.5e-3) \
    X(disc_cone_m,                 "load.disc_cone_m", 1.15e-3) \
    X(bolt_friction,               "load.friction", 0.12) \
    X(bolt_pitch_m,                "load.bolt_pitch_m", 2e-3) \
    X(bolt_flank_m,                "load.bolt_flank_m", 14.701e-3) \
    X(bolt_head_m,                 "load.bolt_head_m", 20e-3) \
    X(added_supply_ohm,            "effects.supply_resistance.resistance_ohm", 0.0) \
    X(droop_volt_per_coulomb,      "effects.supply_droop.volt_per_coulomb", 0.0) \
    X(droop_polarisation_ohm,      "effects.supply_droop.polarisation_ohm", 0.0) \
    X(droop_polarisation_s,        "effects.supply_droop.polarisation_s", 1.0) \
    X(dead_time_s,                 "effects.dead_time.dead_time_s", 0.0) \
    X(dead_time_at_edges,          "effects.dead_time.at_edges", 0.0) \
    X(bridge_resistance_ohm,       "effects.bridge_resistance.resistance_ohm", 0.0) \
    X(winding_relative,            "effects.winding_resistance.relative", 0.0) \
    X(heating_kelvin_per_joule,    "effects.winding_heating.kelvin_per_joule", 0.0) \
    X(heating_cooling_s,           "effects.winding_heating.cooling_s", OFF_AT_INFINITY) \
    X(brush_voltage_v,             "effects.brush_drop.voltage_v", 0.0) \
    X(inductance_relative,         "effects.inductance.relative", 0.0) \
    X(torque_constant_relative,    "effects.torque_constant.relative", 0.0) \
    X(saturation_a,                "effects.magnetic_saturation.saturation_a", OFF_AT_INFINITY) \
    X(coulomb_nm,                  "effects.coulomb_friction.torque_nm", 0.0) \
    X(stribeck_breakaway_nm,       "effects.stribeck_friction.breakaway_nm", 0.0) \
    X(stribeck_speed_rad_s,        "effects.stribeck_friction.speed_rad_s", 1.0) \
    X(viscous,                     "effects.viscous_friction.nm_s_per_rad", 0.0) \
    X(quadratic_drag,              "effects.quadratic_drag.nm_s2_per_rad2", 0.0) \
    X(asymmetric_forward_nm,       "effects.asymmetric_friction.forward_nm", 0.0) \
    X(asymmetric_backward_nm,      "effects.asymmetric_friction.backward_nm", 0.0) \
    X(directional_viscous,         "effects.directional_viscous.nm_s_per_rad", 0.0) \
    X(cogging_nm,                  "effects.cogging_torque.torque_nm", 0.0) \
    X(cogging_periods,             "effects.cogging_torque.periods_per_rev", 1.0) \
    X(cogging_phase_rad,           "effects.cogging_torque.phase_rad", 0.0) \
    X(added_inertia_kg_m2,         "effects.added_inertia.kg_m2", 0.0) \
    X(grease_nm_s_per_rad,         "effects.cold_grease.nm_s_per_rad", 0.0) \
    X(grease_time_s,               "effects.cold_grease.time_s", 1.0) \
    X(load_friction_relative,      "effects.load_dependent_friction.relative", 0.0) \
    X(eccentricity_nm,             "effects.gear_eccentricity.torque_nm", 0.0) \
    X(eccentricity_phase_rad,      "effects.gear_eccentricity.phase_rad", 0.0) \
    X(coupler_stiffness,           "effects.coupler_compliance.stiffness_nm_per_rad", OFF_AT_INFINITY) \
    X(coupler_damping_ratio,       "effects.coupler_compliance.damping_ratio", 0.0) \
    X(coupler_inertia_kg_m2,       "effects.coupler_compliance.inertia_kg_m2", 0.0) \
    X(backlash_play_rad,           "effects.gear_backlash.play_rad", 0.0) \
    X(groove_friction,             "effects.groove_friction.coefficient", 0.0) \
    X(spring_rate_relative,        "effects.spring_rate.relative", 0.0) \
    X(spring_preload_relative,     "effects.spring_preload.relative", 0.0) \
    X(impact_damping_relative,     "effects.impact_damping.relative", 0.0) \
    X(lug_wear_m,                  "effects.lug_wear.height_m", 0.0) \
    X(joint_stiffness_relative,    "effects.joint_stiffness.relative", 0.0) \
    X(thread_friction_relative,    "effects.thread_friction.relative", 0.0) \
    X(joint_hysteresis_relative,   "effects.joint_hysteresis.relative", 0.0) \
    X(knot_nm,                     "effects.wood_knot.torque_nm", 0.0) \
    X(knot_from_rad,               "effects.wood_knot.from_rad", 0.0) \
    X(knot_to_rad,                 "effects.wood_knot.to_rad", 0.0) \
    X(current_lag_s,               "effects.current_lag.time_constant_s", 0.0) \
    X(current_gain_relative,       "effects.current_gain.relative", 0.0) \
    X(current_offset_a,            "effects.current_offset.offset_a", 0.0) \
    X(current_limit_a,             "effects.current_saturation.limit_a", OFF_AT_INFINITY) \
    X(speed_gain_relative,         "effects.speed_gain.relative", 0.0) \
    X(speed_lag_s,                 "effects.speed_lag.time_constant_s", 0.0) \
    X(speed_lag_delay_form,        "effects.speed_lag.delay_form", 0.0) \
    X(hall_amplitude_rad,          "effects.hall_eccentricity.amplitude_rad", 0.0) \
    X(hall_phase_rad,              "effects.hall_eccentricity.phase_rad", 0.0) \
    X(hall_dropout_probability,    "effects.hall_dropout.probability", 0.0) \
    X(supply_gain_relative,        "effects.supply_gain.relative", 0.0) \
    X(transport_delay_s,           "effects.transport_delay.delay_s", 0.0) \
    X(clock_skew_relative,         "effects.clock_skew.relative", 0.0) \
    X(clock_skew_command,          "effects.clock_skew.command_clock", 0.0)
// clang-format on

struct Parameters {
#define VGROOVE_PLANT_MEMBER(member, name, value) double member = value;
    VGROOVE_PLANT_PARAMETERS(VGROOVE_PLANT_MEMBER)
#undef VGROOVE_PLANT_MEMBER
};

#define VGROOVE_PLANT_COUNT(member, name, value) +1
constexpr int PARAMETER_COUNT = 0 VGROOVE_PLANT_PARAMETERS(VGROOVE_PLANT_COUNT);
#undef VGROOVE_PLANT_COUNT
static_assert(sizeof(Parameters) == PARAMETER_COUNT * sizeof(double),
              "the parameters are a flat vector of doubles");

extern const char *const PARAMETER_NAMES[PARAMETER_COUNT];

Parameters parameters_from(const double *theta);

// Throws std::invalid_argument naming the parameter that is outside its physical range.
void check_parameters(const Parameters &p, bool electrical);

}  // namespace vgroove

#endif
