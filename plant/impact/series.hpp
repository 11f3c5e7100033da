// Fast mode: Taylor series of the motion while a lug is touched or the anvil moves. The stiff part
// of the equations is linear there, so that one series step replaces several explicit steps, gives
// its own length and is its own interpolant.
//
// Method: Jorba and Zou, "A software package for the numerical integration of ODEs by means of
// high-order Taylor methods", Experimental Mathematics 14 (2005): coefficients by recurrence, the
// step length from the last ones. Contact, joint, motor and spring are linear and go to
// SERIES_ORDER; the shape of the groove changes slowly and goes to SERIES_GROOVE. The terms left
// out, and a slip torque that is not linear in the head angle, appear in the difference of the
// derivative and the series' own slope at the step's end, which is the error estimate.
#ifndef VGROOVE_PLANT_IMPACT_SERIES_HPP
#define VGROOVE_PLANT_IMPACT_SERIES_HPP

#include "impact/interpolant.hpp"
#include "numeric/power_series.hpp"

namespace vgroove {

constexpr int SERIES_GROOVE = 3;
constexpr double SERIES_SHARE = 0.7;    // of the length that the last terms allow
constexpr double SERIES_REDUCE = 0.5;   // factor on a step whose error is too large
constexpr double SERIES_NEXT_S = 4e-4;  // first step of the method that follows the series
constexpr Reciprocals<SERIES_ORDER> SERIES_RECIPROCAL = reciprocals<SERIES_ORDER>();

// Derivatives of the linear quantities: name_x is the derivative of the quantity by x; i and w are
// motor current and speed, the others belong to hammer, anvil and joint.
struct SeriesRates {
    double current_i, current_w, bus_i;  // A/s, and V of the bus
    double drive_i, drive_w;             // N m on the spindle
    double lug_angle, lug_speed;         // N m, by hammer less anvil
    double lug_ramp;  // N m, by penetration times its rate, while the damping ramps up
    double joint_twist, joint_speed, joint_head;   // N m
    double twist_speed, twist_joint, twist_twist;  // rad/s
};

// The series during the recurrence; coefficients with a negative index are 0.
struct SeriesJet {
    static constexpr int N = SERIES_ORDER + 1, M = SERIES_GROOVE + 1;
    double relative[N], rate[N];  // hammer less anvil, from the flank that is touched; its rate
    double root_inverse, square_inverse;
    double q[M], root[M], slope[M], square[M], share[M], carried[M], bend[M];
    double q_rate_of[SERIES_GROOVE + N], push_of[SERIES_GROOVE + N], axial_of[SERIES_GROOVE + N];
    double *q_rate() { return q_rate_of + SERIES_GROOVE; }
    // Torques of lug and spindle as they act on the balls, and the axial force without them
    double *push() { return push_of + SERIES_GROOVE; }
    double *axial() { return axial_of + SERIES_GROOVE; }
};

// Whether the motion can be followed by series: everything but the groove and the joint's slip
// torque is linear.
template <class L> VGROOVE_INLINE bool series_applies(const ImpactSolver<L> &self) {
    if (L::EXACT || L::FULL || self.fixed_s > 0.0)
        return false;
    const ImpactMode &mode = self.mode;
    const Drive<double> &in = self.drive;
    const bool lug = mode.place == ContactPlace::FORWARD || mode.place == ContactPlace::BACKWARD;
    if (!(lug ? self.model.contact.exponent == 1.0
              : mode.place == ContactPlace::NONE && !mode.ringing && !mode.frozen))
        return false;
    if (mode.drive.slide == 0.0 || in.command_rate != 0.0 ||
        (self.model.joint.of_load && (in.load_rate != 0.0 || in.load_nm < 0.0)))
        return false;
    return true;
}

// i' = (duty bus - dead bus sign(i) - (R + Rb) i - k w) / L with bus = Voc - Rs duty i
template <class L>
VGROOVE_INLINE void series_electrical(const ImpactSolver<L> &self, SeriesRates &a) {
    const Drivetrain<double> &d = self.model.drive;
    const Drive<double> &in = self.drive;
    const bool open = in.open > 0.0;
    const double diode = self.mode.drive.diode, duty = open ? -diode : in.command;
    a.bus_i = -d.supply.resistance_ohm * duty;
    double share = duty;
    if (d.effects & EFFECT_DEAD_TIME)
        share -= self.state.x[STATE_CURRENT] > 0.0 ? in.dead : -in.dead;
    const bool blocked = open && diode == 0.0;
    a.current_i = blocked ? 0.0
                          : (share * a.bus_i - d.bridge.resistance_ohm - d.motor.resistance_ohm) *
                                d.motor.inductance_inverse;
    a.current_w = blocked ? 0.0 : -d.motor.constant * d.motor.inductance_inverse;
}

// Derivative of a slip torque by the head angle
VGROOVE_INLINE double series_slope(const double *c, double x) {
    return c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]);
}

