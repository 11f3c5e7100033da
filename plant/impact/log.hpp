// simulate_impact: the impact tool driven by the rows of a log, for many parameter sets at once,
// with its blows.
#ifndef VGROOVE_PLANT_IMPACT_LOG_HPP
#define VGROOVE_PLANT_IMPACT_LOG_HPP

#include "drivetrain/log_input.hpp"
#include "impact/solver.hpp"

namespace vgroove {

enum class ImpactAccuracy { REFERENCE, FAST, FIXED };

constexpr double IMPACT_STEP_FIXED_S = 35e-6;  // default
// After a change of command or load the next one is assumed to come no earlier than this: a step
// may reach so far beyond the present instant.
constexpr double CHANGE_INTERVAL_S = 1e-3;
// Local error over the scales of current, speeds and angles
constexpr double IMPACT_TOLERANCE_REFERENCE = 1e-10, IMPACT_TOLERANCE_FAST = 7e-5;
constexpr double IMPACT_STEP_LEAST_S = 1e-7, IMPACT_STEP_MOST_S = 0.1;

// Columns of batch x log rows. Current, bus and housing are means over the row, the others values
// at its end; in the first row all are values of the instant.
enum ImpactColumn {
    IMPACT_CURRENT,
    IMPACT_SUPPLY,
    IMPACT_SPEED,
    IMPACT_SPEED_MEASURED,
    IMPACT_ANGLE,
    IMPACT_ANGLE_MEASURED,
    IMPACT_ANVIL_TORQUE,
    IMPACT_ANVIL_ANGLE,
    IMPACT_HEAD,
    IMPACT_HAMMER,
    IMPACT_HAMMER_ANGLE,
    IMPACT_HOUSING,
    IMPACT_ARM,
    IMPACT_COLUMN_COUNT,
};
extern const char *const IMPACT_COLUMN_NAMES[IMPACT_COLUMN_COUNT];

// Quantities of a trace at times of the caller's choice
enum ImpactTraceColumn {
    TRACE_CURRENT,
    TRACE_SPEED,
    TRACE_HAMMER,
    TRACE_HAMMER_RATE,
    TRACE_HAMMER_ANGLE,
    TRACE_HAMMER_SPEED,
    TRACE_RELATIVE,
    TRACE_ANVIL_ANGLE,
    TRACE_ANVIL_SPEED,
    TRACE_TWIST,
    TRACE_HEAD,
    TRACE_ANVIL_TORQUE,
    TRACE_LUG_TORQUE,
    TRACE_HOUSING,
    TRACE_HOUSING_MOMENTUM,
    TRACE_ARM,
    TRACE_COLUMN_COUNT,
};
extern const char *const TRACE_COLUMN_NAMES[TRACE_COLUMN_COUNT];

// Energies of a run since its start, J, at each log row; reference accuracy only. work_in = losses
// + change of stored.
enum ImpactEnergy {
    ENERGY_WORK_IN,
    ENERGY_ELECTRIC,
    ENERGY_FRICTION,
    ENERGY_GROOVE,
    ENERGY_CONTACT,
    ENERGY_JOINT,
    ENERGY_STORED,
    ENERGY_COUNT
};
extern const char *const IMPACT_ENERGY_NAMES[ENERGY_COUNT];

struct ImpactOutput {
    double *columns[IMPACT_COLUMN_COUNT];  // each batch x rows
    std::vector<std::vector<Blow>> blows;  // one list per batch row
    std::vector<ImpactStats> stats;
    std::vector<double> trace_s;  // times of the trace, increasing; empty: none
    std::vector<double> trace;    // times x TRACE_COLUMN_COUNT, first batch row only
    bool keep_history = false;
    std::vector<StepRecord> history;  // first batch row only
    bool keep_energy = false;
    std::vector<double> energy;            // rows x ENERGY_COUNT, first batch row only
    double tolerance = 0.0;                // 0: IMPACT_TOLERANCE_REFERENCE or _FAST
    double fixed_s = IMPACT_STEP_FIXED_S;  // step of accuracy FIXED
    Cancellation *cancellation = nullptr;
};

// theta: batch x PARAMETER_COUNT. The tool starts at rest, the hammer's lug at hammer_start_rad
// from the anvil's. Throws as simulate_log does.
void simulate_impact(const LogInput &in, const double *theta, std::size_t batch,
                     ImpactAccuracy accuracy, int threads, ImpactOutput &out);

// Returns step_s if it is a possible step of accuracy FIXED, else throws std::invalid_argument.
double impact_check_step(double step_s);

// Sets the tool at rest.
template <class L> void impact_start(ImpactSolver<L> &s) {
    s.state = ImpactState<L>{};
    s.mode = ImpactMode{};
    s.mode.axial_sign = 1.0;
    s.mode.segment = joint_segment_at(s.model.joint, 0.0);
    impact_enter_gap(s.model, s.mode, s.model.start_rad);
    if (s.model.two_bodies)
        s.state.x[STATE_TWIST] = 0.0;
    s.allowed_s = IMPACT_FIRST_CONTACT_S;
    s.series_s = IMPACT_NO_HORIZON_S;
    s.slope_stale = true;
    s.pending = false;
    s.elapsed_s = 0.0;
    s.weights = FlightWeights{};
    s.recorder = BlowRecorder{};
    s.stats = ImpactStats{};
    s.dropped_j = 0.0;
    s.check_in = IMPACT_CHECK_STEPS;
    s.step_budget = IMPACT_STEPS_SAVED;
    s.checked_s = 0.0;
}

// Command and load of a stretch
struct ImpactDrive {
    double command, command_rate, open, dead, bus_v, load_nm, load_rate;
};

// Whether the next stretch continues the lines of command and load
template <class L>
VGROOVE_INLINE bool impact_drive_unchanged(const ImpactSolver<L> &s, const ImpactDrive &next) {
    const Drive<double> &d = s.drive;
    return d.command_rate == next.command_rate && d.open == next.open && d.dead == next.dead &&
           d.bus_v == next.bus_v && d.load_rate == next.load_rate &&
           std::fabs(d.command + d.command_rate * s.elapsed_s - next.command) <= 1e-12 &&
           std::fabs(d.load_nm + d.load_rate * s.elapsed_s - next.load_nm) <= 1e-12;
}

// Runs through a stretch. Where command or load change, the pending step is truncated and the modes
// of the bridge follow. Another change is then expected at the stretch's end, but not within
// CHANGE_INTERVAL_S.
template <class L>
VGROOVE_INLINE void impact_stretch(ImpactSolver<L> &s, const ImpactDrive &next, double now_s,
                                   double length_s) {
    s.horizon_s = IMPACT_NO_HORIZON_S;
    if (!impact_drive_unchanged(s, next)) {
        impact_truncate(s);
        s.horizon_s = max_of(length_s, CHANGE_INTERVAL_S);
        s.drive = {next.command, next.command_rate, next.load_nm, next.load_rate,
                   next.bus_v,   next.open,         next.dead,    now_s};
        s.slope_stale = true;
        s.mode.ringing = s.mode.ringing && !s.model.joint.of_load;
        if (!(s.drive.open > 0.0))
            s.mode.drive.diode = 0.0;
        else if (s.mode.drive.diode == 0.0)
            s.mode.drive.diode = sign_of(s.state.x[STATE_CURRENT]);
    }
    impact_run(s, length_s);
}

}  // namespace vgroove

#endif
