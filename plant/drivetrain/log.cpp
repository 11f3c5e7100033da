// Simulation of a log: parameter sets with the same effects are simulated in the lanes of one
// vector, the groups on several threads; a lag in the form of a delay or a mean is applied to the
// finished columns.
#include "drivetrain/log.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "drivetrain/run_rows.hpp"
#include "numeric/thread_pool.hpp"

namespace vgroove {

const char *const ENERGY_NAMES[ENERGY_COLUMNS] = {
    "work_in", "loss_bus", "loss_winding", "loss_friction", "loss_coupler", "work_load", "stored"};

constexpr double NOT_SIMULATED = std::numeric_limits<double>::quiet_NaN();

// Parameter sets that are computed together
struct Job {
    std::uint32_t effects;
    bool exact;  // linear between events: computed alone
    std::vector<std::size_t> batch_rows;
};

struct Run {
    const LogInput *in;
    const double *theta;
    const LogStarts *starts;
    const LogOutput *out;
    SimulateOptions options;
    double command_peak, mean_interval_s;
    std::size_t *exhausted_row;  // for each batch row
};

template <class V, int N> static void run_job(const Run &r, const Job &job) {
    Group<V, N> g{};
    g.lanes = static_cast<int>(job.batch_rows.size());
    Drivetrain<V> &m = g.solver.model;
    m.effects = job.effects;
    m.input = r.in->kind;
    m.bus_measured = !r.in->bus_v.empty();
    m.load.kind = r.in->load_kind;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const std::size_t batch_row =
            job.batch_rows[static_cast<std::size_t>(lane < g.lanes ? lane : 0)];
        g.batch_row[lane] = batch_row;
        g.parameters[lane] = parameters_from(r.theta + batch_row * PARAMETER_COUNT);
        g.cursor[lane] = cursor_from(g.parameters[lane]);
        drivetrain_set_lane(m, lane, g.parameters[lane], r.command_peak, r.mean_interval_s);
    }
    solver_prepare(g.solver, r.options.tolerance);
    g.cancellation = r.options.cancellation;
    std::fill_n(g.exhausted_row, LaneTraits<V>::COUNT, NOT_EXHAUSTED);
    g.solver.exact = job.exact;
    g.solver.exponential = !r.options.adaptive && r.in->kind != InputKind::CURRENT &&
                           !(job.effects & EFFECTS_NOT_LINEAR_IN_CURRENT);
    run_rows(g, *r.in, *r.starts, *r.out);
    for (int lane = 0; lane < g.lanes; ++lane)
        r.exhausted_row[g.batch_row[lane]] = g.exhausted_row[lane];
}

static void run_any(const Run &r, const Job &job) {
    const bool full = (job.effects & EFFECTS_WITH_STATES) != 0u;
    if (job.batch_rows.size() == 1)
        full ? run_job<double, STATE_FULL_COUNT>(r, job)
             : run_job<double, STATE_CORE_COUNT>(r, job);
    else
        full ? run_job<Lanes8, STATE_FULL_COUNT>(r, job)
             : run_job<Lanes8, STATE_CORE_COUNT>(r, job);
}

// The parameter sets of the batch as jobs, in the order of the batch. Up to eight sets with the
// same effects become one job and run in one vector; fewer than options.least_lanes become a job
// each.
static std::vector<Job> jobs_of(const LogInput &in, const double *theta, std::size_t batch,
                                const SimulateOptions &options) {
    std::vector<Job> open, full;
    for (std::size_t row = 0; row < batch; ++row) {
        const Parameters p = parameters_from(theta + row * PARAMETER_COUNT);
        naming_the_set(row, batch, [&] { check_parameters(p, in.kind != InputKind::CURRENT); });
        const std::uint32_t effects = effects_of(p, load_inertia(p, in.load_kind));
        if (!options.adaptive && flow_applies(effects, in.load_kind)) {
            full.push_back(Job{effects, true, {row}});
            continue;
        }
        auto job = std::find_if(open.begin(), open.end(),
                                [&](const Job &j) { return j.effects == effects; });
        if (job == open.end())
            job = open.insert(open.end(), Job{effects, false, {}});
        job->batch_rows.push_back(row);
        if (job->batch_rows.size() == static_cast<std::size_t>(LaneTraits<Lanes8>::COUNT)) {
            full.push_back(*job);
            open.erase(job);
        }
    }
    for (const Job &job : open) {
        if (job.batch_rows.size() >= options.least_lanes)
            full.push_back(job);
        else
            for (const std::size_t row : job.batch_rows)
                full.push_back(Job{job.effects, false, {row}});
    }
    return full;
}

