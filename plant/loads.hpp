// Loads at the output shaft, referred to the motor shaft: a torque that opposes motion, a pendulum. Joints are in joints.hpp.
#ifndef VGROOVE_PLANT_LOADS_HPP
#define VGROOVE_PLANT_LOADS_HPP

#include "effects.hpp"
#include "state.hpp"

namespace vgroove {

enum class LoadKind {
    NONE,
    TORQUE,
    PENDULUM,
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
};

// TL / N of the torque column at a time within the stretch
template <class V> VGROOVE_INLINE V load_opposing(const Load<V> &p, const Drive<V> &in, V tau) {
    return p.kind == LoadKind::TORQUE ? (in.load_nm + in.load_rate * tau) * p.ratio_inverse : V{};
}

// m g l sin(th / N - zero) / N
template <class V> VGROOVE_INLINE V load_of_angle(const Load<V> &p, V output_angle_motor) {
    if (p.kind != LoadKind::PENDULUM)
        return V{};
    return p.pendulum_nm * p.ratio_inverse * sin_of<V>(output_angle_motor * p.ratio_inverse - p.zero_rad);
}

// Potential energy m g l (1 - cos(th / N - zero))
template <class V> VGROOVE_INLINE V load_energy(const Load<V> &p, V output_angle_motor) {
    if (p.kind != LoadKind::PENDULUM)
        return V{};
    return p.pendulum_nm * (1.0 - cos_of<V>(output_angle_motor * p.ratio_inverse - p.zero_rad));
}

}  // namespace vgroove

#endif
