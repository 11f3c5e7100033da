// The drill driver by fixed steps: explicit Euler, classical Runge-Kutta of fourth order, and the
// real-time mode.
#include <Eigen/Core>
#include <chrono>
#include <cmath>
#include <memory>

#include "drill/real_time.hpp"
#include "drill/recorder.hpp"

namespace vgroove {

constexpr double DIVERGED = 1e3;  // state over its scale from which on a run counts as diverged

namespace {

// Rates of an explicit step: the clutch slips where the shaft's torque would exceed its limit.
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

// Events take effect at the end of an explicit step.
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

}  // namespace

DrillRun drill_run_fixed(const DrillParameters &p, const DrillRequest &request) {
    DrillRun run;
    const bool real_time = request.solver == DrillSolver::REAL_TIME;
    DrillSystem system(p, DRILL_CHARGE_SPACING_S, drill_charge_points(p));
    std::unique_ptr<DrillRealTime> real_time_solver(real_time ? new DrillRealTime(p, request.step_s)
                                                              : nullptr);
    if (real_time_solver)
        real_time_solver->marks = &run.marks;
    const DrillSystem &s = real_time_solver ? real_time_solver->system() : system;
    Recorder recorder{run, 0.0};
    recorder.write(s, 0.0, s.x, s.sums);
    const auto count =
        static_cast<std::size_t>(std::floor(request.duration_s / request.step_s + 1e-9));
    const auto every =
        static_cast<std::size_t>(std::max(1LL, std::llround(request.row_s / request.step_s)));
    for (std::size_t n = 1; n <= count; ++n) {
        drill_check_cancelled(request, n);
        const auto started = std::chrono::steady_clock::now();
        if (real_time_solver)
            real_time_solver->step();
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

}  // namespace vgroove
