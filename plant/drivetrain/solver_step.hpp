// One trial step of the drivetrain's solver: exact where the drivetrain is linear, else by Dormand
// and Prince, or, where it is stiff, by an exponential method or by ROS34PW2.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SOLVER_STEP_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SOLVER_STEP_HPP

#include <new>

#include "drivetrain/exponential_step.hpp"
#include "drivetrain/flow.hpp"
#include "drivetrain/solver_state.hpp"
#include "drivetrain/stiff_step.hpp"
#include "numeric/dormand_prince.hpp"

namespace vgroove {

template <class V, int N> struct Trial {
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

// Tries an explicit step of length h and writes its end, slope and error to a.
template <class V, int N>
VGROOVE_INLINE void solver_explicit(const Solver<V, N> &self, const V &h, Trial<V, N> &a) {
    constexpr StageSum SUM = StageSum::COMMON_FACTOR;
    const Drivetrain<V> &m = self.model;
    StageSlopes<V, N> k;
    State<V, N> error;
    dormand_prince_stages<SUM, V, N>(
        self.state, self.slope, h,
        k, [&](V tau, const State<V, N> &s, State<V, N> &to) __attribute__((always_inline)) {
            // Constructed in place: a copy would wait for the stores of its components.
            ::new (static_cast<void *>(&to))
                State<V, N>(drivetrain_stage<V, N>({m, self.drive, self.mode}, tau, s));
        });
    dormand_prince_end<SUM, V, N>(self.state, self.slope, h, k, a.state);
    a.slope = drivetrain_stage<V, N>({m, self.drive, self.mode}, h, a.state);
    dormand_prince_error<V, N>(self.slope, k, a.slope, error);
    a.error = solver_error<V, N>(m, h, error, self.error_scale);
}

template <class V, int N>
VGROOVE_PART void solver_try_explicit(const Solver<V, N> &self, const V &h, Trial<V, N> &a) {
    solver_explicit(self, h, a);
}

template <class V, int N>
VGROOVE_PART void solver_try_stiff(const Solver<V, N> &self, const Rates<V> &rates, const V &h,
                                   Trial<V, N> &a) {
    const RosenbrockStep<V, N> end =
        stiff_step<V, N>({self.model, self.drive, self.mode}, rates, h, self.state, self.slope);
    a.state = end.state;
    a.slope = drivetrain_slope<V, N>(self.model, self.drive, self.mode, h, a.state);
    a.error = solver_error<V, N>(self.model, h, end.error, self.error_scale);
}

template <class V, int N>
VGROOVE_PART void solver_try_exponential(const Solver<V, N> &self, const Rates<V> &rates,
                                         const V &h, Trial<V, N> &a) {
    const ExponentialStep<V, N> end = exponential_step<V, N>({self.model, self.drive, self.mode},
                                                             rates, h, self.state, self.slope);
    a.state = end.state;
    a.slope = end.slope;
    a.error = solver_error<V, N>(self.model, splat<V>(1.0), end.error, self.error_scale);
}

enum class StepMethod { EXPLICIT, ROSENBROCK, EXPONENTIAL };

// Chooses the integration method for a step of h seconds in one lane, by the limits in
// stiff_step.hpp. rate: the fastest rate at which a state of this lane decays, 1/s; oscillates:
// angular frequency of cogging and gear eccentricity, rad/s
template <class V, int N>
VGROOVE_INLINE StepMethod solver_method(const Solver<V, N> &self, double rate, double oscillates,
                                        double h, int lane) {
    if (!(rate * h > STIFF_STEP))
        return StepMethod::EXPLICIT;
    if (N == STATE_CORE_COUNT && self.exponential && rate * h < EXPONENTIAL_DECAY)
        return rate > EXPONENTIAL_RATIO * oscillates ? StepMethod::EXPONENTIAL
                                                     : StepMethod::EXPLICIT;
    return rate * self.least_s[lane] > STIFF_STRETCH * SOLVER_STEP_MIN ? StepMethod::ROSENBROCK
                                                                       : StepMethod::EXPLICIT;
}

// In the lanes whose integration method is `its`, replaces the trial step in `all` by that in
// `one`.
template <class V, int N>
VGROOVE_INLINE void solver_take(Trial<V, N> &all, const Trial<V, N> &one, const StepMethod *method,
                                StepMethod its) {
    V takes{};
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        set(takes, lane, method[lane] == its ? 1.0 : 0.0);
    const auto mine = takes > 0.0;
    for (int n = 0; n < N; ++n) {
        all.state.x[n] = mine ? one.state.x[n] : all.state.x[n];
        all.slope.x[n] = mine ? one.slope.x[n] : all.slope.x[n];
    }
    all.error = mine ? one.error : all.error;
}

// Slopes of the lanes whose state, drive or modes have changed
template <class V, int N> VGROOVE_INLINE void solver_refresh(Solver<V, N> &self) {
    bool any = false;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        any = any || self.slope_stale[lane];
    if (!any)
        return;
    const State<V, N> slope =
        drivetrain_slope<V, N>(self.model, self.drive, self.mode, V{}, self.state);
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        if (!self.slope_stale[lane])
            continue;
        for (int n = 0; n < N; ++n)
            set(self.slope.x[n], lane, get(slope.x[n], lane));
        self.slope_stale[lane] = false;
    }
}

// A step where the drivetrain is linear between events
template <int N>
VGROOVE_INLINE Trial<double, N> solver_step_exact(const Solver<double, N> &self, double h) {
    Trial<double, N> a{};
    a.state = flow_state<N>({self.model, self.drive, self.mode}, h, self.state, a.error);
    a.error /= SOLVER_RAMP_ERROR * self.model.current_scale;
    return a;
}

// A step of length h in each lane; a lane with h = 0 stays where it is.
template <class V, int N> VGROOVE_INLINE Trial<V, N> solver_step_adaptive(Solver<V, N> &self, V h) {
    solver_refresh(self);
    const Rates<V> rates = stiff_rates<V, N>(self.model, self.drive, self.mode, self.state);
    const V fastest = fastest_rate<V>(rates);
    const V oscillates = friction_angle_frequency<V>(self.model.friction, self.model.effects,
                                                     self.state.x[STATE_SPEED]);
    bool uses[3] = {false, false, false};
    StepMethod method[LaneTraits<V>::COUNT];
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        method[lane] =
            solver_method(self, get(fastest, lane), get(oscillates, lane), get(h, lane), lane);
        if (get(h, lane) != 0.0)
            uses[static_cast<int>(method[lane])] = true;
    }
    const bool nonstiff = uses[static_cast<int>(StepMethod::EXPLICIT)];
    const bool stiff = uses[static_cast<int>(StepMethod::ROSENBROCK)];
    Trial<V, N> a;  // by the first method that is used
    if (nonstiff) {
        if constexpr (IN_ONE_PIECE<V, N>)
            solver_explicit(self, h, a);
        else
            solver_try_explicit(self, h, a);
    }
    if (stiff && !nonstiff) {
        solver_try_stiff(self, rates, h, a);
    } else if (stiff) {
        Trial<V, N> one;
        solver_try_stiff(self, rates, h, one);
        solver_take(a, one, method, StepMethod::ROSENBROCK);
    }
    if constexpr (N == STATE_CORE_COUNT) {
        const bool exponential = uses[static_cast<int>(StepMethod::EXPONENTIAL)];
        if (exponential && !nonstiff && !stiff) {
            solver_try_exponential(self, rates, h, a);
        } else if (exponential) {
            Trial<V, N> one;
            solver_try_exponential(self, rates, h, one);
            solver_take(a, one, method, StepMethod::EXPONENTIAL);
        }
    }
    return a;
}

// EXACT: the drivetrain is linear between events.
template <bool EXACT, class V, int N>
VGROOVE_INLINE Trial<V, N> solver_step(Solver<V, N> &self, V h) {
    if constexpr (EXACT)
        return solver_step_exact(self, h);
    else
        return solver_step_adaptive(self, h);
}

}  // namespace vgroove

#endif
