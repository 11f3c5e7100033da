// The flat parameter vector of the plant: rig keys, then the parameters of the effects, each a double named as the gap contract names it.
#ifndef VGROOVE_PLANT_PARAMETERS_HPP
#define VGROOVE_PLANT_PARAMETERS_HPP

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
    X(added_supply_ohm,            "effects.supply_resistance.resistance_ohm", 0.0) \
    X(droop_volt_per_coulomb,      "effects.supply_droop.volt_per_coulomb", 0.0) \
    X(droop_polarisation_ohm,      "effects.supply_droop.polarisation_ohm", 0.0) \
    X(droop_polarisation_s,        "effects.supply_droop.polarisation_s", 1.0) \
    X(dead_time_s,                 "effects.dead_time.dead_time_s", 0.0) \
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
static_assert(sizeof(Parameters) == PARAMETER_COUNT * sizeof(double), "the parameters are a flat vector of doubles");

extern const char *const PARAMETER_NAMES[PARAMETER_COUNT];

Parameters parameters_from(const double *theta);

// Throws std::invalid_argument naming the parameter that is outside its physical range.
void check_parameters(const Parameters &p, bool electrical);

}  // namespace vgroove

#endif
