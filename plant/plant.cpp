// Log-driven simulation: rows to stretches of straight command and load, lanes of equal structure together, outputs as the sensors show them.
#include "plant.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>
#include <thread>

#include "settle.hpp"
#include "solver.hpp"

namespace vgroove {

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(VGROOVE_NO_CLONES)
#define VGROOVE_CLONES __attribute__((flatten, target_clones("avx512f", "avx2", "default")))
#else
#define VGROOVE_CLONES __attribute__((flatten))
#endif

const char *const ENERGY_NAMES[ENERGY_COLUMNS] = {"work_in", "loss_bus", "loss_winding", "loss_friction", "loss_coupler", "work_load", "stored"};

constexpr double NOT_SIMULATED = std::numeric_limits<double>::quiet_NaN();

std::vector<double> hold_missing(const double *column, std::size_t count, double initial) {
    std::vector<double> held(count);
    double last = initial;
    for (std::size_t row = 0; row < count; ++row) {
        last = std::isnan(column[row]) ? last : column[row];
        held[row] = last;
    }
    return held;
}

void log_input_set_command(LogInput &in, const double *command, double slew_per_s, double slew_slack) {
    const std::size_t count = in.time_s.size();
    in.command_end = hold_missing(command, count, 0.0);
    in.command_start = in.command_end;
    if (std::isnan(slew_per_s))
        return;
    for (std::size_t row = 1; row < count; ++row) {
        const double allowed = slew_per_s * (in.time_s[row] - in.time_s[row - 1]) + slew_slack;
        const double change = std::fabs(in.command_end[row] - in.command_end[row - 1]);
        if (change <= allowed * (1.0 + 1e-9))
            in.command_start[row] = in.command_end[row - 1];
    }
}

// Where a lane stands in the log: rows in the lane's own time, the command column possibly shifted against them.
struct Cursor {
    double row_scale;      // true seconds per second of the time stamps
    double command_scale;  // seconds of the command column per true second
    double delay_s;
    double row_left_s;     // true time to the end of the row
    double now_s;          // true time since the first row
    std::size_t command_row;
};

static Cursor cursor_from(const Parameters &p) {
    const double skew = 1.0 + p.clock_skew_relative;
    Cursor c{};
    c.row_scale = p.clock_skew_command != 0.0 ? 1.0 : 1.0 / skew;
    c.command_scale = skew;
    c.delay_s = p.transport_delay_s;
    return c;
}

template <class V, int N> struct Group {
    Solver<V, N> solver;
    Parameters parameters[LaneTraits<V>::COUNT];
    Cursor cursor[LaneTraits<V>::COUNT];
    std::size_t batch_row[LaneTraits<V>::COUNT];
    int lanes;  // in use; the rest repeat the first
};

template <class V> VGROOVE_INLINE void drive_command(Drive<V> &d, const LogInput &in, int lane, std::size_t row, double from, double scale) {
    const double start = in.command_start[row], end = in.command_end[row];
    double rate = 0.0;
    if (start != end)
        rate = (end - start) / (in.time_s[row] - in.time_s[row - 1]);
    set(d.command, lane, start == end ? end : start + rate * from);
    set(d.command_rate, lane, rate * scale);
    set(d.open, lane, in.open.empty() ? 0.0 : in.open[row]);
    const double peak = std::max(std::fabs(start), std::fabs(end));
    const double least = std::min(std::fabs(start), std::fabs(end));
    const bool switching = !(start == end && (peak == 0.0 || peak >= 1.0)) && peak > 0.0 && least < 1.0;
    set(d.dead, lane, switching && !(get(d.open, lane) > 0.0) ? 1.0 : 0.0);
}

// The stretch of the command column that is in force now; its length in true time.
template <class V, int N> VGROOVE_INLINE double shifted_stretch(Group<V, N> &g, const LogInput &in, int lane) {
    Cursor &c = g.cursor[lane];
    const double at = in.time_s[0] + (c.now_s - c.delay_s) * c.command_scale;
    const std::size_t last = in.time_s.size() - 1;
    while (c.command_row < last && in.time_s[c.command_row] - at <= 1e-9 * (in.time_s[c.command_row + 1] - in.time_s[c.command_row]))
        ++c.command_row;
    const std::size_t row = c.command_row;
    const double left = (in.time_s[row] - at) / c.command_scale;
    const double length = left > 0.0 && left < c.row_left_s ? left : c.row_left_s;
    const double from = row > 0 ? at - in.time_s[row - 1] : 0.0;
    drive_command(g.solver.drive, in, lane, row, left > 0.0 ? from : in.time_s[row] - in.time_s[row > 0 ? row - 1 : 0], c.command_scale);
    if (left <= 0.0)
        set(g.solver.drive.command_rate, lane, 0.0);
    return length;
}

template <class V, int N> VGROOVE_INLINE bool next_stretch(Group<V, N> &g, const LogInput &in, std::size_t row, int lane) {
    Cursor &c = g.cursor[lane];
    if (c.row_left_s <= 0.0)
        return false;
    Solver<V, N> &s = g.solver;
    double length = c.row_left_s;
    if (s.model.effects & EFFECT_COMMAND_SHIFT)
        length = shifted_stretch(g, in, lane);
    else
        drive_command(s.drive, in, lane, row, 0.0, 1.0 / c.row_scale);
    set(s.drive.dead, lane, get(s.drive.dead, lane) * get(s.model.dead_share, lane));
    set(s.drive.time_s, lane, c.now_s);
    c.now_s += length;
    c.row_left_s -= length;
    if (c.row_left_s < 1e-12 * length)
        c.row_left_s = 0.0;
    solver_begin(s, lane, length);
    return true;
}

template <class V, int N> VGROOVE_INLINE void begin_row(Group<V, N> &g, const LogInput &in, std::size_t row, int lane) {
    Cursor &c = g.cursor[lane];
    Solver<V, N> &s = g.solver;
    c.row_left_s = (in.time_s[row] - in.time_s[row - 1]) * c.row_scale;
    if (!in.bus_v.empty())
        set(s.drive.bus_v, lane, in.bus_v[row] / (1.0 + g.parameters[lane].supply_gain_relative));
    if (in.load_kind == LoadKind::TORQUE) {
        set(s.drive.load_nm, lane, in.load_nm[row - 1]);
        set(s.drive.load_rate, lane, (in.load_nm[row] - in.load_nm[row - 1]) / c.row_left_s);
    }
    set(s.state.x[STATE_CURRENT_TIME], lane, 0.0);
    set(s.state.x[STATE_BUS_TIME], lane, 0.0);
}

template <class V, int N> VGROOVE_INLINE void reset_lane(Group<V, N> &g, const LogInput &in, std::size_t row, int lane, const double *start, bool first) {
    Solver<V, N> &s = g.solver;
    set(s.drive.load_nm, lane, in.load_kind == LoadKind::TORQUE ? in.load_nm[row] : 0.0);
    set(s.drive.load_rate, lane, 0.0);
    Cursor &c = g.cursor[lane];
    c.now_s = (in.time_s[row] - in.time_s[0]) * c.row_scale;
    c.row_left_s = 0.0;
    set(s.drive.time_s, lane, c.now_s);
    settle_shaft(s, lane, start, first);
}

static double sensed_current(const Parameters &p, double mean_a) {
    const double read = mean_a * (1.0 + p.current_gain_relative) + p.current_offset_a;
    return std::min(std::max(read, -p.current_limit_a), p.current_limit_a);
}

// Shaft quantities of one row; lag and eccentricity are applied to wheel speed and angle, gain to both.
template <class V, int N> VGROOVE_INLINE void write_shaft(const Group<V, N> &g, std::size_t at, int lane, V seen_speed, V seen_angle, const LogOutput &out) {
    const State<V, N> &x = g.solver.state;
    const Parameters &p = g.parameters[lane];
    out.speed_rad_s[at] = get(x.x[STATE_SPEED], lane);
    out.angle_rad[at] = get(x.x[STATE_ANGLE], lane);
    double speed = get(seen_speed, lane), angle = get(seen_angle, lane);
    if constexpr (N > STATE_CORE_COUNT) {
        if (g.solver.model.effects & EFFECT_SPEED_LAG) {
            speed = get(x.x[STATE_SPEED_FILTER], lane);
            angle -= p.speed_lag_s * speed;  // th_f' = w_f = (th - th_f) / T
        }
    }
    out.speed_measured_rad_s[at] = speed * (1.0 + p.speed_gain_relative);
    out.angle_measured_rad[at] = angle * (1.0 + p.speed_gain_relative);
}

template <class V, int N> VGROOVE_INLINE void write_row(const Group<V, N> &g, const LogInput &in, std::size_t row, bool start, const LogOutput &out) {
    const Solver<V, N> &s = g.solver;
    const V speed = sensors_wheel_speed<V>(s.model.sensors, s.model.effects, s.state.x[STATE_SPEED], s.state.x[STATE_ANGLE]);
    const V angle = sensors_wheel_angle<V>(s.model.sensors, s.model.effects, s.state.x[STATE_ANGLE]);
    const Electrical<V> e = drivetrain_electrical<V, N>(s.model, s.drive, s.mode, V{}, s.state);
    for (int lane = 0; lane < g.lanes; ++lane) {
        const Parameters &p = g.parameters[lane];
        const std::size_t at = g.batch_row[lane] * in.time_s.size() + row;
        const double seconds = start ? 1.0 : (in.time_s[row] - in.time_s[row - 1]) * g.cursor[lane].row_scale;
        const double current = start ? get(s.state.x[STATE_CURRENT], lane) : get(s.state.x[STATE_CURRENT_TIME], lane) / seconds;
        const double bus = start ? get(e.bus_v, lane) : get(s.state.x[STATE_BUS_TIME], lane) / seconds;
        out.current_a[at] = sensed_current(p, current);
        out.supply_v[at] = bus * (1.0 + p.supply_gain_relative);
        write_shaft(g, at, lane, speed, angle, out);
    }
    if constexpr (N > STATE_WORK_IN) {
        double *energy = out.energy_j + row * ENERGY_COLUMNS;
        for (int n = 0; n < ENERGY_COLUMNS - 1; ++n)
            energy[n] = get(s.state.x[STATE_WORK_IN + n], 0);
        energy[ENERGY_COLUMNS - 1] = get(drivetrain_stored<V, N>(s.model, s.state), 0);
    }
}

template <class V, int N> VGROOVE_INLINE void reset_group(Group<V, N> &g, const LogInput &in, const LogStarts &starts, std::size_t which) {
    const std::size_t row = starts.rows[which];
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const std::size_t batch = starts.per_row ? g.batch_row[lane] * starts.rows.size() : 0;
        reset_lane(g, in, row, lane, starts.state + 3 * (batch + which), which == 0);
        if (!(g.solver.model.effects & EFFECT_COMMAND_SHIFT))
            drive_command(g.solver.drive, in, lane, row, 0.0, 0.0);
        set(g.solver.drive.command, lane, in.command_end[row]);
        if (!in.bus_v.empty())
            set(g.solver.drive.bus_v, lane, in.bus_v[row] / (1.0 + g.parameters[lane].supply_gain_relative));
    }
}

