// Motor: armature circuit of a permanent-magnet brushed machine, its torque constant, winding heat
// and brushes (docs/spec/model.md, section 2).
#ifndef VGROOVE_PLANT_COMPONENTS_MOTOR_HPP
#define VGROOVE_PLANT_COMPONENTS_MOTOR_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

// docs/spec/gap.md, section 3: winding_heating and brush_drop
constexpr double COPPER_PER_KELVIN = 0.0039;
constexpr double BRUSH_CURRENT_A = 0.3;

template <class V> struct Motor {
    V resistance_ohm;      // R (1 + relative)
    V inductance_inverse;  // 1 / (L (1 + relative))
    V constant;            // k (1 + relative), N m/A and V s/rad
    V saturation_inverse;  // 1 / A
    V kelvin_per_joule, cooling_rate;
    V brush_v;
};

// Inductance of the winding with its effect, H
inline double motor_inductance(const Parameters &p) {
    return p.motor_inductance_h * (1.0 + p.effects.inductance.relative);
}

// Torque constant with its effect, N m/A
inline double motor_torque_constant(const Parameters &p) {
    return p.motor_torque_constant * (1.0 + p.effects.torque_constant.relative);
}

template <class V> void motor_set_lane(Motor<V> &m, int lane, const Parameters &p) {
    const double inductance = motor_inductance(p);
    set(m.resistance_ohm, lane,
        p.motor_resistance_ohm * (1.0 + p.effects.winding_resistance.relative));
    set(m.inductance_inverse, lane, inductance > 0.0 ? 1.0 / inductance : 0.0);
    set(m.constant, lane, motor_torque_constant(p));
    set(m.saturation_inverse, lane, 1.0 / p.effects.magnetic_saturation.saturation_a);
    set(m.kelvin_per_joule, lane, p.effects.winding_heating.kelvin_per_joule);
    set(m.cooling_rate, lane, 1.0 / p.effects.winding_heating.cooling_s);
    set(m.brush_v, lane, p.effects.brush_drop.voltage_v);
}

// Torque constant with saturation: k / (1 + (i / saturation_a)^2)
template <class V> VGROOVE_INLINE V motor_constant(const Motor<V> &p, std::uint32_t effects, V i) {
    if (!(effects & EFFECT_MAGNETIC_SATURATION))
        return p.constant;
    const V share = i * p.saturation_inverse;
    return p.constant / (1.0 + share * share);
}

// Derivative of the torque constant by the current, N m/A^2
template <class V>
VGROOVE_INLINE V motor_constant_slope(const Motor<V> &p, std::uint32_t effects, V i) {
    if (!(effects & EFFECT_MAGNETIC_SATURATION))
        return V{};
    const V share = i * p.saturation_inverse, sum = 1.0 + share * share;
    return -2.0 * share * p.saturation_inverse * p.constant / (sum * sum);
}

// Resistance R (1 + 0.0039 D), D: temperature of the winding above its cold state, K
template <class V, int N>
VGROOVE_INLINE V motor_resistance(const Motor<V> &p, std::uint32_t effects, const State<V, N> &s) {
    if constexpr (N > STATE_HEAT)
        if (effects & EFFECT_WINDING_HEATING)
            return p.resistance_ohm * (1.0 + COPPER_PER_KELVIN * s.x[STATE_HEAT]);
    return p.resistance_ohm;
}

// D' = kelvin_per_joule i^2 R (1 + 0.0039 D) - D / cooling_s
template <class V, int N>
VGROOVE_INLINE void motor_heat_derivative(const Motor<V> &p, std::uint32_t effects, V i, V r,
                                          const State<V, N> &s, State<V, N> &ds) {
    if (effects & EFFECT_WINDING_HEATING)
        ds.x[STATE_HEAT] = p.kelvin_per_joule * i * i * r - s.x[STATE_HEAT] * p.cooling_rate;
}

// voltage_v tanh(i / 0.3 A), averaged over a ripple of +-ir: 0.3 / (2 ir) (ln cosh((i + ir) / 0.3)
// - ln cosh((i - ir) / 0.3))
template <class V>
VGROOVE_INLINE V motor_brush_voltage(const Motor<V> &p, std::uint32_t effects, V i, V ripple_a) {
    if (!(effects & EFFECT_BRUSH_DROP))
        return V{};
    const V upper = log_two_cosh<V>((i + ripple_a) / BRUSH_CURRENT_A);
    const V lower = log_two_cosh<V>((i - ripple_a) / BRUSH_CURRENT_A);
    return p.brush_v * (0.5 * BRUSH_CURRENT_A) * (upper - lower) / ripple_a;
}

// L i' = v - R i - k w - brush
template <class V>
VGROOVE_INLINE V motor_current_slope(const Motor<V> &p, V v, V r, V i, V k, V w, V brush_v) {
    return (v - r * i - k * w - brush_v) * p.inductance_inverse;
}

}  // namespace vgroove

#endif
