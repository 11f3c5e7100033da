// What changes at an event of the impact tool: contact, lugs, joint, shafts, diodes, balls.
#ifndef VGROOVE_PLANT_IMPACT_MODE_CHANGES_HPP
#define VGROOVE_PLANT_IMPACT_MODE_CHANGES_HPP

#include <stdexcept>

#include "impact/attempt.hpp"

namespace vgroove {

// A contact begins: the next step is short; with a lug it begins a blow, and the anvil moves again.
template <class L>
VGROOVE_INLINE void impact_contact_begins(ImpactSolver<L> &self, ContactPlace place) {
    impact_enter_contact(self.mode, place);
    self.allowed_s = min_of(self.allowed_s, IMPACT_FIRST_CONTACT_S);
    if (place != ContactPlace::FORWARD && place != ContactPlace::BACKWARD)
        return;
    self.mode.frozen = self.mode.ringing = false;
    const double closing = self.state.x[L::HAMMER_SPEED] - self.state.x[L::ANVIL_SPEED];
    if (!L::EXACT)  // just beyond the end of the damping's ramp
        self.allowed_s = min_of(self.allowed_s,
                                1.1 * self.model.contact.ramp_m /
                                    (self.model.lug_radius_m * max_of(std::fabs(closing), 1e-9)));
    const bool forward = place == ContactPlace::FORWARD;
    blows_begin(self.recorder, self.drive.time_s, self.mode.lug - (forward ? 0 : 1),
                forward ? closing : -closing, max_of(self.model.lug_height_m - self.point.x, 0.0),
                self.state.x[L::LUG_IMPULSE]);
}

// The penetration turns from growing to shrinking or back.
template <class L> VGROOVE_INLINE void impact_contact_turns(ImpactSolver<L> &self) {
    self.mode.approaching = !self.mode.approaching;
    self.mode.ramped = self.point.pen > self.model.contact.ramp_m;
}

// The hammer leaves the top of a lug into a gap.
template <class L> VGROOVE_INLINE void impact_overlap_ends(ImpactSolver<L> &self) {
    self.dropped_j += contact_energy(self.model.contact, self.point.pen);
    impact_enter_gap(self.model, self.mode, impact_relative<L>(self.model, self.state));
}

// The damping reaches its full value, or leaves it.
template <class L> VGROOVE_INLINE void impact_ramp_ends(ImpactSolver<L> &self) {
    self.mode.ramped = !self.mode.ramped;
    self.allowed_s = max_of(self.allowed_s, IMPACT_FIRST_CONTACT_S);
}

template <class L> VGROOVE_INLINE void impact_contact_ends(ImpactSolver<L> &self) {
    if (self.mode.place == ContactPlace::FORWARD || self.mode.place == ContactPlace::BACKWARD)
        blows_end(self.recorder, self.state.x[L::LUG_IMPULSE]);
    self.mode.place = ContactPlace::NONE;
}

// The hammer rises above the lugs, or comes down into a gap or onto a lug.
template <class L> VGROOVE_INLINE void impact_cross_height(ImpactSolver<L> &self) {
    if (!self.mode.above) {
        self.dropped_j += self.mode.place != ContactPlace::NONE
                              ? contact_energy(self.model.contact, self.point.pen)
                              : 0.0;
        impact_contact_ends(self);
        self.mode.above = true;
        return;
    }
    impact_come_down(self.model, self.mode, impact_relative<L>(self.model, self.state));
    if (self.mode.place == ContactPlace::TOP)
        impact_contact_begins(self, ContactPlace::TOP);
}

// The motor shaft comes to rest or breaks away: decides whether it sticks, or which way it slides.
template <class L> VGROOVE_INLINE void impact_motor_rests(ImpactSolver<L> &self) {
    self.mode.drive.slide = 0.0;
    self.state.x[STATE_SPEED] = 0.0;
    self.point = impact_slope(self, 0.0, self.state, self.slope);
    const ImpactPoint &at = self.point;
    self.mode.drive.slide =
        sign_of(excess_over<double>(at.held_nm, at.hold_forward_nm, at.hold_backward_nm));
}

// The balls come to rest or begin to roll: decides whether they stick, or which way they roll.
template <class L> VGROOVE_INLINE void impact_balls_rest(ImpactSolver<L> &self) {
    self.mode.roll = 0.0;
    self.state.x[L::HAMMER_SPEED] = impact_spindle_speed<L>(self.model, self.state);
    self.point = impact_slope(self, 0.0, self.state, self.slope);
    const double hold = self.model.groove.ball_arm * std::fabs(self.point.axial_n);
    self.mode.roll = sign_of(excess_over<double>(self.point.roll_needed_nm, hold, hold));
}

// The diodes have carried the current to 0 and block, or begin to conduct.
template <class L> VGROOVE_INLINE void impact_diode_switches(ImpactSolver<L> &self) {
    if (self.mode.drive.diode != 0.0) {
        self.mode.drive.diode = 0.0;
        self.state.x[STATE_CURRENT] = 0.0;
    } else {
        self.mode.drive.diode = -sign_of(self.state.x[STATE_SPEED]);
    }
}

template <class L> VGROOVE_CLONES_APART void impact_apply_event(ImpactSolver<L> &self, int event) {
    ImpactMode &mode = self.mode;
    switch (event) {
    case IMPACT_FORWARD:
        impact_contact_begins(self, ContactPlace::FORWARD);
        break;
    case IMPACT_BACKWARD:
        impact_contact_begins(self, ContactPlace::BACKWARD);
        break;
    case IMPACT_STOP:
        impact_contact_begins(self, ContactPlace::STOP);
        break;
    case IMPACT_HEIGHT:
        impact_cross_height(self);
        break;
    case IMPACT_LEAVE:
        impact_contact_ends(self);
        break;
    case IMPACT_TURN:
        impact_contact_turns(self);
        break;
    case IMPACT_RAMP:
        impact_ramp_ends(self);
        break;
    case IMPACT_LAP:
        impact_overlap_ends(self);
        break;
    case IMPACT_SLIP_FORWARD:
    case IMPACT_SLIP_BACKWARD:
        mode.slip = event == IMPACT_SLIP_FORWARD ? 1 : -1;
        break;
    case IMPACT_STICK:
        mode.slip = 0;
        break;
    case IMPACT_SEGMENT_UP:
        ++mode.segment;
        break;
    case IMPACT_SEGMENT_DOWN:
        --mode.segment;
        break;
    case IMPACT_MOTOR:
        impact_motor_rests(self);
        break;
    case IMPACT_DIODE:
        impact_diode_switches(self);
        break;
    case IMPACT_ROLL:
        impact_balls_rest(self);
        break;
    case IMPACT_AXIAL:
        mode.axial_sign = -mode.axial_sign;
        break;
    default:
        break;
    }
    self.stats.events += 1.0;
    self.slope_stale = true;
}

// Applies the events that have already happened at the start of a step, until none is left.
template <class L> void impact_refresh(ImpactSolver<L> &self) {
    for (int n = 0; n < IMPACT_EVENTS_AT_ONCE_MAX; ++n) {
        self.point = impact_slope(self, 0.0, self.state, self.slope);
        const unsigned met = impact_events_met<L>(
            self.model, self.mode, impact_events_possible(self.model, self.mode, self.drive),
            self.state, self.point);
        self.slope_stale = false;
        if (met == 0u)
            return;
        impact_apply_event(self, __builtin_ctz(met));
    }
    throw std::runtime_error("impact mechanism: its modes switch without end");
}

}  // namespace vgroove

#endif
