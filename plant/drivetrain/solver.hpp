// Solver: embedded Runge-Kutta 5(4) of Dormand and Prince (J. Comp. Appl. Math. 6, 1980) with
// halved and doubled steps and located events.
//
// Every lane keeps its own step, so that its result does not depend on its neighbours; a lane that
// waits takes steps of length 0, which change nothing. Where the drivetrain is linear between
// events a step is exact at any length. An event (a body stops or breaks away, the diodes block) is
// found by repeating the step with the Illinois method.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SOLVER_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SOLVER_HPP

#include "drivetrain/flow.hpp"
#include "drivetrain/model.hpp"
#include "drivetrain/stiff_step.hpp"

namespace vgroove {

constexpr double SOLVER_TOLERANCE = 2e-6;  // local error over the scale of the state
constexpr double SOLVER_TOLERANCE_CONTACT =
    1e-7;  // where flanks meet: an error there grows with every bounce
constexpr double SOLVER_GROW_BELOW =
    0.02;  // of the tolerance: the error grows by 2^5 when the step doubles
constexpr double SOLVER_EVENT_S = 1e-10;           // events are located to this time
constexpr double SOLVER_STEP_MIN = 1.0 / 65536.0;  // of the stretch
constexpr double SOLVER_DOUBT =
    2e-7;  // of the current scale: doubt about a ramp behind a supply resistance that is let pass
constexpr double SOLVER_EXACT_SHARE =
    0.0625;  // first step of an exact stretch, doubled after: where events are looked for
constexpr int SOLVER_LOCATE_MAX = 60;            // repeats for one event
constexpr double SOLVER_STEPS_ROW = 1000.0;      // a run may take so many steps a row,
constexpr double SOLVER_STEPS_SECOND = 50000.0;  // so many a second of a row,
constexpr double SOLVER_STEPS_SAVED = 200000.0;  // and save so many for rows that need more
constexpr int SOLVER_EVENTS_MAX =
    400;  // located events per stretch; later ones are taken at the end of their step

enum EventIndex { EVENT_NONE = -1, EVENT_SHAFT, EVENT_OUTPUT, EVENT_DIODE, EVENT_COUNT };

struct Locating {
    int target = EVENT_NONE;
    int repeats = 0;
    double low_s = 0.0, high_s = 0.0, g_low = 0.0, g_high = 0.0;
};

template <class V, int N> struct Solver {
    Drivetrain<V> model;
    State<V, N> state;
    State<V, N> slope;  // derivative at the start of the next step
    Mode<V> mode;
    Drive<V> drive;  // at the start of the next step
    V level_s;       // step that the error allows
    double left_s[LaneTraits<V>::COUNT];
    double floor_s[LaneTraits<V>::COUNT];
    double next_s[LaneTraits<V>::COUNT];  // step to try; 0 waits
    bool fresh[LaneTraits<V>::COUNT];     // slope must be computed anew
    int events[LaneTraits<V>::COUNT];
    Locating locating[LaneTraits<V>::COUNT];
    double credit[LaneTraits<V>::COUNT];  // steps that the lane may still take
    bool spent[LaneTraits<V>::COUNT];     // it has taken them all and stands still
    double error_scale;                   // 1 / tolerance of the local error
    bool careful;  // a tolerance was asked for: events are looked for as in exact stretches
    bool exact;    // linear between events: flow.hpp instead of Runge-Kutta
};

constexpr double TINY = 1e-60;  // A, rad/s, V, K

// What decays towards 0 ends there: subnormal numbers would make every later step several times as
// slow.
template <class V, int N> VGROOVE_INLINE void flush_tiny(State<V, N> &s) {
    for (int n = 0; n < N; ++n)
        s.x[n] = abs_of<V>(s.x[n]) < TINY ? V{} : s.x[n];
}

// tolerance: local error of a step over the scale of the state; 0: the usual one.
template <class V, int N> VGROOVE_INLINE void solver_prepare(Solver<V, N> &self, double tolerance) {
    const double usual =
        self.model.effects & EFFECT_TWO_BODIES ? SOLVER_TOLERANCE_CONTACT : SOLVER_TOLERANCE;
    self.careful = tolerance > 0.0;
    self.error_scale = 1.0 / (tolerance > 0.0 ? tolerance : usual);
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        self.credit[lane] = SOLVER_STEPS_SAVED;
}

template <class V, int N>
VGROOVE_INLINE void solver_earn(Solver<V, N> &self, int lane, int rows, double seconds) {
    const double credit =
        self.credit[lane] + SOLVER_STEPS_ROW * rows + SOLVER_STEPS_SECOND * seconds;
    self.credit[lane] = credit < SOLVER_STEPS_SAVED ? credit : SOLVER_STEPS_SAVED;
}

template <class V, int N> struct Attempt {
    State<V, N> state, slope;
    V error;  // largest local error over tolerance
};

template <class V, int N>
VGROOVE_INLINE V solver_error(const Drivetrain<V> &m, V h, const State<V, N> &e,
                              double error_scale) {
    V worst = abs_of<V>(e.x[STATE_SPEED]) / m.speed_scale;
    if (m.input != InputKind::CURRENT)
        worst = max_of<V>(worst, abs_of<V>(e.x[STATE_CURRENT]) / m.current_scale);
    if constexpr (N > STATE_TWIST) {
        if (m.effects & EFFECT_TWO_BODIES)
            worst = max_of<V>(worst, abs_of<V>(e.x[STATE_OUTPUT_SPEED]) / m.speed_scale);
        if (m.effects & EFFECT_CURRENT_LAG)
            worst = max_of<V>(worst, abs_of<V>(e.x[STATE_CURRENT_FILTER]) / m.current_scale);
        if (m.effects & EFFECT_SPEED_LAG)
            worst = max_of<V>(worst, abs_of<V>(e.x[STATE_SPEED_FILTER]) / m.speed_scale);
    }
    return abs_of<V>(h) * worst * error_scale;
}

template <class V, int N>
VGROOVE_INLINE Attempt<V, N> solver_attempt(const Solver<V, N> &self, V h) {
    const Drivetrain<V> &m = self.model;
    const State<V, N> &y = self.state;
    const State<V, N> &k1 = self.slope;
    State<V, N> s;
    for (int n = 0; n < N; ++n)
        s.x[n] = y.x[n] + h * (1.0 / 5.0 * k1.x[n]);
    const State<V, N> k2 = drivetrain_derivative<V, N>(m, self.drive, self.mode, 0.2 * h, s);
    for (int n = 0; n < N; ++n)
        s.x[n] = y.x[n] + h * (3.0 / 40.0 * k1.x[n] + 9.0 / 40.0 * k2.x[n]);
    const State<V, N> k3 = drivetrain_derivative<V, N>(m, self.drive, self.mode, 0.3 * h, s);
    for (int n = 0; n < N; ++n)
        s.x[n] =
            y.x[n] + h * (44.0 / 45.0 * k1.x[n] - 56.0 / 15.0 * k2.x[n] + 32.0 / 9.0 * k3.x[n]);
    const State<V, N> k4 = drivetrain_derivative<V, N>(m, self.drive, self.mode, 0.8 * h, s);
    for (int n = 0; n < N; ++n)
        s.x[n] = y.x[n] + h * ((19372.0 / 6561.0 * k1.x[n] - 25360.0 / 2187.0 * k2.x[n]) +
                               (64448.0 / 6561.0 * k3.x[n] - 212.0 / 729.0 * k4.x[n]));
    const State<V, N> k5 = drivetrain_derivative<V, N>(m, self.drive, self.mode, 8.0 / 9.0 * h, s);
    for (int n = 0; n < N; ++n)
        s.x[n] = y.x[n] + h * ((9017.0 / 3168.0 * k1.x[n] - 355.0 / 33.0 * k2.x[n]) +
                               (46732.0 / 5247.0 * k3.x[n] + 49.0 / 176.0 * k4.x[n]) -
                               5103.0 / 18656.0 * k5.x[n]);
    const State<V, N> k6 = drivetrain_derivative<V, N>(m, self.drive, self.mode, h, s);
    Attempt<V, N> a;
    for (int n = 0; n < N; ++n)
        a.state.x[n] = y.x[n] + h * ((35.0 / 384.0 * k1.x[n] + 500.0 / 1113.0 * k3.x[n]) +
                                     (125.0 / 192.0 * k4.x[n] - 2187.0 / 6784.0 * k5.x[n]) +
                                     11.0 / 84.0 * k6.x[n]);
    a.slope = drivetrain_derivative<V, N>(m, self.drive, self.mode, h, a.state);
    for (int n = 0; n < N; ++n)
        s.x[n] = (71.0 / 57600.0 * k1.x[n] - 71.0 / 16695.0 * k3.x[n]) +
                 (71.0 / 1920.0 * k4.x[n] - 17253.0 / 339200.0 * k5.x[n]) +
                 (22.0 / 525.0 * k6.x[n] - 1.0 / 40.0 * a.slope.x[n]);
    a.error = solver_error<V, N>(m, h, s, self.error_scale);
    return a;
}

template <class V> VGROOVE_INLINE double event_value(const Events<V> &g, int event, int lane) {
    return event == EVENT_SHAFT
               ? get(g.shaft, lane)
               : (event == EVENT_OUTPUT ? get(g.output, lane) : get(g.diode, lane));
}

template <class V, int N>
VGROOVE_INLINE double event_tolerance(const Solver<V, N> &self, int event, int lane) {
    const double slide =
        event == EVENT_SHAFT ? get(self.mode.slide, lane) : get(self.mode.output_slide, lane);
    const double diode = get(self.mode.diode, lane);
    if (event == EVENT_DIODE)
        return 1e-10 * (diode == 0.0 ? get(self.model.supply.open_circuit_v, lane)
                                     : get(self.model.current_scale, lane));
    return 1e-10 *
           (slide == 0.0 ? get(self.model.torque_scale, lane) : get(self.model.speed_scale, lane));
}

VGROOVE_INLINE double sign_of(double x) {
    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : 0.0);
}

