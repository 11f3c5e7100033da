// Fast mode: steps of a tool with a light second body behind the anvil (coupler, pendulum). Joint
// and coupler damp its speed within microseconds, to which the stability of an explicit method
// would limit the step.
//
// Method: the Rosenbrock method ROS34PW2 (numeric/rosenbrock.hpp), which is L-stable. Of the
// Jacobian it uses the rows and columns of four states: the speeds of anvil and second body, the
// twists of coupler and joint. This block does not change within a step. The two twists are
// eliminated, so that each stage solves two equations for the two speeds.
#ifndef VGROOVE_PLANT_IMPACT_COUPLED_STEP_HPP
#define VGROOVE_PLANT_IMPACT_COUPLED_STEP_HPP

#include "impact/solver.hpp"
#include "numeric/rosenbrock.hpp"

namespace vgroove {

// The method is used where the second body's speed decays at more than COUPLED_RATE, 1/s, and this
// rate times the step exceeds COUPLED_STEP. Elsewhere the explicit method, whose order is higher,
// takes longer steps at the same error.
constexpr double COUPLED_RATE = 8e4, COUPLED_STEP = 2.0;

// Elements of the block: dampings (1/s) and stiffnesses (1/s^2) over an inertia, and the equation
// of the joint's twist, e' = sticks w2 - relaxation e, with w2 the speed of the second body
struct CoupledBlock {
    double anvil_damping, anvil_stiffness;    // of the coupler, over the anvil's inertia
    double output_damping, output_stiffness;  // of the coupler, over the second body's inertia
    double joint_damping, joint_stiffness;    // of the joint, over that; 0 while the head slips
    double sticks, relaxation;  // 1 and 0 while the head sticks, else 0 and K / C, 1/s
};
VGROOVE_INLINE CoupledBlock coupled_block(const Impact &m, const ImpactMode &mode) {
    const bool sticks = mode.slip == 0;
    CoupledBlock b;
    b.anvil_damping = m.coupler_damping * m.anvil_inertia_inverse;
    b.anvil_stiffness = m.coupler_stiffness * m.anvil_inertia_inverse;
    b.output_damping = m.coupler_damping * m.output_inertia_inverse;
    b.output_stiffness = m.coupler_stiffness * m.output_inertia_inverse;
    b.joint_damping = sticks ? m.joint.damping * m.output_inertia_inverse : 0.0;
    b.joint_stiffness = sticks ? m.joint.stiffness * m.output_inertia_inverse : 0.0;
    b.sticks = sticks ? 1.0 : 0.0;
    b.relaxation = sticks ? 0.0 : m.joint.stiffness * m.joint.damping_inverse;
    return b;
}

// Whether a step of length h is stiff
template <class L> VGROOVE_INLINE bool coupled_applies(const ImpactSolver<L> &self, double h) {
    if (L::EXACT || self.fixed_s > 0.0 || !self.model.second_output)
        return false;
    const CoupledBlock b = coupled_block(self.model, self.mode);
    const double rate = b.output_damping + b.joint_damping;
    return rate > COUPLED_RATE && h * rate > COUPLED_STEP;
}

// A stage's slope: solution k of (I - h gamma J) k = f + h J sum
template <class L>
VGROOVE_INLINE ImpactState<L> coupled_slope(const CoupledBlock &b, double h,
                                            const ImpactState<L> &f, const ImpactState<L> &sum) {
    const double g = Ros34pw2::GAMMA * h;
    const double sum_between = sum.x[L::ANVIL_SPEED] - sum.x[L::OUTPUT_SPEED];
    const double anvil = f.x[L::ANVIL_SPEED] - h * (b.anvil_damping * sum_between +
                                                    b.anvil_stiffness * sum.x[L::COUPLER_TWIST]);
    const double output =
        f.x[L::OUTPUT_SPEED] +
        h * (b.output_damping * sum_between + b.output_stiffness * sum.x[L::COUPLER_TWIST] -
             b.joint_damping * sum.x[L::OUTPUT_SPEED] - b.joint_stiffness * sum.x[L::TWIST]);
    const double coupler = f.x[L::COUPLER_TWIST] + h * sum_between;
    const double joint =
        f.x[L::TWIST] + h * (b.sticks * sum.x[L::OUTPUT_SPEED] - b.relaxation * sum.x[L::TWIST]);
    const double on_anvil = g * (b.anvil_damping + g * b.anvil_stiffness),
                 on_output = g * (b.output_damping + g * b.output_stiffness),
                 of_joint = g * (b.joint_damping + g * b.joint_stiffness);
    const double right_anvil = anvil - g * b.anvil_stiffness * coupler,
                 right_output =
                     output + g * (b.output_stiffness * coupler - b.joint_stiffness * joint);
    const double own_anvil = 1.0 + on_anvil, own_output = 1.0 + on_output + of_joint;
    const double inverse = 1.0 / (own_anvil * own_output - on_anvil * on_output);
    ImpactState<L> k = f;
    k.x[L::ANVIL_SPEED] = inverse * (own_output * right_anvil + on_anvil * right_output);
    k.x[L::OUTPUT_SPEED] = inverse * (own_anvil * right_output + on_output * right_anvil);
    k.x[L::COUPLER_TWIST] = coupler + g * (k.x[L::ANVIL_SPEED] - k.x[L::OUTPUT_SPEED]);
    k.x[L::TWIST] = (joint + g * b.sticks * k.x[L::OUTPUT_SPEED]) / (1.0 + g * b.relaxation);
    return k;
}

// Tries a step of length h; error: estimated local error of each state over h
template <class L>
VGROOVE_CLONES_APART void coupled_attempt(ImpactSolver<L> &self, double h, ImpactState<L> &error) {
    ImpactStep<L> &t = self.step;
    const CoupledBlock b = coupled_block(self.model, self.mode);
    const RosenbrockStep<double, L::COUNT> end = ros34pw2_step<double, L::COUNT>(
        self.state, h, self.slope,
        [&](const ImpactState<L> &f, const ImpactState<L> &sum)
            __attribute__((always_inline)) { return coupled_slope<L>(b, h, f, sum); },
        [&](double tau, const ImpactState<L> &s) __attribute__((always_inline)) {
            ImpactState<L> ds;
            impact_stage(self, tau, s, ds);
            return ds;
        });
    t.end = end.state;
    error = end.error;
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    self.stats.derivatives += 3.0;
}

}  // namespace vgroove

#endif