template <class V, int N> VGROOVE_INLINE void run_group(Group<V, N> &g, const LogInput &in, const LogStarts &starts, const LogOutput &out) {
    std::size_t which = 0;
    for (std::size_t row = starts.rows.front(); row < in.time_s.size(); ++row) {
        if (row > starts.rows.front()) {
            for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
                begin_row(g, in, row, lane);
            solver_run(g.solver, [&](int lane) __attribute__((always_inline)) { return next_stretch(g, in, row, lane); });
        }
        const bool start = which < starts.rows.size() && starts.rows[which] == row;
        if (start)
            reset_group(g, in, starts, which++);
        write_row(g, in, row, start, out);
    }
}

VGROOVE_CLONES static void run_wide_core(Group<Lanes8, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_group(g, in, s, o); }
VGROOVE_CLONES static void run_wide_full(Group<Lanes8, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_group(g, in, s, o); }
__attribute__((flatten)) static void run_single_core(Group<double, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_group(g, in, s, o); }
__attribute__((flatten)) static void run_single_full(Group<double, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_group(g, in, s, o); }

__attribute__((flatten)) static void run(Group<double, STATE_AUDIT_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_group(g, in, s, o); }
static void run(Group<Lanes8, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_wide_core(g, in, s, o); }
static void run(Group<Lanes8, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_wide_full(g, in, s, o); }
static void run(Group<double, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_single_core(g, in, s, o); }
static void run(Group<double, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &s, const LogOutput &o) { run_single_full(g, in, s, o); }