// A body that has just come to rest, or is asked whether it still rests: sticks, or slides the way
// it is driven.
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
    const Events<V> g = drivetrain_events<V, N>(self.model, self.drive, self.mode, V{}, self.state);
    if (shaft)
        set(self.mode.slide, lane, sign_of(get(g.excess, lane)));
    if (output)
        set(self.mode.output_slide, lane, sign_of(get(g.output_excess, lane)));
}

// The diodes have carried the current to 0 and block, or the back-EMF has passed the bus and they
// conduct again.
template <class V, int N> VGROOVE_INLINE void solver_diode(Solver<V, N> &self, int lane) {
    if (get(self.mode.diode, lane) != 0.0) {
        set(self.mode.diode, lane, 0.0);
        set(self.state.x[STATE_CURRENT], lane, 0.0);
    } else {
        set(self.mode.diode, lane, -sign_of(get(self.state.x[STATE_SPEED], lane)));
    }
}

template <class V, int N>
VGROOVE_INLINE void solver_accept(Solver<V, N> &self, const Attempt<V, N> &a, int lane, double h) {
    for (int n = 0; n < N; ++n) {
        set(self.state.x[n], lane, get(a.state.x[n], lane));
        set(self.slope.x[n], lane, get(a.slope.x[n], lane));
    }
    Drive<V> &d = self.drive;
    set(d.command, lane, get(d.command, lane) + get(d.command_rate, lane) * h);
    set(d.load_nm, lane, get(d.load_nm, lane) + get(d.load_rate, lane) * h);
    set(d.time_s, lane, get(d.time_s, lane) + h);
    const double left = self.left_s[lane] - h;
    self.left_s[lane] = left < 1e-3 * SOLVER_EVENT_S ? 0.0 : left;
    self.locating[lane] = Locating{};
}

