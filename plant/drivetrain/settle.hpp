// Start of a run from a given current, speed and angle: filters at their steady state, the output
// side in contact.
#ifndef VGROOVE_PLANT_DRIVETRAIN_SETTLE_HPP
#define VGROOVE_PLANT_DRIVETRAIN_SETTLE_HPP

#include "drivetrain/solver.hpp"

namespace vgroove {

constexpr double UNLIMITED_S = 1e9;  // first step: limited by the stretch alone

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

// start: current, speed, angle. The caller has set the load in the drive. Slow states (charge,
// polarisation, heat) keep their values. No sensor measures the output side behind a spring or a
// play: unless this is the first start it keeps its twist and its speed relative to the motor.
template <class V, int N>
VGROOVE_INLINE void settle_shaft(Solver<V, N> &s, int lane, const double *start,
                                 bool first = true) {
    const double motor_before = get(s.state.x[STATE_SPEED], lane);
    set(s.state.x[STATE_CURRENT], lane, start[0]);
    set(s.state.x[STATE_SPEED], lane, start[1]);
    set(s.state.x[STATE_ANGLE], lane, start[2]);
    set(s.mode.slide, lane, sign_of(start[1]));
    set(s.mode.diode, lane, 0.0);
    set(s.allowed_s, lane, UNLIMITED_S);
    s.remaining_s[lane] = 0.0;
    if constexpr (N > STATE_CORE_COUNT) {
        set(s.state.x[STATE_CURRENT_FILTER], lane, start[0]);
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
