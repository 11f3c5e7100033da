// The drill driver's variable-step reference (Rosenbrock, L-stable, events located) and its
// explicit fixed-step solvers.
#include "drill/solvers.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace vgroove {

const char *const DRILL_ROW_NAMES[DRILL_ROW_COUNT] = {
    "time_s",        "current_a",      "speed_rad_s",  "twist_rad",
    "chuck_rad_s",   "shaft_nm",       "duty",         "control",
    "stored_j",      "charge_as",      "angle_rad",    "chuck_angle_rad",
    "work_in_j",     "loss_winding_j", "loss_motor_j", "loss_shaft_j",
    "loss_clutch_j", "work_load_j"};

constexpr double LOCATE_S = 1e-12;  // an event is located this well
constexpr double STEP_MIN_S = 1e-13;
constexpr int STUCK_STEPS =
    1000;  // that many steps of about LOCATE_S on end: changes of mode that never settle
constexpr double DIVERGED = 1e3;  // sizes of a state
constexpr double STEPS_SECOND = 5e5,
                 STEPS_SAVED =
                     1e6;  // the reference may try so many a simulated second, and so many besides
constexpr std::size_t LOOK_STEPS = 256;  // so often a run asks whether it is still wanted

namespace {

struct Point {
    double time_s;
    DrillVector x, slope;
    DrillSums sums, sums_slope;
};

Point point_of(const DrillSystem &s, const DrillInput &in) {
    const DrillRates r = drill_rates(s.p, s.mode, in, s.x);
    return {s.time_s, s.x, r.core, s.sums, r.sums};
}

template <class Vector>
Vector between(const Vector &a, const Vector &a_slope, const Vector &b, const Vector &b_slope,
               double h, double u) {
    const Vector rise = b - a;
    return a + u * rise +
           u * (1.0 - u) * ((1.0 - u) * (h * a_slope - rise) + u * (rise - h * b_slope));
}

struct Recorder {
    DrillRun &run;
    double row_s;
    std::size_t next = 0;  // row of the grid that is written next

    void write(const DrillSystem &s, double time_s, const DrillVector &x, const DrillSums &sums) {
        const std::size_t at = run.rows.size();
        run.rows.resize(at + DRILL_ROW_COUNT);
        double *row = run.rows.data() + at;
        row[DRILL_ROW_TIME] = time_s;
        Eigen::Map<DrillVector>(row + DRILL_ROW_CORE) = x;
        row[DRILL_ROW_SHAFT] = drill_shaft_torque(s.p, s.mode, x);
        row[DRILL_ROW_DUTY] = drill_duty(s.p, s.mode, time_s);
        row[DRILL_ROW_CONTROL] = static_cast<double>(s.mode.control);
        row[DRILL_ROW_STORED] = drill_stored_energy(s.p, x);
        Eigen::Map<DrillSums>(row + DRILL_ROW_SUMS) = sums;
        ++next;
    }

    // Rows of the grid within a step, before its mode changes
    void fill(const DrillSystem &s, const Point &a, const Point &b) {
        const double h = b.time_s - a.time_s;
        for (double t = static_cast<double>(next) * row_s; t <= b.time_s + LOCATE_S;
             t = static_cast<double>(next) * row_s) {
            const double u = h > 0.0 ? std::min((t - a.time_s) / h, 1.0) : 1.0;
            write(s, t, between<DrillVector>(a.x, a.slope, b.x, b.slope, h, u),
                  between<DrillSums>(a.sums, a.sums_slope, b.sums, b.sums_slope, h, u));
        }
    }
};

// RODAS, order 4(3), L-stable and stiffly accurate: Hairer and Wanner, Solving Ordinary
// Differential Equations II, 2nd ed., IV.10.
namespace rodas {
constexpr double GAMMA = 0.25;
constexpr double ALPHA[6] = {0.0, 0.386, 0.21, 0.63, 1.0, 1.0};
constexpr double D[6] = {0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0};
constexpr double A[6][5] = {
    {},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0}};
constexpr double C[6][5] = {
    {},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136,
     -6.058818238834054}};
}  // namespace rodas

