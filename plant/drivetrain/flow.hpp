// Exact motion over a stretch while the drivetrain is linear: (current, speed) and their integrals
// as an affine map of the state at its start.
//
// x' = A x + u0 + u1 t with x = (i, w) gives x(h) = e^Z x + h phi1(Z) u0 + h^2 phi2(Z) u1 and its
// integral h phi1 x + h^2 phi2 u0 + h^3 phi3 u1, Z = h A. Every function of a 2 x 2 matrix is a I +
// b Z (Cayley and Hamilton), whatever its eigenvalues; phi3 is a Taylor sum of a halved Z, the
// doubling phi_k(2 z) = 2^-k (e^z phi_k(z) + sum phi_j(z) / (k - j)!) of Skaflestad and Wright
// (Appl. Numer. Math. 59, 2009) leads back.
#ifndef VGROOVE_PLANT_DRIVETRAIN_FLOW_HPP
#define VGROOVE_PLANT_DRIVETRAIN_FLOW_HPP

#include <cmath>
#include <limits>

#include "drivetrain/model.hpp"

namespace vgroove {

// a I + b Z
template <class V> struct MatrixFunction { V a, b; };

template <class V> struct PhiFunctions { MatrixFunction<V> e, p1, p2, p3; };

constexpr double FLOW_TAYLOR_RADIUS = 1.0;  // of the halved Z; 13 terms of phi3 leave 6 / 16! of 1
// Rates above this per stretch are taken as this: what is over within a millionth of a stretch is
// over at once.
constexpr double FLOW_RATE_MAX = 1e6;

template <class V>
VGROOVE_INLINE MatrixFunction<V> flow_product(const MatrixFunction<V> &p,
                                              const MatrixFunction<V> &q, V trace, V det) {
    const V bb = p.b * q.b;
    return {p.a * q.a - bb * det, p.a * q.b + p.b * q.a + bb * trace};
}

// Largest size of an eigenvalue: |T| / 2 + sqrt(T^2 / 4 + |D|) at most |T| + sqrt|D|.
VGROOVE_INLINE int flow_doublings(double trace, double det) {
    const double radius = std::fabs(trace) + std::sqrt(std::fabs(det));
    return radius > FLOW_TAYLOR_RADIUS && radius < 1e300 ? std::ilogb(radius) + 1 : 0;
}

template <class V> VGROOVE_INLINE PhiFunctions<V> flow_taylor(V trace, V det) {
    V a = splat<V>(1.0 / 1307674368000.0), b{};
    double factorial = 1307674368000.0;  // 15!
    for (int n = 15; n > 3; --n) {
        factorial /= n;
        const V next = 1.0 / factorial - b * det;
        b = a + b * trace;
        a = next;
    }
    PhiFunctions<V> f;
    f.p3 = {a, b};
    f.p2 = {0.5 - f.p3.b * det, f.p3.a + f.p3.b * trace};
    f.p1 = {1.0 - f.p2.b * det, f.p2.a + f.p2.b * trace};
    f.e = {1.0 - f.p1.b * det, f.p1.a + f.p1.b * trace};
    return f;
}

// e^Z, phi1, phi2, phi3 as functions of Z from its trace and determinant; doublings: enough for
// every lane.
template <class V> VGROOVE_INLINE PhiFunctions<V> flow_functions(V trace, V det, int doublings) {
    const double scale = std::ldexp(1.0, -doublings);
    V t = trace * scale, d = det * (scale * scale);
    PhiFunctions<V> f = flow_taylor<V>(t, d);
    for (int n = 0; n < doublings; ++n) {
        const MatrixFunction<V> q1 = flow_product<V>(f.e, f.p1, t, d),
                                q2 = flow_product<V>(f.e, f.p2, t, d);
        const MatrixFunction<V> q3 = flow_product<V>(f.e, f.p3, t, d),
                                q0 = flow_product<V>(f.e, f.e, t, d);
        f.p3 = {0.125 * (q3.a + 0.5 * f.p1.a + f.p2.a + f.p3.a),
                0.0625 * (q3.b + 0.5 * f.p1.b + f.p2.b + f.p3.b)};
        f.p2 = {0.25 * (q2.a + f.p1.a + f.p2.a), 0.125 * (q2.b + f.p1.b + f.p2.b)};
        f.p1 = {0.5 * (q1.a + f.p1.a), 0.25 * (q1.b + f.p1.b)};
        f.e = {q0.a, 0.5 * q0.b};
        t = 2.0 * t;
        d = 4.0 * d;
    }
    return f;
}

// Constants of one linear run, and the modes that hold over the stretch.
struct FlowConstants {
    double inductance_inverse, inertia_inverse;
    double resistance_ohm;  // winding and bridge
    double supply_ohm;      // acts times duty squared; 0 with a measured bus or a stated voltage
    double supply_v;        // open circuit
    double constant;        // N m/A and V s/rad
    double viscous, friction_nm;  // while it slides the way it does: T = viscous w + friction_nm +
                                  // slide (1 + load_relative) TL
    double load_relative;
    double slide;     // 0: at rest
    double conducts;  // 0: the bridge blocks, or the current is the input
    double swing,
        swing_s;  // underdamped: rad/s that a current of 1 A can swing the shaft by, where a
                  // stretch is longer than half a radian of the swing
    bool volts;   // the command is a voltage
    bool current_input;
};

// Command, load at the motor shaft and their slopes along the stretch.
template <class V> struct FlowInput { V h, command, command_rate, load_nm, load_rate, bus_v; };

// x(h) = e x + g; integral of x = f x + m; integral of duty times current = b x + b0; doubt about
// the current d x + d0.
template <class V> struct Flow {
    V e11, e12, e21, e22, g1, g2;
    V f11, f12, f21, f22, m1, m2;
    V b1, b2, b0;
    V d1, d2, d0;  // what the extrapolation of a ramp has added to the current last: larger than
                   // its error
};

// One stretch with the resistance of one duty.
template <class V>
VGROOVE_INLINE Flow<V> flow_constant(const FlowConstants &c, V h, V resistance, V v, V v_rate,
                                     V torque, V torque_rate, int &doublings) {
    const double moves = c.slide * c.slide;
    V inductance = splat<V>(c.conducts * c.inductance_inverse);
    const V damping = resistance * h;
    inductance = damping * inductance > FLOW_RATE_MAX ? FLOW_RATE_MAX / damping : inductance;
    V inertia = splat<V>(moves * c.inertia_inverse);
    const V swing = c.constant * c.constant * inductance * h * h;
    inertia = swing * inertia > FLOW_RATE_MAX * FLOW_RATE_MAX
                  ? FLOW_RATE_MAX * FLOW_RATE_MAX / swing
                  : inertia;
    const V rubbing = abs_of<V>(c.viscous * h);
    inertia = rubbing * inertia > FLOW_RATE_MAX ? FLOW_RATE_MAX / rubbing : inertia;
    const double couples = moves * c.conducts * c.constant;
    const V z11 = -resistance * inductance * h, z12 = -couples * inductance * h,
            z21 = couples * inertia * h, z22 = -c.viscous * inertia * h;
    const V trace = z11 + z22, det = z11 * z22 - z12 * z21;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const int needs = flow_doublings(get(trace, lane), get(det, lane));
        doublings = needs > doublings ? needs : doublings;
    }
    const PhiFunctions<V> p = flow_functions<V>(trace, det, doublings);
    const V h2 = h * h, h3 = h2 * h;
    const V u1 = v * inductance, u2 = torque * inertia, r1 = v_rate * inductance,
            r2 = torque_rate * inertia;
    const V s1 = z11 * u1 + z12 * u2, s2 = z21 * u1 + z22 * u2, q1 = z11 * r1 + z12 * r2,
            q2 = z21 * r1 + z22 * r2;
    Flow<V> f{};
    f.e11 = p.e.a + p.e.b * z11;
    f.e12 = p.e.b * z12;
    f.e21 = p.e.b * z21;
    f.e22 = p.e.a + p.e.b * z22;
    f.g1 = h * (p.p1.a * u1 + p.p1.b * s1) + h2 * (p.p2.a * r1 + p.p2.b * q1);
    f.g2 = h * (p.p1.a * u2 + p.p1.b * s2) + h2 * (p.p2.a * r2 + p.p2.b * q2);
    f.f11 = h * (p.p1.a + p.p1.b * z11);
    f.f12 = h * (p.p1.b * z12);
    f.f21 = h * (p.p1.b * z21);
    f.f22 = h * (p.p1.a + p.p1.b * z22);
    f.m1 = h2 * (p.p2.a * u1 + p.p2.b * s1) + h3 * (p.p3.a * r1 + p.p3.b * q1);
    f.m2 = h2 * (p.p2.a * u2 + p.p2.b * s2) + h3 * (p.p3.a * r2 + p.p3.b * q2);
    return f;
}