template <class L> VGROOVE_INLINE void series_joint(const ImpactSolver<L> &self, SeriesRates &a) {
    const Joint &j = self.model.joint;
    if (self.mode.slip == 0) {
        a.joint_twist = j.stiffness;
        a.joint_speed = j.damping;
        a.twist_speed = 1.0;
        return;
    }
    const JointSegment &s = j.segment[self.mode.segment];
    if (!j.of_load)
        a.joint_head = self.mode.slip > 0 ? series_slope(s.forward, self.point.head_rad)
                                          : -series_slope(s.backward, self.point.head_rad);
    a.twist_joint = j.damping_inverse;
    a.twist_twist = -j.stiffness * j.damping_inverse;
}

template <class L> VGROOVE_INLINE SeriesRates series_rates(const ImpactSolver<L> &self) {
    const Impact &m = self.model;
    const ImpactMode &mode = self.mode;
    SeriesRates a{};
    series_electrical<L>(self, a);
    series_joint<L>(self, a);
    a.drive_i = m.ratio * m.drive.motor.constant;
    a.drive_w = -m.ratio * m.drive.friction.viscous;
    if (mode.place == ContactPlace::NONE)
        return a;
    const double arm = m.lug_radius_m * m.lug_radius_m;
    a.lug_angle = arm * m.contact.stiffness;
    if (mode.approaching)
        (mode.ramped ? a.lug_speed : a.lug_ramp) = arm * m.contact.damping;
    a.lug_ramp *=
        (mode.place == ContactPlace::FORWARD ? m.lug_radius_m : -m.lug_radius_m) / m.contact.ramp_m;
    return a;
}

// x = l (root - e_v), root^2 = q^2 + e_v^2, s = dx/dq = l q / root, bend = m s'
VGROOVE_INLINE void series_groove(const Impact &m, SeriesJet &y, int n) {
    const double inverse = y.root_inverse;
    const double square = 2.0 * y.q[0] * y.q[n] + series_product(y.q, y.q, 1, n - 1, n);
    y.root[n] = 0.5 * inverse * (square - series_product(y.root, y.root, 1, n - 1, n));
    y.slope[n] = inverse * (m.groove.lead * y.q[n] - series_product(y.root, y.slope, 1, n, n));
    y.bend[n - 1] = m.hammer_mass * n * y.slope[n];
}

// With B and A of impact_groove: square = 1 + B m s^2, share = s / square, carried = m s share /
// JS: the groove carries share (A + m s TJ / JJ) + carried Tlug = share A + carried push.
VGROOVE_INLINE void series_shares(const Impact &m, SeriesJet &y, int n) {
    const double both = m.spindle_inertia_inverse + m.hammer_inertia_inverse;
    y.square[n] =
        (n == 0 ? 1.0 : 0.0) + both * m.hammer_mass * series_product(y.slope, y.slope, 0, n, n);
    y.square_inverse = n == 0 ? 1.0 / y.square[0] : y.square_inverse;
    y.share[n] = (y.slope[n] - series_product(y.square, y.share, 1, n, n)) * y.square_inverse;
    y.carried[n] =
        m.hammer_mass * m.hammer_inertia_inverse * series_product(y.slope, y.share, 0, n, n);
}

