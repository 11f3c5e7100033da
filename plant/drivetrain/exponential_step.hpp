// Step of the drivetrain by an exponential Rosenbrock method: current and speed, linearised at the
// start of the step, are exact at any length, and only torques that are not linear limit the step
// (drag, Stribeck friction, cogging, ...). Voltage and torque must be linear in the current: after
// a jump of the command the current changes between the points of a long step, where nothing is
// computed.
//
// Equation of motion: x' = A x + n, with x = (i, w), A the Jacobian at the start of the step, and n
// the nonlinear rest (the remainder). Over a step of length h, n is approximated by the quadratic
// polynomial c0 + c1 s + c2 s^2 of s = t / h; then, with Z = h A, the solution is exact:
// x(h) = e^Z x(0) + h (phi1(Z) c0 + phi2(Z) c1 + 2 phi3(Z) c2), and the integral of x (charge and
// angle) is h (phi1(Z) x(0) + h (phi2(Z) c0 + phi3(Z) c1 + 2 phi4(Z) c2)). The polynomial equals n
// at the start, the middle and the end of the step. At the latter two n depends on the solution: it
// is computed from a first guess and corrected twice (collocation: Hochbruck and Ostermann,
// Exponential integrators, Acta Numerica 19, 2010). The error is estimated from the difference
// between n and the polynomial at a quarter of the step.
#ifndef VGROOVE_PLANT_DRIVETRAIN_EXPONENTIAL_STEP_HPP
#define VGROOVE_PLANT_DRIVETRAIN_EXPONENTIAL_STEP_HPP

#include <cmath>
#include <limits>

#include "drivetrain/solver_state.hpp"
#include "drivetrain/stiff_step.hpp"
#include "numeric/phi_functions.hpp"

