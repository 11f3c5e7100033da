// Solver of the impact mechanism: Runge-Kutta 5(4) of Dormand and Prince from switch to switch, each switch located on the step's interpolant.
//
// EXACT: every located instant is reached by a step of its own and refined until it is known to 1e-12 s; else by the interpolant (Hairer, Norsett,
// Wanner: Solving Ordinary Differential Equations I, II.6), which is of fourth order.
#ifndef VGROOVE_PLANT_IMPACT_SOLVER_HPP
#define VGROOVE_PLANT_IMPACT_SOLVER_HPP

#include <vector>

#include "impact_blows.hpp"
#include "impact_events.hpp"

namespace vgroove {

constexpr double IMPACT_STEP_MAX_S = 1e-3;  // a lug is not passed over within a step
constexpr double IMPACT_STEP_MIN_S = 1e-12;
constexpr double IMPACT_FIRST_CONTACT_S = 4e-6;  // first step after a contact begins
constexpr double FROZEN_TWIST_RAD = 1e-6, FROZEN_SPEED_RAD_S = 1e-2;
constexpr double IMPACT_PIECE_S = 6e-6;  // fixed steps: longest piece in a contact (27 krad/s)
constexpr int IMPACT_CUTS_MAX = 2;       // fixed steps: switches located in a piece
constexpr int IMPACT_SWITCHES_MAX = 64;  // without a step in between

struct ImpactStats {
    double steps = 0.0, rejected = 0.0, events = 0.0, derivatives = 0.0;
};

// One accepted step, for studies of the step size: switch that ended it, or -1.
struct StepRecord {
    double time_s, step_s;
    int event;
};

template <class L> struct ImpactStep {
    ImpactState<L> k2, k3, k4, k5, k6;
    ImpactState<L> rise, bend, last, fine;  // of the interpolant, where impact_interpolate has been asked
    ImpactState<L> end, end_slope;
    ImpactPoint end_point;
    double error;
};

template <class L> struct ImpactSolver;

// Sees each step before it is taken: of the step of length h that has just been tried, the first `share`.
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
    ImpactPoint point;     // and the quantities that go with it
    ImpactStep<L> step;
    double tolerance;
    double fixed_s;    // step of the fixed-step mode; 0: adaptive
    double level_s;    // step that the error allows
    bool fresh;        // slope and switches must be looked at anew
    double dropped_j;  // contact energy dropped at releases
    BlowRecorder recorder;
    ImpactStats stats;
    std::vector<StepRecord> *history;
    ImpactObserver<L> *observer;
};

// Runs for length_s with command and load as straight lines.
template <class L> void impact_run(ImpactSolver<L> &self, double length_s);

// Slope and point at the start of a step; switches that already lie behind are taken at once.
template <class L> void impact_refresh(ImpactSolver<L> &self);

// Coefficients of the interpolant of the step of length h that has just been tried.
template <class L> __attribute__((noinline)) void impact_interpolate(ImpactSolver<L> &self, double h) {
    ImpactStep<L> &t = self.step;
    for (int n = 0; n < L::COUNT; ++n) {
        const double k1 = self.slope.x[n];
        t.rise.x[n] = t.end.x[n] - self.state.x[n];
        t.bend.x[n] = h * k1 - t.rise.x[n];
        t.last.x[n] = t.rise.x[n] - h * t.end_slope.x[n] - t.bend.x[n];
        t.fine.x[n] = h * ((-12715105075.0 / 11282082432.0 * k1 + 87487479700.0 / 32700410799.0 * t.k3.x[n]) +
                           (-10690763975.0 / 1880347072.0 * t.k4.x[n] + 701980252875.0 / 199316789632.0 * t.k5.x[n]) +
                           (-1453857185.0 / 822651844.0 * t.k6.x[n] + 69997945.0 / 29380423.0 * t.end_slope.x[n]));
    }
}

// State at a share of that step.
template <class L> VGROOVE_INLINE ImpactState<L> impact_between(const ImpactSolver<L> &self, double share) {
    const ImpactStep<L> &t = self.step;
    const double rest = 1.0 - share;
    ImpactState<L> s;
    for (int n = 0; n < L::COUNT; ++n)
        s.x[n] = self.state.x[n] + share * (t.rise.x[n] + rest * (t.bend.x[n] + share * (t.last.x[n] + rest * t.fine.x[n])));
    return s;
}

}  // namespace vgroove

#endif