template <class L> VGROOVE_INLINE void series_start(const ImpactSolver<L> &self, SeriesJet &y) {
    const Impact &m = self.model;
    const double *s = self.state.x;
    for (int n = 0; n < SERIES_GROOVE; ++n)
        y.q_rate_of[n] = y.push_of[n] = y.axial_of[n] = y.share[n + 1] = y.carried[n + 1] =
            y.root[n + 1] = y.bend[n + 1] = 0.0;
    const double flank =
        self.mode.place == ContactPlace::BACKWARD ? self.mode.backward_rad : self.mode.forward_rad;
    y.relative[0] = impact_relative<L>(m, self.state) - flank;
    y.rate[0] = s[L::HAMMER_SPEED] - s[L::ANVIL_SPEED];
    const double drive =
        m.spindle_inertia * m.ratio_inverse * self.slope.x[STATE_SPEED] + self.point.spindle_nm;
    y.push()[0] = self.point.lug_nm + m.hammer_inertia * m.spindle_inertia_inverse * drive;
    y.q[0] = self.point.q;
    y.q[1] = y.q_rate()[0] = self.point.q_rate;
    y.root[0] = std::sqrt(y.q[0] * y.q[0] + m.groove.vertex2);
    y.root_inverse = 1.0 / y.root[0];
    y.slope[0] = m.groove.lead * y.q[0] * y.root_inverse;
    series_shares(m, y, 0);
    series_groove(m, y, 1);
    y.axial()[0] = m.preload_n + m.rate_n_per_m * m.groove.lead * (y.root[0] - m.groove.vertex) +
                   y.bend[0] * y.q_rate()[0];
    series_shares(m, y, 1);
}

// Coefficients of order n of the states, kept in registers because the next order needs them at
// once
struct SeriesStates {
    double i, w, hammer, anvil, twist, anvil_before;
};

// Coefficients of order n of the torques of lug, joint, drive and groove, with A = F0 + k x + m s'
// q' (s' the change of s in time). Terms that do not need the newest states are added first.
// SLOW: with current and motor speed, whose coefficients of high order are negligible.
struct SeriesTorques {
    double lug, joint, drive, groove;
};
template <bool SLOW>
VGROOVE_INLINE SeriesTorques series_torques(const Impact &m, const SeriesRates &a, SeriesJet &y,
                                            const SeriesStates &now, int n) {
    const double before = SERIES_RECIPROCAL.of[n],
                 spindle = m.hammer_inertia * m.spindle_inertia_inverse;
    double *axial = y.axial() + n, *push = y.push() + n, *q_rate = y.q_rate() + n;
    double old_axial = n <= SERIES_GROOVE ? m.rate_n_per_m * m.groove.lead * y.root[n] : 0.0,
           old = 0.0;
    for (int j = SERIES_GROOVE; j >= 1; --j)
        old += y.share[j] * axial[-j] + y.carried[j] * push[-j];
    for (int j = SERIES_GROOVE - 1; j >= 1; --j)
        old_axial += y.bend[j] * q_rate[-j];
    SeriesTorques t;
    y.relative[n] = before * y.rate[n - 1];
    double lug = a.lug_angle * y.relative[n];
    y.rate[n] = now.hammer - now.anvil;
    if (a.lug_ramp != 0.0)
        lug += a.lug_ramp * series_product(y.relative, y.rate, 0, n, n);
    t.joint = a.joint_twist * now.twist + a.joint_speed * now.anvil;
    if (a.joint_head != 0.0)
        t.joint += a.joint_head * (before * now.anvil_before - now.twist);
    t.lug = lug + a.lug_speed * y.rate[n];
    push[0] = t.lug;
    axial[0] = old_axial + y.bend[0] * q_rate[0];
    t.groove = (old + y.share[0] * old_axial) +
               ((y.share[0] * y.bend[0]) * q_rate[0] + y.carried[0] * t.lug);
    t.drive = 0.0;
    if constexpr (SLOW) {
        t.drive = a.drive_i * now.i + a.drive_w * now.w;
        push[0] += spindle * t.drive;
        t.groove += (y.carried[0] * spindle) * t.drive;
    }
    return t;
}