template <class V, int N> VGROOVE_INLINE void solver_choose_step(Solver<V, N> &self, int lane) {
    const double level = get(self.level_s, lane);
    const double left = self.left_s[lane];
    self.next_s[lane] = left < 1.0001 * level ? left : level;
}

// Next length to try between the end before the event and the end after it.
VGROOVE_INLINE double illinois_step(const Locating &at) {
    const double width = at.high_s - at.low_s;
    const double guess = at.low_s + width * (at.g_low / (at.g_low - at.g_high));
    const bool inside =
        guess > at.low_s + 1e-3 * width && guess < at.high_s - 1e-6 * width && at.repeats % 8 != 7;
    return inside ? guess : at.low_s + 0.5 * width;
}

// Narrows the bracket of the event that the attempt of length h has met; true once the attempt ends
// at the event.
template <class V, int N>
VGROOVE_INLINE bool solver_locate(Solver<V, N> &self, const Events<V> &before,
                                  const Events<V> &after, int lane, int met, double h) {
    Locating &at = self.locating[lane];
    if (met != EVENT_NONE) {
        if (at.target != met) {
            at = Locating{};
            at.target = met;
            at.g_low = event_value(before, met, lane);
            at.g_low = at.g_low < 0.0 ? 0.0 : at.g_low;
        } else {
            at.g_low *= 0.5;
        }
        at.high_s = h;
        at.g_high = event_value(after, met, lane);
    } else {
        at.low_s = h;
        at.g_low = event_value(after, at.target, lane);
        at.g_high *= 0.5;
    }
    ++at.repeats;
    const bool exact = met != EVENT_NONE && -at.g_high <= event_tolerance(self, met, lane);
    const bool narrow = met != EVENT_NONE &&
                        (at.high_s - at.low_s <= SOLVER_EVENT_S || at.repeats > SOLVER_LOCATE_MAX);
    if (exact || narrow || self.events[lane] > SOLVER_EVENTS_MAX)
        return met != EVENT_NONE;
    self.next_s[lane] =
        met == EVENT_NONE && at.high_s - at.low_s <= SOLVER_EVENT_S ? at.high_s : illinois_step(at);
    return false;
}

