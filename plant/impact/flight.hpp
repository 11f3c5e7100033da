// Fast mode: steps of the hammer's flight between contacts, in which the decay of the motor current
// and the oscillation of the hammer on its spring are exact.
//
// Exponential Runge-Kutta method of fourth order of Krogstad (J. Comput. Phys. 203, 2005). Its
// linear part is the current's own decay, which would limit an explicit step to less than a
// millisecond, and the oscillation q'' = -w^2 q of the groove angle at the slope that the groove
// has away from its vertex. The common motion of spindle and hammer and all other states follow the
// classical method. Four derivatives a step; the error is estimated from the difference of the last
// stage's slope and that at the end.
#ifndef VGROOVE_PLANT_IMPACT_FLIGHT_HPP
#define VGROOVE_PLANT_IMPACT_FLIGHT_HPP

#include "impact/ringing.hpp"
#include "numeric/phi_functions.hpp"

namespace vgroove {

// Share of the difference of slopes that is taken as the error: the difference is of third order,
// the method of fourth.
constexpr double FLIGHT_ERROR_SHARE = 0.02;
// Distance from the groove's vertex, over the vertex radius, beyond which the method is used.
constexpr double FLIGHT_VERTICES = 3.0;
// Longest step towards the vertex, over the distance from it.
constexpr double FLIGHT_APPROACH = 0.45;

// Rate at which the current decays by itself, 1/s
VGROOVE_INLINE double flight_rate(const Impact &m, const ImpactMode &mode,
                                  const Drive<double> &in) {
    const Drivetrain<double> &d = m.drive;
    const bool open = in.open > 0.0;
    if (d.input == InputKind::CURRENT || (open && mode.drive.diode == 0.0))
        return 0.0;
    double ohm = d.motor.resistance_ohm;
    if (d.input == InputKind::DUTY)
        ohm += d.bridge.resistance_ohm +
               (d.bus_measured ? 0.0
                               : d.supply.resistance_ohm * (open ? 1.0 : in.command * in.command));
    return ohm * d.motor.inductance_inverse;
}

// phi_k(Z) = t_k I + t_(k+1) Z of the oscillation, Z = h (0, 1; -square, 0): t_k = sum of
// (-square h^2)^j / (2 j + k)!
VGROOVE_INLINE SwingWeights swing_weights(double square_h2) {
    SwingWeights t{0.0, 0.0, 1.0 / 6227020800.0, 1.0 / 87178291200.0};  // 1 / 13!, 1 / 14!
    double odd = 6227020800.0, even = 87178291200.0;
    for (int n = 13; n > 3; n -= 2) {
        odd /= n * (n - 1.0);
        even /= (n + 1.0) * n;
        t.t3 = 1.0 / odd - square_h2 * t.t3;
        t.t4 = 1.0 / even - square_h2 * t.t4;
    }
    t.t2 = 0.5 - square_h2 * t.t4;
    t.t1 = 1.0 - square_h2 * t.t3;
    return t;
}

// phi_k of z / 2 with z = -rate h, and of z by the doubling formula; the same of the oscillation
VGROOVE_INLINE void flight_weigh(FlightWeights &w, double h, double rate, double square) {
    if (w.h == h && w.rate == rate)
        return;
    const double z = -0.5 * rate * h;
    const Phi f = phi_of(z);
    w.h = h;
    w.rate = rate;
    w.half = swing_weights(0.25 * square * h * h);
    w.full = swing_weights(square * h * h);
    w.half_1 = f.p1;
    w.half_2 = f.p2;
    w.full_1 = 0.5 * (f.p0 + 1.0) * f.p1;
    w.full_2 = 0.25 * (f.p1 * f.p1 + 2.0 * f.p2);
    w.full_3 = 0.125 * (f.p1 * f.p2 + f.p2 + 2.0 * f.p3);
}

// Whether the step is a flight: no contact, and the balls away from the groove's vertex. At the
// vertex the spring force reverses within a fraction of a millisecond; there the method of Dormand
// and Prince needs fewer derivatives.
template <class L> VGROOVE_INLINE bool flight_applies(const ImpactSolver<L> &self) {
    if (L::EXACT || self.model.two_bodies || self.model.second_output)
        return false;
    const ImpactMode &mode = self.mode;
    const double q =
        impact_spindle_angle<L>(self.model, self.state) - self.state.x[L::HAMMER_ANGLE];
    return mode.place == ContactPlace::NONE && (mode.ringing || mode.frozen) &&
           mode.drive.slide != 0.0 &&
           q * q > FLIGHT_VERTICES * FLIGHT_VERTICES * self.model.groove.vertex2;
}

// Longest step; towards the groove's vertex it covers part of the way only
template <class L> VGROOVE_INLINE double flight_longest(const ImpactSolver<L> &self) {
    const ImpactState<L> &s = self.state;
    const double q = impact_spindle_angle<L>(self.model, s) - s.x[L::HAMMER_ANGLE];
    const double rate = impact_spindle_speed<L>(self.model, s) - s.x[L::HAMMER_SPEED];
    const double longest = flight_applies(self) ? IMPACT_FLIGHT_MAX_S : IMPACT_STEP_MAX_S;
    if (q * rate >= 0.0 || std::fabs(q) < 2.0 * self.model.groove.vertex)
        return longest;
    return min_of(longest, FLIGHT_APPROACH * std::fabs(q / rate));
}

// State of a stage: y + h k, the current y + `current`
template <class L>
VGROOVE_INLINE void flight_stage(const ImpactState<L> &y, double h, const ImpactState<L> &k,
                                 double current, ImpactState<L> &s) {
    for (int n = 0; n < L::COUNT; ++n)
        s.x[n] = y.x[n] + h * k.x[n];
    s.x[STATE_CURRENT] = y.x[STATE_CURRENT] + current;
}

// Groove angle and its rate. In a slope: the rate, and the angular acceleration.
struct GrooveMotion {
    double q, rate;
};
template <class L>
VGROOVE_INLINE GrooveMotion flight_groove(const Impact &m, const ImpactState<L> &s) {
    return {s.x[STATE_ANGLE] * m.ratio_inverse - s.x[L::HAMMER_ANGLE],
            s.x[STATE_SPEED] * m.ratio_inverse - s.x[L::HAMMER_SPEED]};
}

// Gives the groove this motion; the common motion of spindle and hammer is kept.
template <class L>
VGROOVE_INLINE void flight_set_groove(const Impact &m, const GrooveMotion &to, ImpactState<L> &s) {
    const GrooveMotion now = flight_groove<L>(m, s);
    const double q = to.q - now.q, rate = to.rate - now.rate;
    s.x[STATE_ANGLE] += m.ratio * m.swing_share * q;
    s.x[STATE_SPEED] += m.ratio * m.swing_share * rate;
    s.x[L::HAMMER_ANGLE] -= (1.0 - m.swing_share) * q;
    s.x[L::HAMMER_SPEED] -= (1.0 - m.swing_share) * rate;
}

// Motion after t from y with the slope f, by the linear part alone, plus the change d of the
// acceleration beyond it with the weights of phi_2 times `times`
VGROOVE_INLINE GrooveMotion swing_on(const SwingWeights &w, double t, double square,
                                     const GrooveMotion &y, const GrooveMotion &f, double d) {
    return {y.q + t * (w.t1 * f.q + t * (w.t2 * f.rate + w.t3 * d)),
            y.rate + t * (w.t1 * f.rate - t * square * w.t2 * f.q + w.t2 * d)};
}

// Motion at the end of the step; a: accelerations beyond the linear part in the first stage, in the
// second and third together, in the fourth
struct SwingStages {
    double first, middle, last;
};
VGROOVE_INLINE GrooveMotion swing_end(const SwingWeights &w, double h, double square,
                                      const GrooveMotion &y, const GrooveMotion &f,
                                      const SwingStages &a) {
    const double q = (4.0 * w.t4 - 3.0 * w.t3) * a.first + (2.0 * w.t3 - 4.0 * w.t4) * a.middle +
                     (4.0 * w.t4 - w.t3) * a.last;
    const double rate = (4.0 * w.t3 - 3.0 * w.t2) * a.first + (2.0 * w.t2 - 4.0 * w.t3) * a.middle +
                        (4.0 * w.t3 - w.t2) * a.last;
    const GrooveMotion linear = swing_on(w, h, square, y, f, 0.0);
    return {linear.q + h * h * q, linear.rate + h * rate};
}

// One trial step of length h; error: of each state, per second
template <class L>
VGROOVE_CLONES_APART void flight_attempt(ImpactSolver<L> &self, double h, ImpactState<L> &error) {
    constexpr int I = STATE_CURRENT;
    ImpactStep<L> &t = self.step;
    const ImpactState<L> &y = self.state, &k1 = self.slope;
    const Impact &m = self.model;
    const double rate = flight_rate(m, self.mode, self.drive), square = m.swing_square;
    flight_weigh(self.weights, h, rate, square);
    const FlightWeights &w = self.weights;
    const double i = y.x[I], n1 = k1.x[I] + rate * i;
    const GrooveMotion g = flight_groove<L>(m, y), f = flight_groove<L>(m, k1);
    const double a1 = f.rate + square * g.q;
    ImpactState<L> s;
    flight_stage<L>(y, 0.5 * h, k1, 0.5 * h * w.half_1 * k1.x[I], s);
    GrooveMotion now = swing_on(w.half, 0.5 * h, square, g, f, 0.0);
    flight_set_groove<L>(m, now, s);
    impact_stage(self, 0.5 * h, s, t.slopes.k2);
    const double n2 = t.slopes.k2.x[I] + rate * s.x[I];
    const double a2 = flight_groove<L>(m, t.slopes.k2).rate + square * now.q;
    flight_stage<L>(y, 0.5 * h, t.slopes.k2, h * (0.5 * w.half_1 * k1.x[I] + w.half_2 * (n2 - n1)),
                    s);
    now = swing_on(w.half, 0.5 * h, square, g, f, 2.0 * (a2 - a1));
    flight_set_groove<L>(m, now, s);
    impact_stage(self, 0.5 * h, s, t.slopes.k3);
    const double middle = s.x[I], n3 = t.slopes.k3.x[I] + rate * middle;
    const double a3 = flight_groove<L>(m, t.slopes.k3).rate + square * now.q;
    flight_stage<L>(y, h, t.slopes.k3, h * (w.full_1 * k1.x[I] + 2.0 * w.full_2 * (n3 - n1)), s);
    now = swing_on(w.full, h, square, g, f, 2.0 * (a3 - a1));
    flight_set_groove<L>(m, now, s);
    impact_stage(self, h, s, t.slopes.k4);
    const double n4 = t.slopes.k4.x[I] + rate * s.x[I];
    const double a4 = flight_groove<L>(m, t.slopes.k4).rate + square * now.q;
    for (int n = 0; n < L::COUNT; ++n)
        t.end.x[n] =
            y.x[n] +
            h / 6.0 * ((k1.x[n] + t.slopes.k4.x[n]) + 2.0 * (t.slopes.k2.x[n] + t.slopes.k3.x[n]));
    t.end.x[I] =
        i + h * (w.full_1 * k1.x[I] + (4.0 * w.full_3 - 3.0 * w.full_2) * n1 +
                 (2.0 * w.full_2 - 4.0 * w.full_3) * (n2 + n3) + (4.0 * w.full_3 - w.full_2) * n4);
    flight_set_groove<L>(m, swing_end(w.full, h, square, g, f, {a1, a2 + a3, a4}), t.end);
    if (self.mode.ringing)
        anvil_ring(self, h, t.end);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    for (int n = 0; n < L::COUNT; ++n)
        error.x[n] = FLIGHT_ERROR_SHARE / 6.0 * (t.slopes.k4.x[n] - t.end_slope.x[n]);
    // Rows are read from the interpolant: compare its middle with the stage there.
    const double deviation =
        0.5 * (i + t.end.x[I]) + 0.125 * h * (k1.x[I] - t.end_slope.x[I]) - middle;
    error.x[I] = FLIGHT_ERROR_SHARE * max_of(std::fabs(deviation) / h,
                                             std::fabs(t.slopes.k4.x[I] - t.end_slope.x[I]) / 6.0);
    self.stats.derivatives += 3.0;
}

}  // namespace vgroove

#endif