// Coefficients of order n + 1 of the states
template <bool SLOW>
VGROOVE_INLINE SeriesStates series_states(const Impact &m, const SeriesRates &a,
                                          const SeriesTorques &t, const SeriesStates &now, int n) {
    const double part = SERIES_RECIPROCAL.of[n + 1];
    SeriesStates next{};
    next.hammer = (part * m.hammer_inertia_inverse) * (t.groove - t.lug);
    next.anvil = (part * m.anvil_inertia_inverse) * (t.lug - t.joint);
    next.twist =
        part * (a.twist_speed * now.anvil + a.twist_joint * t.joint + a.twist_twist * now.twist);
    next.anvil_before = now.anvil;
    if constexpr (SLOW) {
        next.w = (part * m.ratio * m.spindle_inertia_inverse) * (t.drive - t.groove);
        next.i = part * (a.current_i * now.i + a.current_w * now.w);
    }
    return next;
}

// Stores order n + 1 of the fast states
template <class L>
VGROOVE_INLINE void series_store_fast(const SeriesTorques &t, const SeriesStates &now,
                                      const SeriesStates &next, int n, ImpactSeries<L> &to) {
    const double part = SERIES_RECIPROCAL.of[n + 1];
    double *c = to.c[n + 1].x;
    c[L::HAMMER_ANGLE] = part * now.hammer;
    c[L::HAMMER_SPEED] = next.hammer;
    c[L::ANVIL_ANGLE] = part * now.anvil;
    c[L::ANVIL_SPEED] = next.anvil;
    c[L::TWIST] = next.twist;
    c[L::LUG_IMPULSE] = part * t.lug;
}

// Stores order n + 1 of the slow states: motor, integrals and arm
template <class L>
VGROOVE_INLINE void series_store_slow(const Impact &m, const SeriesRates &a, double drive_nm,
                                      const SeriesStates &now, const SeriesStates &next, int n,
                                      ImpactSeries<L> &to) {
    const double part = SERIES_RECIPROCAL.of[n + 1];
    double *c = to.c[n + 1].x;
    const double *last = to.c[n].x;
    const double housing = drive_nm - (m.ratio - 1.0) * m.motor_inertia * (n + 1) * next.w;
    c[STATE_CURRENT] = next.i;
    c[STATE_SPEED] = next.w;
    c[STATE_ANGLE] = part * now.w;
    c[STATE_CURRENT_TIME] = part * now.i;
    c[STATE_BUS_TIME] = part * a.bus_i * now.i;
    c[L::HOUSING_TIME] = part * housing;
    c[L::ARM_ANGLE] = part * last[L::ARM_SPEED];
    c[L::ARM_SPEED] =
        (part * m.arm_inertia_inverse) *
        (housing - m.arm_damping * last[L::ARM_SPEED] - m.arm_stiffness * last[L::ARM_ANGLE]);
}

