// Fast mode: steps of the hammer's flight between contacts, in which the decay of the motor current
// is exact.
//
// Exponential Runge-Kutta method of fourth order of Krogstad (J. Comput. Phys. 203, 2005): the
// classical method for every state but the current, whose own decay would limit an explicit step to
// less than a millisecond. Four derivatives a step; the error is estimated from the difference of
// the last stage's slope and that at the end.
#ifndef VGROOVE_PLANT_IMPACT_FLIGHT_HPP
#define VGROOVE_PLANT_IMPACT_FLIGHT_HPP

#include "impact/ringing.hpp"
#include "numeric/phi_functions.hpp"

namespace vgroove {

// Share of the difference of slopes that is taken as the error: the difference is of third order,
// the method of fourth.
constexpr double FLIGHT_ERROR_SHARE = 0.014;
// Distance from the groove's vertex, over the vertex radius, beyond which the method is used.
constexpr double FLIGHT_VERTICES = 3.0;
// Longest step towards the vertex, over the distance from it.
constexpr double FLIGHT_APPROACH = 0.5;

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

// phi_k of z / 2 with z = -rate h, and of z by the doubling formula
VGROOVE_INLINE void flight_weigh(FlightWeights &w, double h, double rate) {
    if (w.h == h && w.rate == rate)
        return;
    const double z = -0.5 * rate * h;
    const Phi f = phi_of(z);
    w.h = h;
    w.rate = rate;
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

// One trial step of length h; error: of each state, per second
template <class L>
__attribute__((noinline)) void flight_attempt(ImpactSolver<L> &self, double h,
                                              ImpactState<L> &error) {
    constexpr int I = STATE_CURRENT;
    ImpactStep<L> &t = self.step;
    const ImpactState<L> &y = self.state, &k1 = self.slope;
    const double rate = flight_rate(self.model, self.mode, self.drive);
    flight_weigh(self.weights, h, rate);
    const FlightWeights &w = self.weights;
    const double i = y.x[I], n1 = k1.x[I] + rate * i;
    ImpactState<L> s;
    flight_stage<L>(y, 0.5 * h, k1, 0.5 * h * w.half_1 * k1.x[I], s);
    impact_stage(self, 0.5 * h, s, t.slopes.k2);
    const double n2 = t.slopes.k2.x[I] + rate * s.x[I];
    flight_stage<L>(y, 0.5 * h, t.slopes.k2, h * (0.5 * w.half_1 * k1.x[I] + w.half_2 * (n2 - n1)),
                    s);
    impact_stage(self, 0.5 * h, s, t.slopes.k3);
    const double middle = s.x[I], n3 = t.slopes.k3.x[I] + rate * middle;
    flight_stage<L>(y, h, t.slopes.k3, h * (w.full_1 * k1.x[I] + 2.0 * w.full_2 * (n3 - n1)), s);
    impact_stage(self, h, s, t.slopes.k4);
    const double n4 = t.slopes.k4.x[I] + rate * s.x[I];
    for (int n = 0; n < L::COUNT; ++n)
        t.end.x[n] =
            y.x[n] +
            h / 6.0 * ((k1.x[n] + t.slopes.k4.x[n]) + 2.0 * (t.slopes.k2.x[n] + t.slopes.k3.x[n]));
    t.end.x[I] =
        i + h * (w.full_1 * k1.x[I] + (4.0 * w.full_3 - 3.0 * w.full_2) * n1 +
                 (2.0 * w.full_2 - 4.0 * w.full_3) * (n2 + n3) + (4.0 * w.full_3 - w.full_2) * n4);
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
