// The drivetrain as one model: its components joined, the derivative of its state and the functions
// whose change of sign is an event (docs/spec/model.md, sections 1, 2 and 8).
#ifndef VGROOVE_PLANT_DRIVETRAIN_MODEL_HPP
#define VGROOVE_PLANT_DRIVETRAIN_MODEL_HPP

#include "components/bridge.hpp"
#include "components/friction.hpp"
#include "components/gear.hpp"
#include "components/loads.hpp"
#include "components/motor.hpp"
#include "components/sensors.hpp"
#include "components/supply.hpp"

namespace vgroove {

enum class InputKind { DUTY, VOLTAGE, CURRENT };

template <class V> struct Drivetrain {
    std::uint32_t effects;
    InputKind input;
    bool bus_measured;
    Supply<V> supply;
    Bridge<V> bridge;
    Motor<V> motor;
    Friction<V> friction;
    Gear<V> gear;
    Load<V> load;
    Sensors<V> sensors;
    V current_scale, speed_scale, torque_scale;  // A, rad/s, N m: errors are relative to them
};

// A drivetrain with the drive and the modes that hold along a stretch
template <class V> struct Driven {
    const Drivetrain<V> &model;
    const Drive<V> &drive;
    const Mode<V> &mode;
};

// Sets the constants of one lane; effects, input, load kind of m are set before. command_peak: the
// largest command of the run, mean_interval_s: of its rows; both give the scales of errors.
template <class V>
void drivetrain_set_lane(Drivetrain<V> &m, int lane, const Parameters &p, double command_peak,
                         double mean_interval_s);

// Electrical quantities at one instant: current, torque constant, resistance, duty, bus, ...
template <class V> struct Electrical {
    V i, k, r, duty, bus_v, bus_a, terminal_v, brush_v, source_v, ripple_a;
};

// EFFECTS: those that may be on
template <class V, int N, std::uint32_t EFFECTS = ~std::uint32_t{0}>
VGROOVE_INLINE Electrical<V> drivetrain_electrical(const Drivetrain<V> &m, const Drive<V> &in,
                                                   const Mode<V> &mode, V tau,
                                                   const State<V, N> &s) {
    Electrical<V> e{};
    const std::uint32_t effects = m.effects & EFFECTS;
    const V command = in.command + in.command_rate * tau;
    e.source_v = supply_source<V, N>(m.supply, effects, s);
    e.bus_v = m.bus_measured ? in.bus_v : e.source_v;
    if (m.input == InputKind::CURRENT) {
        e.i = command;
        e.k = motor_constant<V>(m.motor, effects, e.i);
        return e;
    }
    e.i = s.x[STATE_CURRENT];
    e.k = motor_constant<V>(m.motor, effects, e.i);
    e.r = motor_resistance<V, N>(m.motor, effects, s);
    e.duty = in.open > 0.0 ? -mode.diode : command;
    e.ripple_a = splat<V>(RIPPLE_FLOOR_A);
    if (m.input == InputKind::VOLTAGE) {
        e.terminal_v = in.open > 0.0 ? e.duty * e.bus_v : command;
    } else {
        e.bus_a = e.duty * e.i;
        if (!m.bus_measured)
            e.bus_v = supply_bus<V>(m.supply, e.source_v, e.bus_a);
        e.ripple_a = bridge_ripple<V>(m.bridge, e.duty, e.bus_v);
        e.terminal_v = bridge_voltage<V>(m.bridge, effects, in, e.duty, e.bus_v, e.ripple_a, e.i);
    }
    e.brush_v = motor_brush_voltage<V>(m.motor, effects, e.i, e.ripple_a);
    return e;
}

// Torques, referred to the motor shaft, that do not depend on the direction of sliding
template <class V> struct Torques {
    V drive_nm;         // on the motor; on the whole shaft where it is one body
    V output_drive_nm;  // on the output side
    V opposing_nm;      // TL / N of the load column
    V free_nm;          // TL / N of a free load
    V load_nm;          // TL / N, all of it
    V coupler_nm;
    V output_angle;  // at the motor shaft
};

template <class V, int N>
VGROOVE_INLINE Torques<V> drivetrain_torques(const Drivetrain<V> &m, const Drive<V> &in, V tau,
                                             V motor_nm, const State<V, N> &s) {
    Torques<V> t{};
    const V angle = s.x[STATE_ANGLE];
    const bool split = N > STATE_TWIST && (m.effects & EFFECT_TWO_BODIES);
    t.output_angle = angle;
    V output_w = s.x[STATE_SPEED];
    if constexpr (N > STATE_TWIST) {
        if (split) {
            t.output_angle = angle - s.x[STATE_TWIST];
            output_w = s.x[STATE_OUTPUT_SPEED];
        }
    }
    const V pendulum = load_of_angle<V>(m.load, t.output_angle);
    t.opposing_nm = load_opposing<V>(m.load, in, tau);
    t.free_nm = load_of_speed<V>(m.load, output_w);
    t.load_nm = t.opposing_nm + pendulum + t.free_nm;
    t.drive_nm = motor_nm - friction_of_angle<V>(m.friction, m.effects, angle);
    if constexpr (N > STATE_TWIST) {
        if (split) {
            t.coupler_nm = gear_coupler_torque<V>(m.gear, m.effects, s.x[STATE_TWIST],
                                                  s.x[STATE_SPEED] - s.x[STATE_OUTPUT_SPEED]);
            t.drive_nm -= t.coupler_nm;
            t.output_drive_nm = t.coupler_nm - pendulum - t.free_nm;
            return t;
        }
    }
    t.drive_nm -= pendulum + t.free_nm;
    return t;
}

// J w' = drive - friction - TL / N while it slides, w' = 0 while it sticks
template <class V, int N>
VGROOVE_INLINE void drivetrain_mechanical(const Drivetrain<V> &m, const Drive<V> &in,
                                          const Mode<V> &mode, V tau, const Torques<V> &t,
                                          const State<V, N> &s, State<V, N> &ds) {
    const V w = s.x[STATE_SPEED];
    const V friction =
        friction_sliding<V>(m.friction, m.effects, mode.slide, w, t.load_nm, in.time_s + tau);
    const bool split = N > STATE_TWIST && (m.effects & EFFECT_TWO_BODIES);
    const V opposing = split ? V{} : mode.slide * t.opposing_nm;
    ds.x[STATE_SPEED] =
        mode.slide * mode.slide * (t.drive_nm - friction - opposing) * m.gear.inertia_inverse;
    ds.x[STATE_ANGLE] = w;
    if constexpr (N > STATE_TWIST) {
        if (split) {
            const V moves = mode.output_slide * mode.output_slide;
            const V net = t.output_drive_nm - mode.output_slide * t.opposing_nm;
            ds.x[STATE_OUTPUT_SPEED] = moves * net * m.gear.output_inertia_inverse;
            ds.x[STATE_TWIST] = w - s.x[STATE_OUTPUT_SPEED];
        }
    }
}

// Powers for the energy audit, from each component; their integrals balance the change of
// drivetrain_stored.
template <class V, int N>
VGROOVE_INLINE void drivetrain_audit(const Drivetrain<V> &m, const Drive<V> &in,
                                     const Mode<V> &mode, V tau, const Electrical<V> &e,
                                     const Torques<V> &t, const State<V, N> &s, State<V, N> &ds) {
    const V w = s.x[STATE_SPEED];
    const bool split = (m.effects & EFFECT_TWO_BODIES) != 0u;
    const V output_w = split ? s.x[STATE_OUTPUT_SPEED] : w;
    const V output_slide = split ? mode.output_slide : mode.slide;
    const V source_v = m.bus_measured ? e.bus_v : e.source_v;
    if (m.input == InputKind::CURRENT)
        ds.x[STATE_WORK_IN] = e.k * e.i * w;
    else
        ds.x[STATE_WORK_IN] = m.input == InputKind::DUTY ? source_v * e.bus_a : e.terminal_v * e.i;
    if (m.input == InputKind::DUTY)
        ds.x[STATE_LOSS_BUS] = (m.bus_measured ? V{} : supply_loss<V>(m.supply, e.bus_a)) +
                               bridge_loss<V>(m.bridge, m.effects, in, e.bus_v, e.ripple_a, e.i);
    ds.x[STATE_LOSS_WINDING] = e.r * e.i * e.i + e.brush_v * e.i;
    ds.x[STATE_LOSS_FRICTION] =
        friction_sliding<V>(m.friction, m.effects, mode.slide, w, t.load_nm, in.time_s + tau) * w;
    if (split)
        ds.x[STATE_LOSS_COUPLER] =
            (t.coupler_nm - gear_spring_torque<V>(m.gear, s.x[STATE_TWIST])) * (w - output_w);
    ds.x[STATE_WORK_LOAD] = (output_slide * t.opposing_nm + t.free_nm) * output_w;
}

// Stored energy: inductance, rotating masses, coupler, pendulum, cogging and eccentricity
template <class V, int N>
VGROOVE_INLINE V drivetrain_stored(const Drivetrain<V> &m, const State<V, N> &s) {
    const V i = s.x[STATE_CURRENT], w = s.x[STATE_SPEED], angle = s.x[STATE_ANGLE];
    V stored = 0.5 * w * w / m.gear.inertia_inverse +
               friction_angle_energy<V>(m.friction, m.effects, angle);
    if (m.input != InputKind::CURRENT)
        stored += 0.5 * i * i / m.motor.inductance_inverse;
    if (!(m.effects & EFFECT_TWO_BODIES))
        return stored + load_energy<V>(m.load, angle);
    const V output_w = s.x[STATE_OUTPUT_SPEED], twist = s.x[STATE_TWIST];
    stored += 0.5 * output_w * output_w / m.gear.output_inertia_inverse +
              gear_coupler_energy<V>(m.gear, twist);
    return stored + load_energy<V>(m.load, angle - twist);
}

// A derivative of the current, 0 while the open bridge blocks it
template <class V>
VGROOVE_INLINE V unless_blocked(const Drive<V> &in, const Mode<V> &mode, V derivative) {
    return (in.open > 0.0) & (mode.diode == 0.0) ? V{} : derivative;
}

// Derivative of the whole state, tau after the start of the stretch
template <class V, int N>
VGROOVE_INLINE State<V, N> drivetrain_derivative(const Drivetrain<V> &m, const Drive<V> &in,
                                                 const Mode<V> &mode, V tau, const State<V, N> &s) {
    // States that every drivetrain has are set once each: clearing all of them first takes time.
    State<V, N> ds;
    for (int n = STATE_CORE_COUNT; n < N; ++n)
        ds.x[n] = V{};
    const Electrical<V> e = drivetrain_electrical<V, N>(m, in, mode, tau, s);
    const V w = s.x[STATE_SPEED];
    ds.x[STATE_CURRENT] = V{};
    if (m.input != InputKind::CURRENT) {
        const V slope = motor_current_slope<V>(m.motor, e.terminal_v, e.r, e.i, e.k, w, e.brush_v);
        ds.x[STATE_CURRENT] = unless_blocked<V>(in, mode, slope);
    }
    const Torques<V> t = drivetrain_torques<V, N>(m, in, tau, e.k * e.i, s);
    drivetrain_mechanical<V, N>(m, in, mode, tau, t, s, ds);
    ds.x[STATE_CURRENT_TIME] = e.i;
    ds.x[STATE_BUS_TIME] = e.bus_v;
    if constexpr (N > STATE_CORE_COUNT) {
        if (m.effects & EFFECT_CURRENT_LAG)
            ds.x[STATE_CURRENT_TIME] = s.x[STATE_CURRENT_FILTER];
        supply_derivative<V, N>(m.supply, m.effects, e.bus_a, s, ds);
        motor_heat_derivative<V, N>(m.motor, m.effects, e.i, e.r, s, ds);
        sensors_derivative<V, N>(m.sensors, m.effects, e.i, s, ds);
    }
    if constexpr (N > STATE_WORK_IN)
        drivetrain_audit<V, N>(m, in, mode, tau, e, t, s, ds);
    return ds;
}

// Torque in excess of what friction holds: > 0 forwards, < 0 backwards, 0 where friction holds it
template <class V> VGROOVE_INLINE V excess_over(V drive, V forward, V backward) {
    return drive > forward ? drive - forward : (drive < -backward ? drive + backward : V{});
}

// Event functions: positive before the event, negative after it
template <class V> struct Events {
    V excess, output_excess;  // N m, signed
    V shaft, output, diode;
};

template <class V, int N>
VGROOVE_INLINE Events<V> drivetrain_events(const Drivetrain<V> &m, const Drive<V> &in,
                                           const Mode<V> &mode, V tau, const State<V, N> &s) {
    Events<V> g{};
    const Electrical<V> e = drivetrain_electrical<V, N>(m, in, mode, tau, s);
    const Torques<V> t = drivetrain_torques<V, N>(m, in, tau, e.k * e.i, s);
    const HoldLimits<V> hold = friction_hold<V>(m.friction, m.effects, t.load_nm);
    const V carried = max_of<V>(t.opposing_nm, V{});
    const bool split = N > STATE_TWIST && (m.effects & EFFECT_TWO_BODIES);
    const V shared = split ? V{} : carried;
    g.excess = excess_over<V>(t.drive_nm, hold.forward_nm + shared, hold.backward_nm + shared);
    g.shaft = mode.slide == 0.0 ? -abs_of<V>(g.excess) : mode.slide * s.x[STATE_SPEED];
    g.output = splat<V>(1.0);
    g.diode = splat<V>(1.0);
    if constexpr (N > STATE_TWIST) {
        if (split) {
            g.output_excess = excess_over<V>(t.output_drive_nm, carried, carried);
            g.output = mode.output_slide == 0.0 ? -abs_of<V>(g.output_excess)
                                                : mode.output_slide * s.x[STATE_OUTPUT_SPEED];
        }
    }
    if (m.input == InputKind::CURRENT)
        return g;
    const V blocked = e.bus_v - abs_of<V>(e.k * s.x[STATE_SPEED]);
    const V open = mode.diode == 0.0 ? blocked : mode.diode * s.x[STATE_CURRENT];
    g.diode = in.open > 0.0 ? open : splat<V>(1.0);
    return g;
}

// drivetrain_events and drivetrain_derivative as functions that stay apart from their callers
template <class V, int N>
VGROOVE_PART Events<V> drivetrain_guards(const Drivetrain<V> &m, const Drive<V> &in,
                                         const Mode<V> &mode, const V &tau, const State<V, N> &s) {
    return drivetrain_events<V, N>(m, in, mode, tau, s);
}
template <class V, int N>
VGROOVE_PART State<V, N> drivetrain_slope(const Drivetrain<V> &m, const Drive<V> &in,
                                          const Mode<V> &mode, const V &tau, const State<V, N> &s) {
    return drivetrain_derivative<V, N>(m, in, mode, tau, s);
}

// Explicit and exponential steps of one simulation with the core states take so little time that
// calls would make them slower: they contain the derivative.
template <class V, int N>
constexpr bool IN_ONE_PIECE = LaneTraits<V>::COUNT == 1 && N == STATE_CORE_COUNT;

// Derivative in a stage of an explicit or exponential step
template <class V, int N>
VGROOVE_INLINE State<V, N> drivetrain_stage(const Driven<V> &d, const V &tau,
                                            const State<V, N> &s) {
    if constexpr (IN_ONE_PIECE<V, N>)
        return drivetrain_derivative<V, N>(d.model, d.drive, d.mode, tau, s);
    else
        return drivetrain_slope<V, N>(d.model, d.drive, d.mode, tau, s);
}

}  // namespace vgroove

#endif
