// Taylor series of the motion while a lug is touched or the anvil still moves, fast mode: what is
// stiff there is linear, and a series takes it as far as several of explicit Runge-Kutta's steps,
// gives its own length and is its own interpolant.
//
// Jorba and Zou, "A software package for the numerical integration of ODEs by means of high-order
// Taylor methods", Experimental Mathematics 14 (2005): coefficients by recurrence, the step from
// the last of them. Here contact, joint, motor and spring, all linear, go to SERIES_ORDER, the
// shape of the groove, which is slow beside them, to SERIES_GROOVE. What that leaves out, and a
// slip torque that is not linear in the head's angle, shows as the difference between the
// derivative and the series' own at the step's end, which is the error that the step is held to.
#ifndef VGROOVE_PLANT_IMPACT_SERIES_HPP
#define VGROOVE_PLANT_IMPACT_SERIES_HPP

#include "impact/solver.hpp"

namespace vgroove {

constexpr int SERIES_GROOVE = 3;
constexpr double SERIES_SHARE = 0.7;   // of the length that the last terms allow
constexpr double SERIES_REDUCE = 0.5;  // a step whose error is too large
constexpr double SERIES_NEXT_S =
    4e-4;  // first step of the other methods once the anvil is left alone

// Rates of change of what is linear, each over what it follows: i and w motor current and speed,
// the rest at hammer, anvil and joint.
struct SeriesLaw {
    double current_i, current_w, bus_i;     // A/s, and V of the bus
    double drive_i, drive_w;                // N m on the spindle
    double lug_angle, lug_speed, lug_ramp;  // N m over hammer less anvil; over penetration times
                                            // its rate while damping ramps up
    double joint_twist, joint_speed, joint_head;   // N m
    double twist_speed, twist_joint, twist_twist;  // rad/s
};

// The series as they grow, coefficient by coefficient; coefficients before the first are 0.
struct SeriesJet {
    static constexpr int N = SERIES_ORDER + 1, M = SERIES_GROOVE + 1;
    double relative[N], rate[N];  // hammer less anvil: of the flank met, and its rate
    double root_inverse, square_inverse;
    double q[M], root[M], slope[M], square[M], share[M], carried[M], bend[M];
    double q_rate_of[SERIES_GROOVE + N], push_of[SERIES_GROOVE + N], axial_of[SERIES_GROOVE + N];
    double *q_rate() { return q_rate_of + SERIES_GROOVE; }
    double *push() {
        return push_of + SERIES_GROOVE;
    }  // lug's torque and the spindle's, as the balls carry them
    double *axial() { return axial_of + SERIES_GROOVE; }  // force without them
};
struct SeriesParts {
    double of[SERIES_ORDER + 2];
};
constexpr SeriesParts series_parts() {
    SeriesParts p{};
    for (int n = 1; n < SERIES_ORDER + 2; ++n)
        p.of[n] = 1.0 / n;
    return p;
}
constexpr SeriesParts SERIES_PARTS = series_parts();

VGROOVE_INLINE double series_product(const double *a, const double *b, int from, int to, int n) {
    double sum = 0.0;
    for (int j = from; j <= to; ++j)
        sum += a[j] * b[n - j];
    return sum;
}

// Whether the motion is one that series follow: all linear but the groove and the joint's slip
// torque.
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
VGROOVE_INLINE void series_electrical(const ImpactSolver<L> &self, SeriesLaw &a) {
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

// Slope of a slip torque over the head's angle.
VGROOVE_INLINE double series_slope(const double *c, double x) {
    return c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]);
}

