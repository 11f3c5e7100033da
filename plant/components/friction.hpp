// Friction and drag torques at the motor shaft: what depends on speed, what depends on angle, and
// what holds at rest.
#ifndef VGROOVE_PLANT_COMPONENTS_FRICTION_HPP
#define VGROOVE_PLANT_COMPONENTS_FRICTION_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

template <class V> struct Friction {
    V viscous, coulomb_nm;  // nominal and effect together
    V forward_nm, backward_nm;
    V breakaway_nm, stribeck_inverse;
    V drag, directional;
    V grease, grease_rate;
    V cogging_nm, cogging_periods, cogging_phase;
    V eccentricity_nm, eccentricity_phase, ratio_inverse;
    V load_relative;
};

// load_dependent_friction: relative abs(TL) / N
template <class V>
VGROOVE_INLINE V friction_of_load(const Friction<V> &p, std::uint32_t effects, V load_motor_nm) {
    return effects & EFFECT_LOAD_FRICTION ? p.load_relative * abs_of<V>(load_motor_nm) : V{};
}

// T = b w + (Tc + breakaway exp(-(w / ws)^2)) s + (forward | -backward) + drag w |w| + directional
// |w| + grease exp(-t / tg) w
template <class V>
VGROOVE_INLINE V friction_sliding(const Friction<V> &p, std::uint32_t effects, V slide, V w,
                                  V load_motor_nm, V time_s) {
    V coulomb = p.coulomb_nm + friction_of_load<V>(p, effects, load_motor_nm);
    V viscous = p.viscous;
    if (effects & EFFECT_STRIBECK) {
        const V share = w * p.stribeck_inverse;
        coulomb += p.breakaway_nm * exp_of<V>(-share * share);
    }
    if (effects & EFFECT_DRAG)
        viscous += p.drag * abs_of<V>(w);
    if (effects & EFFECT_GREASE)
        viscous += p.grease * exp_of<V>(-time_s * p.grease_rate);
    V torque = viscous * w + slide * coulomb + (slide > 0.0 ? p.forward_nm : -p.backward_nm);
    if (effects & EFFECT_DIRECTIONAL)
        torque += p.directional * abs_of<V>(w);
    return torque;
}

// At rest any torque from -(Tc + breakaway + backward) to Tc + breakaway + forward is held; each is
// the limit of the sliding torque at w -> 0.
template <class V> struct HoldLimits { V forward_nm, backward_nm; };
template <class V>
VGROOVE_INLINE HoldLimits<V> friction_hold(const Friction<V> &p, std::uint32_t effects,
                                           V load_motor_nm) {
    V coulomb = p.coulomb_nm + friction_of_load<V>(p, effects, load_motor_nm);
    if (effects & EFFECT_STRIBECK)
        coulomb += p.breakaway_nm;
    return {coulomb + p.forward_nm, coulomb + p.backward_nm};
}

// cogging torque_nm sin(periods th + phase) + eccentricity torque_nm sin(th / N + phase)
template <class V>
VGROOVE_INLINE V friction_of_angle(const Friction<V> &p, std::uint32_t effects, V angle) {
    V torque{};
    if (effects & EFFECT_COGGING)
        torque += p.cogging_nm * sin_of<V>(p.cogging_periods * angle + p.cogging_phase);
    if (effects & EFFECT_ECCENTRICITY)
        torque += p.eccentricity_nm * sin_of<V>(angle * p.ratio_inverse + p.eccentricity_phase);
    return torque;
}

// Their potential: -torque_nm / periods cos(periods th + phase) - torque_nm N cos(th / N + phase)
template <class V>
VGROOVE_INLINE V friction_angle_energy(const Friction<V> &p, std::uint32_t effects, V angle) {
    V energy{};
    if (effects & EFFECT_COGGING)
        energy -= p.cogging_nm / p.cogging_periods *
                  cos_of<V>(p.cogging_periods * angle + p.cogging_phase);
    if (effects & EFFECT_ECCENTRICITY)
        energy -= p.eccentricity_nm / p.ratio_inverse *
                  cos_of<V>(angle * p.ratio_inverse + p.eccentricity_phase);
    return energy;
}

}  // namespace vgroove

#endif
