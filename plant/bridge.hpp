// Bridge, averaged over the PWM period: sign-magnitude drive with synchronous rectification, dead time, switch resistance, diodes when open.
#ifndef VGROOVE_PLANT_BRIDGE_HPP
#define VGROOVE_PLANT_BRIDGE_HPP

#include "effects.hpp"
#include "state.hpp"

namespace vgroove {

constexpr double RIPPLE_FLOOR_A = 0.2;  // gap contract, dead_time

template <class V> struct Bridge {
    V resistance_ohm;
    V ripple_a_per_v;  // 1 / (2 L pwm_hz)
};

// ir = max(0.2 A, abs(d) (1 - abs(d)) Vs / (2 L pwm_hz))
template <class V> VGROOVE_INLINE V bridge_ripple(const Bridge<V> &p, V duty, V bus_v) {
    const V share = abs_of<V>(duty);
    return max_of<V>(splat<V>(RIPPLE_FLOOR_A), share * (1.0 - share) * bus_v * p.ripple_a_per_v);
}

// S(i) = i / ir within +-1: the sign of the current averaged over the ripple
template <class V> VGROOVE_INLINE V bridge_sign(V i, V ripple_a) {
    return max_of<V>(splat<V>(-1.0), min_of<V>(splat<V>(1.0), i / ripple_a));
}

// v = d Vs - dead Vs S(i) - resistance_ohm i
template <class V> VGROOVE_INLINE V bridge_voltage(const Bridge<V> &p, std::uint32_t effects, const Drive<V> &in, V duty, V bus_v, V ripple_a, V i) {
    const V v = duty * bus_v - p.resistance_ohm * i;
    if (!(effects & EFFECT_DEAD_TIME))
        return v;
    return v - in.dead * bus_v * bridge_sign<V>(i, ripple_a);
}

// Heat in switches and diodes: resistance_ohm i^2 + dead Vs S(i) i
template <class V> VGROOVE_INLINE V bridge_loss(const Bridge<V> &p, std::uint32_t effects, const Drive<V> &in, V bus_v, V ripple_a, V i) {
    const V loss = p.resistance_ohm * i * i;
    return effects & EFFECT_DEAD_TIME ? loss + in.dead * bus_v * bridge_sign<V>(i, ripple_a) * i : loss;
}

}  // namespace vgroove

#endif