namespace vgroove {

// The estimate of the error, which is to first order, is multiplied by this.
constexpr double EXPONENTIAL_SAFETY = 2.0;

// A number for the current (i) and one for the speed (w)
template <class V> struct MotorPair { V i, w; };

// A 2 x 2 matrix that multiplies (i, w): iw stands in the row of the current and the column of the
// speed.
template <class V> struct MotorMatrix { V ii, iw, wi, ww; };

// What leads from the start of a step to a part of it: phi_0 to phi_4 of share Z, share: the length
// of the part over that of the step
template <class V> struct Propagator {
    double share;
    MotorMatrix<V> z;  // share h A
    PhiFunctions4<V> phi;
};

// Coefficients of the polynomial c0 + c1 s + c2 s^2 that approximates the remainder
template <class V> struct Remainder { MotorPair<V> c0, c1, c2; };

template <class V>
VGROOVE_INLINE MotorPair<V> motor_product(const MotorMatrix<V> &m, const MotorPair<V> &x) {
    return {m.ii * x.i + m.iw * x.w, m.wi * x.i + m.ww * x.w};
}

// (a I + b Z) x
template <class V>
VGROOVE_INLINE MotorPair<V> motor_function(const MatrixFunction<V> &f, const MotorMatrix<V> &z,
                                           const MotorPair<V> &x) {
    const MotorPair<V> zx = motor_product<V>(z, x);
    return {f.a * x.i + f.b * zx.i, f.a * x.w + f.b * zx.w};
}

template <class V> VGROOVE_INLINE MotorMatrix<V> motor_scaled(const MotorMatrix<V> &m, V factor) {
    return {m.ii * factor, m.iw * factor, m.wi * factor, m.ww * factor};
}

// For a quarter, a half and the whole of a step
template <class V> struct Propagators { Propagator<V> quarter, half, whole; };

template <class V> VGROOVE_INLINE Propagators<V> propagators(const MotorMatrix<V> &jacobian, V h) {
    Propagators<V> p;
    p.quarter.share = 0.25;
    p.half.share = 0.5;
    p.whole.share = 1.0;
    p.quarter.z = motor_scaled<V>(jacobian, 0.25 * h);
    p.half.z = motor_scaled<V>(jacobian, 0.5 * h);
    p.whole.z = motor_scaled<V>(jacobian, h);
    const MotorMatrix<V> &z = p.quarter.z;
    const V trace = z.ii + z.ww, det = z.ii * z.ww - z.iw * z.wi;
    p.quarter.phi = phi_functions_4<V>(trace, det);
    p.half.phi = phi_doubled<V>(p.quarter.phi, trace, det);
    p.whole.phi = phi_doubled<V>(p.half.phi, 2.0 * trace, 4.0 * det);
    return p;
}

// State after the part p of a step that begins in state y and has the length h. Current, speed,
// angle and the integral of the current are computed; the other states are copied from y. n:
// coefficients of the polynomial that approximates the remainder over the whole step
template <class V, int N>
VGROOVE_INLINE State<V, N> motor_moved(const Propagator<V> &p, V h, const State<V, N> &y,
                                       const Remainder<V> &n) {
    const double s = p.share;
    const PhiFunctions<V> &f = p.phi.low;
    const MotorPair<V> x{y.x[STATE_CURRENT], y.x[STATE_SPEED]};
    const MotorPair<V> c1{s * n.c1.i, s * n.c1.w}, c2{2.0 * s * s * n.c2.i, 2.0 * s * s * n.c2.w};
    const V length = s * h;
    const MotorPair<V> grown = motor_function<V>(f.e, p.z, x),
                       a = motor_function<V>(f.p1, p.z, n.c0), b = motor_function<V>(f.p2, p.z, c1),
                       c = motor_function<V>(f.p3, p.z, c2);
    const MotorPair<V> sum = motor_function<V>(f.p1, p.z, x),
                       sum_a = motor_function<V>(f.p2, p.z, n.c0),
                       sum_b = motor_function<V>(f.p3, p.z, c1),
                       sum_c = motor_function<V>(p.phi.p4, p.z, c2);
    State<V, N> end = y;
    end.x[STATE_CURRENT] = grown.i + length * (a.i + b.i + c.i);
    end.x[STATE_SPEED] = grown.w + length * (a.w + b.w + c.w);
    end.x[STATE_ANGLE] += length * (sum.w + length * (sum_a.w + sum_b.w + sum_c.w));
    end.x[STATE_CURRENT_TIME] += length * (sum.i + length * (sum_a.i + sum_b.i + sum_c.i));
    return end;
}

// x' - A x, from the derivative of the state s
template <class V, int N>
VGROOVE_INLINE MotorPair<V> remainder_of(const MotorMatrix<V> &jacobian, const State<V, N> &s,
                                         const State<V, N> &slope) {
    const MotorPair<V> ax = motor_product<V>(jacobian, {s.x[STATE_CURRENT], s.x[STATE_SPEED]});
    return {slope.x[STATE_CURRENT] - ax.i, slope.x[STATE_SPEED] - ax.w};
}

// Coefficients of the quadratic polynomial that equals the remainder at the start, in the middle
// and at the end of a step
template <class V>
VGROOVE_INLINE Remainder<V> remainder_through(const MotorPair<V> &start, const MotorPair<V> &middle,
                                              const MotorPair<V> &end) {
    return {start,
            {4.0 * middle.i - 3.0 * start.i - end.i, 4.0 * middle.w - 3.0 * start.w - end.w},
            {2.0 * (start.i + end.i) - 4.0 * middle.i, 2.0 * (start.w + end.w) - 4.0 * middle.w}};
}

// Whether the shaft may stop and go on between the four points of a step at both ends of which it
// slides the same way: its speed there is smaller than its slope could change it in between, and
// the slope changes its sign.
template <class V, int N>
VGROOVE_INLINE V motor_dips(V slide, V h, const State<V, N> (&at)[4],
                            const State<V, N> (&slope)[4]) {
    V least = slide * at[0].x[STATE_SPEED], steep{}, falls{}, rises{};
    for (int n = 0; n < 4; ++n) {
        const V w = slide * at[n].x[STATE_SPEED], rise = slide * slope[n].x[STATE_SPEED];
        least = min_of<V>(least, w);
        steep = max_of<V>(steep, abs_of<V>(rise));
        falls = max_of<V>(falls, -rise);
        rises = max_of<V>(rises, rise);
    }
    const V close = least < 0.25 * h * steep ? splat<V>(1.0) : V{};
    const V turns = min_of<V>(falls, rises) > 0.0 ? close : V{};
    const V inside = least < 0.0 ? splat<V>(1.0) : turns;
    return slide * at[3].x[STATE_SPEED] < 0.0 ? V{} : inside;
}

// Whether friction may fail to hold a shaft at rest somewhere within a step although it holds it at
// the end: the largest current in between may break it away. Checked are the currents at the points
// of the step, and the one that the current would settle to under the command at the start.
// slope_a: derivative of the current at the start, A/s
template <class V, int N>
VGROOVE_INLINE V motor_breaks_away(const Driven<V> &d, const MotorMatrix<V> &jacobian, V h,
                                   const State<V, N> (&at)[4], const V &slope_a) {
    const V slide = d.mode.slide;
    bool any = false;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        any = any || get(slide, lane) == 0.0;
    if (!any)
        return V{};
    State<V, N> settled = at[0];
    settled.x[STATE_CURRENT] -= jacobian.ii < 0.0 ? slope_a / jacobian.ii : V{};
    const auto held = [&](V tau, const State<V, N> &s) __attribute__((always_inline)) {
        return drivetrain_guards<V, N>(d.model, d.drive, d.mode, tau, s).shaft;
    };
    const V least =
        min_of<V>(held(V{}, settled), min_of<V>(held(0.25 * h, at[1]), held(0.5 * h, at[2])));
    const V breaks = least < 0.0 ? splat<V>(1.0) : V{};
    return (slide == 0.0) & (held(h, at[3]) >= 0.0) ? breaks : V{};
}

// By how much the bus changes with the current, V/A, at the start of a step
template <class V, int N>
VGROOVE_INLINE V bus_current_slope(const Driven<V> &d, const State<V, N> &s) {
    if (d.model.input != InputKind::DUTY || d.model.bus_measured)
        return V{};
    return -d.model.supply.resistance_ohm *
           drivetrain_electrical<V, N>(d.model, d.drive, d.mode, V{}, s).duty;
}

// Integral of the bus over a step: the part that is linear in the current follows its integral, the
// rest, which is slow, Simpson's rule.
template <class V, int N>
VGROOVE_INLINE V bus_time(V per_ampere, V h, const State<V, N> (&at)[4],
                          const State<V, N> (&slope)[4]) {
    const auto rest = [&](int n) __attribute__((always_inline)) {
        return slope[n].x[STATE_BUS_TIME] - per_ampere * at[n].x[STATE_CURRENT];
    };
    return per_ampere * (at[3].x[STATE_CURRENT_TIME] - at[0].x[STATE_CURRENT_TIME]) +
           h * (1.0 / 6.0) * (rest(0) + 4.0 * rest(2) + rest(3));
}

// How much a further correction would change a value, if the changes shrink by a constant factor.
// found: the first guess and the results of the two corrections
template <class V, int N>
VGROOVE_INLINE V error_of_passes(const State<V, N> (&found)[3], int index) {
    const V first = abs_of<V>(found[1].x[index] - found[0].x[index]),
            second = abs_of<V>(found[2].x[index] - found[1].x[index]);
    return second < first ? second * second / first : second;
}

template <class V, int N> struct ExponentialStep {
    State<V, N> state, slope;  // at the end
    State<V, N> error;         // of current and speed; infinite where a shorter step must be taken
};

// r: rates at the start of the step, y: state there, slope: its derivative
template <class V, int N>
VGROOVE_INLINE ExponentialStep<V, N> exponential_step(const Driven<V> &d, const Rates<V> &r, V h,
                                                      const State<V, N> &y,
                                                      const State<V, N> &slope) {
    const MotorCoupling<V> c = stiff_coupling<V, N>(d, y);
    const MotorMatrix<V> a{-r.current, -c.back_emf, c.torque, -r.speed};
    const Propagators<V> p = propagators<V>(a, h);
    const auto derivative = [&](const Propagator<V> &at, const State<V, N> &s)
        __attribute__((always_inline)) {
        return drivetrain_stage<V, N>(d, at.share * h, s);
    };
    const MotorPair<V> n0 = remainder_of<V, N>(a, y, slope);
    Remainder<V> n{n0, {}, {}};
    // states at the start, after a quarter, after a half and at the end of the step
    State<V, N> at[4] = {y, y, y, motor_moved<V, N>(p.whole, h, y, n)};
    State<V, N> found[3] = {at[3], at[3], at[3]};
    State<V, N> slopes[4] = {slope, slope, slope, derivative(p.whole, at[3])};
    for (int pass = 0; pass < 2; ++pass) {
        at[2] = motor_moved<V, N>(p.half, h, y, n);
        slopes[2] = derivative(p.half, at[2]);
        n = remainder_through<V>(n0, remainder_of<V, N>(a, at[2], slopes[2]),
                                 remainder_of<V, N>(a, at[3], slopes[3]));
        at[3] = motor_moved<V, N>(p.whole, h, y, n);
        found[pass + 1] = at[3];
        slopes[3] = derivative(p.whole, at[3]);
    }
    at[1] = motor_moved<V, N>(p.quarter, h, y, n);
    slopes[1] = derivative(p.quarter, at[1]);
    const MotorPair<V> quarter = remainder_of<V, N>(a, at[1], slopes[1]);
    const MotorPair<V> defect{quarter.i - n.c0.i - 0.25 * n.c1.i - 0.0625 * n.c2.i,
                              quarter.w - n.c0.w - 0.25 * n.c1.w - 0.0625 * n.c2.w};
    const MotorPair<V> miss = motor_function<V>(p.whole.phi.low.p1, p.whole.z, defect);
    ExponentialStep<V, N> e{};
    e.state = at[3];
    e.slope = slopes[3];
    e.state.x[STATE_BUS_TIME] += bus_time<V, N>(bus_current_slope<V, N>(d, y), h, at, slopes);
    const V dips = max_of<V>(motor_dips<V, N>(d.mode.slide, h, at, slopes),
                             motor_breaks_away<V, N>(d, a, h, at, slope.x[STATE_CURRENT]));
    const V endless = splat<V>(std::numeric_limits<double>::infinity());
    e.error.x[STATE_CURRENT] =
        EXPONENTIAL_SAFETY * (error_of_passes<V, N>(found, STATE_CURRENT) + abs_of<V>(h * miss.i));
    const V error_w =
        EXPONENTIAL_SAFETY * (error_of_passes<V, N>(found, STATE_SPEED) + abs_of<V>(h * miss.w));
    e.error.x[STATE_SPEED] = dips > 0.0 ? endless : error_w;
    return e;
}

}  // namespace vgroove

#endif
