// Data of the drivetrain's solver: the model, its state and modes, and for each lane the step, the
// search for an event and the step budget.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SOLVER_STATE_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SOLVER_STATE_HPP

#include "drivetrain/model.hpp"
#include "numeric/event_location.hpp"

namespace vgroove {

// Local error of a Runge-Kutta step over the scale of the state; with two bodies it is smaller,
// because an error grows with every contact of the flanks.
constexpr double SOLVER_TOLERANCE = 2e-6;
constexpr double SOLVER_TOLERANCE_CONTACT = 1e-7;
// Error over tolerance below which a step is doubled; its error then grows by 2^5.
constexpr double SOLVER_GROW_BELOW = 0.02;
constexpr double SOLVER_EVENT_S = 1e-10;           // instants of events are located within this
constexpr double SOLVER_EVENT_VALUE = 1e-10;       // or to this share of the event function's scale
constexpr double SOLVER_STEP_MIN = 1.0 / 65536.0;  // of the stretch
// Exact steps: error of the extrapolated current over its scale that is accepted where the duty
// ramps behind a supply resistance.
constexpr double SOLVER_RAMP_ERROR = 2e-7;
// First step of an exact stretch over its length, doubled afterwards: events are looked for at the
// ends of steps.
constexpr double SOLVER_EXACT_SHARE = 0.0625;
constexpr int SOLVER_LOCATE_MAX = 60;  // trials for one event
// Step budget: steps granted for each row and for each second of a row, and the largest balance.
constexpr double SOLVER_STEPS_ROW = 1000.0;
constexpr double SOLVER_STEPS_SECOND = 50000.0;
constexpr double SOLVER_STEPS_SAVED = 200000.0;
// Events located in one stretch; later ones are taken at the end of the step that meets them.
constexpr int SOLVER_EVENTS_MAX = 400;
// States smaller than this (A, rad/s, V, K) become 0: a state that decays would end in subnormal
// numbers, which make every later step several times as slow.
constexpr double SOLVER_TINY = 1e-60;

enum EventIndex { EVENT_NONE = -1, EVENT_SHAFT, EVENT_OUTPUT, EVENT_DIODE, EVENT_COUNT };

struct EventSearch {
    int target = EVENT_NONE;
    EventBracket bracket;
};

template <class V, int N> struct Solver {
    Drivetrain<V> model;
    State<V, N> state;
    State<V, N> slope;  // derivative at the start of the next step
    Mode<V> mode;
    Drive<V> drive;                            // at the start of the next step
    V allowed_s;                               // step that the error allows
    double remaining_s[LaneTraits<V>::COUNT];  // to the end of the stretch
    double least_s[LaneTraits<V>::COUNT];      // shortest step
    double next_s[LaneTraits<V>::COUNT];       // step to try; 0: the lane stays where it is
    bool slope_stale[LaneTraits<V>::COUNT];    // the slope must be computed again
    int events[LaneTraits<V>::COUNT];
    EventSearch search[LaneTraits<V>::COUNT];
    double step_budget[LaneTraits<V>::COUNT];  // steps that the lane may still take
    bool exhausted[LaneTraits<V>::COUNT];      // the budget is used up: the lane stays where it is
    double error_scale;                        // 1 / tolerance of the local error
    bool short_first_step;  // the caller gave a tolerance: look for events as in exact stretches
    bool exact;             // linear between events: flow.hpp instead of Runge-Kutta
    bool exponential;       // stiff steps by exponential_step.hpp, else by stiff_step.hpp
};

template <class V, int N> VGROOVE_INLINE void flush_tiny(State<V, N> &s) {
    for (int n = 0; n < N; ++n)
        s.x[n] = abs_of<V>(s.x[n]) < SOLVER_TINY ? V{} : s.x[n];
}

// tolerance: local error of a step over the scale of the state; 0: SOLVER_TOLERANCE.
template <class V, int N> VGROOVE_INLINE void solver_prepare(Solver<V, N> &self, double tolerance) {
    const double usual =
        self.model.effects & EFFECT_TWO_BODIES ? SOLVER_TOLERANCE_CONTACT : SOLVER_TOLERANCE;
    self.short_first_step = tolerance > 0.0;
    self.error_scale = 1.0 / (tolerance > 0.0 ? tolerance : usual);
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        self.step_budget[lane] = SOLVER_STEPS_SAVED;
}

template <class V, int N>
VGROOVE_INLINE void solver_grant_steps(Solver<V, N> &self, int lane, int rows, double seconds) {
    const double budget =
        self.step_budget[lane] + SOLVER_STEPS_ROW * rows + SOLVER_STEPS_SECOND * seconds;
    self.step_budget[lane] = budget < SOLVER_STEPS_SAVED ? budget : SOLVER_STEPS_SAVED;
}

// Takes one step off a lane's budget; false where none is left, and the lane then stays where it
// is.
template <class V, int N> VGROOVE_INLINE bool solver_spend_step(Solver<V, N> &self, int lane) {
    self.step_budget[lane] -= 1.0;
    if (self.step_budget[lane] >= 0.0)
        return true;
    self.exhausted[lane] = true;
    self.remaining_s[lane] = 0.0;
    return false;
}

}  // namespace vgroove

#endif
