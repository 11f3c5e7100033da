// Step of the drivetrain where it is stiff, so that an explicit method would need very short steps:
// brushes and dead time around 0 A, tiny inductances and time constants.
//
// Method: the Rosenbrock method ROS34PW2 (numeric/rosenbrock.hpp). Of the Jacobian it uses the
// block of current and speed (2 x 2), so that each stage solves two equations for two unknowns, and
// the rows of the filters, each of which follows one of the two. If it left out the off-diagonal
// elements, it would need several times shorter steps where the current depends mainly on the speed
// (the winding has settled), or a filter's state on the filter's input.
#ifndef VGROOVE_PLANT_DRIVETRAIN_STIFF_STEP_HPP
#define VGROOVE_PLANT_DRIVETRAIN_STIFF_STEP_HPP

#include "drivetrain/model.hpp"
#include "numeric/rosenbrock.hpp"

namespace vgroove {

// Limits between the methods, for the fastest rate r at which a state decays, 1/s:
// STIFF_STEP: r times the step. Below it the step is explicit.
// STIFF_STRETCH: r times the time for which one command is simulated, such as a row of a log. Above
// it ROS34PW2 is used.
// Instead of it, exponential steps (exponential_step.hpp) are used where the winding is linear:
// EXPONENTIAL_RATIO: r over the angular frequency of cogging and eccentricity. Below it the step is
// explicit, because an exponential one must be as short and costs more.
// EXPONENTIAL_DECAY: r times the step. Above it ROS34PW2 is used, because rounding makes the
// exponential step inexact.
constexpr double STIFF_STEP = 1.2;
constexpr double STIFF_STRETCH = 64.0;
constexpr double EXPONENTIAL_RATIO = 4.0;
constexpr double EXPONENTIAL_DECAY = 1e6;

// Diagonal elements of the Jacobian with the sign changed, 1/s: the rate at which each state decays
// by itself; 0 where it is never fast.
template <class V> struct Rates { V current, speed, current_filter, speed_filter; };

// Off-diagonal elements of the Jacobian's block of current and speed: back_emf, by how much dI/dt
// falls with the speed, A/s per rad/s; torque, by how much dw/dt rises with the current, rad/s^2
// per A
template <class V> struct MotorCoupling { V back_emf, torque; };

template <class V, int N>
VGROOVE_INLINE V rate_of_current(const Drivetrain<V> &m, const Drive<V> &in, const Mode<V> &mode,
                                 const State<V, N> &s) {
    const Electrical<V> e = drivetrain_electrical<V, N>(m, in, mode, V{}, s);
    V ohm = e.r + motor_constant_slope<V>(m.motor, m.effects, e.i) * s.x[STATE_SPEED];
    if (m.input == InputKind::DUTY)
        ohm += m.bridge.resistance_ohm +
               (m.bus_measured ? V{} : m.supply.resistance_ohm * e.duty * e.duty);
    if (m.effects & EFFECT_BRUSH_DROP) {
        const V share = e.brush_v / m.motor.brush_v;
        ohm += abs_of<V>(m.motor.brush_v * (1.0 - share * share)) /
               max_of<V>(splat<V>(BRUSH_CURRENT_A), e.ripple_a);
    }
    if ((m.effects & EFFECT_DEAD_TIME) && m.input == InputKind::DUTY)
        ohm += in.dead * e.bus_v * bridge_sign_slope<V>(m.bridge, e.i, e.ripple_a);
    return unless_blocked<V>(in, mode, ohm * m.motor.inductance_inverse);
}

template <class V, int N>
VGROOVE_INLINE MotorCoupling<V> stiff_coupling(const Driven<V> &d, const State<V, N> &s) {
    MotorCoupling<V> c{};
    const Drivetrain<V> &m = d.model;
    if (m.input == InputKind::CURRENT)
        return c;
    const V i = s.x[STATE_CURRENT], k = motor_constant<V>(m.motor, m.effects, i);
    // Far in saturation the torque falls as the current rises. With a slope of another sign than
    // the torque constant the equations of a stage could have no unique solution; with 0 they have
    // one.
    const V slope = k + i * motor_constant_slope<V>(m.motor, m.effects, i);
    const V torque_slope = k < 0.0 ? min_of<V>(slope, V{}) : max_of<V>(slope, V{});
    c.back_emf = unless_blocked<V>(d.drive, d.mode, k * m.motor.inductance_inverse);
    c.torque = d.mode.slide * d.mode.slide * torque_slope * m.gear.inertia_inverse;
    return c;
}

template <class V, int N>
VGROOVE_INLINE Rates<V> stiff_rates(const Drivetrain<V> &m, const Drive<V> &in, const Mode<V> &mode,
                                    const State<V, N> &s) {
    Rates<V> r{};
    if (m.input != InputKind::CURRENT)
        r.current = max_of<V>(rate_of_current<V, N>(m, in, mode, s), V{});
    const V w = s.x[STATE_SPEED];
    V drag =
        max_of<V>(friction_speed_slope<V>(m.friction, m.effects, mode.slide, w, in.time_s), V{});
    if (!(m.effects & EFFECT_TWO_BODIES))
        drag += max_of<V>(load_speed_slope<V>(m.load, w), V{});
    r.speed = mode.slide * mode.slide * drag * m.gear.inertia_inverse;
    if (m.effects & EFFECT_CURRENT_LAG)
        r.current_filter = m.sensors.current_lag_rate;
    if (m.effects & EFFECT_SPEED_LAG)
        r.speed_filter = m.sensors.speed_lag_rate;
    return r;
}

template <class V> VGROOVE_INLINE V fastest_rate(const Rates<V> &r) {
    return max_of<V>(max_of<V>(r.current, r.speed), max_of<V>(r.current_filter, r.speed_filter));
}

// A stage's slopes of current and speed: as rosenbrock_slope() with the 2 x 2 block
template <class V, int N>
VGROOVE_INLINE void stiff_motor_slopes(const Rates<V> &r, const MotorCoupling<V> &c, V h,
                                       const State<V, N> &f, const State<V, N> &sum,
                                       State<V, N> &k) {
    const V g = Ros34pw2::GAMMA * h;
    const V sum_i = sum.x[STATE_CURRENT], sum_w = sum.x[STATE_SPEED];
    const V right_i = f.x[STATE_CURRENT] - h * (r.current * sum_i + c.back_emf * sum_w),
            right_w = f.x[STATE_SPEED] + h * (c.torque * sum_i - r.speed * sum_w);
    const V own_i = 1.0 + g * r.current, own_w = 1.0 + g * r.speed;
    const V inverse = 1.0 / (own_i * own_w + g * g * c.back_emf * c.torque);
    k.x[STATE_CURRENT] = inverse * (own_w * right_i - g * c.back_emf * right_w);
    k.x[STATE_SPEED] = inverse * (own_i * right_w + g * c.torque * right_i);
}

// Slope of a filter's state in a stage. The filter is a first-order lag behind the state `source`
// (current or speed), whose slope in this stage must be in k already.
template <class V, int N>
VGROOVE_INLINE void stiff_filter_slope(V rate, V h, int source, int filter, const State<V, N> &sum,
                                       State<V, N> &k) {
    const V right = k.x[filter] + Ros34pw2::GAMMA * (h * rate) * k.x[source];
    k.x[filter] = rosenbrock_slope<V>(right, h, rate, sum.x[filter] - sum.x[source]);
}

template <class V, int N>
VGROOVE_INLINE State<V, N> stiff_slope(const Rates<V> &r, const MotorCoupling<V> &c, V h,
                                       const State<V, N> &f, const State<V, N> &sum) {
    State<V, N> k = f;
    stiff_motor_slopes<V, N>(r, c, h, f, sum, k);
    if constexpr (N > STATE_CORE_COUNT) {
        stiff_filter_slope<V, N>(r.current_filter, h, STATE_CURRENT, STATE_CURRENT_FILTER, sum, k);
        stiff_filter_slope<V, N>(r.speed_filter, h, STATE_SPEED, STATE_SPEED_FILTER, sum, k);
    }
    return k;
}

// slope: the right-hand side at the start of the step.
template <class V, int N>
VGROOVE_INLINE RosenbrockStep<V, N> stiff_step(const Driven<V> &d, const Rates<V> &r, V h,
                                               const State<V, N> &y, const State<V, N> &slope) {
    const MotorCoupling<V> c = stiff_coupling<V, N>(d, y);
    return ros34pw2_step<V, N>(
        y, h, slope,
        [&](const State<V, N> &f, const State<V, N> &sum)
            __attribute__((always_inline)) { return stiff_slope<V, N>(r, c, h, f, sum); },
        [&](V tau, const State<V, N> &s) __attribute__((always_inline)) {
            return drivetrain_slope<V, N>(d.model, d.drive, d.mode, tau, s);
        });
}

}  // namespace vgroove

#endif
