// Location of events within a trial step of the impact tool.
#ifndef VGROOVE_PLANT_IMPACT_LOCATE_HPP
#define VGROOVE_PLANT_IMPACT_LOCATE_HPP

#include "impact/attempt.hpp"
#include "impact/series_events.hpp"
#include "numeric/event_location.hpp"

namespace vgroove {

// Hammer less anvil, and retraction, at a share of the step: all that the events of free flight
// need
template <class L>
VGROOVE_INLINE double impact_relative_between(const ImpactSolver<L> &self, double share) {
    double anvil = self.state.x[L::ANVIL_ANGLE];
    if (self.mode.ringing)
        anvil += anvil_ringing(self.model, self.state.x[L::TWIST], self.state.x[L::ANVIL_SPEED],
                               share * self.step.h)
                     .twist -
                 self.state.x[L::TWIST];
    else if (!self.mode.frozen)
        anvil = impact_component(self.step, self.state, share, L::ANVIL_ANGLE);
    return impact_component(self.step, self.state, share, L::HAMMER_ANGLE) + self.model.start_rad -
           anvil;
}

template <class L>
VGROOVE_INLINE double impact_retraction_between(const ImpactSolver<L> &self, double share) {
    const double spindle =
        impact_component(self.step, self.state, share, STATE_ANGLE) * self.model.ratio_inverse;
    return v_groove_at(self.model.groove,
                       spindle - impact_component(self.step, self.state, share, L::HAMMER_ANGLE))
        .x;
}

// Event function at a share of the step
template <class L>
VGROOVE_INLINE double impact_value_between(ImpactSolver<L> &self, double h, double share,
                                           int event) {
    if constexpr (!L::EXACT && !L::FULL) {
        if (event == IMPACT_FORWARD)
            return self.mode.forward_rad - impact_relative_between(self, share);
        if (event == IMPACT_BACKWARD)
            return impact_relative_between(self, share) - self.mode.backward_rad;
        if (event == IMPACT_HEIGHT)
            return (self.mode.above ? 1.0 : -1.0) *
                   (impact_retraction_between(self, share) - self.model.lug_height_m);
    }
    const ImpactState<L> s = impact_between(self, share);
    ImpactState<L> ds;
    const bool forces = impact_by_force(self.mode, event);
    const ImpactPoint at =
        forces ? impact_slope(self, share * h, s, ds)
               : impact_kinematics<L>(self.model, self.drive, self.mode, share * h, s);
    return impact_event_value<L>(self.model, self.mode, s, at, event);
}

// Share of the step just past the instant of an event whose function is negative at the point `met`
template <class L>
VGROOVE_INLINE double impact_locate(ImpactSolver<L> &self, double h, int event,
                                    const EventPoint &met, double width_s) {
    return locate_sign_change(
        impact_event_value<L>(self.model, self.mode, self.state, self.point, event), met, h,
        width_s, [&](double share) __attribute__((always_inline)) {
            return impact_value_between(self, h, share, event);
        });
}

// Slope in time of the event functions of free flight; 0 for the others
template <class L>
VGROOVE_INLINE double impact_event_rate(const ImpactSolver<L> &self, const ImpactState<L> &s,
                                        const ImpactPoint &at, int event) {
    const double relative = s.x[L::HAMMER_SPEED] - s.x[L::ANVIL_SPEED];
    switch (event) {
    case IMPACT_FORWARD:
        return -relative;
    case IMPACT_BACKWARD:
        return relative;
    case IMPACT_HEIGHT:
        return self.mode.above ? at.x_rate : -at.x_rate;
    case IMPACT_STOP:
        return -at.x_rate;
    default:
        return 0.0;
    }
}

// Bit of an event whose function has a minimum within the step
template <class L>
VGROOVE_INLINE unsigned impact_turned(const ImpactSolver<L> &self, ImpactEvent event) {
    const double from = impact_event_rate(self, self.state, self.point, event),
                 to = impact_event_rate(self, self.step.end, self.step.end_point, event);
    return (from < 0.0 && to > 0.0 ? 1u : 0u) << event;
}

// Grazing events of free flight: the function has a minimum within the step, so that the event may
// happen although the function is positive at both ends.
template <class L>
VGROOVE_INLINE unsigned impact_grazed(const ImpactSolver<L> &self, unsigned candidates) {
    return (impact_turned(self, IMPACT_FORWARD) | impact_turned(self, IMPACT_BACKWARD) |
            impact_turned(self, IMPACT_HEIGHT) | impact_turned(self, IMPACT_STOP)) &
           candidates;
}

// Share of the tried step at which an event happens. met: its function is negative at the end of
// the step; else its minimum is examined. A negative result: the event does not happen.
template <class L>
VGROOVE_INLINE double impact_instant(ImpactSolver<L> &self, double h, int event, bool met,
                                     double width_s) {
    EventPoint at{1.0, impact_event_value<L>(self.model, self.mode, self.step.end,
                                             self.step.end_point, event)};
    if constexpr (!L::EXACT) {
        EventSum sum;
        if (self.step.by_series && series_event_sum<L>(self, event, sum)) {
            const double from =
                impact_event_value<L>(self.model, self.mode, self.state, self.point, event);
            return series_instant<L>(self, sum, from, at.value, width_s) / h;
        }
    }
    if (!met) {
        const double from = impact_event_rate(self, self.state, self.point, event);
        at.share =
            from / (from - impact_event_rate(self, self.step.end, self.step.end_point, event));
        at.value = impact_value_between(self, h, at.share, event);
        if (at.value >= 0.0)
            return -1.0;
    }
    return impact_locate(self, h, event, at, width_s);
}

// The earliest event of the tried step among `met` and `turned` (grazing), as bits, and its share
// of the step; -1: none
template <class L>
VGROOVE_CLONES_APART int impact_earliest_event(ImpactSolver<L> &self, double h, unsigned met,
                                               unsigned turned, double width_s, double &share) {
    impact_interpolate(self, h);
    int event = -1;
    share = 1.0;
    for (unsigned left = met | turned; left != 0u; left &= left - 1u) {
        const int candidate = __builtin_ctz(left);
        const double found =
            impact_instant(self, h, candidate, (met & (1u << candidate)) != 0u, width_s);
        if (found >= 0.0 && (event < 0 || found < share)) {
            event = candidate;
            share = found;
        }
    }
    return event;
}

}  // namespace vgroove

#endif
