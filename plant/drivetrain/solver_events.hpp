// Events of the drivetrain: a body comes to rest or breaks away, the diodes block or conduct. How
// they are met, located and what they change.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SOLVER_EVENTS_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SOLVER_EVENTS_HPP

#include "drivetrain/solver_state.hpp"

namespace vgroove {

template <class V> VGROOVE_INLINE double event_value(const Events<V> &g, int event, int lane) {
    return event == EVENT_SHAFT
               ? get(g.shaft, lane)
               : (event == EVENT_OUTPUT ? get(g.output, lane) : get(g.diode, lane));
}

// Size of an event function at which the event counts as reached
template <class V, int N>
VGROOVE_INLINE double event_tolerance(const Solver<V, N> &self, int event, int lane) {
    const double slide =
        event == EVENT_SHAFT ? get(self.mode.slide, lane) : get(self.mode.output_slide, lane);
    const double diode = get(self.mode.diode, lane);
    if (event == EVENT_DIODE)
        return SOLVER_EVENT_VALUE * (diode == 0.0 ? get(self.model.supply.open_circuit_v, lane)
                                                  : get(self.model.current_scale, lane));
    return SOLVER_EVENT_VALUE *
           (slide == 0.0 ? get(self.model.torque_scale, lane) : get(self.model.speed_scale, lane));
}

// Decides whether a body at rest sticks, or which way it slides.
template <class V, int N>
VGROOVE_INLINE void solver_rest(Solver<V, N> &self, int lane, bool shaft, bool output) {
    if (shaft) {
        set(self.mode.slide, lane, 0.0);
        set(self.state.x[STATE_SPEED], lane, 0.0);
    }
    if constexpr (N > STATE_TWIST) {
        if (output) {
            set(self.mode.output_slide, lane, 0.0);
            set(self.state.x[STATE_OUTPUT_SPEED], lane, 0.0);
        }
    }
    const Events<V> g = drivetrain_guards<V, N>(self.model, self.drive, self.mode, V{}, self.state);
    if (shaft)
        set(self.mode.slide, lane, sign_of(get(g.excess, lane)));
    if (output)
        set(self.mode.output_slide, lane, sign_of(get(g.output_excess, lane)));
}

// Conducting diodes have carried the current to 0 and block; blocking ones conduct because the
// back-EMF has exceeded the bus.
template <class V, int N> VGROOVE_INLINE void solver_diode(Solver<V, N> &self, int lane) {
    if (get(self.mode.diode, lane) != 0.0) {
        set(self.mode.diode, lane, 0.0);
        set(self.state.x[STATE_CURRENT], lane, 0.0);
    } else {
        set(self.mode.diode, lane, -sign_of(get(self.state.x[STATE_SPEED], lane)));
    }
}

// Narrows the bracket of an event after a trial step of length h; `met`: the event within the trial
// step, or EVENT_NONE. True once the trial step ends at the event.
template <class V, int N>
VGROOVE_INLINE bool solver_locate(Solver<V, N> &self, const Events<V> &before,
                                  const Events<V> &after, int lane, int met, double h) {
    EventSearch &search = self.search[lane];
    EventBracket &at = search.bracket;
    if (met != EVENT_NONE) {
        if (search.target != met) {
            search = EventSearch{};
            search.target = met;
            at.value_low = event_value(before, met, lane);
            at.value_low = at.value_low < 0.0 ? 0.0 : at.value_low;
        } else {
            at.value_low *= 0.5;
        }
        at.high_s = h;
        at.value_high = event_value(after, met, lane);
    } else {
        at.low_s = h;
        at.value_low = event_value(after, search.target, lane);
        at.value_high *= 0.5;
    }
    ++at.repeats;
    const double width = at.high_s - at.low_s;
    const bool exact = met != EVENT_NONE && -at.value_high <= event_tolerance(self, met, lane);
    const bool narrow =
        met != EVENT_NONE && (width <= SOLVER_EVENT_S || at.repeats > SOLVER_LOCATE_MAX);
    if (exact || narrow || self.events[lane] > SOLVER_EVENTS_MAX)
        return met != EVENT_NONE;
    self.next_s[lane] =
        met == EVENT_NONE && width <= SOLVER_EVENT_S ? at.high_s : illinois_trial(at);
    return false;
}

// The event to locate among those met: the one that is searched for, else the first of the list
VGROOVE_INLINE int first_event(double shaft, double output, double diode, int target) {
    const bool met[EVENT_COUNT] = {shaft < 0.0, output < 0.0, diode < 0.0};
    if (target != EVENT_NONE && met[target])
        return target;
    return met[EVENT_SHAFT]
               ? EVENT_SHAFT
               : (met[EVENT_OUTPUT] ? EVENT_OUTPUT : (met[EVENT_DIODE] ? EVENT_DIODE : EVENT_NONE));
}

template <class V> VGROOVE_INLINE bool any_event(const Events<V> &g) {
    bool any = false;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        any = any || get(g.shaft, lane) < 0.0 || get(g.output, lane) < 0.0 ||
              get(g.diode, lane) < 0.0;
    return any;
}

// Whether every lane slides with a closed bridge: then the only event is a change of sign of a
// speed, which needs no torque.
template <class V, int N> VGROOVE_INLINE bool solver_all_slide(const Solver<V, N> &self) {
    const bool split = N > STATE_TWIST && (self.model.effects & EFFECT_TWO_BODIES);
    bool all = true;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const bool output = !split || get(self.mode.output_slide, lane) != 0.0;
        all =
            all && output && get(self.mode.slide, lane) != 0.0 && get(self.drive.open, lane) == 0.0;
    }
    return all;
}

template <class V, int N>
VGROOVE_INLINE Events<V> solver_events(const Solver<V, N> &self, V h, const State<V, N> &s) {
    if (!solver_all_slide(self))
        return drivetrain_guards<V, N>(self.model, self.drive, self.mode, h, s);
    Events<V> g{};
    g.shaft = self.mode.slide * s.x[STATE_SPEED];
    g.output = splat<V>(1.0);
    g.diode = splat<V>(1.0);
    if constexpr (N > STATE_TWIST)
        if (self.model.effects & EFFECT_TWO_BODIES)
            g.output = self.mode.output_slide * s.x[STATE_OUTPUT_SPEED];
    return g;
}

}  // namespace vgroove

#endif