struct Job {
    std::uint32_t effects;
    std::vector<std::size_t> batch_rows;
};

struct Run {
    const LogInput *in;
    const double *theta;
    const LogStarts *starts;
    const LogOutput *out;
    double command_peak, mean_interval_s;
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
        const std::size_t batch_row = job.batch_rows[static_cast<std::size_t>(lane < g.lanes ? lane : 0)];
        g.batch_row[lane] = batch_row;
        g.parameters[lane] = parameters_from(r.theta + batch_row * PARAMETER_COUNT);
        g.cursor[lane] = cursor_from(g.parameters[lane]);
        drivetrain_set_lane(m, lane, g.parameters[lane], r.command_peak, r.mean_interval_s);
    }
    run(g, *r.in, *r.starts, *r.out);
}

static void run_any(const Run &r, const Job &job) {
    const bool full = (job.effects & EFFECTS_WITH_STATES) != 0u;
    if (job.batch_rows.size() == 1)
        full ? run_job<double, STATE_FULL_COUNT>(r, job) : run_job<double, STATE_CORE_COUNT>(r, job);
    else
        full ? run_job<Lanes8, STATE_FULL_COUNT>(r, job) : run_job<Lanes8, STATE_CORE_COUNT>(r, job);
}

// Batch rows of equal structure in groups of a vector's width, in the order of the batch.
static std::vector<Job> jobs_of(const LogInput &in, const double *theta, std::size_t batch) {
    std::vector<Job> open, full;
    for (std::size_t row = 0; row < batch; ++row) {
        const Parameters p = parameters_from(theta + row * PARAMETER_COUNT);
        check_parameters(p, in.kind != InputKind::CURRENT);
        const std::uint32_t effects = effects_of(p);
        auto job = std::find_if(open.begin(), open.end(), [&](const Job &j) { return j.effects == effects; });
        if (job == open.end())
            job = open.insert(open.end(), Job{effects, {}});
        job->batch_rows.push_back(row);
        if (job->batch_rows.size() == static_cast<std::size_t>(LaneTraits<Lanes8>::COUNT)) {
            full.push_back(*job);
            open.erase(job);
        }
    }
    full.insert(full.end(), open.begin(), open.end());
    return full;
}

