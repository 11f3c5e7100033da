// Events of the impact tool: for each a function that is positive before it and negative after it,
// and the events that are possible in a mode.
#ifndef VGROOVE_PLANT_IMPACT_EVENTS_HPP
#define VGROOVE_PLANT_IMPACT_EVENTS_HPP

#include "impact/derivative.hpp"

namespace vgroove {

enum ImpactEvent {
    IMPACT_FORWARD,   // hammer lug reaches the lug ahead
    IMPACT_BACKWARD,  // ... the lug behind
    IMPACT_HEIGHT,    // hammer rises above the lugs, or comes down between or on them
    IMPACT_STOP,      // hammer reaches the end stop
    IMPACT_LEAVE,     // contact ends
    IMPACT_TURN,      // contact turns from approaching to separating or back
    IMPACT_RAMP,      // the contact's damping reaches its full value, or leaves it
    IMPACT_LAP,       // the hammer, on top of a lug, reaches the end of the overlap
    IMPACT_SLIP_FORWARD,
    IMPACT_SLIP_BACKWARD,
    IMPACT_STICK,
    IMPACT_SEGMENT_UP,
    IMPACT_SEGMENT_DOWN,
    IMPACT_MOTOR,  // motor shaft comes to rest or breaks away
    IMPACT_DIODE,  // current of an open bridge ends or begins
    IMPACT_ROLL,   // balls come to rest or roll
    IMPACT_AXIAL,  // force through the balls changes sign
    IMPACT_EVENT_COUNT,
};
constexpr const char *IMPACT_EVENT_NAMES[IMPACT_EVENT_COUNT] = {"lug meets the lug ahead",
                                                                "lug meets the lug behind",
                                                                "hammer passes the lug height",
                                                                "hammer reaches the end stop",
                                                                "contact ends",
                                                                "contact turns",
                                                                "contact damping fully on",
                                                                "lug's end passes",
                                                                "joint slips",
                                                                "joint slips backwards",
                                                                "joint sticks",
                                                                "joint's next stretch",
                                                                "joint's last stretch",
                                                                "motor rests or breaks away",
                                                                "diodes end or begin",
                                                                "balls stick or roll",
                                                                "axial force changes sign"};

constexpr unsigned impact_bit(ImpactEvent e) {
    return 1u << e;
}

// Events that can happen in a mode, as bits
VGROOVE_INLINE unsigned impact_events_possible(const Impact &m, const ImpactMode &mode,
                                               const Drive<double> &in) {
    unsigned mask = impact_bit(IMPACT_MOTOR);
    if (mode.place != ContactPlace::NONE)
        mask |= impact_bit(IMPACT_LEAVE) | impact_bit(IMPACT_TURN) |
                (mode.approaching ? impact_bit(IMPACT_RAMP) : 0u);
    if (!mode.above) {
        mask |= impact_bit(IMPACT_HEIGHT);
        if (mode.place == ContactPlace::NONE)
            mask |= impact_bit(IMPACT_FORWARD) | impact_bit(IMPACT_BACKWARD);
    } else if (mode.place == ContactPlace::NONE) {
        mask |= impact_bit(IMPACT_HEIGHT) | impact_bit(IMPACT_STOP);
    } else if (mode.place == ContactPlace::TOP) {
        mask |= impact_bit(IMPACT_LAP);
    }
    if (!mode.frozen)
        mask |= mode.slip == 0 ? impact_bit(IMPACT_SLIP_FORWARD) | impact_bit(IMPACT_SLIP_BACKWARD)
                               : impact_bit(IMPACT_STICK);
    if (mode.slip != 0 && m.joint.count > 1)
        mask |= impact_bit(IMPACT_SEGMENT_UP) | impact_bit(IMPACT_SEGMENT_DOWN);
    if (in.open > 0.0 && m.drive.input != InputKind::CURRENT)
        mask |= impact_bit(IMPACT_DIODE);
    if (m.ball_friction)
        mask |= impact_bit(IMPACT_ROLL) | impact_bit(IMPACT_AXIAL);
    return mask;
}

// Angle by which the hammer lug is past the flank of an anvil lug, from 0 to the lug period: it is
// over the lug while this is below the overlap.
VGROOVE_INLINE double impact_lap(const Impact &m, double relative) {
    return relative - m.period_rad * std::floor(relative / m.period_rad);
}

// Torque by which what friction holds exceeds the torque on a body at rest
VGROOVE_INLINE double hold_margin(double needed, double forward, double backward) {
    return needed > 0.0 ? forward - needed : backward + needed;
}

// Whether the event function needs forces; the others follow from angles and speeds.
VGROOVE_INLINE bool impact_by_force(const ImpactMode &mode, int event) {
    return event == IMPACT_AXIAL || (event == IMPACT_ROLL && mode.roll == 0.0) ||
           (event == IMPACT_MOTOR && mode.drive.slide == 0.0) ||
           (event == IMPACT_DIODE && mode.drive.diode == 0.0);
}

// The event function: positive before the event
template <class L>
VGROOVE_INLINE double impact_event_value(const Impact &m, const ImpactMode &mode,
                                         const ImpactState<L> &s, const ImpactPoint &at,
                                         int event) {
    switch (event) {
    case IMPACT_FORWARD:
        return mode.forward_rad - impact_relative<L>(m, s);
    case IMPACT_BACKWARD:
        return impact_relative<L>(m, s) - mode.backward_rad;
    case IMPACT_HEIGHT:
        return mode.above ? at.x - m.lug_height_m : m.lug_height_m - at.x;
    case IMPACT_STOP:
        return m.travel_m - at.x;
    case IMPACT_LEAVE:
        return at.pen;
    case IMPACT_TURN:
        return mode.approaching ? at.pen_rate : -at.pen_rate;
    case IMPACT_RAMP:
        return mode.ramped ? at.pen - m.contact.ramp_m : m.contact.ramp_m - at.pen;
    case IMPACT_LAP: {
        const double relative =
            impact_relative<L>(m, s) - mode.forward_rad;  // past the first flank of the lug
        return relative < 0.5 * m.overlap_rad ? relative : m.overlap_rad - relative;
    }
    case IMPACT_SLIP_FORWARD:
        return at.forward_nm - at.trial_nm;
    case IMPACT_SLIP_BACKWARD:
        return at.backward_nm + at.trial_nm;
    case IMPACT_STICK:
        return mode.slip > 0 ? at.trial_nm - at.forward_nm : -at.trial_nm - at.backward_nm;
    case IMPACT_SEGMENT_UP:
        return m.joint.segment[mode.segment].to_rad - at.head_rad;
    case IMPACT_SEGMENT_DOWN:
        return at.head_rad - m.joint.segment[mode.segment].from_rad;
    case IMPACT_MOTOR:
        return mode.drive.slide == 0.0
                   ? hold_margin(at.held_nm, at.hold_forward_nm, at.hold_backward_nm)
                   : mode.drive.slide * s.x[STATE_SPEED];
    case IMPACT_DIODE:
        return mode.drive.diode == 0.0 ? at.bus_v - std::fabs(at.emf_v)
                                       : mode.drive.diode * s.x[STATE_CURRENT];
    case IMPACT_ROLL:
        return mode.roll == 0.0
                   ? m.groove.ball_arm * std::fabs(at.axial_n) - std::fabs(at.roll_needed_nm)
                   : mode.roll * at.q_rate;
    case IMPACT_AXIAL:
        return mode.axial_sign * at.axial_n;
    default:
        return 1.0;
    }
}

// Bit of an event whose function is negative
template <class L, ImpactEvent EVENT>
VGROOVE_INLINE unsigned impact_event_met(const Impact &m, const ImpactMode &mode,
                                         const ImpactState<L> &s, const ImpactPoint &at) {
    return (impact_event_value<L>(m, mode, s, at, EVENT) < 0.0 ? 1u : 0u) << EVENT;
}

// Those of the possible events whose function is negative, as bits. The frequent events are
// evaluated in groups, without a branch for each.
template <class L>
VGROOVE_INLINE unsigned impact_events_met(const Impact &m, const ImpactMode &mode,
                                          unsigned possible, const ImpactState<L> &s,
                                          const ImpactPoint &at) {
    constexpr unsigned CONTACT =
        impact_bit(IMPACT_LEAVE) | impact_bit(IMPACT_TURN) | impact_bit(IMPACT_RAMP);
    constexpr unsigned GAP = impact_bit(IMPACT_FORWARD) | impact_bit(IMPACT_BACKWARD);
    constexpr unsigned SLIP = impact_bit(IMPACT_SLIP_FORWARD) | impact_bit(IMPACT_SLIP_BACKWARD);
    unsigned met = impact_event_met<L, IMPACT_MOTOR>(m, mode, s, at) |
                   impact_event_met<L, IMPACT_HEIGHT>(m, mode, s, at);
    if (possible & CONTACT)
        met |= impact_event_met<L, IMPACT_LEAVE>(m, mode, s, at) |
               impact_event_met<L, IMPACT_TURN>(m, mode, s, at) |
               impact_event_met<L, IMPACT_RAMP>(m, mode, s, at);
    if (possible & GAP)
        met |= impact_event_met<L, IMPACT_FORWARD>(m, mode, s, at) |
               impact_event_met<L, IMPACT_BACKWARD>(m, mode, s, at);
    if (possible & SLIP)
        met |= impact_event_met<L, IMPACT_SLIP_FORWARD>(m, mode, s, at) |
               impact_event_met<L, IMPACT_SLIP_BACKWARD>(m, mode, s, at);
    constexpr unsigned GROUPS =
        impact_bit(IMPACT_MOTOR) | impact_bit(IMPACT_HEIGHT) | CONTACT | GAP | SLIP;
    met &= possible;
    for (unsigned left = possible & ~GROUPS; left != 0u; left &= left - 1u) {
        const int event = __builtin_ctz(left);
        if (impact_event_value<L>(m, mode, s, at, event) < 0.0)
            met |= 1u << event;
    }
    return met;
}

// Enters the gap between two lugs in which, or next to which, a relative angle lies.
VGROOVE_INLINE void impact_enter_gap(const Impact &m, ImpactMode &mode, double relative) {
    const double lap = impact_lap(m, relative);
    double lug = std::floor(relative / m.period_rad) + 1.0;
    if (lap < 0.5 * m.overlap_rad)  // just past a flank: it has left the lug backwards
        lug -= 1.0;
    mode.above = false;
    mode.place = ContactPlace::NONE;
    mode.lug = static_cast<long>(lug);
    mode.forward_rad = m.period_rad * lug;
    mode.backward_rad = m.overlap_rad + m.period_rad * (lug - 1.0);
}

VGROOVE_INLINE void impact_enter_contact(ImpactMode &mode, ContactPlace place) {
    mode.place = place;
    mode.approaching = true;
    mode.ramped = false;
}

// The hammer comes down to the height of the lugs: into a gap, or onto a lug.
VGROOVE_INLINE void impact_come_down(const Impact &m, ImpactMode &mode, double relative) {
    const double lap = impact_lap(m, relative);
    if (lap <= 0.0 || lap >= m.overlap_rad) {
        impact_enter_gap(m, mode, relative);
        return;
    }
    impact_enter_contact(mode, ContactPlace::TOP);
    mode.forward_rad = relative - lap;
}

}  // namespace vgroove

#endif
