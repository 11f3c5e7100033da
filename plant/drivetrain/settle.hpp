// Start of a run from a given current, speed and angle: filters at their steady state, the output
// side in contact.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SETTLE_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SETTLE_HPP

#include <cmath>
#include <limits>

#include "drivetrain/solver.hpp"

namespace vgroove {

constexpr double UNLIMITED_S = 1e9;            // first step: limited by the stretch alone
constexpr int STEADY_ITERATIONS = 60;          // bisection alone needs about 50
constexpr double STEADY_CURRENT_SHARE = 1e-9;  // last step of the iteration, in current scales

// Output side that moves with the motor: its twist carries the torque that a rigid shaft would
// transmit; without torque it is in the middle of the play.
template <class V, int N> VGROOVE_INLINE void settle_output(Solver<V, N> &s, int lane) {
    set(s.state.x[STATE_OUTPUT_SPEED], lane, get(s.state.x[STATE_SPEED], lane));
    set(s.state.x[STATE_TWIST], lane, 0.0);
    set(s.mode.output_slide, lane, get(s.mode.slide, lane));
    const V i = s.state.x[STATE_CURRENT], w = s.state.x[STATE_SPEED];
    const V motor_nm = motor_constant<V>(s.model.motor, s.model.effects, i) * i;
    const Torques<V> t = drivetrain_torques<V, N>(s.model, s.drive, V{}, motor_nm, s.state);
    const V friction = friction_sliding<V>(s.model.friction, s.model.effects, s.mode.slide, w,
                                           t.load_nm, s.drive.time_s);
    const double slide = get(s.mode.slide, lane);
    const double free_nm = get(t.drive_nm, lane) + get(t.coupler_nm, lane) -
                           (slide != 0.0 ? get(friction, lane) : 0.0);
    const double load =
        get(t.load_nm, lane) - get(t.opposing_nm, lane) + slide * get(t.opposing_nm, lane);
    const double motor = 1.0 / get(s.model.gear.inertia_inverse, lane),
                 output = 1.0 / get(s.model.gear.output_inertia_inverse, lane);
    const double torque =
        slide != 0.0 ? (free_nm * output + load * motor) / (motor + output) : load;
    const double half = get(s.model.gear.half_play, lane);
    set(s.state.x[STATE_TWIST], lane,
        torque / get(s.model.gear.stiffness, lane) + sign_of(torque) * half);
}

// Output side at a speed, with its twist unchanged
template <class V, int N> VGROOVE_INLINE void keep_output(Solver<V, N> &s, int lane, double speed) {
    set(s.state.x[STATE_OUTPUT_SPEED], lane, speed);
    set(s.mode.output_slide, lane, sign_of(speed));
}

// Interval that holds the steady-state current of a lane, and the current tried in it
struct SteadyCurrent {
    double low = -std::numeric_limits<double>::infinity(),
           high = std::numeric_limits<double>::infinity(), tried = 0.0;
    bool found = false;
};

// Newton's step on i' = 0; bisection where it leaves the interval
inline void next_steady_current(SteadyCurrent &c, double slope, double rate, double scale) {
    (slope > 0.0 ? c.low : c.high) = c.tried;
    const double newton = c.tried + (rate > 0.0 ? slope / rate : 0.0);
    const double next = newton >= c.low && newton <= c.high ? newton : 0.5 * (c.low + c.high);
    c.found = std::abs(next - c.tried) <= STEADY_CURRENT_SHARE * scale;
    c.tried = next;
}

template <class V, int N>
VGROOVE_INLINE void start_current(Solver<V, N> &s, int lane, double current) {
    set(s.state.x[STATE_CURRENT], lane, current);
    if constexpr (N > STATE_CORE_COUNT)
        set(s.state.x[STATE_CURRENT_FILTER], lane, current);
}

// A current that is the driving column itself
template <class V, int N> VGROOVE_INLINE void follow_command(Solver<V, N> &s, const bool *wanted) {
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        if (wanted[lane])
            start_current(s, lane, get(s.drive.command, lane));
}

// Current at which the winding is in balance at the lane's speed and drive, in the lanes where
// `wanted`
template <class V, int N> VGROOVE_INLINE void settle_current(Solver<V, N> &s, const bool *wanted) {
    SteadyCurrent current[LaneTraits<V>::COUNT];
    bool busy = true;
    for (int n = 0; n < STEADY_ITERATIONS && busy; ++n) {
        const State<V, N> slope = drivetrain_slope<V, N>(s.model, s.drive, s.mode, V{}, s.state);
        const V rate = rate_of_current<V, N>(s.model, s.drive, s.mode, s.state);
        busy = false;
        for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
            if (!wanted[lane] || current[lane].found)
                continue;
            next_steady_current(current[lane], get(slope.x[STATE_CURRENT], lane), get(rate, lane),
                                get(s.model.current_scale, lane));
            start_current(s, lane, current[lane].tried);
            busy = busy || !current[lane].found;
        }
    }
}

// start: current, speed, angle. The caller has set the load in the drive. Slow states (charge,
// polarisation, heat) keep their values. No sensor measures the output side behind a spring or a
// play: unless this is the first start it keeps its twist and its speed relative to the motor.
template <class V, int N>
VGROOVE_INLINE void settle_shaft(Solver<V, N> &s, int lane, const double *start,
                                 bool first = true) {
    const double motor_before = get(s.state.x[STATE_SPEED], lane);
    start_current(s, lane, std::isnan(start[0]) ? 0.0 : start[0]);
    set(s.state.x[STATE_SPEED], lane, start[1]);
    set(s.state.x[STATE_ANGLE], lane, start[2]);
    set(s.mode.slide, lane, sign_of(start[1]));
    set(s.mode.diode, lane, 0.0);
    set(s.allowed_s, lane, UNLIMITED_S);
    s.remaining_s[lane] = 0.0;
    if constexpr (N > STATE_CORE_COUNT) {
        const V wheel = sensors_wheel_speed<V>(s.model.sensors, s.model.effects,
                                               s.state.x[STATE_SPEED], s.state.x[STATE_ANGLE]);
        set(s.state.x[STATE_SPEED_FILTER], lane, get(wheel, lane));
        if (s.model.effects & EFFECT_TWO_BODIES) {
            const double output =
                get(s.state.x[STATE_OUTPUT_SPEED], lane) + start[1] - motor_before;
            if (first)
                settle_output(s, lane);
            else
                keep_output(s, lane, output);
        }
    }
}

}  // namespace vgroove

#endif