// Replaces speed and angle of each row by those one delay earlier, or the speed by its mean over
// the last two delays: cubic between rows (value and slope at both ends). Before the start the
// shaft has the speed of the start.
static void delay_measured(const LogInput &in, const Parameters &p, const LogStarts &starts,
                           double *speed, double *angle) {
    const std::size_t count = in.time_s.size();
    const double delay =
        p.effects.speed_lag.time_constant_s *
        (p.effects.clock_skew.command_clock != 0.0 ? 1.0 : 1.0 + p.effects.clock_skew.relative);
    const double to_true = delay > 0.0 ? p.effects.speed_lag.time_constant_s / delay : 1.0;
    const bool averages = p.effects.speed_lag.lag_form == LAG_MEAN;
    const double back = averages ? 2.0 * delay : delay;
    const std::vector<double> w(speed, speed + count), th(angle, angle + count);
    for (std::size_t which = 0; which < starts.rows.size(); ++which) {
        const std::size_t first = starts.rows[which];
        const std::size_t end = which + 1 < starts.rows.size() ? starts.rows[which + 1] : count;
        std::size_t left = first;
        for (std::size_t row = first; row < end; ++row) {
            const double at = in.time_s[row] - back;
            double late_speed = w[first];
            double late_angle = th[first] + w[first] * (at - in.time_s[first]) * to_true;
            if (at > in.time_s[first]) {
                while (left + 1 < row && in.time_s[left + 1] <= at)
                    ++left;
                const double h = (in.time_s[left + 1] - in.time_s[left]) * to_true;
                const double u = (at - in.time_s[left]) * to_true / h;
                const double rise = th[left + 1] - th[left], a = h * w[left] - rise,
                             b = -h * w[left + 1] + rise;
                const double bend = (1.0 - u) * a + u * b;
                late_angle = th[left] + u * rise + u * (1.0 - u) * bend;
                late_speed = (rise + (1.0 - 2.0 * u) * bend + u * (1.0 - u) * (b - a)) / h;
            }
            if (averages) {
                speed[row] = (th[row] - late_angle) / (back * to_true);
            } else {
                speed[row] = late_speed;
                angle[row] = late_angle;
            }
        }
    }
}

static void check_log(const LogInput &in, const LogStarts &starts) {
    const std::size_t count = in.time_s.size();
    if (count < 2 || starts.rows.empty())
        throw std::invalid_argument("simulate_log needs two rows and one start");
    log_input_check_time(in, "simulate_log");
    for (std::size_t n = 0; n < starts.rows.size(); ++n)
        if (starts.rows[n] >= count || (n > 0 && starts.rows[n] <= starts.rows[n - 1]))
            throw std::invalid_argument("simulate_log: starts must be increasing row indices");
}

static void fill_before_start(const LogInput &in, std::size_t batch, const LogStarts &starts,
                              const LogOutput &out) {
    const std::size_t count = in.time_s.size();
    for (double *column : {out.current_a, out.supply_v, out.speed_rad_s, out.speed_measured_rad_s,
                           out.angle_rad, out.angle_measured_rad})
        for (std::size_t row = 0; row < batch; ++row)
            std::fill_n(column + row * count, starts.rows.front(), NOT_SIMULATED);
}

static Run run_of(const LogInput &in, const double *theta, const LogStarts &starts,
                  const LogOutput &out, const SimulateOptions &options) {
    const double interval_s = log_input_interval_s(in);
    return Run{&in,        theta,  &starts, &out, options, log_input_peak(in.command_end),
               interval_s, nullptr};
}

static void throw_exhausted(const LogInput &in, const double *theta, std::size_t batch_row,
                            std::size_t row) {
    const Parameters p = parameters_from(theta + batch_row * PARAMETER_COUNT);
    throw std::runtime_error("simulate_log: parameter set " + std::to_string(batch_row) +
                             " needs too many steps at row " + std::to_string(row) + ", " +
                             std::to_string(in.time_s[row]) + " s: " + fastest_parameter(p));
}

void simulate_log(const LogInput &in, const double *theta, std::size_t batch,
                  const LogStarts &starts, const SimulateOptions &options, const LogOutput &out) {
    check_log(in, starts);
    fill_before_start(in, batch, starts, out);
    std::vector<std::size_t> exhausted(batch, NOT_EXHAUSTED);
    Run run = run_of(in, theta, starts, out, options);
    run.exhausted_row = exhausted.data();
    const std::vector<Job> jobs = jobs_of(in, theta, batch, options);
    run_parallel(jobs.size(), options.threads, options.cancellation,
                 [&](std::size_t job) { run_any(run, jobs[job]); });
    const std::size_t count = in.time_s.size();
    for (std::size_t row = 0; row < batch; ++row) {
        if (exhausted[row] != NOT_EXHAUSTED && !options.keep_unfinished)
            throw_exhausted(in, theta, row, exhausted[row]);
        const Parameters p = parameters_from(theta + row * PARAMETER_COUNT);
        if (p.effects.speed_lag.time_constant_s > 0.0 && p.effects.speed_lag.lag_form != LAG_FILTER)
            delay_measured(in, p, starts, out.speed_measured_rad_s + row * count,
                           out.angle_measured_rad + row * count);
    }
}

void audit_log(const LogInput &in, const double *theta, const LogStarts &starts,
               const LogOutput &out) {
    check_log(in, starts);
    fill_before_start(in, 1, starts, out);
    std::fill_n(out.energy_j, starts.rows.front() * ENERGY_COLUMNS, NOT_SIMULATED);
    std::size_t exhausted = NOT_EXHAUSTED;
    SimulateOptions options;
    options.adaptive = true;
    Run run = run_of(in, theta, starts, out, options);
    run.exhausted_row = &exhausted;
    run_job<double, STATE_AUDIT_COUNT>(run, jobs_of(in, theta, 1, options).front());
    if (exhausted != NOT_EXHAUSTED)
        throw_exhausted(in, theta, 0, exhausted);
}

}  // namespace vgroove
