// One trial step of the impact tool's solver, by the method that suits the motion.
#ifndef VGROOVE_PLANT_IMPACT_ATTEMPT_HPP
#define VGROOVE_PLANT_IMPACT_ATTEMPT_HPP

#include <stdexcept>
#include <string>

#include "impact/coupled_step.hpp"
#include "impact/flight.hpp"
#include "impact/series.hpp"

namespace vgroove {

// Largest local error over the tolerance; e: error of each state, per second
template <class L>
VGROOVE_INLINE double impact_error(const ImpactSolver<L> &self, double h, const ImpactState<L> &e) {
    const Impact &m = self.model;
    const double speed = m.speed_weight, output = m.output_weight, angle = m.angle_weight,
                 current = m.current_weight;
    double worst =
        max_of(std::fabs(e.x[STATE_CURRENT]) * current, std::fabs(e.x[STATE_SPEED]) * speed);
    worst = max_of(worst, max_of(std::fabs(e.x[L::HAMMER_SPEED]), std::fabs(e.x[L::ANVIL_SPEED])) *
                              output);
    worst = max_of(worst,
                   max_of(max_of(std::fabs(e.x[L::HAMMER_ANGLE]), std::fabs(e.x[L::ANVIL_ANGLE])),
                          std::fabs(e.x[L::TWIST])) *
                       angle);
    if constexpr (L::FULL) {
        worst = max_of(worst, max_of(std::fabs(e.x[L::OUTPUT_SPEED]) * output,
                                     std::fabs(e.x[L::COUPLER_TWIST]) * angle));
        worst = max_of(worst, max_of(std::fabs(e.x[STATE_OUTPUT_SPEED]) * speed,
                                     std::fabs(e.x[STATE_TWIST]) * angle * m.ratio_inverse));
        worst = max_of(worst, max_of(std::fabs(e.x[STATE_CURRENT_FILTER]) * current,
                                     std::fabs(e.x[STATE_SPEED_FILTER]) * speed));
    }
    return h * worst / self.tolerance;
}

// By Dormand and Prince
template <class L>
VGROOVE_CLONES_APART void impact_attempt_contact(ImpactSolver<L> &self, double h) {
    constexpr StageSum SUM = StageSum::LAST_SLOPE_LAST;
    constexpr int N = L::COUNT;
    ImpactStep<L> &t = self.step;
    dormand_prince_stages<SUM, double, N>(
        self.state, self.slope, h, t.slopes,
        [&self](double tau, const ImpactState<L> &s, ImpactState<L> &to)
            __attribute__((always_inline)) { impact_stage(self, tau, s, to); });
    dormand_prince_end<SUM, double, N>(self.state, self.slope, h, t.slopes, t.end);
    if (!L::EXACT && self.mode.ringing)
        anvil_ring(self, h, t.end);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    ImpactState<L> error;
    dormand_prince_error<double, N>(self.slope, t.slopes, t.end_slope, error);
    t.error = impact_error(self, h, error);
    self.stats.derivatives += 5.0;
}

// Every IMPACT_CHECK_STEPS steps: whether the run has been cancelled, and its step budget. Throws
// Cancelled or std::runtime_error.
template <class L> __attribute__((noinline)) void impact_check_progress(ImpactSolver<L> &self) {
    self.check_in = IMPACT_CHECK_STEPS;
    if (self.cancellation)
        self.cancellation->check();
    self.step_budget +=
        IMPACT_STEPS_SECOND * (self.drive.time_s - self.checked_s) - IMPACT_CHECK_STEPS;
    self.checked_s = self.drive.time_s;
    if (self.step_budget < 0.0)
        throw std::runtime_error("impact mechanism: needs too many steps at " +
                                 std::to_string(self.drive.time_s) +
                                 " s: " + fastest_parameter(*self.parameters));
    self.step_budget = min_of(self.step_budget, IMPACT_STEPS_SAVED);
}

// One trial step of length h. Returns the factor by which its error allows the step to grow.
template <class L> VGROOVE_INLINE double impact_attempt(ImpactSolver<L> &self, double h) {
    if (--self.check_in <= 0)
        impact_check_progress(self);
    ImpactStep<L> &t = self.step;
    t.h = h;
    t.share = 1.0;
    t.event = -1;
    t.dense_ready = false;
    t.flight = !t.by_series && flight_applies(self);
    t.coupled = false;
    if constexpr (!L::EXACT) {
        ImpactState<L> e;
        if (t.by_series) {
            series_attempt(self, h, e);
            t.error = impact_error(self, h, e);
            return 0.9 / std::sqrt(std::sqrt(max_of(t.error, 1e-8)));
        }
        if (t.flight) {
            flight_attempt(self, h, e);
            t.error = impact_error(self, h, e);
            return 0.9 / std::sqrt(std::sqrt(max_of(t.error, 1e-8)));
        }
        if constexpr (L::FULL) {
            t.coupled = coupled_applies(self, h);
            if (t.coupled) {
                coupled_attempt(self, h, e);
                t.error = impact_error(self, h, e);
                return 0.85 * rough_inverse_root(max_of(t.error, 1e-8), 3);
            }
        }
    }
    impact_attempt_contact(self, h);
    return 0.9 * fifth_inverse_root(max_of(t.error, 1e-8));
}

}  // namespace vgroove

#endif
