// Gear: referred inertia, and the output side behind a spring, damper and play where the effects
// ask for it.
#ifndef VGROOVE_PLANT_COMPONENTS_GEAR_HPP
#define VGROOVE_PLANT_COMPONENTS_GEAR_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

// Contact of backlash without a coupler: a stiff spring, its frequency against the reduced inertia
// (E); it ends well within a row of 1 ms. Its damping ratio z leaves exp(-pi z / sqrt(1 - z^2)) of
// the speed: 0.6, as greased steel at low speed (E).
constexpr double CONTACT_RAD_S = 8000.0;
constexpr double CONTACT_DAMPING_RATIO = 0.15;

template <class V> struct Gear {
    V ratio_inverse;
    V inertia_inverse;         // of everything that turns with the motor
    V output_inertia_inverse;  // of the output side, referred to the motor shaft; two bodies only
    V stiffness, damping;      // at the motor shaft
    V half_play;               // rad at the motor shaft
};

// K e + c x' with the twist e beyond the play; in contact over a play the flanks push and never
// pull
template <class V>
VGROOVE_INLINE V gear_coupler_torque(const Gear<V> &p, std::uint32_t effects, V twist, V slip) {
    if (!(effects & EFFECT_PLAY))
        return p.stiffness * twist + p.damping * slip;
    const V over = twist > p.half_play ? twist - p.half_play
                                       : (twist < -p.half_play ? twist + p.half_play : V{});
    const V torque = p.stiffness * over + p.damping * slip;
    const V forward = max_of<V>(torque, V{});
    const V backward = min_of<V>(torque, V{});
    return over > 0.0 ? forward : (over < 0.0 ? backward : V{});
}

// K e alone
template <class V> VGROOVE_INLINE V gear_spring_torque(const Gear<V> &p, V twist) {
    const V over = max_of<V>(abs_of<V>(twist) - p.half_play, V{});
    return p.stiffness * (twist < 0.0 ? -over : over);
}

// Spring energy K e^2 / 2
template <class V> VGROOVE_INLINE V gear_coupler_energy(const Gear<V> &p, V twist) {
    const V over = max_of<V>(abs_of<V>(twist) - p.half_play, V{});
    return 0.5 * p.stiffness * over * over;
}

}  // namespace vgroove

#endif
