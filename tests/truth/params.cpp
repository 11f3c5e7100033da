// Names of the parameters of a generated tool for Python.
#include "params.hpp"

#include <cstring>

namespace truth {
namespace {

struct Field {
    const char *name;
    double Params::*member;
};

#define FIELD(member)                                                                              \
    { #member, &Params::member }

const Field FIELDS[] = {
    FIELD(voltage_v),
    FIELD(supply_resistance_ohm),
    FIELD(bus_filter_s),
    FIELD(droop_volt_per_coulomb),
    FIELD(polarisation_ohm),
    FIELD(polarisation_s),
    FIELD(pwm_hz),
    FIELD(dead_time_s),
    FIELD(bridge_resistance_ohm),
    FIELD(duty_levels),
    FIELD(resistance_ohm),
    FIELD(inductance_h),
    FIELD(torque_constant_nm_per_a),
    FIELD(brush_drop_v),
    FIELD(brush_knee_a),
    FIELD(saturation_a),
    FIELD(heating_kelvin_per_joule),
    FIELD(heating_cooling_s),
    FIELD(heating_housing_share),
    FIELD(inertia_kg_m2),
    FIELD(viscous_nm_s_per_rad),
    FIELD(coulomb_nm),
    FIELD(breakaway_nm),
    FIELD(stribeck_rad_s),
    FIELD(quadratic_nm_s2),
    FIELD(forward_nm),
    FIELD(backward_nm),
    FIELD(directional_viscous_nm_s),
    FIELD(cogging_nm),
    FIELD(cogging_per_rev),
    FIELD(cogging_phase_rad),
    FIELD(grease_nm_s),
    FIELD(grease_s),
    FIELD(bristle_rad),
    FIELD(bristle_damping),
    FIELD(load_reference_nm),
    FIELD(ratio),
    FIELD(output_inertia_kg_m2),
    FIELD(load_friction),
    FIELD(eccentricity_nm),
    FIELD(eccentricity_phase_rad),
    FIELD(coupler_nm_per_rad),
    FIELD(coupler_damping_ratio),
    FIELD(coupler_inertia_kg_m2),
    FIELD(play_rad),
    FIELD(pendulum_mass_kg),
    FIELD(pendulum_length_m),
    FIELD(pendulum_zero_rad),
    FIELD(current_lag_s),
    FIELD(current_gain),
    FIELD(current_offset_a),
    FIELD(current_limit_a),
    FIELD(supply_gain),
    FIELD(hall_edges),
    FIELD(hall_offset_rad),
    FIELD(hall_spacing_rad),
    FIELD(hall_hysteresis_rad),
    FIELD(hall_eccentricity_rad),
    FIELD(hall_eccentricity_phase_rad),
    FIELD(hall_dropout),
    FIELD(hall_jitter_s),
    FIELD(current_noise_a),
    FIELD(supply_noise_v),
    FIELD(transport_delay_s),
    FIELD(gate_on_s),
    FIELD(gate_off_s),
    FIELD(u_load_nm),
    FIELD(u_brush_ohm),
    FIELD(u_contact_ohm),
    FIELD(u_glitch),
    FIELD(u_tight_nm),
    FIELD(u_tight_every_rad),
    FIELD(u_tight_width_rad),
    FIELD(u_tight_at_rad),
    FIELD(u_wander_nm),
    FIELD(u_wander_s),
    FIELD(u_flux_loss),
    FIELD(u_torque_hum_nm),
    FIELD(u_torque_hz),
    FIELD(u_hum_a),
    FIELD(u_hum_hz),
    FIELD(u_ripple_nm),
    FIELD(u_ripple_per_rev),
    FIELD(u_ripple_wander),
    FIELD(u_supply_square_ohm_per_a),
    FIELD(polarisation2_ohm),
    FIELD(polarisation2_s),
    FIELD(extra_source_ohm),
    FIELD(source_power),
    FIELD(extra_ohm),
    FIELD(extra_ohm_power),
    FIELD(extra_inductance_h),
    FIELD(inductance_knee_a),
    FIELD(dead_knee_a),
    FIELD(reference_a),
    FIELD(power_coulomb_nm),
    FIELD(coulomb_power),
    FIELD(extra_viscous_nm_s),
    FIELD(viscous_power),
    FIELD(reference_rad_s),
    FIELD(stribeck_power),
    FIELD(quadratic_power),
    FIELD(directional_power),
    FIELD(load_friction_power),
    FIELD(cogging_second),
    FIELD(cogging_third),
    FIELD(eccentricity_second),
    FIELD(hall_second),
    FIELD(grease_tail),
    FIELD(grease_tail_s),
    FIELD(coupler_cubic_per_rad2),
    FIELD(current_lag2_s),
    FIELD(current_gain_bend),
    FIELD(current_limit_power),
    FIELD(hall_burst),
    FIELD(transport_jitter_s),
    FIELD(transport_hold_s),
    FIELD(current_source_a),
    FIELD(step_s),
    FIELD(seed),
};

}  // namespace

double *find_param(Params &params, const char *name) {
    for (const Field &field : FIELDS) {
        if (std::strcmp(field.name, name) == 0) {
            return &(params.*field.member);
        }
    }
    return nullptr;
}

}  // namespace truth
