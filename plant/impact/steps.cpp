// Steps of the impact tool's solver, compiled for each layout of the state: step length, trials,
// events, and steps that reach beyond the present instant.
#include <stdexcept>

#include "impact/fixed_steps.hpp"

namespace vgroove {

// Events are located within these: L::EXACT, and otherwise.
constexpr double EVENT_WIDTH_EXACT_S = 1e-12, EVENT_WIDTH_S = 1e-9;

// Adapts the step length to the error of the tried step; a step that was shortened by the end of
// the stretch does not reduce it.
template <class L>
VGROOVE_CLONES_APART void impact_adapt(ImpactSolver<L> &self, double h, double factor,
                                       bool has_event) {
    const double allowed =
        min_of(h * min_of(factor, 5.0), self.step.flight ? IMPACT_FLIGHT_MAX_S : IMPACT_STEP_MAX_S);
    if (self.step.by_series) {
        self.series_s = factor < SERIES_FREE ? h * factor : IMPACT_NO_HORIZON_S;
        self.allowed_s = SERIES_NEXT_S;
        return;
    }
    const bool cut = h < 0.99 * self.allowed_s;
    const bool kept =
        self.step.flight && allowed > h && allowed < 1.25 * h;  // equal steps keep FlightWeights
    if (!has_event && !kept && (!cut || allowed > self.allowed_s))
        self.allowed_s = allowed;
}

// Length of the next step: what the error allows; equal steps up to a horizon that is near
template <class L> VGROOVE_INLINE double impact_length(const ImpactSolver<L> &self) {
    double allowed = self.allowed_s;
    if constexpr (!L::EXACT)
        allowed =
            min_of(allowed, min_of(self.step.by_series ? IMPACT_STEP_MAX_S : ring_longest(self),
                                   flight_longest(self)));
    else
        allowed = min_of(allowed, IMPACT_STEP_MAX_S);
    if (self.horizon_s > 1e3 * allowed || self.horizon_s <= IMPACT_SAME_S)
        return allowed;
    const double pieces = std::ceil(self.horizon_s / allowed - 1e-6);
    return pieces > 1.0 ? self.horizon_s / pieces : self.horizon_s;
}

// L::EXACT: tries a step that ends at the instant of the event. Rounding may leave the event
// function at 0 or above there: the step is then longer, by a length that doubles, up to the step
// in which the event was found.
template <class L> VGROOVE_INLINE void impact_reach_event(ImpactSolver<L> &self) {
    const int event = self.step.event;
    const double whole = self.step.h;
    double h = whole * self.step.share;
    for (double more = EVENT_WIDTH_EXACT_S;; more *= 2.0) {
        impact_attempt(self, h);
        const bool met = impact_event_value<L>(self.model, self.mode, self.step.end,
                                               self.step.end_point, event) < 0.0;
        if (met)
            self.step.event = event;
        if (met || h >= whole)
            return;
        h = min_of(h + more, whole);
    }
}

// Whether the hammer, without contact, rises above the lugs or comes down into a gap within the
// tried step: no force changes then, and the whole step is valid.
template <class L> VGROOVE_INLINE bool impact_passes_lug_height(const ImpactSolver<L> &self) {
    const Impact &m = self.model;
    if (self.mode.place != ContactPlace::NONE || self.step.end_point.x >= m.travel_m)
        return false;
    if (!self.mode.above)
        return true;
    const double from = impact_relative<L>(m, self.state),
                 to = impact_relative<L>(m, self.step.end);
    return impact_lap(m, from) > m.overlap_rad &&
           std::floor(from / m.period_rad) == std::floor(to / m.period_rad) &&
           impact_lap(m, to) > m.overlap_rad;
}

// The first event of the tried step, and its share of it
template <class L> VGROOVE_INLINE void impact_find_event(ImpactSolver<L> &self, double h) {
    ImpactStep<L> &t = self.step;
    const unsigned possible = impact_events_possible(self.model, self.mode, self.drive);
    const unsigned met = impact_events_met<L>(self.model, self.mode, possible, t.end, t.end_point);
    unsigned turned = impact_grazed(self, possible & ~met);
    if constexpr (!L::EXACT)
        if (t.by_series)
            turned |= series_grazed(self, possible & ~met);
    if (!L::EXACT && met == impact_bit(IMPACT_HEIGHT) && turned == 0u &&
        impact_passes_lug_height(self))
        t.event = IMPACT_HEIGHT;
    else if ((met | turned) != 0u)
        t.event = impact_earliest_event(self, h, met, turned,
                                        L::EXACT ? EVENT_WIDTH_EXACT_S : EVENT_WIDTH_S, t.share);
}

// Prepares a step: slope and point, fast mode's ringing anvil and Taylor series
template <class L> VGROOVE_INLINE void impact_prepare(ImpactSolver<L> &self) {
    if (self.slope_stale)
        impact_refresh(self);
    self.step.by_series = false;
    if constexpr (!L::EXACT)
        ring_begin(self);
    if (!series_applies(self))
        return;
    self.step.by_series = true;
    series_expand(self);
    self.allowed_s = min_of(series_longest(self), self.series_s);
}

// Tries steps until the error of one is small enough, and finds its first event.
template <class L> VGROOVE_CLONES_APART void impact_try_step(ImpactSolver<L> &self) {
    ImpactStep<L> &t = self.step;
    impact_prepare(self);
    for (;;) {
        const double h = impact_length(self);
        const double factor = impact_attempt(self, h);
        if (t.error <= 1.0 && (L::EXACT || !ring_contact_missed(self, h))) {
            impact_find_event(self, h);
            impact_adapt(self, h, factor, t.share != 1.0);
            if (L::EXACT && t.event >= 0)
                impact_reach_event(self);
            return;
        }
        self.allowed_s = t.error <= 1.0 ? RING_STEP / std::sqrt(self.model.ring_square)
                                        : h * min_of(max_of(factor, 0.2), 0.9);
        self.stats.rejected += 1.0;
        if (!(h > IMPACT_STEP_MIN_S))
            throw std::runtime_error("impact mechanism: the state is no longer finite");
    }
}

// Steps that end with the stretch
template <class L> VGROOVE_INLINE void impact_run_adaptive(ImpactSolver<L> &self, double length_s) {
    self.horizon_s = length_s;
    while (self.horizon_s > 0.0) {
        impact_try_step(self);
        const double h = self.step.h * self.step.share;
        self.horizon_s = self.step.share == 1.0 && h >= self.horizon_s - IMPACT_SAME_S
                             ? 0.0
                             : self.horizon_s - h;
        impact_accept(self, self.step.share, self.step.event);
    }
}

// Steps of which the last may reach beyond the stretch
template <class L> VGROOVE_INLINE void impact_run_ahead(ImpactSolver<L> &self, double length_s) {
    double to = self.elapsed_s + length_s;
    for (;;) {
        if (!self.pending)
            impact_try_step(self);
        self.pending = true;
        const double reach = self.step.h * self.step.share;
        if (to <= reach + IMPACT_SAME_S) {
            self.elapsed_s = min_of(to, reach);
            return;
        }
        to -= reach;
        self.horizon_s -= reach;
        self.pending = false;
        impact_accept(self, self.step.share, self.step.event);
    }
}

template <class L> void impact_truncate(ImpactSolver<L> &self) {
    if (!self.pending)
        return;
    self.pending = false;
    const bool whole = self.elapsed_s >= self.step.h * self.step.share - IMPACT_SAME_S;
    self.horizon_s -= self.elapsed_s;
    if (whole)
        impact_accept(self, self.step.share, self.step.event);
    else if (self.elapsed_s > 0.0)
        impact_accept(self, self.elapsed_s / self.step.h, -1);
    self.slope_stale = self.slope_stale || !whole;
    self.elapsed_s = 0.0;
}

template <class L> void impact_run(ImpactSolver<L> &self, double length_s) {
    if (L::EXACT)
        impact_run_adaptive(self, length_s);
    else if (self.fixed_s > 0.0)
        impact_run_fixed(self, length_s);
    else
        impact_run_ahead(self, length_s);
}

template void impact_run<FastLayout>(ImpactSolver<FastLayout> &, double);
template void impact_run<FullLayout>(ImpactSolver<FullLayout> &, double);
template void impact_run<AuditLayout>(ImpactSolver<AuditLayout> &, double);
template void impact_refresh<FastLayout>(ImpactSolver<FastLayout> &);
template void impact_refresh<FullLayout>(ImpactSolver<FullLayout> &);
template void impact_refresh<AuditLayout>(ImpactSolver<AuditLayout> &);
template void impact_truncate<FastLayout>(ImpactSolver<FastLayout> &);
template void impact_truncate<FullLayout>(ImpactSolver<FullLayout> &);
template void impact_truncate<AuditLayout>(ImpactSolver<AuditLayout> &);

}  // namespace vgroove
