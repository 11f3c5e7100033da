// Flight of the hammer between contacts, fast mode: the anvil rings in closed form, and a step
// takes the motor's current exactly where it decays.
//
// Exponential Runge-Kutta of fourth order of Krogstad (J. Comput. Phys. 203, 2005): the classical
// one for every state but the current, whose own decay would hold an explicit step below a
// millisecond. Four derivatives a step; error from the last stage's slope against the end's.
#ifndef VGROOVE_PLANT_IMPACT_FLIGHT_HPP
#define VGROOVE_PLANT_IMPACT_FLIGHT_HPP

#include "impact/solver.hpp"

namespace vgroove {

template <class L>
void impact_stage(const ImpactSolver<L> &self, double tau, const ImpactState<L> &s,
                  ImpactState<L> &ds);  // impact_steps.cpp
template <class L>
ImpactPoint impact_slope(ImpactSolver<L> &self, double tau, const ImpactState<L> &s,
                         ImpactState<L> &ds);

constexpr double FLIGHT_ERROR_SHARE = 0.014;  // the estimate is of third order: it overstates
constexpr double FLIGHT_VERTICES =
    8.0;  // vertex radii from the groove's vertex, from where on a flight is one
constexpr double FLIGHT_APPROACH = 0.5;  // of the way to the vertex in one step
constexpr double RING_STEP = 1.0;  // longest step over the anvil's time constant while the hammer
                                   // is within the anvil's swing
constexpr double RING_FELT_RAD = 1e-5;  // a smaller swing moves no contact

// Rate at which the current decays by itself.
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

// phi_k of z / 2 with z = -rate h, and of z by doubling.
VGROOVE_INLINE void flight_weigh(FlightWeights &w, double h, double rate) {
    if (w.h == h && w.rate == rate)
        return;
    const double z = -0.5 * rate * h;
    double phi_0, phi_1, phi_2, phi_3;
    if (z > -1.0) {
        phi_3 = 1.0 / 479001600.0;
        double factorial = 39916800.0;  // Taylor: sum of z^k / (k + 3)!
        for (int n = 11; n >= 3; --n) {
            phi_3 = phi_3 * z + 1.0 / factorial;
            factorial /= n;
        }
        phi_2 = 0.5 + z * phi_3;
        phi_1 = 1.0 + z * phi_2;
        phi_0 = 1.0 + z * phi_1;
    } else {
        phi_0 = exp_of<double>(z);
        phi_1 = (phi_0 - 1.0) / z;
        phi_2 = (phi_1 - 1.0) / z;
        phi_3 = (phi_2 - 0.5) / z;
    }
    w.h = h;
    w.rate = rate;
    w.half_1 = phi_1;
    w.half_2 = phi_2;
    w.full_1 = 0.5 * (phi_0 + 1.0) * phi_1;
    w.full_2 = 0.25 * (phi_1 * phi_1 + 2.0 * phi_2);
    w.full_3 = 0.125 * (phi_1 * phi_2 + phi_2 + 2.0 * phi_3);
}

// How far the untouched anvil can still swing to either side of its head, rad.
template <class L> VGROOVE_INLINE double ring_swing(const Impact &m, const ImpactState<L> &s) {
    return std::sqrt(s.x[L::TWIST] * s.x[L::TWIST] +
                     s.x[L::ANVIL_SPEED] * s.x[L::ANVIL_SPEED] / m.ring_square);
}

// Whether the hammer's lugs are out of reach of an anvil that swings so far.
template <class L>
VGROOVE_INLINE bool ring_clear(const Impact &m, const ImpactMode &mode, const ImpactState<L> &s,
                               double swing) {
    if (mode.above)
        return true;
    const double from_head = impact_relative<L>(m, s) + s.x[L::TWIST];
    return mode.forward_rad - from_head > swing && from_head - mode.backward_rad > swing;
}

// The anvil is left to itself once nothing touches it, the joint can no longer slip and the torque
// no longer pass its peak; at rest it stays.
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
        const double torque =
            swing * (self.model.joint.stiffness +
                     self.model.joint.damping * std::sqrt(self.model.ring_square));
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

// Longest step: short while hammer and anvil may still meet within the anvil's swing.
template <class L> VGROOVE_INLINE double ring_longest(const ImpactSolver<L> &self) {
    if (!self.mode.ringing)
        return IMPACT_NO_HORIZON_S;
    const double swing = ring_swing<L>(self.model, self.state);
    return swing < RING_FELT_RAD || ring_clear<L>(self.model, self.mode, self.state, swing)
               ? IMPACT_NO_HORIZON_S
               : RING_STEP / std::sqrt(self.model.ring_square);
}

// Whether the step just tried brought the hammer within the swing that the anvil had at its start,
// and was too long for that.
template <class L> VGROOVE_INLINE bool ring_overlooked(const ImpactSolver<L> &self, double h) {
    if (!self.mode.ringing)
        return false;
    const double swing = ring_swing<L>(self.model, self.state);
    return swing >= RING_FELT_RAD &&
           h * h * self.model.ring_square > 1.01 * RING_STEP * RING_STEP &&
           !ring_clear<L>(self.model, self.mode, self.step.end, swing);
}

// Off the vertex of the groove: near it the force turns within a fraction of a millisecond, and the
// fifth order is worth its stages.
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

// Longest step: towards the vertex of the groove only part of the way.
template <class L> VGROOVE_INLINE double flight_longest(const ImpactSolver<L> &self) {
    const ImpactState<L> &s = self.state;
    const double q = impact_spindle_angle<L>(self.model, s) - s.x[L::HAMMER_ANGLE];
    const double rate = impact_spindle_speed<L>(self.model, s) - s.x[L::HAMMER_SPEED];
    const double longest = flight_applies(self) ? IMPACT_FLIGHT_MAX_S : IMPACT_STEP_MAX_S;
    if (q * rate >= 0.0 || std::fabs(q) < 2.0 * self.model.groove.vertex)
        return longest;
    return min_of(longest, FLIGHT_APPROACH * std::fabs(q / rate));
}

template <class L>
VGROOVE_INLINE void flight_stage(const ImpactState<L> &y, double h, const ImpactState<L> &k,
                                 double current, ImpactState<L> &s) {
    for (int n = 0; n < L::COUNT; ++n)
        s.x[n] = y.x[n] + h * k.x[n];
    s.x[STATE_CURRENT] = y.x[STATE_CURRENT] + current;
}

// One step. Leaves end, end_slope and the error per second in `error`.
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
    impact_stage(self, 0.5 * h, s, t.k2);
    const double n2 = t.k2.x[I] + rate * s.x[I];
    flight_stage<L>(y, 0.5 * h, t.k2, h * (0.5 * w.half_1 * k1.x[I] + w.half_2 * (n2 - n1)), s);
    impact_stage(self, 0.5 * h, s, t.k3);
    const double middle = s.x[I], n3 = t.k3.x[I] + rate * middle;
    flight_stage<L>(y, h, t.k3, h * (w.full_1 * k1.x[I] + 2.0 * w.full_2 * (n3 - n1)), s);
    impact_stage(self, h, s, t.k4);
    const double n4 = t.k4.x[I] + rate * s.x[I];
    for (int n = 0; n < L::COUNT; ++n)
        t.end.x[n] = y.x[n] + h / 6.0 * ((k1.x[n] + t.k4.x[n]) + 2.0 * (t.k2.x[n] + t.k3.x[n]));
    t.end.x[I] =
        i + h * (w.full_1 * k1.x[I] + (4.0 * w.full_3 - 3.0 * w.full_2) * n1 +
                 (2.0 * w.full_2 - 4.0 * w.full_3) * (n2 + n3) + (4.0 * w.full_3 - w.full_2) * n4);
    if (self.mode.ringing)
        impact_ring(self, h, t.end);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    for (int n = 0; n < L::COUNT; ++n)
        error.x[n] = FLIGHT_ERROR_SHARE / 6.0 * (t.k4.x[n] - t.end_slope.x[n]);
    // Means and rows come off the interpolant: its middle against the stage there.
    const double bent = 0.5 * (i + t.end.x[I]) + 0.125 * h * (k1.x[I] - t.end_slope.x[I]) - middle;
    error.x[I] = FLIGHT_ERROR_SHARE *
                 max_of(std::fabs(bent) / h, std::fabs(t.k4.x[I] - t.end_slope.x[I]) / 6.0);
    self.stats.derivatives += 3.0;
}

}  // namespace vgroove

#endif