struct Attempt {
    DrillVector x;
    DrillSums sums;
    double error;  // local, over the tolerance
};

// Stage n: (1 / (h gamma) - J) U_n = f(t + alpha_n h, y + sum a U) + sum c U / h + h d_n f_t; the
// sums follow from their rows of J.
Attempt attempt(const DrillSystem &s, const DrillSlopes &j, double h, double tolerance) {
    const DrillInput start = drill_input(s.p, s.mode, s.time_s);
    const Eigen::Matrix4d inverse =
        (Eigen::Matrix4d::Identity() / (h * rodas::GAMMA) - j.core).inverse();
    DrillVector u[6];
    DrillSums us[6];
    Attempt a{s.x, s.sums, 0.0};
    for (int n = 0; n < 6; ++n) {
        DrillVector x = s.x;
        DrillSums sums = s.sums;
        for (int k = 0; k < n; ++k) {
            x += rodas::A[n][k] * u[k];
            sums += rodas::A[n][k] * us[k];
        }
        const DrillRates f = drill_rates(s.p, s.mode, drill_later(start, rodas::ALPHA[n] * h), x);
        DrillVector right = f.core + h * rodas::D[n] * j.core_time;
        DrillSums right_sums = f.sums + h * rodas::D[n] * j.sums_time;
        for (int k = 0; k < n; ++k) {
            right += rodas::C[n][k] / h * u[k];
            right_sums += rodas::C[n][k] / h * us[k];
        }
        u[n] = inverse * right;
        us[n] = h * rodas::GAMMA * (right_sums + j.sums * u[n]);
        a.x = x + u[n];
        a.sums = sums + us[n];
    }
    a.error = (u[5].array() / drill_scales(s.p).array()).abs().maxCoeff() / tolerance;
    return a;
}

struct Reference {
    DrillSystem s;
    DrillRequest request;
    DrillRun run;
    Recorder recorder;
    double next_h = 0.0;
    int stuck = 0;

    explicit Reference(const DrillParameters &p, const DrillRequest &r)
        : s(p),
          request(r),
          recorder{run, r.row_s} {}
};

// First step after a change: a tenth of tolerance^(1/4) of the time in which the fastest state
// would cross its size
double first_step(const Reference &r) {
    const DrillRates f =
        drill_rates(r.s.p, r.s.mode, drill_input(r.s.p, r.s.mode, r.s.time_s), r.s.x);
    const double rate = (f.core.array() / drill_scales(r.s.p).array()).abs().maxCoeff();
    return std::min(r.request.step_max_s,
                    0.1 * std::pow(r.request.tolerance, 0.25) / std::max(rate, 1.0));
}

DrillGuards guards_after(const Reference &r, const Attempt &a, double h) {
    return drill_guards(r.s, r.s.time_s + h, a.x, a.sums[DRILL_CHARGE]);
}

// The shortest step, to LOCATE_S, at whose end a guard has been passed
double locate(Reference &r, const DrillSlopes &j, double h, Attempt &a) {
    double low = 0.0, high = h;
    while (high - low > LOCATE_S + 1e-15 * r.s.time_s) {
        const double middle = 0.5 * (low + high);
        if (middle <= low || middle >= high)
            break;
        const Attempt tried = attempt(r.s, j, middle, r.request.tolerance);
        ++r.run.rejected;
        if (drill_any(guards_after(r, tried, middle))) {
            high = middle;
            a = tried;
        } else {
            low = middle;
        }
    }
    return high;
}

void accept(Reference &r, const Attempt &a, double time_s) {
    DrillSystem &s = r.s;
    const DrillInput start = drill_input(s.p, s.mode, s.time_s);
    const DrillInput end = drill_later(start, time_s - s.time_s);
    const Point before = point_of(s, start);
    s.x = a.x;
    s.sums = a.sums;
    s.time_s = time_s;
    s.charge.push(s.time_s, s.sums[DRILL_CHARGE], s.x[DRILL_CURRENT], true);
    if (r.request.row_s > 0.0)
        r.recorder.fill(s, before, point_of(s, end));
    else
        r.recorder.write(s, s.time_s, s.x, s.sums);
}

