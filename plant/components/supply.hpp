// Supply: open-circuit source behind a resistance, with droop by charge and polarisation.
#ifndef VGROOVE_PLANT_COMPONENTS_SUPPLY_HPP
#define VGROOVE_PLANT_COMPONENTS_SUPPLY_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

template <class V> struct Supply {
    V open_circuit_v, resistance_ohm;
    V volt_per_coulomb, polarisation_ohm, polarisation_rate;
};

// effect supply_droop: Voc falls by volt_per_coulomb q + vp
template <class V, int N>
VGROOVE_INLINE V supply_source(const Supply<V> &p, std::uint32_t effects, const State<V, N> &s) {
    if constexpr (N > STATE_POLARISATION)
        if (effects & EFFECT_DROOP)
            return p.open_circuit_v - p.volt_per_coulomb * s.x[STATE_CHARGE] -
                   s.x[STATE_POLARISATION];
    return p.open_circuit_v;
}

// q' = d i; vp' = (polarisation_ohm d i - vp) / polarisation_s
template <class V, int N>
VGROOVE_INLINE void supply_derivative(const Supply<V> &p, std::uint32_t effects, V bus_a,
                                      const State<V, N> &s, State<V, N> &ds) {
    if (!(effects & EFFECT_DROOP))
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
