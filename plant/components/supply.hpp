// Supply: open-circuit source behind a resistance, with droop by charge and polarisation
// (docs/spec/model.md, section 1).
#ifndef VGROOVE_PLANT_COMPONENTS_SUPPLY_HPP
#define VGROOVE_PLANT_COMPONENTS_SUPPLY_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

template <class V> struct Supply {
    V open_circuit_v, resistance_ohm;
    V volt_per_coulomb, polarisation_ohm, polarisation_rate;
};

template <class V> void supply_set_lane(Supply<V> &s, int lane, const Parameters &p) {
    set(s.open_circuit_v, lane, p.supply_voltage_v);
    set(s.resistance_ohm, lane,
        p.supply_resistance_ohm + p.effects.supply_resistance.resistance_ohm);
    set(s.volt_per_coulomb, lane, p.effects.supply_droop.volt_per_coulomb);
    set(s.polarisation_ohm, lane, p.effects.supply_droop.polarisation_ohm);
    set(s.polarisation_rate, lane, 1.0 / p.effects.supply_droop.polarisation_s);
}

// Effect supply_droop: Voc - volt_per_coulomb q - vp, q: charge drawn, vp: polarisation voltage
template <class V, int N>
VGROOVE_INLINE V supply_source(const Supply<V> &p, std::uint32_t effects, const State<V, N> &s) {
    if constexpr (N > STATE_POLARISATION)
        if (effects & EFFECT_SUPPLY_DROOP)
            return p.open_circuit_v - p.volt_per_coulomb * s.x[STATE_CHARGE] -
                   s.x[STATE_POLARISATION];
    return p.open_circuit_v;
}

// q' = d i; vp' = (polarisation_ohm d i - vp) / polarisation_s
template <class V, int N>
VGROOVE_INLINE void supply_derivative(const Supply<V> &p, std::uint32_t effects, V bus_a,
                                      const State<V, N> &s, State<V, N> &ds) {
    if (!(effects & EFFECT_SUPPLY_DROOP))
        return;
    ds.x[STATE_CHARGE] = bus_a;
    ds.x[STATE_POLARISATION] =
        (p.polarisation_ohm * bus_a - s.x[STATE_POLARISATION]) * p.polarisation_rate;
}

// Vs = Voc - Rs d i
template <class V> VGROOVE_INLINE V supply_bus(const Supply<V> &p, V source_v, V bus_a) {
    return source_v - p.resistance_ohm * bus_a;
}

// Heat Rs (d i)^2
template <class V> VGROOVE_INLINE V supply_loss(const Supply<V> &p, V bus_a) {
    return p.resistance_ohm * bus_a * bus_a;
}

}  // namespace vgroove

#endif
