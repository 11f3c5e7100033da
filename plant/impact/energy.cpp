// Stored energy of the impact tool, and its angular momentum's rate of change.
#include "impact/energy.hpp"

namespace vgroove {

// Energy of joint and coupler twist, second output body and pendulum
static double twist_energy(const Impact &m, const ImpactState<AuditLayout> &s) {
    using L = AuditLayout;
    double energy = 0.5 * m.joint.stiffness * s.x[L::TWIST] * s.x[L::TWIST];
    if (!m.second_output)
        return energy;
    const double twist = s.x[L::COUPLER_TWIST], w = s.x[L::OUTPUT_SPEED];
    energy += 0.5 * m.coupler_stiffness * twist * twist + 0.5 * m.output_inertia * w * w;
    return energy +
           m.pendulum_nm * (1.0 - cos_of<double>(s.x[L::ANVIL_ANGLE] - twist - m.zero_rad));
}

double impact_stored(const Impact &m, const ImpactMode &mode, const ImpactState<AuditLayout> &s) {
    using L = AuditLayout;
    const double i = s.x[STATE_CURRENT], w = s.x[STATE_SPEED],
                 spindle = impact_spindle_speed<L>(m, s);
    const double q = impact_spindle_angle<L>(m, s) - s.x[L::HAMMER_ANGLE],
                 q_rate = spindle - s.x[L::HAMMER_SPEED];
    const GroovePoint g = v_groove_at(m.groove, q);
    const double x_rate = g.s * q_rate;
    double energy =
        0.5 * m.spindle_inertia * spindle * spindle +
        friction_angle_energy<double>(m.drive.friction, m.drive.effects, s.x[STATE_ANGLE]);
    if (m.two_bodies)
        energy += 0.5 * m.motor_inertia * w * w +
                  gear_coupler_energy<double>(m.drive.gear, s.x[STATE_TWIST]);
    if (m.drive.input != InputKind::CURRENT)
        energy += 0.5 * i * i / m.drive.motor.inductance_inverse;
    energy += 0.5 * m.hammer_inertia * s.x[L::HAMMER_SPEED] * s.x[L::HAMMER_SPEED] +
              0.5 * m.hammer_mass * x_rate * x_rate;
    energy += m.preload_n * g.x + 0.5 * m.rate_n_per_m * g.x * g.x;
    energy +=
        0.5 * m.anvil_inertia * s.x[L::ANVIL_SPEED] * s.x[L::ANVIL_SPEED] + twist_energy(m, s);
    if (mode.place != ContactPlace::NONE)
        energy += contact_energy(
            m.contact, impact_gap(m, mode, impact_relative<L>(m, s), 0.0, g.x, x_rate).pen);
    return energy;
}

double impact_reaction_by_momentum(const Impact &m, const ImpactPoint &at,
                                   const ImpactState<AuditLayout> &ds) {
    using L = AuditLayout;
    const double spindle_alone =
        m.spindle_inertia - (m.two_bodies ? 0.0 : m.ratio * m.ratio * m.motor_inertia);
    const double spindle_rate =
        (m.two_bodies ? ds.x[STATE_OUTPUT_SPEED] : ds.x[STATE_SPEED]) * m.ratio_inverse;
    double change = m.motor_inertia * ds.x[STATE_SPEED] + spindle_alone * spindle_rate;
    change += m.hammer_inertia * ds.x[L::HAMMER_SPEED] + m.anvil_inertia * ds.x[L::ANVIL_SPEED];
    if (m.second_output)
        change += m.output_inertia * ds.x[L::OUTPUT_SPEED];
    return at.joint_nm + change;
}

}  // namespace vgroove
