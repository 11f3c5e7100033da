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

#include "impact/series_effects.hpp"
#include "numeric/power_series.hpp"

namespace vgroove {

constexpr int SERIES_GROOVE = 3;
constexpr double SERIES_SHARE = 0.7;    // of the length that the last terms allow
constexpr double SERIES_NEXT_S = 6e-4;  // first step of the method that follows the series
// A step whose error would allow the next one to be so many times longer does not limit the next
// series: the last terms of that series do.
constexpr double SERIES_FREE = 2.0;
constexpr Reciprocals<SERIES_ORDER> SERIES_RECIPROCAL = reciprocals<SERIES_ORDER>();

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

// Whether the motion can be followed by series: everything but the groove, the joint's slip torque
// and effects at the motor is linear.
template <class L> VGROOVE_INLINE bool series_applies(const ImpactSolver<L> &self) {
    if (L::EXACT || self.fixed_s > 0.0 || (L::FULL && !series_takes_effects(self.model)))
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
    if constexpr (L::FULL)
        series_motor_effects<L>(self, a);
    else
        series_motor<L>(self, a);
    series_joint<L>(self, a);
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

// Weights of the coefficients of order n in those of order n + 1, times n + 1: to_from, with the
// letters of SeriesStates. Summing the newest coefficients with constant weights, after everything
// that older coefficients give, keeps the chain of dependent operations from order to order short.
struct SeriesWeights {
    double lug_rate;                      // N m s, lug torque by hammer less anvil speed
    double spindle;                       // JS / JJ
    double joint_anvil, joint_twist;      // N m
    double hammer_old, anvil_old, w_old;  // of torques from older coefficients
    double lug_hammer, lug_w;             // of the lug torque through the groove and directly
    double hammer_hammer, hammer_anvil, hammer_w, hammer_i;
    double anvil_hammer, anvil_anvil, anvil_twist;
    double twist_anvil, twist_twist;
    double w_hammer, w_anvil, w_w, w_i;
};
VGROOVE_INLINE SeriesWeights series_weights(const Impact &m, const SeriesRates &a,
                                            const SeriesJet &y) {
    SeriesWeights g;
    const double share = y.share[0] * y.bend[0], carried = y.carried[0];
    g.lug_rate = a.lug_speed + a.lug_ramp * y.relative[0];
    g.spindle = m.hammer_inertia * m.spindle_inertia_inverse;
    g.joint_anvil = a.joint_speed;
    g.joint_twist = a.joint_twist - a.joint_head;
    g.hammer_old = m.hammer_inertia_inverse;
    g.anvil_old = m.anvil_inertia_inverse;
    g.w_old = m.ratio * m.spindle_inertia_inverse;
    g.lug_hammer = (carried - 1.0) * g.hammer_old;
    g.lug_w = -carried * g.w_old;
    const double drive_hammer = carried * g.spindle * g.hammer_old,
                 drive_w = (1.0 - carried * g.spindle) * g.w_old;
    g.hammer_hammer = g.lug_hammer * g.lug_rate - share * g.hammer_old;
    g.hammer_anvil = -g.lug_hammer * g.lug_rate;
    g.hammer_w = share * m.ratio_inverse * g.hammer_old + drive_hammer * a.drive_w;
    g.hammer_i = drive_hammer * a.drive_i;
    g.anvil_hammer = g.anvil_old * g.lug_rate;
    g.anvil_anvil = -g.anvil_old * (g.lug_rate + g.joint_anvil);
    g.anvil_twist = -g.anvil_old * g.joint_twist;
    g.twist_anvil = a.twist_speed + a.twist_joint * g.joint_anvil;
    g.twist_twist = a.twist_twist + a.twist_joint * g.joint_twist;
    g.w_hammer = g.lug_w * g.lug_rate + share * g.w_old;
    g.w_anvil = -g.lug_w * g.lug_rate;
    g.w_w = drive_w * a.drive_w - share * m.ratio_inverse * g.w_old;
    g.w_i = drive_w * a.drive_i;
    return g;
}

// What the coefficients before order n give to the torques of order n: of lug, joint and groove,
// with A = F0 + k x + m s' q' (s' the change of s in time)
struct SeriesOld {
    double lug, joint, groove, axial;
};
template <int N, bool SLOW>
VGROOVE_INLINE SeriesOld series_old(const Impact &m, const SeriesRates &a, SeriesJet &y,
                                    const SeriesStates &now) {
    const double before = SERIES_RECIPROCAL.of[N];
    const double *axial = y.axial() + N, *push = y.push() + N, *q_rate = y.q_rate() + N;
    SeriesOld old{};
    if constexpr (SLOW) {
        if constexpr (N <= SERIES_GROOVE)
            old.axial = m.rate_n_per_m * m.groove.lead * y.root[N];
        for (int j = SERIES_GROOVE - 1; j >= 1; --j)
            old.axial += y.bend[j] * q_rate[-j];
        old.groove = y.share[0] * old.axial;
        for (int j = SERIES_GROOVE; j >= 1; --j)
            old.groove += y.share[j] * axial[-j];
    }
    for (int j = SERIES_GROOVE; j >= 1; --j)
        old.groove += y.carried[j] * push[-j];
    y.relative[N] = before * y.rate[N - 1];
    old.lug = a.lug_angle * y.relative[N];
    if (a.lug_ramp != 0.0)
        old.lug += a.lug_ramp * series_product(y.relative, y.rate, 1, N, N);
    old.joint = a.joint_head * (before * now.anvil_before);
    return old;
}

// Coefficients of order n + 1 of the states. SLOW: with current and motor speed, whose coefficients
// of high order are negligible.
template <int N, bool SLOW>
VGROOVE_INLINE SeriesStates series_states(const SeriesRates &a, const SeriesWeights &g,
                                          const SeriesOld &old, const SeriesStates &now) {
    constexpr double part = SERIES_RECIPROCAL.of[N + 1];
    SeriesStates next{};
    double hammer = g.hammer_old * old.groove + g.lug_hammer * old.lug;
    if constexpr (SLOW) {
        hammer += g.hammer_w * now.w + g.hammer_i * now.i;
        next.w =
            part * (((g.lug_w * old.lug - g.w_old * old.groove) + (g.w_w * now.w + g.w_i * now.i)) +
                    (g.w_hammer * now.hammer + g.w_anvil * now.anvil));
        next.i = part * (a.current_i * now.i + a.current_w * now.w);
    }
    next.hammer = part * (hammer + (g.hammer_hammer * now.hammer + g.hammer_anvil * now.anvil));
    next.anvil = part * ((g.anvil_old * (old.lug - old.joint) + g.anvil_twist * now.twist) +
                         (g.anvil_hammer * now.hammer + g.anvil_anvil * now.anvil));
    next.twist = part * (a.twist_joint * old.joint +
                         (g.twist_anvil * now.anvil + g.twist_twist * now.twist));
    next.anvil_before = now.anvil;
    return next;
}

// Coefficients of order n of the torques of lug and drive; those that later orders need
struct SeriesTorques {
    double lug, drive;
};
template <int N, bool SLOW>
VGROOVE_INLINE SeriesTorques series_torques(const SeriesRates &a, const SeriesWeights &g,
                                            SeriesJet &y, const SeriesOld &old,
                                            const SeriesStates &now) {
    SeriesTorques t{};
    y.rate[N] = now.hammer - now.anvil;
    t.lug = old.lug + g.lug_rate * y.rate[N];
    y.push()[N] = t.lug;
    if constexpr (SLOW) {
        t.drive = a.drive_i * now.i + a.drive_w * now.w;
        y.push()[N] += g.spindle * t.drive;
        y.axial()[N] = old.axial + y.bend[0] * y.q_rate()[N];
    }
    return t;
}

// Stores order n + 1 of the fast states
template <class L, int N>
VGROOVE_INLINE void series_store_fast(const SeriesTorques &t, const SeriesStates &now,
                                      const SeriesStates &next, ImpactSeries<L> &to) {
    constexpr double part = SERIES_RECIPROCAL.of[N + 1];
    double *c = to.c[N + 1].x;
    c[L::HAMMER_ANGLE] = part * now.hammer;
    c[L::HAMMER_SPEED] = next.hammer;
    c[L::ANVIL_ANGLE] = part * now.anvil;
    c[L::ANVIL_SPEED] = next.anvil;
    c[L::TWIST] = next.twist;
    c[L::LUG_IMPULSE] = part * t.lug;
}

// Stores order n + 1 of the slow states: motor, integrals and arm
template <class L, int N>
VGROOVE_INLINE void series_store_slow(const Impact &m, const SeriesRates &a, double drive_nm,
                                      const SeriesStates &now, const SeriesStates &next,
                                      ImpactSeries<L> &to) {
    constexpr double part = SERIES_RECIPROCAL.of[N + 1];
    double *c = to.c[N + 1].x;
    const double *last = to.c[N].x;
    const double housing = drive_nm - (m.ratio - 1.0) * m.motor_inertia * (N + 1) * next.w;
    c[STATE_CURRENT] = next.i;
    c[STATE_SPEED] = next.w;
    c[STATE_ANGLE] = part * now.w;
    c[STATE_CURRENT_TIME] = part * now.i;
    if constexpr (L::FULL)
        series_store_effects<L>(a.effects, now.i, now.w, part, last, c);
    c[STATE_BUS_TIME] = part * a.bus_i * now.i;
    c[L::HOUSING_TIME] = part * housing;
    c[L::ARM_ANGLE] = part * last[L::ARM_SPEED];
    c[L::ARM_SPEED] =
        (part * m.arm_inertia_inverse) *
        (housing - m.arm_damping * last[L::ARM_SPEED] - m.arm_stiffness * last[L::ARM_ANGLE]);
}

// Orders from N + 1 on, as long as the slow states have coefficients; each order is a function of
// its own, so that the compiler knows which terms it has.
template <class L, int N>
VGROOVE_INLINE void series_slow_orders(const Impact &m, const SeriesRates &a,
                                       const SeriesWeights &g, SeriesJet &y, SeriesStates &now,
                                       ImpactSeries<L> &to) {
    const double q_rate = now.w * m.ratio_inverse - now.hammer;
    y.q_rate()[N] = q_rate;
    if constexpr (N < SERIES_GROOVE) {
        y.q[N + 1] = SERIES_RECIPROCAL.of[N + 1] * q_rate;
        series_groove(m, y, N + 1);
    }
    const SeriesOld old = series_old<N, true>(m, a, y, now);
    const SeriesStates next = series_states<N, true>(a, g, old, now);
    const SeriesTorques t = series_torques<N, true>(a, g, y, old, now);
    series_store_fast<L, N>(t, now, next, to);
    series_store_slow<L, N>(m, a, t.drive, now, next, to);
    if constexpr (N < SERIES_GROOVE)
        series_shares(m, y, N + 1);
    now = next;
    if constexpr (N + 1 < SERIES_SLOW)
        series_slow_orders<L, N + 1>(m, a, g, y, now, to);
}

// The other orders of the fast states
template <class L, int N>
VGROOVE_INLINE void series_fast_orders(const Impact &m, const SeriesRates &a,
                                       const SeriesWeights &g, SeriesJet &y, SeriesStates &now,
                                       ImpactSeries<L> &to) {
    const SeriesOld old = series_old<N, false>(m, a, y, now);
    const SeriesStates next = series_states<N, false>(a, g, old, now);
    series_store_fast<L, N>(series_torques<N, false>(a, g, y, old, now), now, next, to);
    now = next;
    if constexpr (N + 1 < SERIES_ORDER)
        series_fast_orders<L, N + 1>(m, a, g, y, now, to);
}

// Coefficients of all orders from the state and slope of the solver
template <class L> VGROOVE_CLONES_APART void series_expand(ImpactSolver<L> &self) {
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
    const SeriesWeights g = series_weights(m, a, y);
    series_slow_orders<L, 1>(m, a, g, y, now, to);
    series_fast_orders<L, SERIES_SLOW>(m, a, g, y, now, to);
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
    double speed = std::fabs(c.x[STATE_SPEED]), current = std::fabs(c.x[STATE_CURRENT]);
    if constexpr (L::FULL) {
        speed = max_of(speed, std::fabs(c.x[STATE_SPEED_FILTER]));
        current = max_of(current, std::fabs(c.x[STATE_CURRENT_FILTER]));
    }
    return max_of(speed * m.speed_weight, current * m.current_weight) / self.tolerance;
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
    double slope[static_cast<unsigned>(COUNT)];
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
VGROOVE_CLONES_APART void series_attempt(ImpactSolver<L> &self, double h, ImpactState<L> &error) {
    ImpactStep<L> &t = self.step;
    t.end = impact_series_at<L>(t.series, h);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    error = ImpactState<L>{};
    series_defect<L, STATE_CURRENT, 2>(t, h, error);
    series_defect<L, L::HAMMER_SPEED, 4>(t, h, error);
}

}  // namespace vgroove

#endif
