// The reference tool of physics.md section 4, drivetrain and mechanism, for tests in C++.
#ifndef VGROOVE_TESTS_REFERENCE_TOOL_HPP
#define VGROOVE_TESTS_REFERENCE_TOOL_HPP

#include "plant/components/parameters.hpp"

inline vgroove::Parameters reference_tool() {
    vgroove::Parameters p;
    p.supply_voltage_v = 18.5;
    p.supply_resistance_ohm = 0.10;
    p.bridge_pwm_hz = 31372.5;
    p.motor_resistance_ohm = 0.19;
    p.motor_inductance_h = 1e-4;
    p.motor_torque_constant = 0.0109;
    p.motor_inertia_kg_m2 = 1.6e-5;
    p.motor_viscous = 4.5e-6;
    p.motor_coulomb_nm = 0.012;
    p.gearbox_ratio = 5.6;
    p.gearbox_output_inertia = 6e-6;
    p.hammer_inertia_kg_m2 = 4.5e-5;
    p.hammer_mass_kg = 0.19;
    p.groove_lead_m_per_rad = 4.4e-3;
    p.groove_radius_m = 0.010;
    p.travel_rad = 2.8;
    p.spring_preload_n = 220.0;
    p.spring_rate_n_per_m = 29400.0;
    p.lug_height_m = 4.5e-3;
    p.lug_radius_m = 0.015;
    p.lug_overlap_rad = 1.0;
    p.contact_stiffness = 3e7;
    p.contact_damping = 2e3;
    p.anvil_inertia_kg_m2 = 1.2e-5;
    return p;
}

#endif