// Speed and angle of delay_s ago: cubic between rows (value and slope at both ends); before the start the shaft ran as it did at the start.
static void delay_measured(const LogInput &in, const Parameters &p, const LogStarts &starts, double *speed, double *angle) {
    const std::size_t count = in.time_s.size();
    const double delay = p.speed_lag_s * (p.clock_skew_command != 0.0 ? 1.0 : 1.0 + p.clock_skew_relative);
    const double to_true = delay > 0.0 ? p.speed_lag_s / delay : 1.0;
    const std::vector<double> w(speed, speed + count), th(angle, angle + count);
    for (std::size_t which = 0; which < starts.rows.size(); ++which) {
        const std::size_t first = starts.rows[which];
        const std::size_t end = which + 1 < starts.rows.size() ? starts.rows[which + 1] : count;
        std::size_t left = first;
        for (std::size_t row = first; row < end; ++row) {
            const double at = in.time_s[row] - delay;
            if (at <= in.time_s[first]) {
                speed[row] = w[first];
                angle[row] = th[first] + w[first] * (at - in.time_s[first]) * to_true;
                continue;
            }
            while (left + 1 < row && in.time_s[left + 1] <= at)
                ++left;
            const double h = (in.time_s[left + 1] - in.time_s[left]) * to_true;
            const double u = (at - in.time_s[left]) * to_true / h;
            const double rise = th[left + 1] - th[left], a = h * w[left] - rise, b = -h * w[left + 1] + rise;
            angle[row] = th[left] + u * rise + u * (1.0 - u) * ((1.0 - u) * a + u * b);
            speed[row] = (rise + (1.0 - 2.0 * u) * ((1.0 - u) * a + u * b) + u * (1.0 - u) * (b - a)) / h;
        }
    }
}

