// Solver of the impact mechanism: Runge-Kutta 5(4) of Dormand and Prince from switch to switch,
// each switch located on the step's interpolant.
//
// EXACT: every located instant is reached by a step of its own and refined until it is known to
// 1e-12 s; else by the interpolant (Hairer, Norsett, Wanner: Solving Ordinary Differential
// Equations I, II.6), which is of fourth order. Not EXACT, the flight between contacts has steps of
// its own (impact_flight.hpp), and a step may reach beyond the present (impact_run): rows and
// controllers look into it and do not shorten it.
#ifndef VGROOVE_PLANT_IMPACT_SOLVER_HPP
#define VGROOVE_PLANT_IMPACT_SOLVER_HPP

#include <vector>

#include "impact/blows.hpp"
#include "impact/events.hpp"
#include "numeric/watch.hpp"

namespace vgroove {

constexpr double IMPACT_STEP_MAX_S = 1e-3;
constexpr double IMPACT_FLIGHT_MAX_S = 3e-3;
constexpr double IMPACT_NO_HORIZON_S = 1e9;
constexpr double IMPACT_SAME_S = 1e-15;  // instants that only rounding parts
constexpr double IMPACT_STEP_MIN_S = 1e-12;
constexpr double IMPACT_FIRST_CONTACT_S = 4e-6;  // first step after a contact begins
constexpr double FROZEN_TWIST_RAD = 1e-6, FROZEN_SPEED_RAD_S = 1e-2;
constexpr double IMPACT_PIECE_S = 6e-6;  // fixed steps: longest piece in a contact (27 krad/s)
constexpr int IMPACT_CUTS_MAX = 2;       // fixed steps: switches located in a piece
constexpr int IMPACT_SWITCHES_MAX = 64;  // without a step in between
constexpr int IMPACT_LOOK_STEPS = 256;   // so often a run asks whether it is still wanted
constexpr double IMPACT_STEPS_SECOND = 1e6,
                 IMPACT_STEPS_SAVED =
                     2e6;  // a run may try so many steps a simulated second, and save so many

struct ImpactStats {
    double steps = 0.0, rejected = 0.0, events = 0.0, derivatives = 0.0;
};

constexpr int SERIES_ORDER = 12;  // of the series in a contact, impact_series.hpp

template <class L> struct ImpactSeries {
    ImpactState<L> c[SERIES_ORDER + 1];  // coefficients of time
};

// One accepted step, for studies of the step size: switch that ended it, or -1.
struct StepRecord {
    double time_s, step_s;
    int event;
};

template <class L> struct ImpactStep {
    ImpactState<L> k2, k3, k4, k5, k6;
    ImpactState<L> rise, bend, last,
        fine;  // of the interpolant, where impact_interpolate has been asked
    ImpactSeries<L> series;
    ImpactState<L> end, end_slope;
    ImpactPoint end_point;
    double error;
    double h, share;  // length, and how much of it holds
    int event;        // switch that ends it, or -1
    bool flight;      // of fourth order, its interpolant of third
    bool by_series;   // its interpolant is `series`
    bool shaped;      // the interpolant's coefficients are there
};

// Exponential weights of a flight step of length h for a current that decays at `rate`: phi
// functions of -rate h, and of half of it.
struct FlightWeights {
    double h, rate;
    double half_1, half_2, full_1, full_2, full_3;
};

template <class L> struct ImpactSolver;

// Sees each step before it is taken: of the step of length h that has just been tried, the first
// `share`.
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
    bool ahead;        // `step` has been tried and not taken yet: the present lies in it,
    double into_s;     // this far from its start
    double horizon_s;  // from the step's start: how long command and load are known to go on
    FlightWeights weights;
    double dropped_j;  // contact energy dropped at releases
    BlowRecorder recorder;
    ImpactStats stats;
    int look_in;                   // steps until the next look
    double credit;                 // steps that the run may still try
    double looked_s;               // simulated time of the last look
    Watch *watch;                  // or null
    const Parameters *parameters;  // where the model comes from, for what is said of a run that
                                   // does not come forward
    std::vector<StepRecord> *history;
    ImpactObserver<L> *observer;
};

// Runs for length_s with command and load as straight lines. EXACT or with fixed steps a step ends
// there; else the last one may reach beyond, for as long as command and load may go on (horizon_s).
template <class L> void impact_run(ImpactSolver<L> &self, double length_s);

// Takes the step that reaches beyond the present up to the present.
template <class L> void impact_cut(ImpactSolver<L> &self);

