// Solver of the drivetrain: steps that are halved and doubled by their local error, and located
// events.
//
// Every lane keeps its own step, so that its result does not depend on the other lanes; a lane that
// has reached the end of its stretch takes steps of length 0, which change nothing. Where the
// drivetrain is linear between events a step is exact at any length.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SOLVER_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SOLVER_HPP

#include "drivetrain/solver_events.hpp"
#include "drivetrain/solver_step.hpp"

namespace vgroove {

template <class V, int N>
VGROOVE_INLINE void solver_accept(Solver<V, N> &self, const Trial<V, N> &a, int lane, double h) {
    for (int n = 0; n < N; ++n) {
        set(self.state.x[n], lane, get(a.state.x[n], lane));
        set(self.slope.x[n], lane, get(a.slope.x[n], lane));
    }
    Drive<V> &d = self.drive;
    set(d.command, lane, get(d.command, lane) + get(d.command_rate, lane) * h);
    set(d.load_nm, lane, get(d.load_nm, lane) + get(d.load_rate, lane) * h);
    set(d.time_s, lane, get(d.time_s, lane) + h);
    const double remaining = self.remaining_s[lane] - h;
    self.remaining_s[lane] = remaining < 1e-3 * SOLVER_EVENT_S ? 0.0 : remaining;
    self.search[lane] = EventSearch{};
}

template <class V, int N> VGROOVE_INLINE void solver_choose_step(Solver<V, N> &self, int lane) {
    const double allowed = get(self.allowed_s, lane);
    const double remaining = self.remaining_s[lane];
    self.next_s[lane] = remaining < 1.0001 * allowed ? remaining : allowed;
}

// One lane's trial step: repeated with half the length where its error is too large, repeated where
// an event in it is being located, else accepted.
template <class V, int N>
VGROOVE_INLINE void solver_judge(Solver<V, N> &self, const Trial<V, N> &a, const Events<V> &before,
                                 const Events<V> &after, int lane) {
    const double h = self.next_s[lane];
    const double allowed = get(self.allowed_s, lane);
    const double error = get(a.error, lane);
    if (!(error <= 1.0) && h > self.least_s[lane]) {
        set(self.allowed_s, lane, 0.5 * (h < allowed ? h : allowed));
        self.search[lane] = EventSearch{};
        solver_choose_step(self, lane);
        return;
    }
    const double shaft = get(after.shaft, lane), output = get(after.output, lane),
                 diode = get(after.diode, lane);
    const int met = first_event(shaft, output, diode, self.search[lane].target);
    const bool searching = met != EVENT_NONE || self.search[lane].target != EVENT_NONE;
    if (searching && !solver_locate(self, before, after, lane, met, h))
        return;
    if (error < SOLVER_GROW_BELOW && h >= allowed)
        set(self.allowed_s, lane, 2.0 * allowed);
    solver_accept(self, a, lane, h);
    self.slope_stale[lane] = met != EVENT_NONE;
    if (met != EVENT_NONE) {
        ++self.events[lane];
        if (diode < 0.0)
            solver_diode(self, lane);
        if (shaft < 0.0 || output < 0.0)
            solver_rest(self, lane, shaft < 0.0, output < 0.0);
    }
    solver_choose_step(self, lane);
}

// Begins a stretch in one lane, whose drive the caller has set: the modes follow the bridge, and
// for a body at rest it is decided whether it sticks.
template <class V, int N>
VGROOVE_INLINE void solver_begin(Solver<V, N> &self, int lane, double length_s) {
    self.remaining_s[lane] = length_s;
    self.least_s[lane] = SOLVER_STEP_MIN * length_s;
    self.events[lane] = 0;
    self.search[lane] = EventSearch{};
    self.slope_stale[lane] = true;
    if (self.exact || self.short_first_step)
        set(self.allowed_s, lane, SOLVER_EXACT_SHARE * length_s);
    else if (!(get(self.allowed_s, lane) <= length_s))
        set(self.allowed_s, lane, length_s);
    const bool open = get(self.drive.open, lane) > 0.0;
    if (!open)
        set(self.mode.diode, lane, 0.0);
    else if (get(self.mode.diode, lane) == 0.0)
        set(self.mode.diode, lane, sign_of(get(self.state.x[STATE_CURRENT], lane)));
    bool output = false;
    if constexpr (N > STATE_TWIST)
        output = (self.model.effects & EFFECT_TWO_BODIES) != 0u &&
                 get(self.state.x[STATE_OUTPUT_SPEED], lane) == 0.0;
    const bool shaft = get(self.state.x[STATE_SPEED], lane) == 0.0;
    if (shaft || output)
        solver_rest(self, lane, shaft, output);
    solver_choose_step(self, lane);
}

// Runs until every lane is at the end of its stretch and next_stretch(lane) begins no other one.
// EXACT: the drivetrain is linear between events.
template <bool EXACT, class V, int N, class NextStretch>
VGROOVE_INLINE void solver_run(Solver<V, N> &self, NextStretch &&next_stretch) {
    for (;;) {
        bool busy = false;
        V h{};
        for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
            while (self.remaining_s[lane] <= 0.0 && next_stretch(lane)) {
            }
            self.next_s[lane] = self.remaining_s[lane] > 0.0 ? self.next_s[lane] : 0.0;
            busy = busy || self.next_s[lane] > 0.0;
            set(h, lane, self.next_s[lane]);
        }
        if (!busy)
            return;
        const Trial<V, N> a = solver_step<EXACT>(self, h);
        const Events<V> after = solver_events<V, N>(self, h, a.state);
        Events<V> before;  // used where an event has been met
        if (any_event(after))
            before = drivetrain_guards<V, N>(self.model, self.drive, self.mode, V{}, self.state);
        for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
            if (self.next_s[lane] > 0.0 && solver_spend_step(self, lane))
                solver_judge(self, a, before, after, lane);
    }
}

}  // namespace vgroove

#endif
