// Gear: inertia referred to the motor shaft, or two bodies joined by a spring, a damper and a play
// (docs/spec/model.md, section 2; effects coupler_compliance and gear_backlash).
#ifndef VGROOVE_PLANT_COMPONENTS_GEAR_HPP
#define VGROOVE_PLANT_COMPONENTS_GEAR_HPP

#include <cmath>

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

// Contact of the flanks where there is backlash without a coupler: a spring of this frequency
// against the reduced inertia, so that a contact ends within a row of 1 ms (estimate). The damping
// ratio z gives a coefficient of restitution exp(-pi z / sqrt(1 - z^2)) = 0.6, greased steel at low
// speed (estimate).
constexpr double CONTACT_RAD_S = 8000.0;
constexpr double CONTACT_DAMPING_RATIO = 0.15;

template <class V> struct Gear {
    V ratio_inverse;
    V inertia_inverse;         // of everything that turns with the motor
    V output_inertia_inverse;  // of the output side, referred to the motor shaft; two bodies only
    V stiffness, damping;      // at the motor shaft
    V half_play;               // rad at the motor shaft
};

// load_inertia_kg_m2: of the load, at the output. Two bodies: the coupler's stiffness, or the
// contact's where there is play alone; c = 2 damping_ratio sqrt(stiffness J), J that of the output
// side for a coupler and the reduced inertia for a contact.
template <class V>
void gear_set_lane(Gear<V> &g, int lane, const Parameters &p, std::uint32_t effects,
                   double load_inertia_kg_m2) {
    const double ratio2 = p.gearbox_ratio * p.gearbox_ratio;
    const double motor = p.motor_inertia_kg_m2 + p.effects.added_inertia.kg_m2;
    const bool split = (effects & EFFECT_TWO_BODIES) != 0u;
    const bool coupler = std::isfinite(p.effects.coupler_compliance.stiffness_nm_per_rad);
    const double output = (p.gearbox_output_inertia + load_inertia_kg_m2) / ratio2 +
                          (coupler ? p.effects.coupler_compliance.inertia_kg_m2 : 0.0);
    const double reduced = motor * output / (motor + output);
    const double stiffness = coupler ? p.effects.coupler_compliance.stiffness_nm_per_rad
                                     : CONTACT_RAD_S * CONTACT_RAD_S * reduced;
    const double damping =
        coupler ? 2.0 * p.effects.coupler_compliance.damping_ratio * std::sqrt(stiffness * output)
                : 2.0 * CONTACT_DAMPING_RATIO * std::sqrt(stiffness * reduced);
    set(g.ratio_inverse, lane, 1.0 / p.gearbox_ratio);
    set(g.inertia_inverse, lane, 1.0 / (split ? motor : motor + output));
    set(g.output_inertia_inverse, lane, split ? 1.0 / output : 0.0);
    set(g.stiffness, lane, split ? stiffness : 0.0);
    set(g.damping, lane, split ? damping : 0.0);
    set(g.half_play, lane,
        split ? 0.5 * p.effects.gear_backlash.play_rad * std::fabs(p.gearbox_ratio) : 0.0);
}

// Coupler torque K e + c e', e the twist beyond the play, e' = slip the difference of the speeds.
// Flanks that meet across a play push each other and never pull.
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

// Elastic part K e of the coupler torque
template <class V> VGROOVE_INLINE V gear_spring_torque(const Gear<V> &p, V twist) {
    const V over = max_of<V>(abs_of<V>(twist) - p.half_play, V{});
    return p.stiffness * (twist < 0.0 ? -over : over);
}

// Energy of the spring K e^2 / 2
template <class V> VGROOVE_INLINE V gear_coupler_energy(const Gear<V> &p, V twist) {
    const V over = max_of<V>(abs_of<V>(twist) - p.half_play, V{});
    return 0.5 * p.stiffness * over * over;
}

}  // namespace vgroove

#endif
