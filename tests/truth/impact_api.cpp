// The C functions through which Python runs the impact tool, for logs and in lock-step.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>

#include "curve.hpp"
#include "fields.hpp"
#include "impact.hpp"

using truth::Blow;
using truth::Curve;
using truth::Drive;
using truth::ImpactParams;
using truth::ImpactTool;

namespace truth {
namespace {

#define FIELD(member)                                                                              \
    { #member, &ImpactParams::member }

const Field<ImpactParams> FIELDS[] = {
    FIELD(voltage_v),
    FIELD(supply_resistance_ohm),
    FIELD(pwm_hz),
    FIELD(droop_volt_per_coulomb),
    FIELD(polarisation_ohm),
    FIELD(polarisation_s),
    FIELD(polarisation2_ohm),
    FIELD(polarisation2_s),
    FIELD(dead_time_s),
    FIELD(bridge_resistance_ohm),
    FIELD(transport_delay_s),
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
    FIELD(directional_viscous_nm_s),
    FIELD(cogging_nm),
    FIELD(cogging_per_rev),
    FIELD(cogging_phase_rad),
    FIELD(cogging_second),
    FIELD(grease_nm_s),
    FIELD(grease_s),
    FIELD(ratio),
    FIELD(output_inertia_kg_m2),
    FIELD(load_friction),
    FIELD(load_friction_power),
    FIELD(load_reference_nm),
    FIELD(eccentricity_nm),
    FIELD(eccentricity_phase_rad),
    FIELD(hammer_inertia_kg_m2),
    FIELD(hammer_mass_kg),
    FIELD(groove_lead_m_per_rad),
    FIELD(groove_radius_m),
    FIELD(vertex_rad),
    FIELD(travel_rad),
    FIELD(spring_preload_n),
    FIELD(spring_rate_n_per_m),
    FIELD(lug_count),
    FIELD(lug_height_m),
    FIELD(lug_radius_m),
    FIELD(lug_overlap_rad),
    FIELD(contact_stiffness_n_per_m),
    FIELD(contact_damping_n_s_per_m),
    FIELD(contact_ramp_m),
    FIELD(anvil_inertia_kg_m2),
    FIELD(groove_friction),
    FIELD(groove_knee_rad_s),
    FIELD(joint_nm_per_rad),
    FIELD(joint_nm_s_per_rad),
    FIELD(coupler_nm_per_rad),
    FIELD(coupler_nm_s_per_rad),
    FIELD(coupler_inertia_kg_m2),
    FIELD(current_lag_s),
    FIELD(current_gain),
    FIELD(current_offset_a),
    FIELD(current_limit_a),
    FIELD(supply_gain),
    FIELD(hall_edges),
    FIELD(hall_offset_rad),
    FIELD(hall_jitter_s),
    FIELD(hall_eccentricity_rad),
    FIELD(hall_eccentricity_phase_rad),
    FIELD(hall_dropout),
    FIELD(current_noise_a),
    FIELD(supply_noise_v),
    FIELD(gate_on_s),
    FIELD(gate_off_s),
    FIELD(u_brush_ohm),
    FIELD(u_contact_ohm),
    FIELD(u_flux_loss),
    FIELD(u_load_nm),
    FIELD(u_groove_dent_m),
    FIELD(u_dent_at_rad),
    FIELD(u_dent_width_rad),
    FIELD(u_lug_offset_rad),
    FIELD(u_lug_height_m),
    FIELD(u_coil_bind_n_per_m),
    FIELD(u_coil_bind_at_m),
    FIELD(u_housing_drag_nm),
    FIELD(u_drag_from_m),
    FIELD(u_drag_width_m),
    FIELD(u_arm_inertia_kg_m2),
    FIELD(u_arm_nm_per_rad),
    FIELD(u_arm_nm_s_per_rad),
    FIELD(u_bit_play_rad),
    FIELD(u_heat_per_joule),
    FIELD(u_heat_s),
    FIELD(u_wander_nm),
    FIELD(u_wander_s),
    FIELD(extra_ohm),
    FIELD(extra_ohm_power),
    FIELD(extra_source_ohm),
    FIELD(source_power),
    FIELD(reference_a),
    FIELD(power_coulomb_nm),
    FIELD(coulomb_power),
    FIELD(extra_viscous_nm_s),
    FIELD(viscous_power),
    FIELD(reference_rad_s),
    FIELD(groove_static),
    FIELD(spring_square_n_per_m2),
    FIELD(extra_damping_n_s_per_m2),
    FIELD(joint_cubic_per_rad2),
    FIELD(current_lag2_s),
    FIELD(current_gain_bend),
    FIELD(hammer_start_rad),
    FIELD(tolerance),
    FIELD(step_s),
    FIELD(seed),
};

}  // namespace

double *find_impact_param(ImpactParams &params, const char *name) {
    return find_field(FIELDS, params, name);
}

}  // namespace truth

namespace {

struct RowOut {
    double current_a, supply_v, speed_rad_s, angle_rad, winding_kelvin;
    double anvil_torque_nm, anvil_angle_rad, hammer_m;
};

void close_row(ImpactTool &tool, double length, RowOut &row) {
    row = {tool.state[truth::SENSED_CHARGE] / length,
           tool.state[truth::BUS] / length,
           tool.motor_speed(),
           tool.motor_angle(),
           tool.slow.winding_kelvin,
           tool.joint_torque(),
           tool.state[truth::ANVIL],
           tool.travel_m()};
    tool.state[truth::SENSED_CHARGE] = 0.0;
    tool.state[truth::BUS] = 0.0;
}

}  // namespace

extern "C" {

struct TruthImpactRun {
    const double *time_s, *duty, *coast;
    int count;
    const double *forward_nm, *backward_nm;
    int slip_count;
    double slip_first_rad, slip_step_rad;
};

ImpactTool *truth_impact_new(void) {
    return new ImpactTool();
}

void truth_impact_free(ImpactTool *tool) {
    delete tool;
}

int truth_impact_set(ImpactTool *tool, const char *name, double value) {
    return truth::set_member(truth::find_impact_param(tool->params, name), value);
}

double truth_impact_get(ImpactTool *tool, const char *name) {
    return truth::member_value(truth::find_impact_param(tool->params, name));
}

// Rows end at row_s[0..rows-1]; the first begins at 0. Returns the number of edges; -1 where the
// integration diverged. The slip torques belong to the caller and must outlive the tool's runs.
int truth_impact_run(ImpactTool *tool, const TruthImpactRun *run, const double *row_s, int rows,
                     double *out) {
    tool->slip = {run->forward_nm, run->backward_nm, run->slip_count, run->slip_first_rad,
                  run->slip_step_rad};
    tool->start();
    const double late = tool->params.transport_delay_s;
    Curve before(run->time_s, run->duty, run->count), after(run->time_s, run->duty, run->count),
        coast(run->time_s, run->coast, run->count);
    auto *row_out = reinterpret_cast<RowOut *>(out);
    double begin = 0.0;
    int point = 0;
    for (int row = 0; row < rows; ++row) {
        const double row_begin = begin;
        while (begin < row_s[row]) {  // up to the next point of the command
            while (point < run->count && run->time_s[point] + late <= begin + 1e-12) {
                ++point;
            }
            const double next =
                point < run->count ? std::min(run->time_s[point] + late, row_s[row]) : row_s[row];
            const double middle = 0.5 * (begin + next) - late;
            const double from = before.at(std::max(begin - late + 1e-10, 0.0));
            const double mean = after.at(std::max(middle, 0.0));
            const double level = middle >= 0.0 ? mean : 0.0;
            const double slope = middle >= 0.0 ? mean - from : 0.0;
            tool->advance(next, level - slope, level + slope, coast.held(middle) > 0.5);
            begin = next;
        }
        close_row(*tool, row_s[row] - row_begin, row_out[row]);
    }
    return std::isfinite(tool->motor_angle()) && std::abs(tool->motor_speed()) < 1e5
               ? static_cast<int>(tool->edges.size())
               : -1;
}

// Begins a lock-step at rest.
void truth_impact_begin(ImpactTool *tool, const TruthImpactRun *run) {
    tool->slip = {run->forward_nm, run->backward_nm, run->slip_count, run->slip_first_rad,
                  run->slip_step_rad};
    tool->start();
}

struct TruthImpactPeriod {
    double current_a, supply_v;
    std::int32_t edge_count;
    std::int32_t edge_cycle[8];
};

// One lock-step period of 510 cycles of 16 MHz; `dead` is the loss of duty by dead time, as in the
// board's message.
void truth_impact_period(ImpactTool *tool, int coast, double duty, double dead,
                         TruthImpactPeriod *out) {
    constexpr double PERIOD_S = 510.0 / 16e6;
    const auto late =
        static_cast<std::size_t>(std::llround(tool->params.transport_delay_s / PERIOD_S));
    tool->commands.push_back({coast != 0, duty, dead, 0.0});  // dead as a share of the voltage
    Drive drive;
    drive.coast = true;
    if (tool->commands.size() > late) {
        drive = tool->commands.front();
        tool->commands.pop_front();
    }
    const double begin = tool->time_s;
    tool->edges.clear();
    tool->dead_share = drive.dead_s;
    tool->advance(begin + PERIOD_S, drive.duty, drive.duty, drive.coast);
    out->current_a = tool->sensed_current() + tool->params.current_noise_a * tool->random.normal();
    out->supply_v =
        tool->state[truth::BUS] / PERIOD_S + tool->params.supply_noise_v * tool->random.normal();
    tool->state[truth::BUS] = 0.0;
    out->edge_count = static_cast<std::int32_t>(std::min<std::size_t>(tool->edges.size(), 8));
    for (std::int32_t n = 0; n < out->edge_count; ++n) {
        const double cycle =
            std::floor((tool->edges[static_cast<std::size_t>(n)].time_s - begin) * 16e6);
        out->edge_cycle[n] = static_cast<std::int32_t>(std::clamp(cycle, 0.0, 509.0));
    }
}

void truth_impact_edges(const ImpactTool *tool, double *time_s, double *direction) {
    for (std::size_t n = 0; n < tool->edges.size(); ++n) {
        time_s[n] = tool->edges[n].time_s;
        direction[n] = tool->edges[n].direction;
    }
}

// Copies at most `most` blows of six values each; returns how many there are.
int truth_impact_blows(const ImpactTool *tool, double *out, int most) {
    const int count = std::min(static_cast<int>(tool->blows.size()), most);
    std::memcpy(out, tool->blows.data(), sizeof(Blow) * static_cast<std::size_t>(count));
    return static_cast<int>(tool->blows.size());
}

// States and energies for the tests, in the order of INSIDE in impact_tool.py.
void truth_impact_inside(const ImpactTool *tool, double *out) {
    const double values[8] = {tool->time_s,
                              tool->motor_speed(),
                              tool->stored_energy(),
                              tool->state[truth::INPUT_J],
                              tool->state[truth::LOST_J],
                              static_cast<double>(tool->steps),
                              tool->state[truth::TWIST],
                              tool->travel_m()};
    std::memcpy(out, values, sizeof values);
}

}  // extern "C"
