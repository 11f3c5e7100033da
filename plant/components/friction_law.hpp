// Friction law of free loads and of the drill driver's chuck: a smooth torque over speed, in two
// forms (docs/spec/model.md, section 3).
#ifndef VGROOVE_PLANT_COMPONENTS_FRICTION_LAW_HPP
#define VGROOVE_PLANT_COMPONENTS_FRICTION_LAW_HPP

#include "numeric/lanes.hpp"

namespace vgroove {

template <class V> struct FrictionLaw {
    V breakaway_nm, coulomb_nm, viscous;
    V breakaway_rad_s;  // w_brk; wSt = sqrt(2) w_brk, wCoul = w_brk / 10
    V threshold_rad_s;  // w_th of the exponential form
    V decay_s_per_rad;  // cv of the exponential form
};

// Stribeck form (below, 1.41421... is sqrt(2) and 2.33164... is sqrt(2e)):
// T = sqrt(2e) (Tbrk - Tc) exp(-(w / wSt)^2) w / wSt + Tc tanh(w / wCoul) + f w
template <class V> VGROOVE_INLINE V friction_law_stribeck(const FrictionLaw<V> &p, V w) {
    const V share = w / (1.4142135623730951 * p.breakaway_rad_s);
    const V peak =
        2.331643981597124 * (p.breakaway_nm - p.coulomb_nm) * exp_of<V>(-share * share) * share;
    return peak + p.coulomb_nm * tanh_of<V>(10.0 * w / p.breakaway_rad_s) + p.viscous * w;
}

// dT / dw of the Stribeck form
template <class V> VGROOVE_INLINE V friction_law_stribeck_slope(const FrictionLaw<V> &p, V w) {
    const V scale = 1.4142135623730951 * p.breakaway_rad_s;
    const V share = w / scale;
    const V peak_slope = 2.331643981597124 * (p.breakaway_nm - p.coulomb_nm) *
                         exp_of<V>(-share * share) * (1.0 - 2.0 * share * share) / scale;
    const V sign = tanh_of<V>(10.0 * w / p.breakaway_rad_s);
    return peak_slope + p.coulomb_nm * (1.0 - sign * sign) * 10.0 / p.breakaway_rad_s + p.viscous;
}

// Exponential form: linear below w_th; then (Tc + (Tbrk - Tc) exp(-cv |w|)) sign(w) + f w
template <class V> VGROOVE_INLINE V friction_law_exponential(const FrictionLaw<V> &p, V w) {
    const V speed = abs_of<V>(w);
    const V at = max_of<V>(speed, p.threshold_rad_s);
    const V torque = p.coulomb_nm +
                     (p.breakaway_nm - p.coulomb_nm) * exp_of<V>(-p.decay_s_per_rad * at) +
                     p.viscous * at;
    const V sized = speed < p.threshold_rad_s ? torque * speed / p.threshold_rad_s : torque;
    return w < 0.0 ? -sized : sized;
}

// dT / dw of the exponential form
template <class V> VGROOVE_INLINE V friction_law_exponential_slope(const FrictionLaw<V> &p, V w) {
    const V speed = abs_of<V>(w);
    const V at = max_of<V>(speed, p.threshold_rad_s);
    const V decaying = (p.breakaway_nm - p.coulomb_nm) * exp_of<V>(-p.decay_s_per_rad * at);
    const V beyond = p.viscous - p.decay_s_per_rad * decaying;
    return speed < p.threshold_rad_s
               ? (p.coulomb_nm + decaying + p.viscous * at) / p.threshold_rad_s
               : beyond;
}

}  // namespace vgroove

#endif