// One accepted step: error control, events located, timed changes met exactly.
void advance(Reference &r) {
    DrillSystem &s = r.s;
    const double stop = std::min(drill_next_time(s), r.request.duration_s);
    const DrillSlopes j = drill_slopes(s.p, s.mode, drill_input(s.p, s.mode, s.time_s), s.x);
    double h = std::min(r.next_h, r.request.step_max_s);
    const bool reaches = s.time_s + 1.01 * h >= stop;
    h = reaches ? stop - s.time_s : h;
    Attempt a = attempt(s, j, h, r.request.tolerance);
    if (!(a.error <= 1.0) && h > STEP_MIN_S) {
        ++r.run.rejected;
        r.next_h =
            h * (std::isfinite(a.error) ? std::max(0.2, 0.9 * std::pow(a.error, -0.25)) : 0.2);
        return;
    }
    const double grown = h * std::min(5.0, 0.9 * std::pow(std::max(a.error, 1e-8), -0.25));
    const bool met = drill_any(guards_after(r, a, h));
    h = met ? locate(r, j, h, a) : h;
    const DrillGuards g = guards_after(r, a, h);
    accept(r, a, met || !reaches ? s.time_s + h : stop);
    DrillMark mark = met ? drill_switch(s, g) : drill_input_mark(s.p, s.time_s);
    const DrillMark timed = drill_timers(s);
    mark = timed != DrillMark::NONE ? timed : mark;
    r.stuck = h < 10.0 * LOCATE_S ? r.stuck + 1 : 0;
    if (r.stuck > STUCK_STEPS)
        throw std::runtime_error(
            "drill driver: changes of mode follow one another without end at " +
            std::to_string(s.time_s) + " s");
    r.run.steps.push_back({s.time_s, h, mark});
    if (mark != DrillMark::NONE)
        r.run.marks.push_back({s.time_s, h, mark});
    r.next_h =
        mark != DrillMark::NONE ? first_step(r) : (reaches ? std::max(grown, r.next_h) : grown);
}

void look(const DrillRequest &request, std::size_t step) {
    if (request.watch && step % LOOK_STEPS == 0)
        request.watch->look();
}

DrillRun run_reference(const DrillParameters &p, const DrillRequest &request) {
    Reference r(p, request);
    r.recorder.write(r.s, 0.0, r.s.x, r.s.sums);
    r.next_h = first_step(r);
    for (std::size_t tries = 1; r.s.time_s < request.duration_s - LOCATE_S; ++tries) {
        look(request, tries);
        if (static_cast<double>(tries) > STEPS_SAVED + STEPS_SECOND * r.s.time_s)
            throw std::runtime_error("drill driver: needs too many steps at " +
                                     std::to_string(r.s.time_s) +
                                     " s: a stiffness, a damping or an "
                                     "inertia of the rig is far off, or the tolerance too tight");
        advance(r);
    }
    return std::move(r.run);
}

// The clutch of an explicit step has no memory: it slips where the shaft would pass its limit.
DrillRates clamped_rates(const DrillSystem &s, double time_s, const DrillVector &x) {
    DrillMode m = s.mode;
    m.clutch = 0;
    const double torque = drill_shaft_torque(s.p, m, x);
    m.clutch = torque > s.p.clutch_nm ? 1 : (torque < -s.p.clutch_nm ? -1 : 0);
    return drill_rates(s.p, m, drill_input(s.p, m, time_s), x);
}

void euler_step(DrillSystem &s, double h) {
    const DrillRates k = clamped_rates(s, s.time_s, s.x);
    s.x += h * k.core;
    s.sums += h * k.sums;
}

