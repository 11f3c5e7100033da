// Acceptance of a trial step of the impact tool, whole or up to an event.
#ifndef VGROOVE_PLANT_IMPACT_ACCEPT_HPP
#define VGROOVE_PLANT_IMPACT_ACCEPT_HPP

#include "impact/locate.hpp"
#include "impact/mode_changes.hpp"

namespace vgroove {

template <class L>
VGROOVE_INLINE void impact_move_to(ImpactSolver<L> &self, double h, const ImpactState<L> &to) {
    self.state = to;
    self.drive.command += self.drive.command_rate * h;
    self.drive.load_nm += self.drive.load_rate * h;
    self.drive.time_s += h;
    self.stats.steps += 1.0;
}

// Slope in time of the torque of a sticking joint
template <class L> VGROOVE_INLINE double impact_torque_rate(const ImpactSolver<L> &self) {
    const Joint &j = self.model.joint;
    return self.mode.slip == 0
               ? j.stiffness * self.slope.x[L::TWIST] + j.damping * self.slope.x[L::ANVIL_SPEED]
               : 0.0;
}

// Accepts the tried step up to a share of it, and applies the event that ends it (-1: none).
template <class L>
VGROOVE_CLONES_APART void impact_accept(ImpactSolver<L> &self, double share, int event) {
    const double h = self.step.h, torque = self.point.joint_nm, rate = impact_torque_rate(self);
    if (self.observer)
        self.observer->step(self, h, share);
    if (share != 1.0)
        impact_interpolate(self, h);
    impact_move_to(self, h * share, share == 1.0 ? self.step.end : impact_between(self, share));
    if (self.history)
        self.history->push_back({self.drive.time_s, h * share, event});
    self.slope = self.step.end_slope;
    self.point = self.step.end_point;
    if (share != 1.0)
        self.point = impact_kinematics<L>(self.model, self.drive, self.mode, 0.0, self.state);
    if (self.recorder.any)
        blows_torque(self.recorder, h * share, torque, rate, self.point.joint_nm,
                     share == 1.0 ? impact_torque_rate(self) : 0.0);
    if (event >= 0)
        impact_apply_event(self, event);
}

}  // namespace vgroove

#endif
