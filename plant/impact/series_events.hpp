// Fast mode: events within a step of the Taylor series, as zeros of polynomials of time.
#ifndef VGROOVE_PLANT_IMPACT_SERIES_EVENTS_HPP
#define VGROOVE_PLANT_IMPACT_SERIES_EVENTS_HPP

#include "impact/series.hpp"

namespace vgroove {

// Event function as a weighted sum of states
struct EventSum {
    double relative, rate, twist, anvil_speed;  // relative: hammer less anvil
};

// Weights of an event function; false where it is not such a sum
template <class L>
VGROOVE_INLINE bool series_event_sum(const ImpactSolver<L> &self, int event, EventSum &f) {
    const ImpactMode &mode = self.mode;
    const Joint &j = self.model.joint;
    const double arm =
        mode.place == ContactPlace::BACKWARD ? -self.model.lug_radius_m : self.model.lug_radius_m;
    f = EventSum{};
    switch (event) {
    case IMPACT_FORWARD:
        f.relative = -1.0;
        return true;
    case IMPACT_BACKWARD:
        f.relative = 1.0;
        return true;
    case IMPACT_LEAVE:
        f.relative = arm;
        return true;
    case IMPACT_RAMP:
        f.relative = mode.ramped ? arm : -arm;
        return true;
    case IMPACT_TURN:
        f.rate = mode.approaching ? arm : -arm;
        return true;
    case IMPACT_SLIP_FORWARD:
    case IMPACT_SLIP_BACKWARD:
        f.twist = event == IMPACT_SLIP_FORWARD ? -j.stiffness : j.stiffness;
        f.anvil_speed = event == IMPACT_SLIP_FORWARD ? -j.damping : j.damping;
        return true;
    default:
        return false;
    }
}

template <class L> VGROOVE_INLINE double event_sum_of(const EventSum &f, const ImpactState<L> &c) {
    return (f.relative * (c.x[L::HAMMER_ANGLE] - c.x[L::ANVIL_ANGLE]) +
            f.rate * (c.x[L::HAMMER_SPEED] - c.x[L::ANVIL_SPEED])) +
           (f.twist * c.x[L::TWIST] + f.anvil_speed * c.x[L::ANVIL_SPEED]);
}

// Instant of an event within the step: the function is negative at the end, or its minimum is. A
// negative result: the event is not met.
template <class L>
VGROOVE_INLINE double series_instant(const ImpactSolver<L> &self, const EventSum &f,
                                     double at_start, double at_end, double width_s) {
    const ImpactStep<L> &t = self.step;
    Polynomial<SERIES_ORDER> p;
    p.c[0] = at_start;
    for (int k = 1; k <= SERIES_ORDER; ++k)
        p.c[k] = event_sum_of<L>(f, t.series.c[k]);
    if (at_end < 0.0)
        return polynomial_zero(p, t.h, at_end, width_s);
    const double least = polynomial_minimum(p, t.h), value = polynomial_at(p, least).value;
    return value < 0.0 ? polynomial_zero(p, least, value, width_s) : -1.0;
}

// Events of contact and joint whose function has a minimum within the step, so that they may happen
// although the function is positive at both ends
template <class L>
VGROOVE_INLINE unsigned series_grazed(const ImpactSolver<L> &self, unsigned candidates) {
    const ImpactStep<L> &t = self.step;
    const Joint &j = self.model.joint;
    const double arm = self.mode.place == ContactPlace::BACKWARD ? -1.0 : 1.0,
                 way = self.mode.approaching ? arm : -arm;
    const double from = way * (self.slope.x[L::HAMMER_SPEED] - self.slope.x[L::ANVIL_SPEED]);
    const double to = way * (t.end_slope.x[L::HAMMER_SPEED] - t.end_slope.x[L::ANVIL_SPEED]);
    const double torque_from =
        j.stiffness * self.slope.x[L::TWIST] + j.damping * self.slope.x[L::ANVIL_SPEED];
    const double torque_to =
        j.stiffness * t.end_slope.x[L::TWIST] + j.damping * t.end_slope.x[L::ANVIL_SPEED];
    unsigned turned = 0u;
    if (self.point.pen_rate < 0.0 && t.end_point.pen_rate > 0.0)
        turned |= impact_bit(IMPACT_LEAVE);
    if (from < 0.0 && to > 0.0)
        turned |= impact_bit(IMPACT_TURN);
    if (torque_from > 0.0 && torque_to < 0.0)
        turned |= impact_bit(IMPACT_SLIP_FORWARD);
    if (torque_from < 0.0 && torque_to > 0.0)
        turned |= impact_bit(IMPACT_SLIP_BACKWARD);
    return turned & candidates;
}

}  // namespace vgroove

#endif
