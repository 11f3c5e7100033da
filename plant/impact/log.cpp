// Simulation of a log with the impact tool: rows as stretches with command and load as straight
// lines; columns, trace and energies from the solver's states.
#include "impact/log.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "impact/energy.hpp"
#include "impact/interpolant.hpp"
#include "numeric/thread_pool.hpp"

namespace vgroove {

const char *const IMPACT_COLUMN_NAMES[IMPACT_COLUMN_COUNT] = {
    "current_a", "supply_v",           "speed_rad_s",     "speed_measured_rad_s",
    "angle_rad", "angle_measured_rad", "anvil_torque_nm", "anvil_angle_rad",
    "head_rad",  "hammer_mm",          "hammer_rad",      "housing_nm",
    "arm_rad"};
const char *const TRACE_COLUMN_NAMES[TRACE_COLUMN_COUNT] = {
    "current_a",    "speed_rad_s",     "hammer_m",        "hammer_m_per_s", "hammer_rad",
    "hammer_rad_s", "relative_rad",    "anvil_angle_rad", "anvil_rad_s",    "twist_rad",
    "head_rad",     "anvil_torque_nm", "lug_torque_nm",   "housing_nm",     "housing_momentum_nm",
    "arm_rad"};
const char *const IMPACT_ENERGY_NAMES[ENERGY_COUNT] = {
    "work_in",      "loss_electric", "loss_friction", "loss_groove",
    "loss_contact", "loss_joint",    "stored"};

// One stretch of a row, in true time, with the command as a straight line
struct Stretch {
    double length_s, command, command_rate, open;
    bool switching;
};

// The command column in its own time: effects transport_delay and clock_skew (of the command's
// clock) shift it against the rows.
class CommandReader {
public:
    CommandReader(const LogInput &in, const Parameters &p)
        : in_(in),
          delay_s_(p.effects.transport_delay.delay_s) {
        const double skew = 1.0 + p.effects.clock_skew.relative;
        row_scale_ = p.effects.clock_skew.command_clock != 0.0 ? 1.0 : 1.0 / skew;
        command_scale_ = skew;
        shifted_ = delay_s_ > 0.0 || (p.effects.clock_skew.relative != 0.0 &&
                                      p.effects.clock_skew.command_clock != 0.0);
    }

    double row_scale() const { return row_scale_; }  // true seconds per second of the log
    double row_s(std::size_t row) const {
        return (in_.time_s[row] - in_.time_s[row - 1]) * row_scale_;
    }

    // Index of the last row until whose end the command at the bridge is zero; 0 for none.
    std::size_t last_row_without_command() const {
        const std::size_t last = in_.time_s.size() - 1;
        std::size_t zero = 0;
        while (zero < last && is_zero(zero) && is_zero(zero + 1))
            ++zero;
        if (!shifted_)
            return zero;
        std::size_t row = 0;
        while (row < last && command_time_s(row_end_s(row + 1)) <= in_.time_s[zero])
            ++row;
        return row;
    }

    double row_end_s(std::size_t row) const {  // since the first row
        return (in_.time_s[row] - in_.time_s[0]) * row_scale_;
    }

    // The stretch that begins now_s after the first row, with left_s to the end of the row.
    Stretch next(std::size_t row, double now_s, double left_s) {
        if (!shifted_)
            return of_row(row, 0.0, 1.0 / row_scale_, left_s);
        const double at = command_time_s(now_s);
        const std::size_t last = in_.time_s.size() - 1;
        while (row_ < last &&
               in_.time_s[row_] - at <= 1e-9 * (in_.time_s[row_ + 1] - in_.time_s[row_]))
            ++row_;
        const double until = (in_.time_s[row_] - at) / command_scale_;
        if (until <= 0.0) {
            Stretch s = of_row(row_, in_.time_s[row_] - in_.time_s[row_ > 0 ? row_ - 1 : 0],
                               command_scale_, left_s);
            s.command_rate = 0.0;
            return s;
        }
        return of_row(row_, row_ > 0 ? at - in_.time_s[row_ - 1] : 0.0, command_scale_,
                      std::min(until, left_s));
    }

private:
    bool is_zero(std::size_t row) const {
        return in_.command_start[row] == 0.0 && in_.command_end[row] == 0.0;
    }