static void check_log(const LogInput &in, const LogStarts &starts) {
    const std::size_t count = in.time_s.size();
    if (count < 2 || starts.rows.empty())
        throw std::invalid_argument("simulate_log needs two rows and one start");
    for (std::size_t row = 1; row < count; ++row)
        if (!(in.time_s[row] > in.time_s[row - 1]))
            throw std::invalid_argument("simulate_log: time_s must increase");
    for (std::size_t n = 0; n < starts.rows.size(); ++n)
        if (starts.rows[n] >= count || (n > 0 && starts.rows[n] <= starts.rows[n - 1]))
            throw std::invalid_argument("simulate_log: starts must be increasing row indices");
}

static double peak_of(const std::vector<double> &column) {
    double peak = 0.0;
    for (const double x : column)
        peak = std::max(peak, std::fabs(x));
    return peak;
}

static void run_all(const Run &r, const std::vector<Job> &jobs, int threads) {
    std::atomic<std::size_t> next{0};
    const auto work = [&] {
        for (std::size_t job = next++; job < jobs.size(); job = next++)
            run_any(r, jobs[job]);
    };
    std::vector<std::thread> pool;
    for (int n = 1; n < threads && static_cast<std::size_t>(n) < jobs.size(); ++n)
        pool.emplace_back(work);
    work();
    for (std::thread &thread : pool)
        thread.join();
}

static void fill_before_start(const LogInput &in, std::size_t batch, const LogStarts &starts, const LogOutput &out) {
    const std::size_t count = in.time_s.size();
    for (double *column : {out.current_a, out.supply_v, out.speed_rad_s, out.speed_measured_rad_s, out.angle_rad, out.angle_measured_rad})
        for (std::size_t row = 0; row < batch; ++row)
            std::fill_n(column + row * count, starts.rows.front(), NOT_SIMULATED);
}

static Run run_of(const LogInput &in, const double *theta, const LogStarts &starts, const LogOutput &out) {
    const double interval_s = (in.time_s.back() - in.time_s.front()) / static_cast<double>(in.time_s.size() - 1);
    return Run{&in, theta, &starts, &out, peak_of(in.command_end), interval_s};
}

void simulate_log(const LogInput &in, const double *theta, std::size_t batch, const LogStarts &starts, int threads, const LogOutput &out) {
    check_log(in, starts);
    fill_before_start(in, batch, starts, out);
    run_all(run_of(in, theta, starts, out), jobs_of(in, theta, batch), threads);
    const std::size_t count = in.time_s.size();
    for (std::size_t row = 0; row < batch; ++row) {
        const Parameters p = parameters_from(theta + row * PARAMETER_COUNT);
        if (p.speed_lag_s > 0.0 && p.speed_lag_delay_form != 0.0)
            delay_measured(in, p, starts, out.speed_measured_rad_s + row * count, out.angle_measured_rad + row * count);
    }
}

void audit_log(const LogInput &in, const double *theta, const LogStarts &starts, const LogOutput &out) {
    check_log(in, starts);
    fill_before_start(in, 1, starts, out);
    std::fill_n(out.energy_j, starts.rows.front() * ENERGY_COLUMNS, NOT_SIMULATED);
    run_job<double, STATE_AUDIT_COUNT>(run_of(in, theta, starts, out), jobs_of(in, theta, 1).front());
}

}  // namespace vgroove
