// Parameters of a generated tool, SI units; Python sets them by these names.
#pragma once

namespace truth {

struct Params {
    // supply
    double voltage_v = 18.0, supply_resistance_ohm = 0.0, bus_filter_s = 2e-4;
    double droop_volt_per_coulomb = 0.0, polarisation_ohm = 0.0, polarisation_s = 1.0;
    // bridge
    double pwm_hz = 20000.0, dead_time_s = 0.0, bridge_resistance_ohm = 0.0, duty_levels = 255.0;
    // motor, electrical
    double resistance_ohm = 0.19, inductance_h = 1e-4, torque_constant_nm_per_a = 0.0109;
    double brush_drop_v = 0.0, brush_knee_a = 0.25, saturation_a = 0.0;
    double heating_kelvin_per_joule = 0.0, heating_cooling_s = 20.0, heating_housing_share = 0.15;
    // motor, mechanical
    double inertia_kg_m2 = 1.6e-5, viscous_nm_s_per_rad = 4.5e-6, coulomb_nm = 0.012;
    double breakaway_nm = 0.0, stribeck_rad_s = 20.0, quadratic_nm_s2 = 0.0;
    double forward_nm = 0.0, backward_nm = 0.0, directional_viscous_nm_s = 0.0;
    double cogging_nm = 0.0, cogging_per_rev = 12.0, cogging_phase_rad = 0.0;
    double grease_nm_s = 0.0, grease_s = 2.0;
    double bristle_rad = 0.0008, bristle_damping = 0.7, load_reference_nm = 0.02;
    // gear and output
    double ratio = 5.6, output_inertia_kg_m2 = 6e-5;
    double load_friction = 0.0, eccentricity_nm = 0.0, eccentricity_phase_rad = 0.0;
    double coupler_nm_per_rad = 0.0, coupler_damping_ratio = 0.1, coupler_inertia_kg_m2 = 0.0,
           play_rad = 0.0;
    double pendulum_mass_kg = 0.0, pendulum_length_m = 0.0, pendulum_zero_rad = 0.0;
    // sensors
    double current_lag_s = 0.0, current_gain = 0.0, current_offset_a = 0.0, current_limit_a = 0.0;
    double supply_gain = 0.0, hall_edges = 4.0, hall_offset_rad = 0.3, hall_spacing_rad = 0.0,
           hall_hysteresis_rad = 0.005;
    double hall_eccentricity_rad = 0.0, hall_eccentricity_phase_rad = 0.0, hall_dropout = 0.0,
           hall_jitter_s = 0.0;
    double current_noise_a = 0.0, supply_noise_v = 0.0;
    // timing
    double transport_delay_s = 0.0;
    // outside the catalogue; the gate switches intermittent effects on and off at random times
    double gate_on_s = 0.2, gate_off_s = 0.5;
    double u_load_nm = 0.0, u_brush_ohm = 0.0, u_contact_ohm = 0.0, u_glitch = 0.0;
    double u_tight_nm = 0.0, u_tight_every_rad = 6.283185307179586, u_tight_width_rad = 0.5,
           u_tight_at_rad = 2.0;
    double u_wander_nm = 0.0, u_wander_s = 1.3, u_flux_loss = 0.0;
    double u_torque_hum_nm = 0.0, u_torque_hz = 7.3, u_hum_a = 0.0, u_hum_hz = 50.0;
    double u_ripple_nm = 0.0, u_ripple_per_rev = 0.37, u_ripple_wander = 3.0;
    double u_supply_square_ohm_per_a = 0.0;
    // functional forms other than the catalogue's: powers over a reference, second stages, bends;
    // the defaults are neutral
    double polarisation2_ohm = 0.0, polarisation2_s = 1.0, extra_source_ohm = 0.0,
           source_power = 0.0;
    double extra_ohm = 0.0, extra_ohm_power = 0.0, extra_inductance_h = 0.0,
           inductance_knee_a = 0.0, dead_knee_a = 0.0, reference_a = 10.0;
    double power_coulomb_nm = 0.0, coulomb_power = 0.0, extra_viscous_nm_s = 0.0,
           viscous_power = 1.0, reference_rad_s = 500.0;
    double stribeck_power = 2.0, quadratic_power = 2.0, directional_power = 1.0,
           load_friction_power = 1.0;
    double cogging_second = 0.15, cogging_third = 0.0, eccentricity_second = 0.0, hall_second = 0.0;
    double grease_tail = 0.0, grease_tail_s = 10.0, coupler_cubic_per_rad2 = 0.0;
    double current_lag2_s = 0.0, current_gain_bend = 0.0, current_limit_power = 0.0,
           hall_burst = 0.0;
    double transport_jitter_s = 0.0, transport_hold_s = 2e-3;
    // above 0: the command is a current, duty times this
    double current_source_a = 0.0;
    // integration step, seed of the random numbers
    double step_s = 5e-6, seed = 1.0;
};

// Address of a parameter by its name, or nullptr.
double *find_param(Params &params, const char *name);

}  // namespace truth