    double command_time_s(double now_s) const {  // in the time of the column
        return in_.time_s[0] + (now_s - delay_s_) * command_scale_;
    }

    Stretch of_row(std::size_t row, double from, double scale, double length_s) const {
        const double start = in_.command_start[row], end = in_.command_end[row];
        const double rate =
            start != end ? (end - start) / (in_.time_s[row] - in_.time_s[row - 1]) : 0.0;
        const double open = in_.open.empty() ? 0.0 : in_.open[row];
        return {length_s, start == end ? end : start + rate * from, rate * scale, open,
                log_input_switches(start, end) && !(open > 0.0)};
    }

    const LogInput &in_;
    double delay_s_, row_scale_, command_scale_;
    bool shifted_;
    std::size_t row_ = 0;
};

template <class L>
static void write_trace(const ImpactSolver<L> &s, const ImpactState<L> &x, double tau, double *to) {
    ImpactState<L> ds{};
    const ImpactPoint at = impact_derivative<L>(s.model, s.drive, s.mode, tau, x, ds);
    double momentum = 0.0;
    if constexpr (L::AUDIT)
        momentum = impact_reaction_by_momentum(s.model, at, ds);
    const double values[TRACE_COLUMN_COUNT] = {at.i,
                                               at.motor_w,
                                               at.x,
                                               at.x_rate,
                                               x.x[L::HAMMER_ANGLE],
                                               x.x[L::HAMMER_SPEED],
                                               impact_relative<L>(s.model, x),
                                               x.x[L::ANVIL_ANGLE],
                                               x.x[L::ANVIL_SPEED],
                                               x.x[L::TWIST],
                                               at.head_rad,
                                               at.joint_nm,
                                               at.lug_nm,
                                               at.housing_nm,
                                               momentum,
                                               x.x[L::ARM_ANGLE]};
    std::copy(values, values + TRACE_COLUMN_COUNT, to);
}

// Writes the rows of the trace whose times lie in a step.
struct Tracer {
    ImpactOutput *out = nullptr;
    double origin_s = 0.0, scale = 1.0;  // of the log's time, and true seconds per second of it
    std::size_t next = 0;

    template <class L> void step(ImpactSolver<L> &s, double h, double share) {
        const double from = s.drive.time_s, to = from + h * share + 1e-12;  // rounding of times
        for (; next < out->trace_s.size(); ++next) {
            const double at = (out->trace_s[next] - origin_s) * scale;
            if (at > to)
                return;
            if (at < from - 1e-12)  // before the first row
                continue;
            impact_interpolate(s, h);
            const double part = at > from ? (at - from) / h : 0.0;
            write_trace<L>(s, impact_between(s, part), part * h,
                           out->trace.data() + next * TRACE_COLUMN_COUNT);
        }
    }
};

template <class L> static ShaftMotion shaft_of(const ImpactState<L> &x) {
    return {x.x[STATE_SPEED], x.x[STATE_ANGLE], L::FULL ? x.x[STATE_SPEED_FILTER] : 0.0};
}
template <class L>
static double measured_speed(const ImpactSolver<L> &s, const Parameters &p,
                             const ImpactState<L> &x) {
    const Drivetrain<double> &d = s.model.drive;
    return sensors_measured_speed(d.sensors, d.effects, p, shaft_of<L>(x));
}
template <class L>
static double measured_angle(const ImpactSolver<L> &s, const Parameters &p,
                             const ImpactState<L> &x) {
    const Drivetrain<double> &d = s.model.drive;
    return sensors_measured_angle(d.sensors, d.effects, p, shaft_of<L>(x));
}

// Effect speed_lag as a delay: measured speed and angle one delay before the end of each row; as a
// mean: the angle two delays before it. Before the start the shaft is at rest.
struct DelayedRow {
    double due_s, speed, angle;
};
struct DelayedWheel {
    Parameters parameters;
    std::vector<DelayedRow> rows;  // empty without a delay
    std::size_t next = 0;          // first that no step has reached
    double mean_s = 0.0;           // window of the mean, 0 for a delay