// First a, then b.
template <class V> VGROOVE_INLINE Flow<V> flow_joined(const Flow<V> &a, const Flow<V> &b, V duty) {
    Flow<V> f;
    f.e11 = b.e11 * a.e11 + b.e12 * a.e21;
    f.e12 = b.e11 * a.e12 + b.e12 * a.e22;
    f.e21 = b.e21 * a.e11 + b.e22 * a.e21;
    f.e22 = b.e21 * a.e12 + b.e22 * a.e22;
    f.g1 = b.e11 * a.g1 + b.e12 * a.g2 + b.g1;
    f.g2 = b.e21 * a.g1 + b.e22 * a.g2 + b.g2;
    const V i1 = b.f11 * a.e11 + b.f12 * a.e21, i2 = b.f11 * a.e12 + b.f12 * a.e22,
            i0 = b.f11 * a.g1 + b.f12 * a.g2 + b.m1;
    f.f11 = a.f11 + i1;
    f.f12 = a.f12 + i2;
    f.m1 = a.m1 + i0;
    f.f21 = a.f21 + b.f21 * a.e11 + b.f22 * a.e21;
    f.f22 = a.f22 + b.f21 * a.e12 + b.f22 * a.e22;
    f.m2 = a.m2 + b.f21 * a.g1 + b.f22 * a.g2 + b.m2;
    f.b1 = a.b1 + duty * i1;
    f.b2 = a.b2 + duty * i2;
    f.b0 = a.b0 + duty * i0;
    f.d1 = f.d2 = f.d0 = V{};
    return f;
}