// Coefficients of all orders from the state and slope of the solver
template <class L> __attribute__((noinline)) void series_expand(ImpactSolver<L> &self) {
    const Impact &m = self.model;
    const SeriesRates a = series_rates<L>(self);
    ImpactSeries<L> &to = self.step.series;
    SeriesJet y;
    series_start<L>(self, y);
    to.c[0] = self.state;
    to.c[1] = self.slope;
    const double *first = self.slope.x;
    SeriesStates now{first[STATE_CURRENT],  first[STATE_SPEED], first[L::HAMMER_SPEED],
                     first[L::ANVIL_SPEED], first[L::TWIST],    self.state.x[L::ANVIL_SPEED]};
    for (int n = 1; n < SERIES_SLOW; ++n) {
        const double q_rate = now.w * m.ratio_inverse - now.hammer;
        y.q_rate()[n] = q_rate;
        if (n < SERIES_GROOVE) {
            y.q[n + 1] = SERIES_RECIPROCAL.of[n + 1] * q_rate;
            series_groove(m, y, n + 1);
        }
        const SeriesTorques t = series_torques<true>(m, a, y, now, n);
        const SeriesStates next = series_states<true>(m, a, t, now, n);
        series_store_fast<L>(t, now, next, n, to);
        series_store_slow<L>(m, a, t.drive, now, next, n, to);
        if (n < SERIES_GROOVE)
            series_shares(m, y, n + 1);
        now = next;
    }
    for (int n = SERIES_SLOW; n < SERIES_ORDER; ++n) {
        y.q_rate()[n] = -now.hammer;
        const SeriesTorques t = series_torques<false>(m, a, y, now, n);
        const SeriesStates next = series_states<false>(m, a, t, now, n);
        series_store_fast<L>(t, now, next, n, to);
        now = next;
    }
}

// Largest coefficient of one order, relative to the tolerance
template <class L>
VGROOVE_INLINE double series_norm(const ImpactSolver<L> &self, const ImpactState<L> &c) {
    const Impact &m = self.model;
    const double speeds =
        max_of(std::fabs(c.x[L::HAMMER_SPEED]), std::fabs(c.x[L::ANVIL_SPEED])) * m.output_weight;
    const double twist =
        max_of(std::fabs(c.x[L::TWIST]), std::fabs(c.x[L::HAMMER_ANGLE])) * m.angle_weight;
    return max_of(speeds, twist) / self.tolerance;
}
template <class L>
VGROOVE_INLINE double series_slow_norm(const ImpactSolver<L> &self, const ImpactState<L> &c) {
    const Impact &m = self.model;
    return max_of(std::fabs(c.x[STATE_SPEED]) * m.speed_weight,
                  std::fabs(c.x[STATE_CURRENT]) * m.current_weight) /
           self.tolerance;
}

// Longest step whose last two terms of the fast states and last term of the slow ones are within
// the tolerance
template <class L> VGROOVE_INLINE double series_longest(const ImpactSolver<L> &self) {
    const ImpactSeries<L> &s = self.step.series;
    const double last = rough_inverse_root(series_norm<L>(self, s.c[SERIES_ORDER]), SERIES_ORDER);
    const double before =
        rough_inverse_root(series_norm<L>(self, s.c[SERIES_ORDER - 1]), SERIES_ORDER - 1);
    const double slow =
        rough_inverse_root(series_slow_norm<L>(self, s.c[SERIES_SLOW]), SERIES_SLOW);
    return SERIES_SHARE * min_of(slow, min_of(last, before));
}

// Derivative at the end less the series' slope there, for COUNT states of one order from FROM on
template <class L, int FROM, int COUNT>
VGROOVE_INLINE void series_defect(const ImpactStep<L> &t, double h, ImpactState<L> &error) {
    constexpr int ORDER = ImpactSeries<L>::order(FROM);
    double slope[COUNT];
    for (int n = 0; n < COUNT; ++n)
        slope[n] = ORDER * t.series.c[ORDER].x[FROM + n];
    for (int k = ORDER - 1; k > 0; --k)
        for (int n = 0; n < COUNT; ++n)
            slope[n] = slope[n] * h + k * t.series.c[k].x[FROM + n];
    for (int n = 0; n < COUNT; ++n)
        error.x[FROM + n] = t.end_slope.x[FROM + n] - slope[n];
}

// One trial step of length h; error: of each state, per second
template <class L>
__attribute__((noinline)) void series_attempt(ImpactSolver<L> &self, double h,
                                              ImpactState<L> &error) {
    ImpactStep<L> &t = self.step;
    t.end = impact_series_at<L>(t.series, h);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    error = ImpactState<L>{};
    series_defect<L, STATE_CURRENT, 2>(t, h, error);
    series_defect<L, L::HAMMER_SPEED, 4>(t, h, error);
}

}  // namespace vgroove

#endif
