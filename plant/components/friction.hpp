// Friction and drag torques at the motor shaft: those that depend on speed, those that depend on
// angle, and the torque that is held at rest (docs/spec/model.md, section 2).
#ifndef VGROOVE_PLANT_COMPONENTS_FRICTION_HPP
#define VGROOVE_PLANT_COMPONENTS_FRICTION_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

template <class V> struct Friction {
    V viscous, coulomb_nm;  // nominal value plus effect
    V forward_nm, backward_nm;
    V breakaway_nm, stribeck_inverse;
    V drag, directional;
    V grease, grease_rate;
    V cogging_nm, cogging_periods, cogging_phase;
    V eccentricity_nm, eccentricity_phase, ratio_inverse;
    V load_relative;
};

template <class V> void friction_set_lane(Friction<V> &f, int lane, const Parameters &p) {
    set(f.viscous, lane, p.motor_viscous + p.effects.viscous_friction.nm_s_per_rad);
    set(f.coulomb_nm, lane, p.motor_coulomb_nm + p.effects.coulomb_friction.torque_nm);
    set(f.forward_nm, lane, p.effects.asymmetric_friction.forward_nm);
    set(f.backward_nm, lane, p.effects.asymmetric_friction.backward_nm);
    set(f.breakaway_nm, lane, p.effects.stribeck_friction.breakaway_nm);
    set(f.stribeck_inverse, lane, 1.0 / p.effects.stribeck_friction.speed_rad_s);
    set(f.drag, lane, p.effects.quadratic_drag.nm_s2_per_rad2);
    set(f.directional, lane, p.effects.directional_viscous.nm_s_per_rad);
    set(f.grease, lane, p.effects.cold_grease.nm_s_per_rad);
    set(f.grease_rate, lane, 1.0 / p.effects.cold_grease.time_s);
    set(f.cogging_nm, lane, p.effects.cogging_torque.torque_nm);
    set(f.cogging_periods, lane, p.effects.cogging_torque.periods_per_rev);
    set(f.cogging_phase, lane, p.effects.cogging_torque.phase_rad);
    set(f.eccentricity_nm, lane, p.effects.gear_eccentricity.torque_nm);
    set(f.eccentricity_phase, lane, p.effects.gear_eccentricity.phase_rad);
    set(f.ratio_inverse, lane, 1.0 / p.gearbox_ratio);
    set(f.load_relative, lane, p.effects.load_dependent_friction.relative);
}

// Effect load_dependent_friction: relative |TL| / N
template <class V>
VGROOVE_INLINE V friction_of_load(const Friction<V> &p, std::uint32_t effects, V load_motor_nm) {
    return effects & EFFECT_LOAD_DEPENDENT_FRICTION ? p.load_relative * abs_of<V>(load_motor_nm)
                                                    : V{};
}

// T = b w + (Tc + breakaway exp(-(w / ws)^2)) s + (forward | -backward)
//     + drag w |w| + grease exp(-t / tg) w + directional |w|,    s: direction of sliding
template <class V>
VGROOVE_INLINE V friction_sliding(const Friction<V> &p, std::uint32_t effects, V slide, V w,
                                  V load_motor_nm, V time_s) {
    V coulomb = p.coulomb_nm + friction_of_load<V>(p, effects, load_motor_nm);
    V viscous = p.viscous;
    if (effects & EFFECT_STRIBECK_FRICTION) {
        const V share = w * p.stribeck_inverse;
        coulomb += p.breakaway_nm * exp_of<V>(-share * share);
    }
    if (effects & EFFECT_QUADRATIC_DRAG)
        viscous += p.drag * abs_of<V>(w);
    if (effects & EFFECT_COLD_GREASE)
        viscous += p.grease * exp_of<V>(-time_s * p.grease_rate);
    V torque = viscous * w + slide * coulomb + (slide > 0.0 ? p.forward_nm : -p.backward_nm);
    if (effects & EFFECT_DIRECTIONAL_VISCOUS)
        torque += p.directional * abs_of<V>(w);
    return torque;
}

// dT / dw of the parts that grow with speed
template <class V>
VGROOVE_INLINE V friction_speed_slope(const Friction<V> &p, std::uint32_t effects, V slide, V w,
                                      V time_s) {
    V slope = p.viscous;
    if (effects & EFFECT_QUADRATIC_DRAG)
        slope += 2.0 * p.drag * abs_of<V>(w);
    if (effects & EFFECT_COLD_GREASE)
        slope += p.grease * exp_of<V>(-time_s * p.grease_rate);
    if (effects & EFFECT_DIRECTIONAL_VISCOUS)
        slope += slide * p.directional;
    return slope;
}

// At rest any torque from -(Tc + breakaway + backward) to Tc + breakaway + forward is held; both
// ends are limits of the sliding torque for w -> 0.
template <class V> struct HoldLimits { V forward_nm, backward_nm; };
template <class V>
VGROOVE_INLINE HoldLimits<V> friction_hold(const Friction<V> &p, std::uint32_t effects,
                                           V load_motor_nm) {
    V coulomb = p.coulomb_nm + friction_of_load<V>(p, effects, load_motor_nm);
    if (effects & EFFECT_STRIBECK_FRICTION)
        coulomb += p.breakaway_nm;
    return {coulomb + p.forward_nm, coulomb + p.backward_nm};
}

// Effects cogging_torque and gear_eccentricity: torque_nm sin(periods th + phase) + torque_nm
// sin(th / N + phase)
template <class V>
VGROOVE_INLINE V friction_of_angle(const Friction<V> &p, std::uint32_t effects, V angle) {
    V torque{};
    if (effects & EFFECT_COGGING_TORQUE)
        torque += p.cogging_nm * sin_of<V>(p.cogging_periods * angle + p.cogging_phase);
    if (effects & EFFECT_GEAR_ECCENTRICITY)
        torque += p.eccentricity_nm * sin_of<V>(angle * p.ratio_inverse + p.eccentricity_phase);
    return torque;
}

// Angular frequency, rad/s, of the torque of cogging and gear eccentricity (the faster one) while
// the shaft turns at speed w
template <class V>
VGROOVE_INLINE V friction_angle_frequency(const Friction<V> &p, std::uint32_t effects, V w) {
    V periods{};
    if (effects & EFFECT_GEAR_ECCENTRICITY)
        periods = abs_of<V>(p.ratio_inverse);
    if (effects & EFFECT_COGGING_TORQUE)
        periods = max_of<V>(periods, p.cogging_periods);
    return periods * abs_of<V>(w);
}

// Potential energy of both: -torque_nm / periods cos(periods th + phase) - torque_nm N cos(th / N +
// phase)
template <class V>
VGROOVE_INLINE V friction_angle_energy(const Friction<V> &p, std::uint32_t effects, V angle) {
    V energy{};
    if (effects & EFFECT_COGGING_TORQUE)
        energy -= p.cogging_nm / p.cogging_periods *
                  cos_of<V>(p.cogging_periods * angle + p.cogging_phase);
    if (effects & EFFECT_GEAR_ECCENTRICITY)
        energy -= p.eccentricity_nm / p.ratio_inverse *
                  cos_of<V>(angle * p.ratio_inverse + p.eccentricity_phase);
    return energy;
}

}  // namespace vgroove

#endif
