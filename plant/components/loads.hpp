// Loads at the output shaft, referred to the motor shaft: a torque that opposes motion, a pendulum,
// a free load's friction. Joints are in joints.hpp.
#ifndef VGROOVE_PLANT_COMPONENTS_LOADS_HPP
#define VGROOVE_PLANT_COMPONENTS_LOADS_HPP

#include "components/effects.hpp"
#include "components/friction_law.hpp"
#include "components/state.hpp"

namespace vgroove {

enum class LoadKind {
    NONE,
    TORQUE,
    PENDULUM,
    FREE,
    LOCKED,
    HARD_JOINT,
    DISC_SPRING,
    WOOD_SCREW
};  // from LOCKED on: joints of the impact mechanism (joints.hpp)

constexpr double GRAVITY_M_S2 = 9.81;  // gap contract, pendulum

template <class V> struct Load {
    LoadKind kind;
    V ratio_inverse;
    V pendulum_nm;  // mass g length
    V zero_rad;
    FrictionLaw<V> law;  // of a free load, at the output
    V exponential;       // 1: its older form
};

// TL / N of the torque column at a time within the stretch
template <class V> VGROOVE_INLINE V load_opposing(const Load<V> &p, const Drive<V> &in, V tau) {
    return p.kind == LoadKind::TORQUE ? (in.load_nm + in.load_rate * tau) * p.ratio_inverse : V{};
}

// m g l sin(th / N - zero) / N
template <class V> VGROOVE_INLINE V load_of_angle(const Load<V> &p, V output_angle_motor) {
    if (p.kind != LoadKind::PENDULUM)
        return V{};
    return p.pendulum_nm * p.ratio_inverse *
           sin_of<V>(output_angle_motor * p.ratio_inverse - p.zero_rad);
}

// A free load: friction law of physics.md section 3 over the output's speed w / N, referred by 1 /
// N; its slope by 1 / N^2
template <class V> VGROOVE_INLINE V load_of_speed(const Load<V> &p, V output_w_motor) {
    if (p.kind != LoadKind::FREE)
        return V{};
    const V w = output_w_motor * p.ratio_inverse;
    return (p.exponential > 0.0 ? friction_law_exponential<V>(p.law, w)
                                : friction_law_stribeck<V>(p.law, w)) *
           p.ratio_inverse;
}
template <class V> VGROOVE_INLINE V load_speed_slope(const Load<V> &p, V output_w_motor) {
    if (p.kind != LoadKind::FREE)
        return V{};
    const V w = output_w_motor * p.ratio_inverse;
    const V slope = p.exponential > 0.0 ? friction_law_exponential_slope<V>(p.law, w)
                                        : friction_law_stribeck_slope<V>(p.law, w);
    return slope * p.ratio_inverse * p.ratio_inverse;
}

// Potential energy m g l (1 - cos(th / N - zero))
template <class V> VGROOVE_INLINE V load_energy(const Load<V> &p, V output_angle_motor) {
    if (p.kind != LoadKind::PENDULUM)
        return V{};
    return p.pendulum_nm * (1.0 - cos_of<V>(output_angle_motor * p.ratio_inverse - p.zero_rad));
}

}  // namespace vgroove

#endif
