// Fast mode: the anvil that nothing touches rings on its joint in closed form, and is left out of
// the equations until it can be touched again.
#ifndef VGROOVE_PLANT_IMPACT_RINGING_HPP
#define VGROOVE_PLANT_IMPACT_RINGING_HPP

#include "impact/interpolant.hpp"

namespace vgroove {

// Longest step times the anvil's natural frequency, 1, while the hammer can be touched by the
// oscillating anvil
constexpr double RING_STEP = 1.0;
// An amplitude below this does not limit the step: its effect on the contacts is negligible.
constexpr double RING_NEGLIGIBLE_RAD = 1e-5;

// Amplitude of the untouched anvil about its head, rad
template <class L> VGROOVE_INLINE double ring_swing(const Impact &m, const ImpactState<L> &s) {
    return std::sqrt(s.x[L::TWIST] * s.x[L::TWIST] +
                     s.x[L::ANVIL_SPEED] * s.x[L::ANVIL_SPEED] / m.ring_square);
}

// Upper bound of |K e + C e'|, the joint's torque T on an anvil that nothing touches, for all later
// times. T is a sum of solutions of e'' + 2 ring_decay e' + ring_square e = 0 and so a solution
// itself; T^2 + T'^2 / ring_square falls at the rate 4 ring_decay T'^2 / ring_square.
template <class L> VGROOVE_INLINE double ring_torque(const Impact &m, const ImpactState<L> &s) {
    const double twist = s.x[L::TWIST], speed = s.x[L::ANVIL_SPEED];
    const double torque = m.joint.stiffness * twist + m.joint.damping * speed;
    const double rate =
        m.joint.stiffness * speed - m.joint.damping * m.anvil_inertia_inverse * torque;
    return std::sqrt(torque * torque + rate * rate / m.ring_square);
}

// Amplitude, rad, of the part of the twist that may make the anvil touch a lug within a long step
// and not at its ends: of an oscillation the whole amplitude, above critical damping that of the
// faster of the two exponentials.
template <class L> VGROOVE_INLINE double ring_hidden(const Impact &m, const ImpactState<L> &s) {
    if (m.ring_swings || m.ring_rate <= 0.0)
        return ring_swing<L>(m, s);
    const double slow = m.ring_decay - m.ring_rate;
    return std::fabs(s.x[L::ANVIL_SPEED] + slow * s.x[L::TWIST]) / (2.0 * m.ring_rate);
}

// Whether the hammer's lugs are out of reach of an anvil with this amplitude
template <class L>
VGROOVE_INLINE bool ring_clear(const Impact &m, const ImpactMode &mode, const ImpactState<L> &s,
                               double swing) {
    if (mode.above)
        return true;
    const double from_head = impact_relative<L>(m, s) + s.x[L::TWIST];
    return mode.forward_rad - from_head > swing && from_head - mode.backward_rad > swing;
}

// Begins the closed form once nothing touches the anvil, its torque is below the slip torques and
// below the peak of the last blow; an anvil at rest is frozen.
template <class L> VGROOVE_INLINE void ring_begin(ImpactSolver<L> &self) {
    ImpactMode &mode = self.mode;
    const ImpactState<L> &s = self.state;
    const bool struck = mode.place == ContactPlace::FORWARD || mode.place == ContactPlace::BACKWARD;
    if (mode.frozen || struck || mode.slip != 0 || self.model.second_output)
        return;
    const double swing = ring_swing<L>(self.model, s);
    if (swing < FROZEN_TWIST_RAD) {
        mode.frozen = true;
    } else if (!mode.ringing) {
        const double torque = ring_torque<L>(self.model, s);
        const double peak = self.recorder.any ? self.recorder.blows.back().peak_torque_nm : 0.0;
        mode.ringing =
            torque < self.point.forward_nm && torque < self.point.backward_nm && torque <= peak;
    }
    if (mode.frozen || mode.ringing)
        self.slope.x[L::ANVIL_ANGLE] = self.slope.x[L::ANVIL_SPEED] = self.slope.x[L::TWIST] = 0.0;
    if (mode.frozen) {
        mode.ringing = false;
        self.state.x[L::ANVIL_SPEED] = 0.0;
    }
}

// Longest step: short while the hammer is within the anvil's amplitude
template <class L> VGROOVE_INLINE double ring_longest(const ImpactSolver<L> &self) {
    if (!self.mode.ringing)
        return IMPACT_NO_HORIZON_S;
    return ring_hidden<L>(self.model, self.state) < RING_NEGLIGIBLE_RAD ||
                   ring_clear<L>(self.model, self.mode, self.state,
                                 ring_swing<L>(self.model, self.state))
               ? IMPACT_NO_HORIZON_S
               : RING_STEP / std::sqrt(self.model.ring_square);
}

// Whether the tried step was too long to exclude a contact within the amplitude that the anvil had
// at its start
template <class L> VGROOVE_INLINE bool ring_contact_missed(const ImpactSolver<L> &self, double h) {
    if (!self.mode.ringing)
        return false;
    return h * h * self.model.ring_square > 1.01 * RING_STEP * RING_STEP &&
           ring_hidden<L>(self.model, self.state) >= RING_NEGLIGIBLE_RAD &&
           !ring_clear<L>(self.model, self.mode, self.step.end,
                          ring_swing<L>(self.model, self.state));
}

}  // namespace vgroove

#endif