// a x + b y, coefficient by coefficient
template <class V>
VGROOVE_INLINE Flow<V> flow_blend(double a, const Flow<V> &x, double b, const Flow<V> &y) {
    Flow<V> f;
    const V *from = &x.e11, *other = &y.e11;
    V *to = &f.e11;
    for (unsigned n = 0; n < sizeof f / sizeof(V); ++n)
        to[n] = a * from[n] + b * other[n];
    return f;
}

// Torque that friction and load put on the sliding shaft; |TL| keeps its sign along a stretch.
template <class V> struct FlowTorque { V torque_nm, rate; };
template <class V>
VGROOVE_INLINE FlowTorque<V> flow_torque(const FlowConstants &c, const FlowInput<V> &in) {
    const V mean = in.load_nm + 0.5 * in.h * in.load_rate;
    const V share =
        c.slide * (1.0 + (mean < 0.0 ? splat<V>(-c.load_relative) : splat<V>(c.load_relative)));
    FlowTorque<V> t{-c.friction_nm - share * in.load_nm, -share * in.load_rate};
    if (c.current_input) {
        t.torque_nm += c.constant * in.command;
        t.rate += c.constant * in.command_rate;
    }
    return t;
}

// A ramp of the duty behind a supply resistance in equal parts, each with the resistance of its
// middle.
template <class V>
VGROOVE_INLINE Flow<V> flow_parts(const FlowConstants &c, const FlowInput<V> &in, V source,
                                  const FlowTorque<V> &t, int parts) {
    const V h = in.h * (1.0 / parts);
    Flow<V> whole{};
    whole.e11 = whole.e22 = splat<V>(1.0);
    int doublings = 0;
    for (int n = 0; n < parts; ++n) {
        const V begin = h * n;
        const V duty = in.command + in.command_rate * (begin + 0.5 * h);
        const V v = (in.command + in.command_rate * begin) * source,
                torque = t.torque_nm + t.rate * begin;
        const V resistance = c.resistance_ohm + c.supply_ohm * duty * duty;
        whole = flow_joined<V>(whole,
                               flow_constant<V>(c, h, resistance, v, in.command_rate * source,
                                                torque, t.rate, doublings),
                               duty);
    }
    return whole;
}

