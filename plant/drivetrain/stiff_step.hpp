// One step for what explicit Runge-Kutta would crawl through: brushes and dead time around 0 A,
// tiny inductances and time constants.
//
// ROS34PW2 of Rang and Angermann (BIT 45, 2005), order 3 with an error of order 2, L-stable, for
// any approximation of the Jacobian: here its diagonal for currents, speed and filters, so that no
// system has to be solved.
#ifndef VGROOVE_PLANT_DRIVETRAIN_STIFF_STEP_HPP
#define VGROOVE_PLANT_DRIVETRAIN_STIFF_STEP_HPP

#include "drivetrain/model.hpp"

namespace vgroove {

constexpr double STIFF_STEP = 1.2;      // rate times step from which on a step is stiff,
constexpr double STIFF_STRETCH = 64.0;  // where the rate times the whole stretch is more than this

// How fast each state falls back by itself, 1/s; 0 where that is never fast.
template <class V> struct Rates { V current, speed, current_filter, speed_filter; };

template <class V, int N>
VGROOVE_INLINE V rate_of_current(const Drivetrain<V> &m, const Drive<V> &in, const Mode<V> &mode,
                                 const State<V, N> &s) {
    const Electrical<V> e = drivetrain_electrical<V, N>(m, in, mode, V{}, s);
    V ohm = e.r;
    if (m.input == InputKind::DUTY)
        ohm += m.bridge.resistance_ohm +
               (m.bus_measured ? V{} : m.supply.resistance_ohm * e.duty * e.duty);
    if (m.effects & EFFECT_BRUSH) {
        const V share = e.brush_v / m.motor.brush_v;
        ohm += abs_of<V>(m.motor.brush_v * (1.0 - share * share)) /
               max_of<V>(splat<V>(BRUSH_CURRENT_A), e.ripple_a);
    }
    if ((m.effects & EFFECT_DEAD_TIME) && m.input == InputKind::DUTY)
        ohm += in.dead * e.bus_v * bridge_sign_slope<V>(m.bridge, e.i, e.ripple_a);
    return (in.open > 0.0) & (mode.diode == 0.0) ? V{} : ohm * m.motor.inductance_inverse;
}

template <class V, int N>
VGROOVE_INLINE Rates<V> stiff_rates(const Drivetrain<V> &m, const Drive<V> &in, const Mode<V> &mode,
                                    const State<V, N> &s) {
    Rates<V> r{};
    if (m.input != InputKind::CURRENT)
        r.current = rate_of_current<V, N>(m, in, mode, s);
    V drag = abs_of<V>(m.friction.viscous);
    if (!(m.effects & EFFECT_TWO_BODIES))
        drag += max_of<V>(load_speed_slope<V>(m.load, s.x[STATE_SPEED]), V{});
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

constexpr double STIFF_GAMMA = 0.435866521508459;

// A stage's slope k from the right-hand side f and the earlier slopes in `sum`: (1 + h gamma rate)
// k = f - h rate sum
template <class V> VGROOVE_INLINE V stiff_solved(V f, V h, V rate, V sum) {
    return (f - h * rate * sum) / (1.0 + STIFF_GAMMA * (h * rate));
}

template <class V, int N>
VGROOVE_INLINE State<V, N> stiff_stage(const Rates<V> &r, V h, const State<V, N> &f,
                                       const State<V, N> &sum) {
    State<V, N> k = f;
    k.x[STATE_CURRENT] = stiff_solved<V>(f.x[STATE_CURRENT], h, r.current, sum.x[STATE_CURRENT]);
    k.x[STATE_SPEED] = stiff_solved<V>(f.x[STATE_SPEED], h, r.speed, sum.x[STATE_SPEED]);
    if constexpr (N > STATE_CORE_COUNT) {
        k.x[STATE_CURRENT_FILTER] = stiff_solved<V>(f.x[STATE_CURRENT_FILTER], h, r.current_filter,
                                                    sum.x[STATE_CURRENT_FILTER]);
        k.x[STATE_SPEED_FILTER] =
            stiff_solved<V>(f.x[STATE_SPEED_FILTER], h, r.speed_filter, sum.x[STATE_SPEED_FILTER]);
    }
    return k;
}

template <class V, int N> struct StiffStep { State<V, N> state, error; };

// slope: the right-hand side at the start of the step.
template <class V, int N>
VGROOVE_INLINE StiffStep<V, N> stiff_step(const Drivetrain<V> &m, const Drive<V> &in,
                                          const Mode<V> &mode, const Rates<V> &r, V h,
                                          const State<V, N> &y, const State<V, N> &slope) {
    State<V, N> s{}, sum{};
    const State<V, N> k1 = stiff_stage<V, N>(r, h, slope, sum);
    for (int n = 0; n < N; ++n) {
        s.x[n] = y.x[n] + h * (0.871733043016918 * k1.x[n]);
        sum.x[n] = -0.871733043016918 * k1.x[n];
    }
    const State<V, N> k2 = stiff_stage<V, N>(
        r, h, drivetrain_derivative<V, N>(m, in, mode, 0.871733043016918 * h, s), sum);
    for (int n = 0; n < N; ++n) {
        s.x[n] = y.x[n] + h * (0.84457060015369423 * k1.x[n] - 0.11299064236484185 * k2.x[n]);
        sum.x[n] = -0.90338057013044082 * k1.x[n] + 0.054180672388095326 * k2.x[n];
    }
    const State<V, N> k3 = stiff_stage<V, N>(
        r, h, drivetrain_derivative<V, N>(m, in, mode, 0.73157995778885238 * h, s), sum);
    for (int n = 0; n < N; ++n) {
        s.x[n] = y.x[n] + h * k3.x[n];
        sum.x[n] = 0.24212380706095346 * k1.x[n] - 1.2232505839045147 * k2.x[n] +
                   0.54526025533510214 * k3.x[n];
    }
    const State<V, N> k4 =
        stiff_stage<V, N>(r, h, drivetrain_derivative<V, N>(m, in, mode, h, s), sum);
    StiffStep<V, N> end;
    for (int n = 0; n < N; ++n) {
        end.state.x[n] =
            y.x[n] + h * (0.24212380706095346 * k1.x[n] - 1.2232505839045147 * k2.x[n] +
                          1.545260255335102 * k3.x[n] + STIFF_GAMMA * k4.x[n]);
        end.error.x[n] = (0.24212380706095346 - 0.37810903145819369) * k1.x[n] +
                         (0.096042292212423178 - 1.2232505839045147) * k2.x[n] +
                         (1.545260255335102 - 0.5) * k3.x[n] +
                         (STIFF_GAMMA - 0.2179332607542295) * k4.x[n];
    }
    return end;
}

}  // namespace vgroove

#endif
