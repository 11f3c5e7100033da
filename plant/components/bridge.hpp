// Bridge, averaged over the PWM period: sign-magnitude drive with synchronous rectification, dead
// time, switch resistance, diodes when open.
#ifndef VGROOVE_PLANT_COMPONENTS_BRIDGE_HPP
#define VGROOVE_PLANT_COMPONENTS_BRIDGE_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

constexpr double RIPPLE_FLOOR_A = 0.2;  // gap contract, dead_time

template <class V> struct Bridge {
    V resistance_ohm;
    V ripple_a_per_v;  // 1 / (2 L pwm_hz)
    V at_edges;        // 1: dead time follows the current at the two edges of the pulse
};

// ir = max(0.2 A, abs(d) (1 - abs(d)) Vs / (2 L pwm_hz))
template <class V> VGROOVE_INLINE V bridge_ripple(const Bridge<V> &p, V duty, V bus_v) {
    const V share = abs_of<V>(duty);
    return max_of<V>(splat<V>(RIPPLE_FLOOR_A), share * (1.0 - share) * bus_v * p.ripple_a_per_v);
}

template <class V> VGROOVE_INLINE V within_one(V x) {
    return max_of<V>(splat<V>(-1.0), min_of<V>(splat<V>(1.0), x));
}

// S(i) = i / ir within +-1: the sign of the current averaged over the ripple; or averaged over the
// two edges of the pulse, where the current is at i - ir and i + ir
template <class V> VGROOVE_INLINE V bridge_sign(const Bridge<V> &p, V i, V ripple_a) {
    const V edges = within_one<V>((i - ripple_a) / RIPPLE_FLOOR_A) +
                    within_one<V>((i + ripple_a) / RIPPLE_FLOOR_A);
    return p.at_edges > 0.0 ? 0.5 * edges : within_one<V>(i / ripple_a);
}

// Slope of S(i), 1/A
template <class V> VGROOVE_INLINE V bridge_sign_slope(const Bridge<V> &p, V i, V ripple_a) {
    const V edge =
        abs_of<V>(abs_of<V>(i) - ripple_a) < RIPPLE_FLOOR_A ? splat<V>(0.5 / RIPPLE_FLOOR_A) : V{};
    const V mean = abs_of<V>(i) < ripple_a ? 1.0 / ripple_a : V{};
    return p.at_edges > 0.0 ? edge : mean;
}

// v = d Vs - dead Vs S(i) - resistance_ohm i
template <class V>
VGROOVE_INLINE V bridge_voltage(const Bridge<V> &p, std::uint32_t effects, const Drive<V> &in,
                                V duty, V bus_v, V ripple_a, V i) {
    const V v = duty * bus_v - p.resistance_ohm * i;
    if (!(effects & EFFECT_DEAD_TIME))
        return v;
    return v - in.dead * bus_v * bridge_sign<V>(p, i, ripple_a);
}

// Heat in switches and diodes: resistance_ohm i^2 + dead Vs S(i) i
template <class V>
VGROOVE_INLINE V bridge_loss(const Bridge<V> &p, std::uint32_t effects, const Drive<V> &in, V bus_v,
                             V ripple_a, V i) {
    const V loss = p.resistance_ohm * i * i;
    return effects & EFFECT_DEAD_TIME ? loss + in.dead * bus_v * bridge_sign<V>(p, i, ripple_a) * i
                                      : loss;
}

}  // namespace vgroove

#endif