// The whole stretch. Ramps behind a supply resistance: parts with constant resistance have an error
// in even powers of their length, which is extrapolated.
template <class V>
VGROOVE_INLINE Flow<V> flow_of(const FlowConstants &c, const FlowInput<V> &in, bool ramps) {
    const V source = c.volts ? splat<V>(1.0) : in.bus_v;
    const FlowTorque<V> t = flow_torque<V>(c, in);
    if (ramps && c.supply_ohm > 0.0 && c.conducts > 0.0) {
        const Flow<V> coarse = flow_parts<V>(c, in, source, t, 1),
                      middle = flow_parts<V>(c, in, source, t, 2);
        const Flow<V> fine = flow_parts<V>(c, in, source, t, 4);
        const Flow<V> fourth = flow_blend<V>(-1.0 / 3.0, middle, 4.0 / 3.0, fine);
        Flow<V> sixth = flow_blend<V>(1.0 / 45.0, coarse, 1.0,
                                      flow_blend<V>(-20.0 / 45.0, middle, 64.0 / 45.0, fine));
        sixth.d1 = sixth.e11 - fourth.e11;
        sixth.d2 = sixth.e12 - fourth.e12;
        sixth.d0 = sixth.g1 - fourth.g1;
        return sixth;
    }
    const V resistance = c.resistance_ohm + c.supply_ohm * in.command * in.command;
    int doublings = 0;
    Flow<V> f = flow_constant<V>(c, in.h, resistance, in.command * source, in.command_rate * source,
                                 t.torque_nm, t.rate, doublings);
    f.b1 = in.command * f.f11;
    f.b2 = in.command * f.f12;
    f.b0 = in.command * f.m1;
    f.d1 = f.d2 = f.d0 = V{};
    return f;
}

// Effects under which the drivetrain is linear between changes of direction; sensors that only show
// it otherwise are not in its way.
constexpr std::uint32_t FLOW_EFFECTS =
    EFFECT_DIRECTIONAL | EFFECT_LOAD_FRICTION | EFFECT_HALL | EFFECT_COMMAND_SHIFT;

VGROOVE_INLINE bool flow_applies(std::uint32_t effects, LoadKind load) {
    return !(effects & ~FLOW_EFFECTS) && (load == LoadKind::NONE || load == LoadKind::TORQUE);
}

// Underdamped motors swing: the speed between two instants of one sign may have the other one.
VGROOVE_INLINE void flow_set_swing(FlowConstants &c) {
    const double a = c.conducts * c.resistance_ohm * c.inductance_inverse,
                 b = c.viscous * c.inertia_inverse;
    const double square =
        c.conducts * c.constant * c.constant * c.inductance_inverse * c.inertia_inverse -
        0.25 * (a - b) * (a - b);
    c.swing_s = square > 0.0 ? 0.5 / std::sqrt(square) : std::numeric_limits<double>::infinity();
    c.swing = square > 0.0 ? std::sqrt(c.inertia_inverse / c.inductance_inverse) : 0.0;
}

