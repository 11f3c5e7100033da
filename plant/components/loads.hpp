// Loads at the output shaft, referred to the motor shaft: a torque that opposes motion, a pendulum,
// the friction of a free load. Joints are in components/joints/.
#ifndef VGROOVE_PLANT_COMPONENTS_LOADS_HPP
#define VGROOVE_PLANT_COMPONENTS_LOADS_HPP

#include "components/effects.hpp"
#include "components/friction_law.hpp"
#include "components/state.hpp"

namespace vgroove {

// X(enumerator, name in rigs). From LOCKED on: joints, components/joints/.
// clang-format off
#define VGROOVE_LOADS(X) \
    X(NONE,        "none") \
    X(TORQUE,      "torque") \
    X(PENDULUM,    "pendulum") \
    X(FREE,        "free") \
    X(LOCKED,      "locked") \
    X(HARD_JOINT,  "hard_joint") \
    X(DISC_SPRING, "disc_spring") \
    X(WOOD_SCREW,  "wood_screw")
// clang-format on

#define VGROOVE_LOAD_ENUMERATOR(kind, name) kind,
enum class LoadKind { VGROOVE_LOADS(VGROOVE_LOAD_ENUMERATOR) };
#undef VGROOVE_LOAD_ENUMERATOR

#define VGROOVE_LOAD_NAME(kind, name) name,
constexpr const char *LOAD_NAMES[] = {VGROOVE_LOADS(VGROOVE_LOAD_NAME)};
#undef VGROOVE_LOAD_NAME

// Whether the load is a joint; a joint needs an impact mechanism.
constexpr bool load_is_joint(LoadKind kind) {
    return kind >= LoadKind::LOCKED;
}

constexpr double GRAVITY_M_S2 = 9.81;  // docs/spec/gap.md, section 2, pendulum

template <class V> struct Load {
    LoadKind kind;
    V ratio_inverse;
    V pendulum_nm;  // mass g length
    V zero_rad;
    FrictionLaw<V> law;  // of a free load, at the output
    V exponential;       // 1: the law's exponential form
};

// Inertia that the load adds at the output, kg m2
inline double load_inertia(const Parameters &p, LoadKind kind) {
    return kind == LoadKind::PENDULUM ? p.load.mass_kg * p.load.length_m * p.load.length_m : 0.0;
}

template <class V> void load_set_lane(Load<V> &l, int lane, const Parameters &p) {
    set(l.ratio_inverse, lane, 1.0 / p.gearbox_ratio);
    set(l.pendulum_nm, lane, p.load.mass_kg * GRAVITY_M_S2 * p.load.length_m);
    set(l.zero_rad, lane, p.load.zero_rad);
    set(l.law.breakaway_nm, lane, p.load.torque_nm * p.load.breakaway_ratio);
    set(l.law.coulomb_nm, lane, p.load.torque_nm);
    set(l.law.viscous, lane, p.load.viscous_nm_s_per_rad);
    set(l.law.breakaway_rad_s, lane, p.load.breakaway_rad_s);
    set(l.law.threshold_rad_s, lane, p.load.threshold_rad_s);
    set(l.law.decay_s_per_rad, lane, p.load.decay_s_per_rad);
    set(l.exponential, lane, p.load.exponential);
}

// TL / N of the log's torque column, tau after the start of the stretch
template <class V> VGROOVE_INLINE V load_opposing(const Load<V> &p, const Drive<V> &in, V tau) {
    return p.kind == LoadKind::TORQUE ? (in.load_nm + in.load_rate * tau) * p.ratio_inverse : V{};
}

// Torque of a pendulum at the motor shaft: m g length sin(th / N - zero) / N
template <class V> VGROOVE_INLINE V load_of_angle(const Load<V> &p, V output_angle_motor) {
    if (p.kind != LoadKind::PENDULUM)
        return V{};
    return p.pendulum_nm * p.ratio_inverse *
           sin_of<V>(output_angle_motor * p.ratio_inverse - p.zero_rad);
}

// A free load: the friction law over the output's speed w / N, referred to the motor shaft by 1 / N
template <class V> VGROOVE_INLINE V load_of_speed(const Load<V> &p, V output_w_motor) {
    if (p.kind != LoadKind::FREE)
        return V{};
    const V w = output_w_motor * p.ratio_inverse;
    return (p.exponential > 0.0 ? friction_law_exponential<V>(p.law, w)
                                : friction_law_stribeck<V>(p.law, w)) *
           p.ratio_inverse;
}

// Slope dT / dw of that torque, both referred to the motor shaft
template <class V> VGROOVE_INLINE V load_speed_slope(const Load<V> &p, V output_w_motor) {
    if (p.kind != LoadKind::FREE)
        return V{};
    const V w = output_w_motor * p.ratio_inverse;
    const V slope = p.exponential > 0.0 ? friction_law_exponential_slope<V>(p.law, w)
                                        : friction_law_stribeck_slope<V>(p.law, w);
    return slope * p.ratio_inverse * p.ratio_inverse;
}

// Potential energy m g length (1 - cos(th / N - zero))
template <class V> VGROOVE_INLINE V load_energy(const Load<V> &p, V output_angle_motor) {
    if (p.kind != LoadKind::PENDULUM)
        return V{};
    return p.pendulum_nm * (1.0 - cos_of<V>(output_angle_motor * p.ratio_inverse - p.zero_rad));
}

}  // namespace vgroove

#endif