VGROOVE_INLINE int first_event(double shaft, double output, double diode, int target) {
    const bool met[EVENT_COUNT] = {shaft < 0.0, output < 0.0, diode < 0.0};
    if (target != EVENT_NONE && met[target])
        return target;
    return met[EVENT_SHAFT]
               ? EVENT_SHAFT
               : (met[EVENT_OUTPUT] ? EVENT_OUTPUT : (met[EVENT_DIODE] ? EVENT_DIODE : EVENT_NONE));
}

// One lane's verdict on the attempt: too coarse, an event to locate, or accepted.
template <class V, int N>
VGROOVE_INLINE void solver_judge(Solver<V, N> &self, const Attempt<V, N> &a,
                                 const Events<V> &before, const Events<V> &after, int lane) {
    const double h = self.next_s[lane];
    const double level = get(self.level_s, lane);
    const double error = get(a.error, lane);
    if (!(error <= 1.0) && h > self.floor_s[lane]) {
        set(self.level_s, lane, 0.5 * (h < level ? h : level));
        self.locating[lane] = Locating{};
        solver_choose_step(self, lane);
        return;
    }
    const double shaft = get(after.shaft, lane), output = get(after.output, lane),
                 diode = get(after.diode, lane);
    const int met = first_event(shaft, output, diode, self.locating[lane].target);
    const bool searching = met != EVENT_NONE || self.locating[lane].target != EVENT_NONE;
    if (searching && !solver_locate(self, before, after, lane, met, h))
        return;
    if (error < SOLVER_GROW_BELOW && h >= level)
        set(self.level_s, lane, 2.0 * level);
    solver_accept(self, a, lane, h);
    self.fresh[lane] = met != EVENT_NONE;
    if (met != EVENT_NONE) {
        ++self.events[lane];
        if (diode < 0.0)
            solver_diode(self, lane);
        if (shaft < 0.0 || output < 0.0)
            solver_rest(self, lane, shaft < 0.0, output < 0.0);
    }
    solver_choose_step(self, lane);
}

template <class V, int N> VGROOVE_INLINE void solver_refresh(Solver<V, N> &self) {
    bool any = false;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        any = any || self.fresh[lane];
    if (!any)
        return;
    const State<V, N> slope =
        drivetrain_derivative<V, N>(self.model, self.drive, self.mode, V{}, self.state);
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        if (!self.fresh[lane])
            continue;
        for (int n = 0; n < N; ++n)
            set(self.slope.x[n], lane, get(slope.x[n], lane));
        self.fresh[lane] = false;
    }
}

// A new stretch for one lane: its drive is set, its modes follow (bridge opens or closes, resting
// bodies are asked again).
template <class V, int N>
VGROOVE_INLINE void solver_begin(Solver<V, N> &self, int lane, double length_s) {
    self.left_s[lane] = length_s;
    self.floor_s[lane] = SOLVER_STEP_MIN * length_s;
    self.events[lane] = 0;
    self.locating[lane] = Locating{};
    self.fresh[lane] = true;
    if (self.exact || self.careful)
        set(self.level_s, lane, SOLVER_EXACT_SHARE * length_s);
    else if (!(get(self.level_s, lane) <= length_s))
        set(self.level_s, lane, length_s);
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

template <class V> VGROOVE_INLINE bool solver_any_event(const Events<V> &g) {
    bool any = false;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        any = any || get(g.shaft, lane) < 0.0 || get(g.output, lane) < 0.0 ||
              get(g.diode, lane) < 0.0;
    return any;
}

// While every lane slides and its bridge is closed, the only event is a change of sign of a speed:
// no torque is needed to see it.
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
        return drivetrain_events<V, N>(self.model, self.drive, self.mode, h, s);
    Events<V> g{};
    g.shaft = self.mode.slide * s.x[STATE_SPEED];
    g.output = splat<V>(1.0);
    g.diode = splat<V>(1.0);
    if constexpr (N > STATE_TWIST)
        if (self.model.effects & EFFECT_TWO_BODIES)
            g.output = self.mode.output_slide * s.x[STATE_OUTPUT_SPEED];
    return g;
}