    void prepare(const LogInput &in, double row_scale, const Parameters &p) {
        parameters = p;
        const double delay = p.effects.speed_lag.time_constant_s;
        mean_s = p.effects.speed_lag.lag_form == LAG_MEAN ? 2.0 * delay : 0.0;
        for (const double time_s : in.time_s)
            rows.push_back(
                {(time_s - in.time_s[0]) * row_scale - std::max(delay, mean_s), 0.0, 0.0});
    }

    // Measured speed and angle of a row, from those of its end.
    DelayedRow measured(std::size_t row, double speed, double angle) const {
        if (rows.empty())
            return {0.0, speed, angle};
        if (mean_s == 0.0)
            return rows[row];
        return {0.0, (angle - rows[row].angle) / mean_s, angle};
    }

    template <class L> void step(ImpactSolver<L> &s, double h, double share) {
        const double from = s.drive.time_s, to = from + h * share + 1e-12;
        for (; next < rows.size() && rows[next].due_s <= to; ++next) {
            if (rows[next].due_s < 0.0)
                continue;
            impact_interpolate(s, h);
            const ImpactState<L> x =
                impact_between(s, std::max((rows[next].due_s - from) / h, 0.0));
            rows[next].speed = measured_speed(s, parameters, x);
            rows[next].angle = measured_angle(s, parameters, x);
        }
    }
};

// The run of one parameter set
template <class L> struct LogRun final : ImpactObserver<L> {
    const LogInput &in;
    Parameters parameters;
    CommandReader reader;
    ImpactSolver<L> solver{};
    Tracer tracer{};
    DelayedWheel delayed{};
    double now_s = 0.0;
    double charge_as = 0.0, bus_vs = 0.0, housing_nms = 0.0;  // integrals at the last row

    LogRun(const LogInput &log, const Parameters &p) : in(log), parameters(p), reader(log, p) {}

    void step(ImpactSolver<L> &s, double h, double share) override {
        if (tracer.out)
            tracer.step(s, h, share);
        if (!delayed.rows.empty())
            delayed.step(s, h, share);
    }
};

// Geometry and torques at the present instant; whole: with the forces. The derivative is computed
// only where it is needed.
template <class L>
static ImpactPoint present_point(const ImpactSolver<L> &s, const ImpactState<L> &x, bool whole) {
    if (!whole && !s.model.second_output)
        return impact_kinematics<L>(s.model, s.drive, s.mode, s.elapsed_s, x);
    ImpactState<L> ds{};
    return impact_derivative<L>(s.model, s.drive, s.mode, s.elapsed_s, x, ds);
}

template <class L>
static void write_row(LogRun<L> &run, std::size_t row, const ImpactOutput &out, std::size_t at) {
    ImpactSolver<L> &s = run.solver;
    const Parameters &p = run.parameters;
    const ImpactState<L> present = impact_present(s);
    const double *x = present.x;
    const ImpactPoint now = present_point(s, present, row == 0);
    const DelayedRow measured =
        run.delayed.measured(row, measured_speed(s, p, present), measured_angle(s, p, present));
    const double per_s = row > 0 ? 1.0 / run.reader.row_s(row) : 0.0;
    const double current = row > 0 ? (x[STATE_CURRENT_TIME] - run.charge_as) * per_s : now.i;
    const double bus = row > 0 ? (x[STATE_BUS_TIME] - run.bus_vs) * per_s : now.bus_v;
    const double values[IMPACT_COLUMN_COUNT] = {
        sensors_measured_current(p, current),
        bus * (1.0 + p.effects.supply_gain.relative),
        x[STATE_SPEED],
        measured.speed,
        x[STATE_ANGLE],
        measured.angle,
        now.joint_nm,
        x[L::ANVIL_ANGLE],
        now.head_rad,
        1e3 * now.x,
        x[L::HAMMER_ANGLE],
        row > 0 ? (x[L::HOUSING_TIME] - run.housing_nms) * per_s : now.housing_nm,
        x[L::ARM_ANGLE]};
    for (int n = 0; n < IMPACT_COLUMN_COUNT; ++n)
        out.columns[n][at] = values[n];
    run.charge_as = x[STATE_CURRENT_TIME];
    run.bus_vs = x[STATE_BUS_TIME];
    run.housing_nms = x[L::HOUSING_TIME];
}

static void write_energy(const ImpactSolver<AuditLayout> &s, double *to) {
    using L = AuditLayout;
    const double *x = s.state.x;
    const double values[ENERGY_COUNT] = {x[L::WORK_IN],
                                         x[L::LOSS_ELECTRIC],
                                         x[L::LOSS_FRICTION],
                                         x[L::LOSS_GROOVE],
                                         x[L::LOSS_CONTACT] + s.dropped_j,
                                         x[L::LOSS_JOINT],
                                         impact_stored(s.model, s.mode, s.state)};
    std::copy(values, values + ENERGY_COUNT, to);
}

template <class L> static void run_row(LogRun<L> &run, std::size_t row) {
    const LogInput &in = run.in;
    const double length = run.reader.row_s(row);
    const bool load = in.load_kind == LoadKind::TORQUE;
    const double load_rate = load ? (in.load_nm[row] - in.load_nm[row - 1]) / length : 0.0;
    const double bus_v = in.bus_v.empty()
                             ? 0.0
                             : in.bus_v[row] / (1.0 + run.parameters.effects.supply_gain.relative);
    double left = length;
    while (left > 0.0) {
        const Stretch stretch = run.reader.next(row, run.now_s, left);
        const double load_nm = load ? in.load_nm[row - 1] + load_rate * (length - left) : 0.0;
        const ImpactDrive next{
            stretch.command, stretch.command_rate,
            stretch.open,    stretch.switching ? run.solver.model.drive.bridge.dead_share : 0.0,
            bus_v,           load_nm,
            load_rate};
        impact_stretch(run.solver, next, run.now_s, stretch.length_s);
        run.now_s += stretch.length_s;
        left -= stretch.length_s;
        left = left < 1e-12 * stretch.length_s ? 0.0 : left;
    }
    if (!run.delayed.rows.empty())
        impact_truncate(run.solver);
}

// Whether all states of a tool that is neither driven nor loaded stay as they are.
template <class L> static bool stays_at_rest(const ImpactSolver<L> &s) {
    ImpactState<L> ds{};
    impact_derivative<L>(s.model, s.drive, s.mode, 0.0, s.state, ds);
    ds.x[STATE_BUS_TIME] = 0.0;  // integral of the bus voltage, which is there at rest too
    return std::all_of(ds.x, ds.x + L::COUNT, [](double slope) { return slope == 0.0; });
}

// Fills the rows before the first command with the values of row 0, without a simulation, and
// returns the index of the last of them: 0 where a load torque, a measured bus voltage or a record
// of the steps requires the simulation.
template <class L>
static std::size_t write_rest(LogRun<L> &run, const ImpactOutput &out, std::size_t at) {
    ImpactSolver<L> &s = run.solver;
    const bool steps_needed = run.tracer.out || s.history || out.keep_energy;
    if (steps_needed || run.in.load_kind == LoadKind::TORQUE || !run.in.bus_v.empty() ||
        !stays_at_rest(s))
        return 0;
    const std::size_t last = run.reader.last_row_without_command();
    for (double *column : out.columns)
        std::fill(column + at + 1, column + at + 1 + last, column[at]);
    run.now_s = s.drive.time_s = run.reader.row_end_s(last);
    return last;
}

struct ImpactJob {
    const LogInput *in;
    const double *theta;
    double command_peak;
    ImpactAccuracy accuracy;
    ImpactOutput *out;
};

template <class L>
static void prepare(LogRun<L> &run, const ImpactJob &job, std::size_t batch_row,
                    const Impact &model) {
    const LogInput &in = *job.in;
    ImpactOutput &out = *job.out;
    ImpactSolver<L> &s = run.solver;
    s.model = model;
    s.tolerance = out.tolerance > 0.0
                      ? out.tolerance
                      : (L::EXACT ? IMPACT_TOLERANCE_REFERENCE : IMPACT_TOLERANCE_FAST);
    s.fixed_s = job.accuracy == ImpactAccuracy::FIXED ? out.fixed_s : 0.0;
    s.history = batch_row == 0 && out.keep_history ? &out.history : nullptr;
    s.drive.load_nm = in.load_kind == LoadKind::TORQUE ? in.load_nm[0] : 0.0;
    impact_start(s);
    if (batch_row == 0 && !out.trace_s.empty())
        run.tracer = {&out, in.time_s[0], run.reader.row_scale(), 0};
    if (run.parameters.effects.speed_lag.time_constant_s > 0.0 &&
        run.parameters.effects.speed_lag.lag_form != LAG_FILTER)
        run.delayed.prepare(in, run.reader.row_scale(), run.parameters);
    s.cancellation = out.cancellation;
    s.parameters = &run.parameters;
    s.observer = run.tracer.out || !run.delayed.rows.empty() ? &run : nullptr;
}

template <class L>
static void run_tool(const ImpactJob &job, std::size_t batch_row, const Impact &model) {
    const LogInput &in = *job.in;
    ImpactOutput &out = *job.out;
    LogRun<L> run(in, parameters_from(job.theta + batch_row * PARAMETER_COUNT));
    prepare(run, job, batch_row, model);
    const std::size_t rows = in.time_s.size();
    const auto write = [&](std::size_t row) {
        write_row(run, row, out, batch_row * rows + row);
        if constexpr (L::AUDIT)
            if (batch_row == 0 && out.keep_energy)
                write_energy(run.solver, out.energy.data() + row * ENERGY_COUNT);
    };
    write(0);
    for (std::size_t row = write_rest(run, out, batch_row * rows) + 1; row < rows; ++row) {
        run_row(run, row);
        write(row);
    }
    ImpactSolver<L> &s = run.solver;
    impact_truncate(s);
    blows_end(s.recorder, s.state.x[L::LUG_IMPULSE]);
    for (Blow &b : s.recorder.blows)
        b.time_s = in.time_s[0] + b.time_s / run.reader.row_scale();
    out.blows[batch_row] = std::move(s.recorder.blows);
    out.stats[batch_row] = s.stats;
}

static Impact model_of(const ImpactJob &job, std::size_t batch_row) {
    const Parameters p = parameters_from(job.theta + batch_row * PARAMETER_COUNT);
    return impact_from(p, job.in->load_kind, job.in->kind, !job.in->bus_v.empty(),
                       job.command_peak);
}

static void run_any(const ImpactJob &job, std::size_t batch_row) {
    const Impact model = model_of(job, batch_row);
    if (job.accuracy == ImpactAccuracy::REFERENCE)
        run_tool<AuditLayout>(job, batch_row, model);
    else if (impact_needs_full(model))
        run_tool<FullLayout>(job, batch_row, model);
    else
        run_tool<FastLayout>(job, batch_row, model);
}

double impact_check_step(double step_s) {
    if (!(step_s >= IMPACT_STEP_LEAST_S && step_s <= IMPACT_STEP_MOST_S))
        throw std::invalid_argument("the impact tool's fixed step_s must be from 1e-7 to 0.1");
    return step_s;
}

static void check_trace(const std::vector<double> &trace_s) {
    for (std::size_t n = 0; n < trace_s.size(); ++n)
        if (!std::isfinite(trace_s[n]) || (n > 0 && trace_s[n] < trace_s[n - 1]))
            throw std::invalid_argument("simulate_impact: trace_s must be finite and increase");
}

static void check_log(const LogInput &in) {
    if (in.time_s.size() < 2)
        throw std::invalid_argument("simulate_impact needs two rows");
    log_input_check_time(in, "simulate_impact");
}

void simulate_impact(const LogInput &in, const double *theta, std::size_t batch,
                     ImpactAccuracy accuracy, int threads, ImpactOutput &out) {
    check_log(in);
    check_trace(out.trace_s);
    if (accuracy == ImpactAccuracy::FIXED)
        impact_check_step(out.fixed_s);
    const ImpactJob job{&in, theta, log_input_peak(in.command_end), accuracy, &out};
    out.blows.assign(batch, {});
    out.stats.assign(batch, {});
    out.trace.assign(out.trace_s.size() * TRACE_COLUMN_COUNT, std::nan(""));
    out.energy.assign(out.keep_energy ? in.time_s.size() * ENERGY_COUNT : 0, 0.0);
    const auto each = [&](auto what) {
        return [&job, batch, what](std::size_t row) {
            naming_the_set(row, batch, [&] { what(job, row); });
        };
    };
    run_parallel(batch, 1, nullptr, each(model_of));  // impossible sets are refused before any run
    run_parallel(batch, threads, out.cancellation, each(run_any));
}

}  // namespace vgroove
