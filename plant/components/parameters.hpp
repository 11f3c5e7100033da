// The flat parameter vector of the plant: rig keys, then the parameters of the effects, each a
// double with the name that docs/spec/gap.md, sections 2 and 3, gives it.
#ifndef VGROOVE_PLANT_COMPONENTS_PARAMETERS_HPP
#define VGROOVE_PLANT_COMPONENTS_PARAMETERS_HPP

#include <iterator>

#include "effect_parameters.hpp"  // generated: plant/generate_effects.py

namespace vgroove {

// Keys of the rig but for loads and effects: X(member, name, default), SI units
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
    X(arm_damping,                 "mechanism.arm_damping_nm_s_per_rad", 0.25)
// clang-format on

// In the order of the flat vector: rig keys, loads, effects
struct Parameters {
#define VGROOVE_PLANT_MEMBER(member, name, value) double member = value;
    VGROOVE_PLANT_PARAMETERS(VGROOVE_PLANT_MEMBER)
#undef VGROOVE_PLANT_MEMBER
    LoadParameters load;
    EffectParameters effects;
};

#define VGROOVE_PLANT_COUNT(member, name, value) +1
constexpr int RIG_KEY_COUNT = 0 VGROOVE_PLANT_PARAMETERS(VGROOVE_PLANT_COUNT);
#undef VGROOVE_PLANT_COUNT
constexpr int PARAMETER_COUNT = RIG_KEY_COUNT + static_cast<int>(std::size(LOAD_AND_EFFECT_NAMES));
static_assert(sizeof(Parameters) == PARAMETER_COUNT * sizeof(double),
              "the parameters are a flat vector of doubles");

// Name of the n-th parameter of the flat vector
const char *parameter_name(int n);

Parameters parameters_from(const double *theta);

// Throws std::invalid_argument, which names the parameter that is outside its physical range.
// electrical: whether winding and bridge are simulated; else their parameters are not checked.
void require_parameter(bool holds, const char *message);
void check_parameters(const Parameters &p, bool electrical);

}  // namespace vgroove

#endif
