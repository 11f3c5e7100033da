// Bridge, averaged over the PWM period: sign-magnitude drive with synchronous rectification, dead
// time, switch resistance, diodes when open (docs/spec/model.md, section 1).
#ifndef VGROOVE_PLANT_COMPONENTS_BRIDGE_HPP
#define VGROOVE_PLANT_COMPONENTS_BRIDGE_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

// Least ripple amplitude: docs/spec/gap.md, section 3, dead_time
constexpr double RIPPLE_FLOOR_A = 0.2;

template <class V> struct Bridge {
    V resistance_ohm;
    V ripple_a_per_v;  // 1 / (2 L pwm_hz)
    V at_edges;        // 1: dead time acts by the current at the two edges of the pulse
    V dead_share;      // 2 dead_time_s pwm_hz
};

// inductance_h: of the winding, including effect inductance
template <class V>
void bridge_set_lane(Bridge<V> &b, int lane, const Parameters &p, double inductance_h) {
    set(b.resistance_ohm, lane, p.effects.bridge_resistance.resistance_ohm);
    set(b.ripple_a_per_v, lane,
        inductance_h > 0.0 ? 1.0 / (2.0 * inductance_h * p.bridge_pwm_hz) : 0.0);
    set(b.at_edges, lane, p.effects.dead_time.at_edges);
    set(b.dead_share, lane, 2.0 * p.effects.dead_time.dead_time_s * p.bridge_pwm_hz);
}

// Amplitude of the current ripple: ir = max(0.2 A, abs(d) (1 - abs(d)) Vs / (2 L pwm_hz))
template <class V> VGROOVE_INLINE V bridge_ripple(const Bridge<V> &p, V duty, V bus_v) {
    const V share = abs_of<V>(duty);
    return max_of<V>(splat<V>(RIPPLE_FLOOR_A), share * (1.0 - share) * bus_v * p.ripple_a_per_v);
}

template <class V> VGROOVE_INLINE V within_one(V x) {
    return max_of<V>(splat<V>(-1.0), min_of<V>(splat<V>(1.0), x));
}

// S(i) = i / ir within +-1: the sign of the current averaged over the ripple. With at_edges: the
// mean of the signs at the two edges of the pulse, where the current is i - ir and i + ir.
template <class V> VGROOVE_INLINE V bridge_sign(const Bridge<V> &p, V i, V ripple_a) {
    const V edges = within_one<V>((i - ripple_a) / RIPPLE_FLOOR_A) +
                    within_one<V>((i + ripple_a) / RIPPLE_FLOOR_A);
    return p.at_edges > 0.0 ? 0.5 * edges : within_one<V>(i / ripple_a);
}

// dS / di, 1/A
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
