// State of the impact tool within a step that has been tried.
#ifndef VGROOVE_PLANT_IMPACT_INTERPOLANT_HPP
#define VGROOVE_PLANT_IMPACT_INTERPOLANT_HPP

#include "impact/solver.hpp"

namespace vgroove {

// Untouched anvil on its sticking joint, t after a twist and speed: solution of
// JA e'' + C e' + K e = 0, as e'' + 2 ring_decay e' + ring_square e = 0
struct Ringing {
    double twist, speed;
};
VGROOVE_INLINE Ringing anvil_ringing(const Impact &m, double twist, double speed, double t) {
    double even = exp_of<double>(-m.ring_decay * t), odd = even * t;
    if (m.ring_swings) {
        odd = even * sin_of<double>(m.ring_rate * t) / m.ring_rate;
        even *= cos_of<double>(m.ring_rate * t);
    } else if (m.ring_rate > 0.0) {
        const double slow = exp_of<double>((m.ring_rate - m.ring_decay) * t),
                     fast = exp_of<double>(-(m.ring_rate + m.ring_decay) * t);
        even = 0.5 * (slow + fast);
        odd = 0.5 * (slow - fast) / m.ring_rate;
    }
    return {even * twist + odd * (speed + m.ring_decay * twist),
            even * speed - odd * (m.ring_decay * speed + m.ring_square * twist)};
}

// Sets the ringing anvil in a state at t after the start of the step.
template <class L>
VGROOVE_INLINE void anvil_ring(const ImpactSolver<L> &self, double t, ImpactState<L> &s) {
    const double *from = self.state.x;
    const Ringing r = anvil_ringing(self.model, from[L::TWIST], from[L::ANVIL_SPEED], t);
    s.x[L::TWIST] = r.twist;
    s.x[L::ANVIL_SPEED] = r.speed;
    s.x[L::ANVIL_ANGLE] = from[L::ANVIL_ANGLE] + (r.twist - from[L::TWIST]);
}

// Interpolant of a flight, of third order; of fifth order for an angle, through its acceleration at
// both ends, and its derivative for the angle's speed
template <class L>
VGROOVE_INLINE void flight_dense(ImpactSolver<L> &self, double h, int angle, int speed) {
    ImpactStep<L> &t = self.step;
    const double d2 = t.dense_2.x[angle], d3 = t.dense_3.x[angle];
    const double from = 0.5 * h * h * self.slope.x[speed] + d2 - d3,
                 to = 0.5 * h * h * t.end_slope.x[speed] + d2 + 2.0 * d3;
    t.dense_4.x[angle] = from;
    t.dense_5.x[angle] = to - from;
    t.dense_4.x[speed] = 5.0 / h * t.dense_5.x[angle];
}

// Computes the coefficients of the interpolant of a tried step of length h, unless they are there.
template <class L> VGROOVE_CLONES_APART void impact_interpolate(ImpactSolver<L> &self, double h) {
    ImpactStep<L> &t = self.step;
    if (t.dense_ready)
        return;
    t.dense_ready = true;
    if (t.by_series)
        return;
    for (int n = 0; n < L::COUNT; ++n) {
        const double k1 = self.slope.x[n];
        t.dense_1.x[n] = t.end.x[n] - self.state.x[n];
        t.dense_2.x[n] = h * k1 - t.dense_1.x[n];
        t.dense_3.x[n] = t.dense_1.x[n] - h * t.end_slope.x[n] - t.dense_2.x[n];
    }
    t.dense_4 = t.dense_5 = ImpactState<L>{};
    if (t.coupled)
        return;
    if (t.flight) {
        flight_dense(self, h, STATE_ANGLE, STATE_SPEED);
        flight_dense(self, h, L::HAMMER_ANGLE, L::HAMMER_SPEED);
        return;
    }
    for (int n = 0; n < L::COUNT; ++n)
        t.dense_4.x[n] =
            h * weighted_slopes<double>(DormandPrince::DENSE, self.slope.x[n], t.slopes.k3.x[n],
                                        t.slopes.k4.x[n], t.slopes.k5.x[n], t.slopes.k6.x[n],
                                        t.end_slope.x[n]);
}

// State at t after the start of a series
template <class L>
VGROOVE_CLONES_APART ImpactState<L> impact_series_at(const ImpactSeries<L> &p, double t) {
    using Series = ImpactSeries<L>;
    ImpactState<L> s = p.c[SERIES_SLOW];
    for (int n = Series::FAST_FROM; n < Series::FAST_TO; ++n)
        s.x[n] = p.c[SERIES_ORDER].x[n];
    for (int k = SERIES_ORDER - 1; k >= SERIES_SLOW; --k)
        for (int n = Series::FAST_FROM; n < Series::FAST_TO; ++n)
            s.x[n] = s.x[n] * t + p.c[k].x[n];
    for (int k = SERIES_SLOW - 1; k >= 0; --k)
        for (int n = 0; n < L::COUNT; ++n)
            s.x[n] = s.x[n] * t + p.c[k].x[n];
    return s;
}

// Component n at a share of the step
template <class L>
VGROOVE_INLINE double impact_component(const ImpactStep<L> &t, const ImpactState<L> &from,
                                       double share, int n) {
    if (t.by_series) {
        const int order = ImpactSeries<L>::order(n);
        double x = t.series.c[order].x[n];
        for (int k = order - 1; k >= 0; --k)
            x = x * (share * t.h) + t.series.c[k].x[n];
        return x;
    }
    const double rest = 1.0 - share;
    return from.x[n] +
           share * (t.dense_1.x[n] +
                    rest * (t.dense_2.x[n] +
                            share * (t.dense_3.x[n] +
                                     rest * (t.dense_4.x[n] + share * t.dense_5.x[n]))));
}

// State at a share of the tried step
template <class L>
VGROOVE_INLINE ImpactState<L> impact_between(const ImpactSolver<L> &self, double share) {
    if (self.step.by_series)
        return impact_series_at<L>(self.step.series, share * self.step.h);
    ImpactState<L> s;
    for (int n = 0; n < L::COUNT; ++n)
        s.x[n] = impact_component(self.step, self.state, share, n);
    if (!L::EXACT && self.mode.ringing)
        anvil_ring(self, share * self.step.h, s);
    return s;
}

// State at the present instant
template <class L> VGROOVE_INLINE ImpactState<L> impact_present(ImpactSolver<L> &self) {
    if (!self.pending)
        return self.state;
    impact_interpolate(self, self.step.h);
    return impact_between(self, self.elapsed_s / self.step.h);
}

// One component of the state at the present instant; not of a ringing anvil
template <class L> VGROOVE_INLINE double impact_present_of(ImpactSolver<L> &self, int n) {
    if (!self.pending)
        return self.state.x[n];
    impact_interpolate(self, self.step.h);
    return impact_component(self.step, self.state, self.elapsed_s / self.step.h, n);
}

}  // namespace vgroove

#endif