// Slope and point at the start of a step; switches that already lie behind are taken at once.
template <class L> void impact_refresh(ImpactSolver<L> &self);

// Coefficients of the interpolant of the step of length h that has just been tried.
template <class L>
__attribute__((noinline)) void impact_interpolate(ImpactSolver<L> &self, double h) {
    ImpactStep<L> &t = self.step;
    if (t.shaped)
        return;
    t.shaped = true;
    if (t.by_series)
        return;
    for (int n = 0; n < L::COUNT; ++n) {
        const double k1 = self.slope.x[n];
        t.rise.x[n] = t.end.x[n] - self.state.x[n];
        t.bend.x[n] = h * k1 - t.rise.x[n];
        t.last.x[n] = t.rise.x[n] - h * t.end_slope.x[n] - t.bend.x[n];
    }
    if (t.flight) {
        t.fine = ImpactState<L>{};
        return;
    }
    for (int n = 0; n < L::COUNT; ++n) {
        const double k1 = self.slope.x[n];
        t.fine.x[n] =
            h * ((-12715105075.0 / 11282082432.0 * k1 + 87487479700.0 / 32700410799.0 * t.k3.x[n]) +
                 (-10690763975.0 / 1880347072.0 * t.k4.x[n] +
                  701980252875.0 / 199316789632.0 * t.k5.x[n]) +
                 (-1453857185.0 / 822651844.0 * t.k6.x[n] +
                  69997945.0 / 29380423.0 * t.end_slope.x[n]));
    }
}

// Anvil on its sticking joint, t after twist and speed: e'' + 2 decay e' + frequency^2 e = 0
// (impact_from).
struct Ringing {
    double twist, speed;
};
VGROOVE_INLINE Ringing impact_ringing(const Impact &m, double twist, double speed, double t) {
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

// Sets the ringing anvil in a state t after the start of the step.
template <class L>
VGROOVE_INLINE void impact_ring(const ImpactSolver<L> &self, double t, ImpactState<L> &s) {
    const double *from = self.state.x;
    const Ringing r = impact_ringing(self.model, from[L::TWIST], from[L::ANVIL_SPEED], t);
    s.x[L::TWIST] = r.twist;
    s.x[L::ANVIL_SPEED] = r.speed;
    s.x[L::ANVIL_ANGLE] = from[L::ANVIL_ANGLE] + (r.twist - from[L::TWIST]);
}

// State t after the start of a series.
template <class L>
__attribute__((noinline)) ImpactState<L> impact_series_at(const ImpactSeries<L> &p, double t) {
    ImpactState<L> s = p.c[SERIES_ORDER];
    for (int k = SERIES_ORDER - 1; k >= 0; --k)
        for (int n = 0; n < L::COUNT; ++n)
            s.x[n] = s.x[n] * t + p.c[k].x[n];
    return s;
}

template <class L>
VGROOVE_INLINE double impact_component(const ImpactStep<L> &t, const ImpactState<L> &from,
                                       double share, int n) {
    if (t.by_series) {
        double x = t.series.c[SERIES_ORDER].x[n];
        for (int k = SERIES_ORDER - 1; k >= 0; --k)
            x = x * (share * t.h) + t.series.c[k].x[n];
        return x;
    }
    const double rest = 1.0 - share;
    return from.x[n] + share * (t.rise.x[n] +
                                rest * (t.bend.x[n] + share * (t.last.x[n] + rest * t.fine.x[n])));
}

// State at a share of that step.
template <class L>
VGROOVE_INLINE ImpactState<L> impact_between(const ImpactSolver<L> &self, double share) {
    if (self.step.by_series)
        return impact_series_at<L>(self.step.series, share * self.step.h);
    ImpactState<L> s;
    for (int n = 0; n < L::COUNT; ++n)
        s.x[n] = impact_component(self.step, self.state, share, n);
    if (!L::EXACT && self.mode.ringing)
        impact_ring(self, share * self.step.h, s);
    return s;
}

// State of the present.
template <class L> VGROOVE_INLINE ImpactState<L> impact_present(ImpactSolver<L> &self) {
    if (!self.ahead)
        return self.state;
    impact_interpolate(self, self.step.h);
    return impact_between(self, self.into_s / self.step.h);
}

// One component of it, not of the anvil.
template <class L> VGROOVE_INLINE double impact_present_of(ImpactSolver<L> &self, int n) {
    if (!self.ahead)
        return self.state.x[n];
    impact_interpolate(self, self.step.h);
    return impact_component(self.step, self.state, self.into_s / self.step.h, n);
}

}  // namespace vgroove

#endif