void rk4_step(DrillSystem &s, double h) {
    const DrillRates k1 = clamped_rates(s, s.time_s, s.x);
    const DrillRates k2 = clamped_rates(s, s.time_s + 0.5 * h, s.x + 0.5 * h * k1.core);
    const DrillRates k3 = clamped_rates(s, s.time_s + 0.5 * h, s.x + 0.5 * h * k2.core);
    const DrillRates k4 = clamped_rates(s, s.time_s + h, s.x + h * k3.core);
    s.x += h / 6.0 * (k1.core + 2.0 * k2.core + 2.0 * k3.core + k4.core);
    s.sums += h / 6.0 * (k1.sums + 2.0 * k2.sums + 2.0 * k3.sums + k4.sums);
}

// Changes of mode at the end of an explicit step, where they are first seen
void explicit_step(DrillSystem &s, DrillSolver solver, double h, double end_s,
                   std::vector<DrillStep> &marks) {
    solver == DrillSolver::EULER ? euler_step(s, h) : rk4_step(s, h);
    s.time_s = end_s;
    s.charge.push(s.time_s, s.sums[DRILL_CHARGE], s.x[DRILL_CURRENT], false);
    const DrillGuards g = drill_guards(s, s.time_s, s.x, s.sums[DRILL_CHARGE]);
    const DrillMark switched = drill_any(g) ? drill_switch(s, g) : DrillMark::NONE;
    const DrillMark timed = drill_timers(s);
    for (const DrillMark mark : {switched, timed})
        if (mark != DrillMark::NONE)
            marks.push_back({s.time_s, h, mark});
}

bool has_diverged(const DrillSystem &s) {
    return !((s.x.array() / drill_scales(s.p).array()).abs().maxCoeff() < DIVERGED);
}

DrillRun run_fixed(const DrillParameters &p, const DrillRequest &request) {
    DrillRun run;
    const bool real_time = request.solver == DrillSolver::REAL_TIME;
    DrillSystem system(p, DRILL_CHARGE_SPACING_S, drill_charge_points(p));
    std::unique_ptr<DrillRealTime> body(real_time ? new DrillRealTime(p, request.step_s) : nullptr);
    if (body)
        body->marks = &run.marks;
    const DrillSystem &s = body ? body->system() : system;
    Recorder recorder{run, 0.0};
    recorder.write(s, 0.0, s.x, s.sums);
    const auto count =
        static_cast<std::size_t>(std::floor(request.duration_s / request.step_s + 1e-9));
    const auto every =
        static_cast<std::size_t>(std::max(1LL, std::llround(request.row_s / request.step_s)));
    for (std::size_t n = 1; n <= count; ++n) {
        look(request, n);
        const auto started = std::chrono::steady_clock::now();
        if (body)
            body->step();
        else
            explicit_step(system, request.solver, request.step_s,
                          static_cast<double>(n) * request.step_s, run.marks);
        if (request.timed)
            run.execution_ns.push_back(
                std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - started)
                    .count());
        if (has_diverged(s)) {
            run.diverged_s = s.time_s;
            break;
        }
        if (n % every == 0)
            recorder.write(s, s.time_s, s.x, s.sums);
    }
    return run;
}

}  // namespace

DrillRun drill_run(const DrillParameters &p, const DrillRequest &request) {
    drill_check(p);
    if (p.rise_nm_per_rad != 0.0)
        throw std::invalid_argument("load.rise_nm_per_rad is a load of the lock-step plant alone "
                                    "(vgroove sim, vgroove run)");
    DrillRequest r = request;
    if (!(r.duration_s > 0.0 && r.duration_s <= 3600.0))
        throw std::invalid_argument("duration_s must be above 0 and at most 3600");
    if (r.solver != DrillSolver::REFERENCE) {
        if (!(r.step_s >= 1e-7 && r.step_s <= r.duration_s))
            throw std::invalid_argument("step_s must be at least 1e-7 and at most duration_s");
        return run_fixed(p, r);
    }
    if (!(r.tolerance >= 1e-12 && r.tolerance <= 0.1))
        throw std::invalid_argument("tolerance must be within 1e-12 and 0.1");
    r.step_max_s = r.step_max_s > 0.0 ? r.step_max_s : r.duration_s / 50.0;
    return run_reference(p, r);
}

}  // namespace vgroove