template <class V, int N>
VGROOVE_INLINE Attempt<V, N> solver_attempt_stiff(const Solver<V, N> &self, const Rates<V> &rates,
                                                  V h) {
    const StiffStep<V, N> end =
        stiff_step<V, N>(self.model, self.drive, self.mode, rates, h, self.state, self.slope);
    Attempt<V, N> a;
    a.state = end.state;
    a.slope = drivetrain_derivative<V, N>(self.model, self.drive, self.mode, h, a.state);
    a.error = solver_error<V, N>(self.model, h, end.error, self.error_scale);
    return a;
}

// Each lane takes the step that its own rates ask for.
template <class V, int N>
VGROOVE_INLINE Attempt<V, N> solver_mixed(const Attempt<V, N> &stiff, const Attempt<V, N> &plain,
                                          const bool *which) {
    Attempt<V, N> a = plain;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        if (!which[lane])
            continue;
        for (int n = 0; n < N; ++n) {
            set(a.state.x[n], lane, get(stiff.state.x[n], lane));
            set(a.slope.x[n], lane, get(stiff.slope.x[n], lane));
        }
        set(a.error, lane, get(stiff.error, lane));
    }
    return a;
}

template <class V, int N> VGROOVE_INLINE Attempt<V, N> solver_step(Solver<V, N> &self, V h) {
    if constexpr (LaneTraits<V>::COUNT == 1)
        if (self.exact) {
            Attempt<V, N> a{};
            a.state = flow_state<N>(self.model, self.drive, self.mode, h, self.state, a.error);
            a.error /= SOLVER_DOUBT * self.model.current_scale;
            return a;
        }
    solver_refresh(self);
    const Rates<V> rates = stiff_rates<V, N>(self.model, self.drive, self.mode, self.state);
    const V fastest = fastest_rate<V>(rates);
    bool all = true, any = false;
    bool stiff[LaneTraits<V>::COUNT];
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const double rate = get(fastest, lane);
        stiff[lane] = rate * get(h, lane) > STIFF_STEP &&
                      rate * self.floor_s[lane] > STIFF_STRETCH * SOLVER_STEP_MIN;
        const bool waits = get(h, lane) == 0.0;
        all = all && (stiff[lane] || waits);
        any = any || stiff[lane];
    }
    if (!any)
        return solver_attempt(self, h);
    const Attempt<V, N> a = solver_attempt_stiff(self, rates, h);
    return all ? a : solver_mixed(a, solver_attempt(self, h), stiff);
}

// A lane whose credit is used up stands still from here on.
template <class V, int N> VGROOVE_INLINE bool solver_pays(Solver<V, N> &self, int lane) {
    self.credit[lane] -= 1.0;
    if (self.credit[lane] >= 0.0)
        return true;
    self.spent[lane] = true;
    self.left_s[lane] = 0.0;
    return false;
}

// Runs until every lane is at the end of its stretch and next_stretch(lane) gives it no other one.
template <class V, int N, class NextStretch>
VGROOVE_INLINE void solver_run(Solver<V, N> &self, NextStretch &&next_stretch) {
    for (;;) {
        bool busy = false;
        V h{};
        for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
            while (self.left_s[lane] <= 0.0 && next_stretch(lane)) {
            }
            self.next_s[lane] = self.left_s[lane] > 0.0 ? self.next_s[lane] : 0.0;
            busy = busy || self.next_s[lane] > 0.0;
            set(h, lane, self.next_s[lane]);
        }
        if (!busy)
            return;
        const Attempt<V, N> a = solver_step(self, h);
        const Events<V> after = solver_events<V, N>(self, h, a.state);
        Events<V> before{};
        const bool met = solver_any_event(after);
        if (met)
            before = drivetrain_events<V, N>(self.model, self.drive, self.mode, V{}, self.state);
        for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
            if (self.next_s[lane] > 0.0 && solver_pays(self, lane))
                solver_judge(self, a, before, after, lane);
    }
}

}  // namespace vgroove

#endif
