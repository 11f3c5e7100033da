// Derivative of the impact tool's state: contact, groove, anvil, joint, housing and arm
// (docs/spec/model.md, sections 4 to 6 and 8).
#ifndef VGROOVE_PLANT_IMPACT_DERIVATIVE_HPP
#define VGROOVE_PLANT_IMPACT_DERIVATIVE_HPP

#include "impact/model.hpp"

namespace vgroove {

// Forces and geometry of one instant
struct ImpactPoint {
    double i, motor_w, motor_rate;  // motor current, speed, and the speed's rate
    double friction_nm;             // of the motor; at rest the torque that friction holds
    double held_nm, hold_forward_nm,
        hold_backward_nm;  // torque on a resting motor and what friction holds
    double bus_v, emf_v;
    double q, q_rate, x, x_rate;  // angle spindle less hammer, retraction of the hammer, rates
    double axial_n;               // through the balls
    double roll_needed_nm;        // friction torque that keeps balls at rest
    double spindle_nm;            // torque from spindle to hammer through the groove
    double pen, pen_rate, contact_n, lug_nm;             // penetration, m; forces of the contact
    double anvil_load_nm;                                // torque of joint or coupler on the anvil
    double joint_nm, trial_nm, forward_nm, backward_nm;  // trial: if the joint stuck; slip torques
    double head_rad;
    double housing_nm;
};

struct ContactGap {
    double pen, rate;
};

// Penetration of the contact, and its rate
VGROOVE_INLINE ContactGap impact_gap(const Impact &m, const ImpactMode &mode, double relative,
                                     double relative_rate, double x, double x_rate) {
    switch (mode.place) {
    case ContactPlace::FORWARD:
        return {m.lug_radius_m * (relative - mode.forward_rad), m.lug_radius_m * relative_rate};
    case ContactPlace::BACKWARD:
        return {m.lug_radius_m * (mode.backward_rad - relative), -m.lug_radius_m * relative_rate};
    case ContactPlace::TOP:
        return {m.lug_height_m - x, -x_rate};
    case ContactPlace::STOP:
        return {x - m.travel_m, x_rate};
    case ContactPlace::NONE:
        break;
    }
    return {0.0, 0.0};
}

template <class L>
VGROOVE_INLINE double impact_spindle_angle(const Impact &m, const ImpactState<L> &s) {
    double angle = s.x[STATE_ANGLE];
    if constexpr (L::FULL)
        if (m.two_bodies)
            angle -= s.x[STATE_TWIST];
    return angle * m.ratio_inverse;
}

template <class L>
VGROOVE_INLINE double impact_spindle_speed(const Impact &m, const ImpactState<L> &s) {
    if constexpr (L::FULL)
        if (m.two_bodies)
            return s.x[STATE_OUTPUT_SPEED] * m.ratio_inverse;
    return s.x[STATE_SPEED] * m.ratio_inverse;
}

template <class L> VGROOVE_INLINE double impact_relative(const Impact &m, const ImpactState<L> &s) {
    return s.x[L::HAMMER_ANGLE] + m.start_rad - s.x[L::ANVIL_ANGLE];
}

template <class L> VGROOVE_INLINE double impact_head(const Impact &m, const ImpactState<L> &s) {
    double output = s.x[L::ANVIL_ANGLE];
    if constexpr (L::FULL)
        if (m.second_output)
            output -= s.x[L::COUPLER_TWIST];
    return output - s.x[L::TWIST];
}

// Motor current L i' = v - R i - k w - brush, and motor friction
template <class L>
VGROOVE_INLINE Electrical<double>
impact_electrical(const Impact &m, const Drive<double> &in, const ImpactMode &mode, double tau,
                  const ImpactState<L> &s, ImpactState<L> &ds, ImpactPoint &at) {
    const Drivetrain<double> &d = m.drive;
    const std::uint32_t effects = d.effects & IMPACT_EFFECTS<L>;
    const Electrical<double> e =
        drivetrain_electrical<double, L::COUNT, IMPACT_EFFECTS<L>>(d, in, mode.drive, tau, s);
    const double w = s.x[STATE_SPEED];
    ds.x[STATE_CURRENT] = 0.0;
    if (d.input != InputKind::CURRENT && !(in.open > 0.0 && mode.drive.diode == 0.0))
        ds.x[STATE_CURRENT] =
            motor_current_slope<double>(d.motor, e.terminal_v, e.r, e.i, e.k, w, e.brush_v);
    ds.x[STATE_CURRENT_TIME] = e.i;
    ds.x[STATE_BUS_TIME] = e.bus_v;
    at.i = e.i;
    at.motor_w = w;
    at.bus_v = e.bus_v;
    at.emf_v = e.k * w;
    at.friction_nm = friction_sliding<double>(d.friction, effects, mode.drive.slide, w, e.k * e.i,
                                              in.time_s + tau);
    if (mode.drive.slide == 0.0) {
        const HoldLimits<double> hold = friction_hold<double>(d.friction, effects, e.k * e.i);
        at.hold_forward_nm = hold.forward_nm;
        at.hold_backward_nm = hold.backward_nm;
    }
    return e;
}

// Contact, then spindle (J) and hammer (S), in the symbols of docs/spec/model.md, section 4: with
// B = 1 / JJ + 1 / JS, s_b = s + ball friction, A = F0 + k x + Faxial + m s' q'^2 and
// P = TJ / JJ + Tlug / JS, q'' = (P - B s_b A) / (1 + B m s s_b); the balls carry
// Fball = A + m s q'' = (A + m s P) / (1 + B m s s_b), the groove s_b Fball.
struct GrooveForces {
    double spindle_rate, hammer_rate;
};

template <class L>
VGROOVE_INLINE GrooveForces impact_groove(const Impact &m, const ImpactMode &mode,
                                          double spindle_nm, const GroovePoint &g,
                                          ImpactPoint &at) {
    double axial =
        m.preload_n + m.rate_n_per_m * at.x + m.hammer_mass * g.c * at.q_rate * at.q_rate;
    if (mode.place != ContactPlace::NONE) {
        const double n =
            contact_force(m.contact, at.pen, at.pen_rate, mode.approaching, mode.ramped);
        at.contact_n = n;
        if (mode.place == ContactPlace::FORWARD || mode.place == ContactPlace::BACKWARD) {
            at.lug_nm =
                mode.place == ContactPlace::FORWARD ? m.lug_radius_m * n : -m.lug_radius_m * n;
            if (L::FULL && m.flank_friction)
                axial += contact_friction(m.contact, at.x_rate) * n;
        } else {
            axial += mode.place == ContactPlace::STOP ? n : -n;
        }
    }
    const bool stuck = mode.drive.slide == 0.0 && !(L::FULL && m.two_bodies);
    const double spindle = stuck ? 0.0 : m.spindle_inertia_inverse;
    const double pull = spindle_nm * spindle + at.lug_nm * m.hammer_inertia_inverse;
    const double both = spindle + m.hammer_inertia_inverse;
    at.axial_n = axial;
    if (L::FULL && m.ball_friction) {
        const double s = g.s + mode.roll * mode.axial_sign * m.groove.ball_arm;
        at.roll_needed_nm = pull / both - g.s * axial;
        if (mode.roll != 0.0)
            at.axial_n =
                (axial + m.hammer_mass * g.s * pull) / (1.0 + both * m.hammer_mass * g.s * s);
        at.spindle_nm = mode.roll == 0.0 ? pull / both : s * at.axial_n;
    } else {
        at.axial_n = (axial + m.hammer_mass * g.s * pull) *
                     (g.square / (g.square + both * m.hammer_mass * g.run * g.run));
        at.spindle_nm = g.s * at.axial_n;
    }
    return {(spindle_nm - at.spindle_nm) * spindle,
            (at.spindle_nm - at.lug_nm) * m.hammer_inertia_inverse};
}

// Groove and contact from angles and speeds
template <class L>
VGROOVE_INLINE GroovePoint impact_geometry(const Impact &m, const ImpactMode &mode,
                                           const ImpactState<L> &s, ImpactPoint &at) {
    at.q = impact_spindle_angle<L>(m, s) - s.x[L::HAMMER_ANGLE];
    at.q_rate = impact_spindle_speed<L>(m, s) - s.x[L::HAMMER_SPEED];
    const GroovePoint g = v_groove_at(m.groove, at.q);
    at.x = g.x;
    at.x_rate = g.s * at.q_rate;
    const double relative_rate = s.x[L::HAMMER_SPEED] - s.x[L::ANVIL_SPEED];
    const ContactGap gap =
        impact_gap(m, mode, impact_relative<L>(m, s), relative_rate, at.x, at.x_rate);
    at.pen = gap.pen;
    at.pen_rate = gap.rate;
    return g;
}

// Speed of the body to which the joint is attached
template <class L>
VGROOVE_INLINE double impact_output_speed(const Impact &m, const ImpactState<L> &s) {
    if constexpr (L::FULL)
        if (m.second_output)
            return s.x[L::OUTPUT_SPEED];
    return s.x[L::ANVIL_SPEED];
}

// Torque of the joint: T = K e + C w while the head sticks, else the slip torque of its direction.
template <class L>
VGROOVE_INLINE void impact_joint(const Impact &m, const Drive<double> &in, const ImpactMode &mode,
                                 double tau, const ImpactState<L> &s, ImpactPoint &at) {
    at.head_rad = impact_head<L>(m, s);
    const double load = in.load_nm + in.load_rate * tau;
    const SlipTorques slip =
        joint_slip(m.joint, mode.segment, at.head_rad, load > 0.0 ? load : 0.0);
    at.trial_nm =
        m.joint.stiffness * s.x[L::TWIST] + m.joint.damping * impact_output_speed<L>(m, s);
    at.forward_nm = slip.forward_nm;
    at.backward_nm = slip.backward_nm;
    at.joint_nm =
        mode.slip == 0 ? at.trial_nm : (mode.slip > 0 ? slip.forward_nm : -slip.backward_nm);
}

// Geometry and joint without forces, for events that angles and speeds decide
template <class L>
VGROOVE_INLINE ImpactPoint impact_kinematics(const Impact &m, const Drive<double> &in,
                                             const ImpactMode &mode, double tau,
                                             const ImpactState<L> &s) {
    ImpactPoint at{};
    impact_geometry<L>(m, mode, s, at);
    impact_joint<L>(m, in, mode, tau, s, at);
    return at;
}

// e' = (T - K e) / C; JA wA' = Tlug - T. A second body: J2 w2' = Kc ec + Cc ec' - T, ec' = wA - w2,
// and the anvil carries Kc ec + Cc ec'.
template <class L>
VGROOVE_INLINE void impact_output(const Impact &m, const ImpactMode &mode, const ImpactState<L> &s,
                                  ImpactState<L> &ds, ImpactPoint &at) {
    const double w = impact_output_speed<L>(m, s);
    ds.x[L::TWIST] = mode.slip == 0 ? w
                                    : (at.joint_nm - m.joint.stiffness * s.x[L::TWIST]) *
                                          m.joint.damping_inverse;
    at.anvil_load_nm = at.joint_nm;
    if constexpr (L::FULL) {
        if (m.second_output) {
            const double twist = s.x[L::COUPLER_TWIST];
            ds.x[L::COUPLER_TWIST] = s.x[L::ANVIL_SPEED] - w;
            at.anvil_load_nm =
                m.coupler_stiffness * twist + m.coupler_damping * ds.x[L::COUPLER_TWIST];
            at.joint_nm +=
                m.pendulum_nm != 0.0
                    ? m.pendulum_nm * sin_of<double>(s.x[L::ANVIL_ANGLE] - twist - m.zero_rad)
                    : 0.0;
            ds.x[L::OUTPUT_SPEED] = (at.anvil_load_nm - at.joint_nm) * m.output_inertia_inverse;
        }
    }
    ds.x[L::ANVIL_ANGLE] = s.x[L::ANVIL_SPEED];
    ds.x[L::ANVIL_SPEED] = (at.lug_nm - at.anvil_load_nm) * m.anvil_inertia_inverse;
    if (mode.ringing || mode.frozen)
        ds.x[L::ANVIL_ANGLE] = ds.x[L::ANVIL_SPEED] = ds.x[L::TWIST] = 0.0;
}

// Motor and spindle: one body, or two with play between them. Returns the torque on the spindle
// from the motor's side.
template <class L>
VGROOVE_INLINE double impact_spindle_torque(const Impact &m, const ImpactState<L> &s,
                                            double motor_nm) {
    if constexpr (L::FULL)
        if (m.two_bodies)
            return m.ratio *
                   gear_coupler_torque<double>(m.drive.gear, m.drive.effects, s.x[STATE_TWIST],
                                               s.x[STATE_SPEED] - s.x[STATE_OUTPUT_SPEED]);
    return m.ratio * motor_nm;
}

template <class L>
VGROOVE_INLINE void impact_shafts(const Impact &m, const ImpactMode &mode, double motor_nm,
                                  double spindle_nm, double spindle_rate, ImpactState<L> &ds,
                                  ImpactPoint &at, const ImpactState<L> &s) {
    const bool slides = mode.drive.slide != 0.0;
    at.motor_rate = spindle_rate * m.ratio;
    at.held_nm = motor_nm + at.friction_nm - at.spindle_nm * m.ratio_inverse;
    if constexpr (L::FULL) {
        if (m.two_bodies) {
            const double gear_nm = spindle_nm * m.ratio_inverse;
            at.held_nm = motor_nm + at.friction_nm - gear_nm;
            at.motor_rate = slides ? (motor_nm - gear_nm) / m.motor_inertia : 0.0;
            ds.x[STATE_OUTPUT_SPEED] = spindle_rate * m.ratio;
            ds.x[STATE_TWIST] = s.x[STATE_SPEED] - s.x[STATE_OUTPUT_SPEED];
        }
    }
    if (!slides)
        at.friction_nm = at.held_nm;
    ds.x[STATE_SPEED] = at.motor_rate;
    ds.x[STATE_ANGLE] = s.x[STATE_SPEED];
}

// T_h = N (k i - Tf) - (N - 1) Jm w'; arm: J_h ph'' + c ph' + k ph = T_h
template <class L>
VGROOVE_INLINE void impact_housing(const Impact &m, double motor_nm_before_friction,
                                   const ImpactState<L> &s, ImpactState<L> &ds, ImpactPoint &at) {
    at.housing_nm = m.ratio * (motor_nm_before_friction - at.friction_nm) -
                    (m.ratio - 1.0) * m.motor_inertia * at.motor_rate;
    ds.x[L::ARM_ANGLE] = s.x[L::ARM_SPEED];
    ds.x[L::ARM_SPEED] =
        (at.housing_nm - m.arm_damping * s.x[L::ARM_SPEED] - m.arm_stiffness * s.x[L::ARM_ANGLE]) *
        m.arm_inertia_inverse;
    ds.x[L::HOUSING_TIME] = at.housing_nm;
    ds.x[L::LUG_IMPULSE] = at.lug_nm;
}

// Powers of source and losses; together with the energy that contact springs lose at releases they
// balance the change of impact_stored.
template <class L>
VGROOVE_INLINE void impact_audit(const Impact &m, const Drive<double> &in,
                                 const Electrical<double> &e, const ImpactMode &mode,
                                 const ImpactState<L> &s, ImpactState<L> &ds,
                                 const ImpactPoint &at) {
    const Drivetrain<double> &d = m.drive;
    const double w = at.motor_w;
    const double source_v = d.bus_measured ? e.bus_v : e.source_v;
    if (d.input == InputKind::CURRENT)
        ds.x[L::WORK_IN] = e.k * e.i * w;
    else
        ds.x[L::WORK_IN] = d.input == InputKind::DUTY ? source_v * e.bus_a : e.terminal_v * e.i;
    double electric = d.input == InputKind::CURRENT ? 0.0 : e.r * e.i * e.i + e.brush_v * e.i;
    if (d.input == InputKind::DUTY)
        electric += (d.bus_measured ? 0.0 : supply_loss<double>(d.supply, e.bus_a)) +
                    bridge_loss<double>(d.bridge, d.effects, in, e.bus_v, e.ripple_a, e.i);
    ds.x[L::LOSS_ELECTRIC] = electric;
    ds.x[L::LOSS_FRICTION] = at.friction_nm * w;
    if (m.two_bodies) {
        const double slip = s.x[STATE_SPEED] - s.x[STATE_OUTPUT_SPEED];
        const double torque =
            gear_coupler_torque<double>(d.gear, d.effects, s.x[STATE_TWIST], slip);
        ds.x[L::LOSS_FRICTION] +=
            (torque - gear_spring_torque<double>(d.gear, s.x[STATE_TWIST])) * slip;
    }
    ds.x[L::LOSS_GROOVE] = mode.roll * std::fabs(at.axial_n) * m.groove.ball_arm * at.q_rate;
    if (mode.place != ContactPlace::NONE)
        ds.x[L::LOSS_CONTACT] = (at.contact_n - contact_spring(m.contact, at.pen)) * at.pen_rate;
    if (m.flank_friction && at.lug_nm != 0.0)
        ds.x[L::LOSS_CONTACT] += contact_friction(m.contact, at.x_rate) * at.contact_n * at.x_rate;
    const double elastic = m.joint.stiffness * s.x[L::TWIST];
    const double joint_only =
        mode.slip == 0 ? at.trial_nm : (mode.slip > 0 ? at.forward_nm : -at.backward_nm);
    const double output_w = m.second_output ? s.x[L::OUTPUT_SPEED] : s.x[L::ANVIL_SPEED];
    ds.x[L::LOSS_JOINT] = joint_only * output_w - elastic * ds.x[L::TWIST];
    if (m.second_output)
        ds.x[L::LOSS_JOINT] += m.coupler_damping * ds.x[L::COUPLER_TWIST] * ds.x[L::COUPLER_TWIST];
}

// Derivative of the whole state, tau after the start of a step. POINT: with the ImpactPoint;
// without it the torque of a joint that does not move is left out.
template <class L, bool POINT = true>
VGROOVE_INLINE ImpactPoint impact_derivative(const Impact &m, const Drive<double> &in,
                                             const ImpactMode &mode, double tau,
                                             const ImpactState<L> &s, ImpactState<L> &ds) {
    impact_assume_layout<L>(m);
    ImpactPoint at{};
    const Electrical<double> e = impact_electrical<L>(m, in, mode, tau, s, ds, at);
    const double torque =
        e.k * e.i - friction_of_angle<double>(m.drive.friction, m.drive.effects & IMPACT_EFFECTS<L>,
                                              s.x[STATE_ANGLE]);
    const double motor_nm = torque - at.friction_nm;
    const GroovePoint g = impact_geometry<L>(m, mode, s, at);
    const double spindle_nm = impact_spindle_torque<L>(m, s, motor_nm);
    const GrooveForces f = impact_groove<L>(m, mode, spindle_nm, g, at);
    ds.x[L::HAMMER_ANGLE] = s.x[L::HAMMER_SPEED];
    ds.x[L::HAMMER_SPEED] = f.hammer_rate;
    if (POINT || L::AUDIT || !(mode.ringing || mode.frozen)) {
        impact_joint<L>(m, in, mode, tau, s, at);
        impact_output<L>(m, mode, s, ds, at);
    } else {
        ds.x[L::ANVIL_ANGLE] = ds.x[L::ANVIL_SPEED] = ds.x[L::TWIST] = 0.0;
    }
    impact_shafts<L>(m, mode, motor_nm, spindle_nm, f.spindle_rate, ds, at, s);
    impact_housing<L>(m, torque, s, ds, at);
    if constexpr (L::FULL) {
        if (m.drive.effects & EFFECT_CURRENT_LAG)
            ds.x[STATE_CURRENT_TIME] = s.x[STATE_CURRENT_FILTER];
        supply_derivative<double, L::COUNT>(m.drive.supply, m.drive.effects, e.bus_a, s, ds);
        motor_heat_derivative<double, L::COUNT>(m.drive.motor, m.drive.effects, e.i, e.r, s, ds);
        sensors_derivative<double, L::COUNT>(m.drive.sensors, m.drive.effects, e.i, s, ds);
    }
    if constexpr (L::AUDIT)
        impact_audit<L>(m, in, e, mode, s, ds, at);
    return at;
}

}  // namespace vgroove

#endif