// slide: -1, 0, 1; open: all gates are off, and the diodes carry current when diode is not 0
VGROOVE_INLINE FlowConstants flow_constants(const Drivetrain<double> &m, double slide, bool open,
                                            double diode) {
    const Friction<double> &f = m.friction;
    const bool duty = m.input == InputKind::DUTY;
    FlowConstants c{};
    c.inductance_inverse = m.motor.inductance_inverse;
    c.inertia_inverse = m.gear.inertia_inverse;
    c.resistance_ohm = m.motor.resistance_ohm + (duty ? m.bridge.resistance_ohm : 0.0);
    c.supply_ohm = duty && !m.bus_measured ? m.supply.resistance_ohm : 0.0;
    c.supply_v = m.supply.open_circuit_v;
    c.constant = m.motor.constant;
    c.viscous = f.viscous + (m.effects & EFFECT_DIRECTIONAL ? slide * f.directional : 0.0);
    c.friction_nm = slide * f.coulomb_nm + (slide > 0.0 ? f.forward_nm : -f.backward_nm);
    c.load_relative = m.effects & EFFECT_LOAD_FRICTION ? f.load_relative : 0.0;
    c.slide = slide;
    c.conducts = m.input == InputKind::CURRENT || (open && diode == 0.0) ? 0.0 : 1.0;
    c.volts = m.input == InputKind::VOLTAGE && !open;
    c.current_input = m.input == InputKind::CURRENT;
    flow_set_swing(c);
    return c;
}

// Whether the shaft may stop and go on within the stretch unseen: it slows down at first and speeds
// up at last, and could come to 0 in between.
VGROOVE_INLINE bool flow_dips(const FlowConstants &c, const FlowInput<double> &in, double i0,
                              double w0, double i1, double w1) {
    const FlowTorque<double> t = flow_torque<double>(c, in);
    const double k = c.conducts * c.constant;
    const double rise0 = c.slide * (k * i0 + t.torque_nm - c.viscous * w0) * c.inertia_inverse;
    const double rise1 =
        c.slide * (k * i1 + t.torque_nm + in.h * t.rate - c.viscous * w1) * c.inertia_inverse;
    const double least = c.slide * w0 < c.slide * w1 ? c.slide * w0 : c.slide * w1;
    const bool turns =
        rise0 < 0.0 && rise1 > 0.0 && least < 0.5 * in.h * (-rise0 > rise1 ? -rise0 : rise1);
    const bool swings =
        in.h > c.swing_s && least < c.swing * (std::fabs(i0) + std::fabs(i1)) + std::fabs(w1 - w0);
    return least >= 0.0 && c.slide != 0.0 && (turns || swings);
}

// The state after h seconds of one mode; doubt: of the current there, A, or infinite where a
// shorter step must be taken.
template <int N>
VGROOVE_INLINE State<double, N> flow_state(const Drivetrain<double> &m, const Drive<double> &in,
                                           const Mode<double> &mode, double h,
                                           const State<double, N> &s, double &doubt) {
    const bool open = in.open > 0.0 && m.input != InputKind::CURRENT;
    const FlowConstants c = flow_constants(m, mode.slide, open, mode.diode);
    const double bus = m.bus_measured ? in.bus_v : c.supply_v;
    const FlowInput<double> line{h,
                                 open ? -mode.diode : in.command,
                                 open ? 0.0 : in.command_rate,
                                 in.load_nm * m.load.ratio_inverse,
                                 in.load_rate * m.load.ratio_inverse,
                                 bus};
    const Flow<double> f = flow_of<double>(c, line, line.command_rate != 0.0);
    const double i = s.x[STATE_CURRENT], w = s.x[STATE_SPEED];
    State<double, N> end = s;
    end.x[STATE_CURRENT] = f.e11 * i + f.e12 * w + f.g1;
    end.x[STATE_SPEED] = f.e21 * i + f.e22 * w + f.g2;
    end.x[STATE_ANGLE] += f.f21 * i + f.f22 * w + f.m2;
    end.x[STATE_CURRENT_TIME] += c.current_input ? (in.command + 0.5 * h * in.command_rate) * h
                                                 : f.f11 * i + f.f12 * w + f.m1;
    end.x[STATE_BUS_TIME] += bus * h - c.supply_ohm * (f.b1 * i + f.b2 * w + f.b0);
    const bool dips = flow_dips(c, line, i, w, end.x[STATE_CURRENT], end.x[STATE_SPEED]);
    doubt = dips ? std::numeric_limits<double>::infinity() : std::fabs(f.d1 * i + f.d2 * w + f.d0);
    return end;
}

}  // namespace vgroove

#endif
