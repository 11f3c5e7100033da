// Exact motion over a stretch while the drivetrain is linear: (current, speed) and their integrals
// as an affine map of the state at its start.
//
// x' = A x + u0 + u1 t with x = (i, w) gives x(h) = e^Z x + h phi1(Z) u0 + h^2 phi2(Z) u1 and its
// integral h phi1 x + h^2 phi2 u0 + h^3 phi3 u1, Z = h A, phi of numeric/phi_functions.hpp.
#ifndef VGROOVE_PLANT_DRIVETRAIN_FLOW_HPP
#define VGROOVE_PLANT_DRIVETRAIN_FLOW_HPP

#include <cmath>
#include <limits>

#include "drivetrain/model.hpp"
#include "numeric/phi_functions.hpp"

namespace vgroove {

// Rates above this per stretch are limited to it: a motion that ends within a millionth of a
// stretch counts as over at once.
constexpr double FLOW_RATE_MAX = 1e6;

// Constants of the linear drivetrain, and the modes that hold over the stretch.
struct FlowConstants {
    double inductance_inverse, inertia_inverse;
    double resistance_ohm;  // winding and bridge
    double supply_ohm;      // multiplied by duty squared; 0 with a measured bus or a stated voltage
    double supply_v;        // open circuit
    double constant;        // N m/A and V s/rad
    // Friction and load torque in the direction of sliding: viscous w + friction_nm +
    // slide (1 + load_relative) TL
    double viscous, friction_nm;
    double load_relative;
    double slide;     // 0: at rest
    double conducts;  // 0: the bridge blocks, or the current is the input
    // Underdamped: a current of 1 A can change the speed by `swing` rad/s and back within a stretch
    // that is longer than swing_s, half a radian of the oscillation.
    double swing, swing_s;
    bool volts;  // the command is a voltage
    bool current_input;
};

// Command, load at the motor shaft and their slopes along the stretch.
template <class V> struct FlowInput { V h, command, command_rate, load_nm, load_rate, bus_v; };

// x(h) = e x + g; integral of x = f x + m; integral of duty times current = b x + b0; error of the
// current at most d x + d0.
template <class V> struct Flow {
    V e11, e12, e21, e22, g1, g2;
    V f11, f12, f21, f22, m1, m2;
    V b1, b2, b0;
    V d1, d2, d0;  // last correction by the extrapolation of a ramp
};

// One stretch with a constant resistance.
template <class V>
VGROOVE_INLINE Flow<V> flow_constant(const FlowConstants &c, V h, V resistance, V v, V v_rate,
                                     V torque, V torque_rate, int &halvings) {
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
        const int needs = phi_halvings(get(trace, lane), get(det, lane));
        halvings = needs > halvings ? needs : halvings;
    }
    const PhiFunctions<V> p = phi_functions<V>(trace, det, halvings);
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

// The map a followed by the map b
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

// Torque of friction and load TL on the sliding shaft; TL, referred to it, keeps its sign along a
// stretch.
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

// A ramp of the duty behind a supply resistance, in equal parts, each with the resistance at its
// middle.
template <class V>
VGROOVE_PART Flow<V> flow_parts(const FlowConstants &c, const FlowInput<V> &in, const V &source,
                                const FlowTorque<V> &t, int parts) {
    const V h = in.h * (1.0 / parts);
    Flow<V> whole{};
    whole.e11 = whole.e22 = splat<V>(1.0);
    int halvings = 0;
    for (int n = 0; n < parts; ++n) {
        const V begin = h * n;
        const V duty = in.command + in.command_rate * (begin + 0.5 * h);
        const V v = (in.command + in.command_rate * begin) * source,
                torque = t.torque_nm + t.rate * begin;
        const V resistance = c.resistance_ohm + c.supply_ohm * duty * duty;
        whole = flow_joined<V>(whole,
                               flow_constant<V>(c, h, resistance, v, in.command_rate * source,
                                                torque, t.rate, halvings),
                               duty);
    }
    return whole;
}

// The whole stretch. For a ramp behind a supply resistance the error of the parts is a series in
// even powers of their length: Richardson extrapolation from one, two and four parts.
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
    int halvings = 0;
    Flow<V> f = flow_constant<V>(c, in.h, resistance, in.command * source, in.command_rate * source,
                                 t.torque_nm, t.rate, halvings);
    f.b1 = in.command * f.f11;
    f.b2 = in.command * f.f12;
    f.b0 = in.command * f.m1;
    f.d1 = f.d2 = f.d0 = V{};
    return f;
}

// Effects with which the drivetrain is linear between changes of direction.
constexpr std::uint32_t FLOW_EFFECTS = EFFECT_DIRECTIONAL_VISCOUS | EFFECT_LOAD_DEPENDENT_FRICTION |
                                       EFFECT_HALL_ECCENTRICITY | EFFECT_COMMAND_SHIFT;

VGROOVE_INLINE bool flow_applies(std::uint32_t effects, LoadKind load) {
    return !(effects & ~FLOW_EFFECTS) && (load == LoadKind::NONE || load == LoadKind::TORQUE);
}

// An underdamped motor oscillates: the speed between two instants may have another sign than at
// both.
VGROOVE_INLINE void flow_set_swing(FlowConstants &c) {
    const double a = c.conducts * c.resistance_ohm * c.inductance_inverse,
                 b = c.viscous * c.inertia_inverse;
    const double square =
        c.conducts * c.constant * c.constant * c.inductance_inverse * c.inertia_inverse -
        0.25 * (a - b) * (a - b);
    c.swing_s = square > 0.0 ? 0.5 / std::sqrt(square) : std::numeric_limits<double>::infinity();
    c.swing = square > 0.0 ? std::sqrt(c.inertia_inverse / c.inductance_inverse) : 0.0;
}

// slide: -1, 0, 1; open: all switches are open, and the diodes conduct where diode is not 0
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
    c.viscous = f.viscous + (m.effects & EFFECT_DIRECTIONAL_VISCOUS ? slide * f.directional : 0.0);
    c.friction_nm = slide * f.coulomb_nm + (slide > 0.0 ? f.forward_nm : -f.backward_nm);
    c.load_relative = m.effects & EFFECT_LOAD_DEPENDENT_FRICTION ? f.load_relative : 0.0;
    c.slide = slide;
    c.conducts = m.input == InputKind::CURRENT || (open && diode == 0.0) ? 0.0 : 1.0;
    c.volts = m.input == InputKind::VOLTAGE && !open;
    c.current_input = m.input == InputKind::CURRENT;
    flow_set_swing(c);
    return c;
}

// Whether the shaft may stop and go on within the stretch although both ends have the same sign: it
// decelerates at first and accelerates at last, and could reach 0 in between.
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

// The state after h seconds in one mode. error_a: of its current, A; infinite where a shorter step
// must be taken.
template <int N>
VGROOVE_INLINE State<double, N> flow_state(const Driven<double> &d, double h,
                                           const State<double, N> &s, double &error_a) {
    const Drivetrain<double> &m = d.model;
    const Drive<double> &in = d.drive;
    const Mode<double> &mode = d.mode;
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
    error_a =
        dips ? std::numeric_limits<double>::infinity() : std::fabs(f.d1 * i + f.d2 * w + f.d0);
    return end;
}

}  // namespace vgroove

#endif
