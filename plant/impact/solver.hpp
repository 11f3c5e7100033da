// Data of the impact tool's solver: the model, its state and modes, the step that has been tried.
//
// The solver steps from event to event; within a step all modes are constant. Two accuracies:
// L::EXACT reaches every event by a step of its own, located within 1e-12 s. Otherwise events are
// located on the step's interpolant, the flight between contacts has steps of its own (flight.hpp),
// contacts are followed by Taylor series (series.hpp), and a step may reach beyond the present
// instant: rows and lock-step intervals read its interpolant and do not shorten it.
#ifndef VGROOVE_PLANT_IMPACT_SOLVER_HPP
#define VGROOVE_PLANT_IMPACT_SOLVER_HPP

#include <vector>

#include "impact/blows.hpp"
#include "impact/events.hpp"
#include "numeric/cancellation.hpp"
#include "numeric/dormand_prince.hpp"

namespace vgroove {

constexpr double IMPACT_STEP_MAX_S = 1e-3, IMPACT_FLIGHT_MAX_S = 2.2e-3, IMPACT_STEP_MIN_S = 1e-12;
constexpr double IMPACT_NO_HORIZON_S = 1e9;
constexpr double IMPACT_SAME_S = 1e-15;          // instants that differ by rounding only
constexpr double IMPACT_FIRST_CONTACT_S = 4e-6;  // first step after a contact begins
constexpr int IMPACT_EVENTS_AT_ONCE_MAX = 64;    // without a step in between
constexpr int IMPACT_CHECK_STEPS = 256;          // steps between two checks of the run
// Step budget: steps granted for each simulated second, and the largest balance.
constexpr double IMPACT_STEPS_SECOND = 1e6, IMPACT_STEPS_SAVED = 2e6;
// Anvil and joint count as at rest below these.
constexpr double FROZEN_TWIST_RAD = 1e-6, FROZEN_SPEED_RAD_S = 1e-2;

struct ImpactStats {
    double steps = 0.0, rejected = 0.0, events = 0.0, derivatives = 0.0;
};

// Order of the Taylor series in a contact: of hammer, anvil, twist and lug impulse, and of the
// other states, which change slowly
constexpr int SERIES_ORDER = 12, SERIES_SLOW = 7;

template <class L> struct ImpactSeries {
    ImpactState<L> c[SERIES_ORDER + 1];  // coefficients of the powers of time
    static constexpr int FAST_FROM = L::HAMMER_ANGLE, FAST_TO = L::LUG_IMPULSE + 1;  // fast states
    static constexpr int order(int state) {
        return state >= FAST_FROM && state < FAST_TO ? SERIES_ORDER : SERIES_SLOW;
    }
};

// One accepted step, for studies of the step size; event: the one that ended it, or -1.
struct StepRecord {
    double time_s, step_s;
    int event;
};

// A step that has been tried. `slopes`: of its stages. `dense`: coefficients of the interpolant
// y + u (d1 + (1 - u) (d2 + u (d3 + (1 - u) (d4 + u d5)))), u the share of the step.
template <class L> struct ImpactStep {
    StageSlopes<double, L::COUNT> slopes;
    ImpactState<L> dense_1, dense_2, dense_3, dense_4, dense_5;  // once dense_ready
    ImpactSeries<L> series;
    ImpactState<L> end, end_slope;
    ImpactPoint end_point;
    double error;
    double h, share;  // length, and the share of it that is accepted
    int event;        // that ends it, or -1
    bool flight;      // by the method of flight.hpp, whose interpolant has d5
    bool by_series;   // by Taylor series, which is its own interpolant
    bool coupled;     // by the method of coupled_step.hpp, whose interpolant is of third order
    bool dense_ready;
};

// Weights of a flight step of length h for a current that decays at `rate`: phi functions of -rate
// h and of half of it; weights of the hammer's oscillation for half the step and all of it
struct SwingWeights {
    double t1, t2, t3, t4;
};
struct FlightWeights {
    double h, rate;
    SwingWeights half, full;
    double half_1, half_2, full_1, full_2, full_3;
};

template <class L> struct ImpactSolver;

// Called before a step of length h is accepted up to `share` of it.
template <class L> struct ImpactObserver {
    virtual ~ImpactObserver() = default;
    virtual void step(ImpactSolver<L> &solver, double h, double share) = 0;
};

template <class L> struct ImpactSolver {
    Impact model;
    ImpactMode mode;
    Drive<double> drive;  // at the start of the next step
    ImpactState<L> state;
    ImpactState<L> slope;  // derivative at the start of the next step
    ImpactPoint point;     // forces and geometry that belong to it
    ImpactStep<L> step;
    double tolerance;
    double fixed_s;    // step of the fixed-step mode; 0: adaptive
    double allowed_s;  // step that the error allows
    double series_s;   // longest step of the next Taylor series, by the error of the last one
    bool slope_stale;  // slope and events must be computed again
    bool pending;      // `step` has been tried and is not yet accepted: the present lies in it,
    double elapsed_s;  // this long after its start
    double horizon_s;  // from the step's start: time during which command and load stay as they are
    FlightWeights weights;
    double dropped_j;  // energy of contact springs that a release has removed
    BlowRecorder recorder;
    ImpactStats stats;
    int check_in;                // steps until the next check of the run
    double step_budget;          // steps that the run may still try
    double checked_s;            // simulated time of the last check
    Cancellation *cancellation;  // or null
    const Parameters
        *parameters;  // of the model, for the message of a run that takes too many steps
    std::vector<StepRecord> *history;  // or null
    ImpactObserver<L> *observer;       // or null
};

// Derivative and ImpactPoint (forces and geometry) in a state, tau after the start of the step. Not
// inlined: the code of a step must fit into the processor's first-level cache.
template <class L>
VGROOVE_CLONES_APART ImpactPoint impact_slope(ImpactSolver<L> &self, double tau,
                                              const ImpactState<L> &s, ImpactState<L> &ds) {
    self.stats.derivatives += 1.0;
    if constexpr (L::FULL)
        ds = ImpactState<L>{};
    return impact_derivative<L>(self.model, self.drive, self.mode, tau, s, ds);
}

// The derivative alone, for the stages of a step
template <class L>
VGROOVE_CLONES_APART void impact_stage(const ImpactSolver<L> &self, double tau,
                                       const ImpactState<L> &s, ImpactState<L> &ds) {
    if constexpr (L::FULL)
        ds = ImpactState<L>{};
    impact_derivative<L, false>(self.model, self.drive, self.mode, tau, s, ds);
}

// Runs for length_s with command and load as straight lines. L::EXACT or with fixed steps, a step
// ends there; else the last step may reach beyond, by at most horizon_s.
template <class L> void impact_run(ImpactSolver<L> &self, double length_s);

// Accepts the pending step up to the present and drops the rest of it.
template <class L> void impact_truncate(ImpactSolver<L> &self);

// Computes slope and point at the start of a step; events that have already happened are applied.
template <class L> void impact_refresh(ImpactSolver<L> &self);

}  // namespace vgroove

#endif