template <class L> VGROOVE_INLINE void series_joint(const ImpactSolver<L> &self, SeriesLaw &a) {
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

template <class L> VGROOVE_INLINE SeriesLaw series_law(const ImpactSolver<L> &self) {
    const Impact &m = self.model;
    const ImpactMode &mode = self.mode;
    SeriesLaw a{};
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

// x = l (root - e), root^2 = q^2 + e^2, s = dx/dq = l q / root, bend = m s'
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

// States of order n, the newest: kept apart from the arrays, for the next order waits for them.
struct SeriesNow {
    double i, w, hammer, anvil, twist, anvil_before;
};

// Torques of order n: lug and joint, and the groove's with all that does not wait for the newest
// states added first. A = F0 + k x + m s' q', the dot of s its change in time.
struct SeriesTorques {
    double lug, joint, drive, groove;
};
VGROOVE_INLINE SeriesTorques series_torques(const Impact &m, const SeriesLaw &a, SeriesJet &y,
                                            const SeriesNow &now, int n) {
    const double before = SERIES_PARTS.of[n],
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
    t.drive = a.drive_i * now.i + a.drive_w * now.w;
    t.lug = lug + a.lug_speed * y.rate[n];
    push[0] = t.lug + spindle * t.drive;
    axial[0] = old_axial + y.bend[0] * q_rate[0];
    t.groove = ((old + y.share[0] * old_axial) + (y.carried[0] * spindle) * t.drive) +
               ((y.share[0] * y.bend[0]) * q_rate[0] + y.carried[0] * t.lug);
    return t;
}

VGROOVE_INLINE SeriesNow series_states(const Impact &m, const SeriesLaw &a, const SeriesTorques &t,
                                       const SeriesNow &now, int n) {
    const double part = SERIES_PARTS.of[n + 1];
    SeriesNow next;
    next.hammer = (part * m.hammer_inertia_inverse) * (t.groove - t.lug);
    next.w = (part * m.ratio * m.spindle_inertia_inverse) * (t.drive - t.groove);
    next.anvil = (part * m.anvil_inertia_inverse) * (t.lug - t.joint);
    next.twist =
        part * (a.twist_speed * now.anvil + a.twist_joint * t.joint + a.twist_twist * now.twist);
    next.i = part * (a.current_i * now.i + a.current_w * now.w);
    next.anvil_before = now.anvil;
    return next;
}

// Order n + 1 of all states, with those that follow others: angles, integrals, arm.
template <class L>
VGROOVE_INLINE void series_store(const Impact &m, const SeriesLaw &a, const SeriesTorques &t,
                                 const SeriesNow &now, const SeriesNow &next, int n,
                                 ImpactSeries<L> &to) {
    const double part = SERIES_PARTS.of[n + 1];
    double *c = to.c[n + 1].x;
    const double *last = to.c[n].x;
    const double housing = t.drive - (m.ratio - 1.0) * m.motor_inertia * (n + 1) * next.w;
    c[STATE_CURRENT] = next.i;
    c[STATE_SPEED] = next.w;
    c[STATE_ANGLE] = part * now.w;
    c[STATE_CURRENT_TIME] = part * now.i;
    c[STATE_BUS_TIME] = part * a.bus_i * now.i;
    c[L::HAMMER_ANGLE] = part * now.hammer;
    c[L::HAMMER_SPEED] = next.hammer;
    c[L::ANVIL_ANGLE] = part * now.anvil;
    c[L::ANVIL_SPEED] = next.anvil;
    c[L::TWIST] = next.twist;
    c[L::HOUSING_TIME] = part * housing;
    c[L::LUG_IMPULSE] = part * t.lug;
    c[L::ARM_ANGLE] = part * last[L::ARM_SPEED];
    c[L::ARM_SPEED] =
        (part * m.arm_inertia_inverse) *
        (housing - m.arm_damping * last[L::ARM_SPEED] - m.arm_stiffness * last[L::ARM_ANGLE]);
}

template <class L> __attribute__((noinline)) void series_expand(ImpactSolver<L> &self) {
    const Impact &m = self.model;
    const SeriesLaw a = series_law<L>(self);
    ImpactSeries<L> &to = self.step.series;
    SeriesJet y;
    series_start<L>(self, y);
    to.c[0] = self.state;
    to.c[1] = self.slope;
    const double *first = self.slope.x;
    SeriesNow now{first[STATE_CURRENT],  first[STATE_SPEED], first[L::HAMMER_SPEED],
                  first[L::ANVIL_SPEED], first[L::TWIST],    self.state.x[L::ANVIL_SPEED]};
    for (int n = 1; n < SERIES_ORDER; ++n) {
        const double q_rate = now.w * m.ratio_inverse - now.hammer;
        y.q_rate()[n] = q_rate;
        if (n < SERIES_GROOVE) {
            y.q[n + 1] = SERIES_PARTS.of[n + 1] * q_rate;
            series_groove(m, y, n + 1);
        }
        const SeriesTorques t = series_torques(m, a, y, now, n);
        const SeriesNow next = series_states(m, a, t, now, n);
        series_store<L>(m, a, t, now, next, n, to);
        if (n < SERIES_GROOVE)
            series_shares(m, y, n + 1);
        now = next;
    }
}

// x^(-1/n) within some percent, the same on every machine: the exponent's bits over n.
VGROOVE_INLINE double series_root_inverse(double x, unsigned n) {
    constexpr std::uint64_t ONE = 0x3FF0000000000000u;
    return from_bits<double>(ONE + ONE / n - bits_of(x) / n);
}

// Largest of a state's coefficients in its share of the tolerance.
template <class L>
VGROOVE_INLINE double series_norm(const ImpactSolver<L> &self, const ImpactState<L> &c) {
    const Impact &m = self.model;
    const double speeds =
        max_of(std::fabs(c.x[L::HAMMER_SPEED]), std::fabs(c.x[L::ANVIL_SPEED])) * m.output_weight;
    const double twist =
        max_of(std::fabs(c.x[L::TWIST]), std::fabs(c.x[L::HAMMER_ANGLE])) * m.angle_weight;
    return max_of(speeds, max_of(twist, std::fabs(c.x[STATE_CURRENT]) * m.current_weight)) /
           self.tolerance;
}

// The longest step whose last two terms lie within the tolerance.
template <class L> VGROOVE_INLINE double series_longest(const ImpactSolver<L> &self) {
    const ImpactSeries<L> &s = self.step.series;
    const double last = series_root_inverse(series_norm<L>(self, s.c[SERIES_ORDER]), SERIES_ORDER);
    const double before =
        series_root_inverse(series_norm<L>(self, s.c[SERIES_ORDER - 1]), SERIES_ORDER - 1);
    return SERIES_SHARE * min_of(last, before);
}

// Of some of the states, the derivative at the end less the series' own.
template <class L>
VGROOVE_INLINE void series_defect(const ImpactStep<L> &t, double h, int from, int count,
                                  ImpactState<L> &error) {
    double slope[4];
    for (int n = 0; n < count; ++n)
        slope[n] = SERIES_ORDER * t.series.c[SERIES_ORDER].x[from + n];
    for (int k = SERIES_ORDER - 1; k > 0; --k)
        for (int n = 0; n < count; ++n)
            slope[n] = slope[n] * h + k * t.series.c[k].x[from + n];
    for (int n = 0; n < count; ++n)
        error.x[from + n] = t.end_slope.x[from + n] - slope[n];
}

// One step: the end of the series, and the derivative there against theirs.
template <class L>
__attribute__((noinline)) void series_attempt(ImpactSolver<L> &self, double h,
                                              ImpactState<L> &error) {
    ImpactStep<L> &t = self.step;
    t.end = impact_series_at<L>(t.series, h);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    error = ImpactState<L>{};
    series_defect<L>(t, h, STATE_CURRENT, 2, error);
    series_defect<L>(t, h, L::HAMMER_SPEED, 4, error);
}

// A switch's function as a sum of states.
struct SeriesSwitch {
    double relative, rate, twist, anvil_speed;  // hammer less anvil, its rate
};

// Gives false for a switch that is no such sum.
template <class L>
VGROOVE_INLINE bool series_switch(const ImpactSolver<L> &self, int event, SeriesSwitch &f) {
    const ImpactMode &mode = self.mode;
    const Joint &j = self.model.joint;
    const double arm =
        mode.place == ContactPlace::BACKWARD ? -self.model.lug_radius_m : self.model.lug_radius_m;
    f = SeriesSwitch{};
    switch (event) {
    case IMPACT_FORWARD:
        f.relative = -1.0;
        return true;
    case IMPACT_BACKWARD:
        f.relative = 1.0;
        return true;
    case IMPACT_LEAVE:
        f.relative = arm;
        return true;
    case IMPACT_RAMP:
        f.relative = mode.ramped ? arm : -arm;
        return true;
    case IMPACT_TURN:
        f.rate = mode.approaching ? arm : -arm;
        return true;
    case IMPACT_SLIP_FORWARD:
    case IMPACT_SLIP_BACKWARD:
        f.twist = event == IMPACT_SLIP_FORWARD ? -j.stiffness : j.stiffness;
        f.anvil_speed = event == IMPACT_SLIP_FORWARD ? -j.damping : j.damping;
        return true;
    default:
        return false;
    }
}

template <class L>
VGROOVE_INLINE double series_switch_sum(const SeriesSwitch &f, const ImpactState<L> &c) {
    return (f.relative * (c.x[L::HAMMER_ANGLE] - c.x[L::ANVIL_ANGLE]) +
            f.rate * (c.x[L::HAMMER_SPEED] - c.x[L::ANVIL_SPEED])) +
           (f.twist * c.x[L::TWIST] + f.anvil_speed * c.x[L::ANVIL_SPEED]);
}

struct SeriesPolynomial {
    double c[SERIES_ORDER + 1];
};
struct SeriesValue {
    double value, rate;
};
VGROOVE_INLINE SeriesValue series_value(const SeriesPolynomial &p, double t) {
    double value = p.c[SERIES_ORDER], rate = 0.0;
    for (int k = SERIES_ORDER - 1; k >= 0; --k) {
        rate = rate * t + value;
        value = value * t + p.c[k];
    }
    return {value, rate};
}

// Instant just past the first zero between 0, where the function is positive, and `high`, where it
// is not: Newton within a bracket.
VGROOVE_INLINE double series_zero(const SeriesPolynomial &p, double high, double high_value,
                                  double width_s) {
    const double end = high;
    double low = 0.0, t = high * (p.c[0] / (p.c[0] - high_value));
    for (int n = 0; n < 40 && high - low > width_s; ++n) {
        const SeriesValue g = series_value(p, t);
        (g.value < 0.0 ? high : low) = t;
        const double step = g.value / g.rate, next = t - step;
        if (g.rate < 0.0 && std::fabs(step) < 0.25 * width_s)
            return min_of(next + 0.5 * width_s, end);
        t = next > low && next < high ? next : 0.5 * (low + high);
    }
    for (double past = 0.5 * width_s; t < end; past *= 2.0) {
        t = min_of(t + past, end);
        if (series_value(p, t).value < 0.0)
            break;
    }
    return t;
}

// Where the function, falling at 0 and rising at h, is least.
VGROOVE_INLINE double series_least(const SeriesPolynomial &p, double h) {
    double low = 0.0, high = h;
    for (int n = 0; n < 12; ++n) {
        const double t = 0.5 * (low + high);
        (series_value(p, t).rate < 0.0 ? low : high) = t;
    }
    return 0.5 * (low + high);
}

// Instant of a switch within the series' step: met at its end, or met and left again. Negative: it
// is not met.
template <class L>
VGROOVE_INLINE double series_instant(const ImpactSolver<L> &self, const SeriesSwitch &f,
                                     double at_start, double at_end, double width_s) {
    const ImpactStep<L> &t = self.step;
    SeriesPolynomial p;
    p.c[0] = at_start;
    for (int k = 1; k <= SERIES_ORDER; ++k)
        p.c[k] = series_switch_sum<L>(f, t.series.c[k]);
    if (at_end < 0.0)
        return series_zero(p, t.h, at_end, width_s);
    const double least = series_least(p, t.h), value = series_value(p, least).value;
    return value < 0.0 ? series_zero(p, least, value, width_s) : -1.0;
}

// Switches of contact and joint that may be met and left again within the step: where their
// function turns.
template <class L>
VGROOVE_INLINE unsigned series_grazed(const ImpactSolver<L> &self, unsigned candidates) {
    const ImpactStep<L> &t = self.step;
    const Joint &j = self.model.joint;
    const double arm = self.mode.place == ContactPlace::BACKWARD ? -1.0 : 1.0,
                 way = self.mode.approaching ? arm : -arm;
    const double from = way * (self.slope.x[L::HAMMER_SPEED] - self.slope.x[L::ANVIL_SPEED]);
    const double to = way * (t.end_slope.x[L::HAMMER_SPEED] - t.end_slope.x[L::ANVIL_SPEED]);
    const double torque_from =
        j.stiffness * self.slope.x[L::TWIST] + j.damping * self.slope.x[L::ANVIL_SPEED];
    const double torque_to =
        j.stiffness * t.end_slope.x[L::TWIST] + j.damping * t.end_slope.x[L::ANVIL_SPEED];
    unsigned turned = 0u;
    if (self.point.pen_rate < 0.0 && t.end_point.pen_rate > 0.0)
        turned |= impact_bit(IMPACT_LEAVE);
    if (from < 0.0 && to > 0.0)
        turned |= impact_bit(IMPACT_TURN);
    if (torque_from > 0.0 && torque_to < 0.0)
        turned |= impact_bit(IMPACT_SLIP_FORWARD);
    if (torque_from < 0.0 && torque_to > 0.0)
        turned |= impact_bit(IMPACT_SLIP_BACKWARD);
    return turned & candidates;
}

}  // namespace vgroove

#endif
