// The drill driver's reference: variable steps by RODAS, L-stable, with located events.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "drill/recorder.hpp"
#include "numeric/rosenbrock.hpp"

namespace vgroove {

constexpr double STEP_MIN_S = 1e-13;
// A run ends with an error after so many steps of about DRILL_LOCATE_S one after the other: its
// modes change without end.
constexpr int STUCK_STEPS = 1000;
// Step budget: trial steps granted for each simulated second, and once for the run
constexpr double STEPS_SECOND = 5e5, STEPS_SAVED = 1e6;

namespace {

struct StepTrial {
    DrillVector x;
    DrillSums sums;
    double error;  // local, over the tolerance
};

// Stage n: (1 / (h gamma) - J) U_n = f(t + alpha_n h, y + sum a U) + sum c U / h + h d_n f_t; the
// sums follow from their rows of J.
StepTrial attempt(const DrillSystem &s, const DrillSlopes &j, double h, double tolerance) {
    const DrillInput start = drill_input(s.p, s.mode, s.time_s);
    const Eigen::Matrix4d inverse =
        (Eigen::Matrix4d::Identity() / (h * Rodas::GAMMA) - j.core).inverse();
    DrillVector u[6];
    DrillSums us[6];
    StepTrial a{s.x, s.sums, 0.0};
    for (int n = 0; n < 6; ++n) {
        DrillVector x = s.x;
        DrillSums sums = s.sums;
        for (int k = 0; k < n; ++k) {
            x += Rodas::A[n][k] * u[k];
            sums += Rodas::A[n][k] * us[k];
        }
        const DrillRates f = drill_rates(s.p, s.mode, drill_later(start, Rodas::ALPHA[n] * h), x);
        DrillVector right = f.core + h * Rodas::D[n] * j.core_time;
        DrillSums right_sums = f.sums + h * Rodas::D[n] * j.sums_time;
        for (int k = 0; k < n; ++k) {
            right += Rodas::C[n][k] / h * u[k];
            right_sums += Rodas::C[n][k] / h * us[k];
        }
        u[n] = inverse * right;
        us[n] = h * Rodas::GAMMA * (right_sums + j.sums * u[n]);
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

// First step after an event: a tenth of tolerance^(1/4) of the time in which the fastest state
// would change by its scale
double first_step(const Reference &r) {
    const DrillRates f =
        drill_rates(r.s.p, r.s.mode, drill_input(r.s.p, r.s.mode, r.s.time_s), r.s.x);
    const double rate = (f.core.array() / drill_scales(r.s.p).array()).abs().maxCoeff();
    return std::min(r.request.step_max_s,
                    0.1 * std::pow(r.request.tolerance, 0.25) / std::max(rate, 1.0));
}

DrillGuards guards_after(const Reference &r, const StepTrial &a, double h) {
    return drill_guards(r.s, r.s.time_s + h, a.x, a.sums[DRILL_CHARGE]);
}

// Shortest step, within DRILL_LOCATE_S, at whose end a guard is negative: bisection
double locate(Reference &r, const DrillSlopes &j, double h, StepTrial &a) {
    double low = 0.0, high = h;
    while (high - low > DRILL_LOCATE_S + 1e-15 * r.s.time_s) {
        const double middle = 0.5 * (low + high);
        if (middle <= low || middle >= high)
            break;
        const StepTrial tried = attempt(r.s, j, middle, r.request.tolerance);
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

void accept(Reference &r, const StepTrial &a, double time_s) {
    DrillSystem &s = r.s;
    const DrillInput start = drill_input(s.p, s.mode, s.time_s);
    const DrillInput end = drill_later(start, time_s - s.time_s);
    const DrillPoint before = drill_point(s, start);
    s.x = a.x;
    s.sums = a.sums;
    s.time_s = time_s;
    s.charge.push(s.time_s, s.sums[DRILL_CHARGE], s.x[DRILL_CURRENT], true);
    if (r.request.row_s > 0.0)
        r.recorder.fill(s, before, drill_point(s, end));
    else
        r.recorder.write(s, s.time_s, s.x, s.sums);
}

// One trial step with error control; an accepted one ends at the first event or timed change.
void advance(Reference &r) {
    DrillSystem &s = r.s;
    const double stop = std::min(drill_next_time(s), r.request.duration_s);
    const DrillSlopes j = drill_slopes(s.p, s.mode, drill_input(s.p, s.mode, s.time_s), s.x);
    double h = std::min(r.next_h, r.request.step_max_s);
    const bool reaches = s.time_s + 1.01 * h >= stop;
    h = reaches ? stop - s.time_s : h;
    StepTrial a = attempt(s, j, h, r.request.tolerance);
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
    r.stuck = h < 10.0 * DRILL_LOCATE_S ? r.stuck + 1 : 0;
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

}  // namespace

DrillRun drill_run_reference(const DrillParameters &p, const DrillRequest &request) {
    Reference r(p, request);
    r.recorder.write(r.s, 0.0, r.s.x, r.s.sums);
    r.next_h = first_step(r);
    for (std::size_t tries = 1; r.s.time_s < request.duration_s - DRILL_LOCATE_S; ++tries) {
        drill_check_cancelled(request, tries);
        if (static_cast<double>(tries) > STEPS_SAVED + STEPS_SECOND * r.s.time_s)
            throw std::runtime_error("drill driver: needs too many steps at " +
                                     std::to_string(r.s.time_s) +
                                     " s: a stiffness, a damping or an "
                                     "inertia of the rig is far off, or the tolerance too tight");
        advance(r);
    }
    return std::move(r.run);
}

}  // namespace vgroove
