// Steps of the impact mechanism's solver, compiled once for each layout of the state: attempts,
// switches, control of the step.
#include <stdexcept>
#include <string>

#include "impact/flight.hpp"
#include "impact/series.hpp"

namespace vgroove {

template <class L>
VGROOVE_INLINE double impact_error(const ImpactSolver<L> &self, double h, const ImpactState<L> &e) {
    const Impact &m = self.model;
    const double speed = m.speed_weight, output = m.output_weight, angle = m.angle_weight,
                 current = m.current_weight;
    double worst =
        max_of(std::fabs(e.x[STATE_CURRENT]) * current, std::fabs(e.x[STATE_SPEED]) * speed);
    worst = max_of(worst, max_of(std::fabs(e.x[L::HAMMER_SPEED]), std::fabs(e.x[L::ANVIL_SPEED])) *
                              output);
    worst = max_of(worst,
                   max_of(max_of(std::fabs(e.x[L::HAMMER_ANGLE]), std::fabs(e.x[L::ANVIL_ANGLE])),
                          std::fabs(e.x[L::TWIST])) *
                       angle);
    if constexpr (L::FULL) {
        worst = max_of(worst, max_of(std::fabs(e.x[L::OUTPUT_SPEED]) * output,
                                     std::fabs(e.x[L::COUPLER_TWIST]) * angle));
        worst = max_of(worst, max_of(std::fabs(e.x[STATE_OUTPUT_SPEED]) * speed,
                                     std::fabs(e.x[STATE_TWIST]) * angle * m.ratio_inverse));
        worst = max_of(worst, max_of(std::fabs(e.x[STATE_CURRENT_FILTER]) * current,
                                     std::fabs(e.x[STATE_SPEED_FILTER]) * speed));
    }
    return h * worst / self.tolerance;
}

// Once in the program, not once a stage: the code of a step must stay in the processor's nearest
// memory.
template <class L>
__attribute__((noinline)) ImpactPoint impact_slope(ImpactSolver<L> &self, double tau,
                                                   const ImpactState<L> &s, ImpactState<L> &ds) {
    self.stats.derivatives += 1.0;
    if constexpr (L::FULL)
        ds = ImpactState<L>{};
    return impact_derivative<L>(self.model, self.drive, self.mode, tau, s, ds);
}

// The same for the stages of a step, which need no more than the slope.
template <class L>
__attribute__((noinline)) void impact_stage(const ImpactSolver<L> &self, double tau,
                                            const ImpactState<L> &s, ImpactState<L> &ds) {
    if constexpr (L::FULL)
        ds = ImpactState<L>{};
    impact_derivative<L>(self.model, self.drive, self.mode, tau, s, ds);
}

template <class L>
__attribute__((noinline)) void impact_attempt_contact(ImpactSolver<L> &self, double h) {
    constexpr int N = L::COUNT;
    ImpactStep<L> &t = self.step;
    const ImpactState<L> &y = self.state, &k1 = self.slope;
    // In each sum the slope that comes last is added last: the sum waits for nothing else.
    ImpactState<L> s;
    for (int n = 0; n < N; ++n)
        s.x[n] = y.x[n] + (1.0 / 5.0 * h) * k1.x[n];
    impact_stage(self, 0.2 * h, s, t.k2);
    for (int n = 0; n < N; ++n)
        s.x[n] = (y.x[n] + (3.0 / 40.0 * h) * k1.x[n]) + (9.0 / 40.0 * h) * t.k2.x[n];
    impact_stage(self, 0.3 * h, s, t.k3);
    for (int n = 0; n < N; ++n)
        s.x[n] = (y.x[n] + h * (44.0 / 45.0 * k1.x[n] - 56.0 / 15.0 * t.k2.x[n])) +
                 (32.0 / 9.0 * h) * t.k3.x[n];
    impact_stage(self, 0.8 * h, s, t.k4);
    for (int n = 0; n < N; ++n)
        s.x[n] = (y.x[n] + h * ((19372.0 / 6561.0 * k1.x[n] - 25360.0 / 2187.0 * t.k2.x[n]) +
                                64448.0 / 6561.0 * t.k3.x[n])) -
                 (212.0 / 729.0 * h) * t.k4.x[n];
    impact_stage(self, 8.0 / 9.0 * h, s, t.k5);
    for (int n = 0; n < N; ++n)
        s.x[n] = (y.x[n] + h * ((9017.0 / 3168.0 * k1.x[n] - 355.0 / 33.0 * t.k2.x[n]) +
                                (46732.0 / 5247.0 * t.k3.x[n] + 49.0 / 176.0 * t.k4.x[n]))) -
                 (5103.0 / 18656.0 * h) * t.k5.x[n];
    impact_stage(self, h, s, t.k6);
    for (int n = 0; n < N; ++n)
        t.end.x[n] = (y.x[n] + h * ((35.0 / 384.0 * k1.x[n] + 500.0 / 1113.0 * t.k3.x[n]) +
                                    (125.0 / 192.0 * t.k4.x[n] - 2187.0 / 6784.0 * t.k5.x[n]))) +
                     (11.0 / 84.0 * h) * t.k6.x[n];
    if (!L::EXACT && self.mode.ringing)
        impact_ring(self, h, t.end);
    t.end_point = impact_slope(self, h, t.end, t.end_slope);
    for (int n = 0; n < N; ++n)
        s.x[n] = (71.0 / 57600.0 * k1.x[n] - 71.0 / 16695.0 * t.k3.x[n]) +
                 (71.0 / 1920.0 * t.k4.x[n] - 17253.0 / 339200.0 * t.k5.x[n]) +
                 (22.0 / 525.0 * t.k6.x[n] - 1.0 / 40.0 * t.end_slope.x[n]);
    t.error = impact_error(self, h, s);
    self.stats.derivatives += 5.0;
}

// x^(-1/5) within 1e-5, the same on every machine: a guess from the bits, then Newton.
static double fifth_root_inverse(double x) {
    double y = from_bits<double>(0x4CB8E91F5C28F5C2u - bits_of(x) / 5u);
    for (int n = 0; n < 2; ++n) {
        const double y2 = y * y;
        y *= 1.2 - 0.2 * x * (y2 * y2 * y);
    }
    return y;
}

// Every IMPACT_LOOK_STEPS tries: whether the run is still wanted, and whether it comes forward.
template <class L> __attribute__((noinline)) void impact_look(ImpactSolver<L> &self) {
    self.look_in = IMPACT_LOOK_STEPS;
    if (self.watch)
        self.watch->look();
    self.credit += IMPACT_STEPS_SECOND * (self.drive.time_s - self.looked_s) - IMPACT_LOOK_STEPS;
    self.looked_s = self.drive.time_s;
    if (self.credit < 0.0)
        throw std::runtime_error("impact mechanism: needs too many steps at " +
                                 std::to_string(self.drive.time_s) +
                                 " s: " + fastest_parameter(*self.parameters));
    self.credit = min_of(self.credit, IMPACT_STEPS_SAVED);
}

// One step of length h, by the method that suits it; returns by what its error would let it grow.
template <class L> VGROOVE_INLINE double impact_attempt(ImpactSolver<L> &self, double h) {
    if (--self.look_in <= 0)
        impact_look(self);
    ImpactStep<L> &t = self.step;
    t.h = h;
    t.share = 1.0;
    t.event = -1;
    t.shaped = false;
    t.flight = !t.by_series && flight_applies(self);
    if constexpr (!L::EXACT) {
        ImpactState<L> e;
        if (t.by_series) {
            series_attempt(self, h, e);
            t.error = impact_error(self, h, e);
            return SERIES_REDUCE;
        }
        if (t.flight) {
            flight_attempt(self, h, e);
            t.error = impact_error(self, h, e);
            return 0.9 / std::sqrt(std::sqrt(max_of(t.error, 1e-8)));
        }
    }
    impact_attempt_contact(self, h);
    return 0.9 * fifth_root_inverse(max_of(t.error, 1e-8));
}

// Hammer less anvil at a share of the step, and retraction: all that the switches of free flight
// ask for.
template <class L>
VGROOVE_INLINE double impact_relative_between(const ImpactSolver<L> &self, double share) {
    double anvil = self.state.x[L::ANVIL_ANGLE];
    if (self.mode.ringing)
        anvil += impact_ringing(self.model, self.state.x[L::TWIST], self.state.x[L::ANVIL_SPEED],
                                share * self.step.h)
                     .twist -
                 self.state.x[L::TWIST];
    else if (!self.mode.frozen)
        anvil = impact_component(self.step, self.state, share, L::ANVIL_ANGLE);
    return impact_component(self.step, self.state, share, L::HAMMER_ANGLE) + self.model.start_rad -
           anvil;
}

template <class L>
VGROOVE_INLINE double impact_retraction_between(const ImpactSolver<L> &self, double share) {
    const double spindle =
        impact_component(self.step, self.state, share, STATE_ANGLE) * self.model.ratio_inverse;
    return v_groove_at(self.model.groove,
                       spindle - impact_component(self.step, self.state, share, L::HAMMER_ANGLE))
        .x;
}

template <class L>
VGROOVE_INLINE double impact_value_between(ImpactSolver<L> &self, double h, double share,
                                           int event) {
    if constexpr (!L::EXACT && !L::FULL) {
        if (event == IMPACT_FORWARD)
            return self.mode.forward_rad - impact_relative_between(self, share);
        if (event == IMPACT_BACKWARD)
            return impact_relative_between(self, share) - self.mode.backward_rad;
        if (event == IMPACT_HEIGHT)
            return (self.mode.above ? 1.0 : -1.0) *
                   (impact_retraction_between(self, share) - self.model.lug_height_m);
    }
    const ImpactState<L> s = impact_between(self, share);
    ImpactState<L> ds;
    const bool forces = impact_by_force(self.mode, event);
    const ImpactPoint at = forces
                               ? impact_slope(self, share * h, s, ds)
                               : impact_sight<L>(self.model, self.drive, self.mode, share * h, s);
    return impact_event_value<L>(self.model, self.mode, s, at, event);
}

// A switch that has been met by a share of the step, with its function there.
struct ImpactMet {
    double share, value;
};

// Share of the step just past the instant of a switch: Illinois on the interpolant, between low
// (not yet) and high (already).
template <class L>
VGROOVE_INLINE double impact_locate(ImpactSolver<L> &self, double h, int event,
                                    const ImpactMet &met, double width_s) {
    double low = 0.0, high = met.share, g_high = met.value;
    double g_low = impact_event_value<L>(self.model, self.mode, self.state, self.point, event);
    int side = 0;
    for (int n = 0; n < 40 && (high - low) * h > width_s; ++n) {
        const double middle = low + (high - low) * (g_low / (g_low - g_high));
        const double nudge = 0.4 * width_s / h;
        double share = n % 4 == 3 ? 0.5 * (low + high) : middle + (side >= 0 ? nudge : -nudge);
        share = share <= low || share >= high ? 0.5 * (low + high) : share;
        const double g = impact_value_between(self, h, share, event);
        if (g < 0.0) {
            high = share;
            g_high = g;
            g_low = side < 0 ? 0.5 * g_low : g_low;
            side = -1;
        } else {
            low = share;
            g_low = g;
            g_high = side > 0 ? 0.5 * g_high : g_high;
            side = 1;
        }
    }
    return high;
}

template <class L>
VGROOVE_INLINE void impact_contact_begins(ImpactSolver<L> &self, ContactPlace place) {
    impact_enter_contact(self.mode, place);
    self.level_s = min_of(self.level_s, IMPACT_FIRST_CONTACT_S);
    if (place != ContactPlace::FORWARD && place != ContactPlace::BACKWARD)
        return;
    self.mode.frozen = self.mode.ringing = false;
    const double closing = self.state.x[L::HAMMER_SPEED] - self.state.x[L::ANVIL_SPEED];
    if (!L::EXACT)  // just beyond the ramp of the damping
        self.level_s =
            min_of(self.level_s, 1.1 * self.model.contact.ramp_m /
                                     (self.model.lug_radius_m * max_of(std::fabs(closing), 1e-9)));
    const bool forward = place == ContactPlace::FORWARD;
    blows_begin(self.recorder, self.drive.time_s, self.mode.lug - (forward ? 0 : 1),
                forward ? closing : -closing, max_of(self.model.lug_height_m - self.point.x, 0.0),
                self.state.x[L::LUG_IMPULSE]);
}

template <class L> VGROOVE_INLINE void impact_ramp_ends(ImpactSolver<L> &self) {
    self.mode.ramped = !self.mode.ramped;
    self.level_s = max_of(self.level_s, IMPACT_FIRST_CONTACT_S);
}

template <class L> VGROOVE_INLINE void impact_contact_ends(ImpactSolver<L> &self) {
    if (self.mode.place == ContactPlace::FORWARD || self.mode.place == ContactPlace::BACKWARD)
        blows_end(self.recorder, self.state.x[L::LUG_IMPULSE]);
    self.mode.place = ContactPlace::NONE;
}

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

// A shaft that has just come to rest, or breaks away: sticks, or slides the way it is driven.
template <class L> VGROOVE_INLINE void impact_motor_rests(ImpactSolver<L> &self) {
    self.mode.drive.slide = 0.0;
    self.state.x[STATE_SPEED] = 0.0;
    self.point = impact_slope(self, 0.0, self.state, self.slope);
    const ImpactPoint &at = self.point;
    self.mode.drive.slide =
        impact_sign(excess_over<double>(at.held_nm, at.hold_forward_nm, at.hold_backward_nm));
}

template <class L> VGROOVE_INLINE void impact_balls_rest(ImpactSolver<L> &self) {
    self.mode.roll = 0.0;
    self.state.x[L::HAMMER_SPEED] = impact_spindle_speed<L>(self.model, self.state);
    self.point = impact_slope(self, 0.0, self.state, self.slope);
    const double hold = self.model.groove.ball_arm * std::fabs(self.point.axial_n);
    self.mode.roll = impact_sign(excess_over<double>(self.point.roll_needed_nm, hold, hold));
}

template <class L> VGROOVE_INLINE void impact_diode_switches(ImpactSolver<L> &self) {
    if (self.mode.drive.diode != 0.0) {
        self.mode.drive.diode = 0.0;
        self.state.x[STATE_CURRENT] = 0.0;
    } else {
        self.mode.drive.diode = -impact_sign(self.state.x[STATE_SPEED]);
    }
}

template <class L> __attribute__((noinline)) void impact_switch(ImpactSolver<L> &self, int event) {
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
        mode.approaching = !mode.approaching;
        mode.ramped = self.point.pen > self.model.contact.ramp_m;
        break;
    case IMPACT_RAMP:
        impact_ramp_ends(self);
        break;
    case IMPACT_LAP:
        self.dropped_j += contact_energy(self.model.contact, self.point.pen);
        impact_enter_gap(self.model, mode, impact_relative<L>(self.model, self.state));
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
    self.fresh = true;
}

template <class L> void impact_refresh(ImpactSolver<L> &self) {
    for (int n = 0; n < IMPACT_SWITCHES_MAX; ++n) {
        self.point = impact_slope(self, 0.0, self.state, self.slope);
        const unsigned met =
            impact_met<L>(self.model, self.mode, impact_possible(self.model, self.mode, self.drive),
                          self.state, self.point);
        self.fresh = false;
        if (met == 0u)
            return;
        impact_switch(self, __builtin_ctz(met));
    }
    throw std::runtime_error("impact mechanism: its modes switch without end");
}

// Fixed steps: anvil and joint have come to rest, their motion is left out until the next contact.
template <class L> VGROOVE_INLINE void impact_freeze(ImpactSolver<L> &self) {
    const bool struck =
        self.mode.place == ContactPlace::FORWARD || self.mode.place == ContactPlace::BACKWARD;
    if (self.mode.frozen || struck || self.mode.slip != 0 || self.model.second_output)
        return;
    if (std::fabs(self.state.x[L::ANVIL_SPEED]) > FROZEN_SPEED_RAD_S ||
        std::fabs(self.state.x[L::TWIST]) > FROZEN_TWIST_RAD)
        return;
    self.mode.frozen = true;
    self.state.x[L::ANVIL_SPEED] = 0.0;
    self.fresh = true;
}

template <class L>
VGROOVE_INLINE void impact_accept(ImpactSolver<L> &self, double h, const ImpactState<L> &to) {
    self.state = to;
    self.drive.command += self.drive.command_rate * h;
    self.drive.load_nm += self.drive.load_rate * h;
    self.drive.time_s += h;
    self.stats.steps += 1.0;
}

template <class L> VGROOVE_INLINE double impact_torque_rate(const ImpactSolver<L> &self) {
    const Joint &j = self.model.joint;
    return self.mode.slip == 0
               ? j.stiffness * self.slope.x[L::TWIST] + j.damping * self.slope.x[L::ANVIL_SPEED]
               : 0.0;
}

// Rate of a switch's function, for those of free flight.
template <class L>
VGROOVE_INLINE double impact_event_rate(const ImpactSolver<L> &self, const ImpactState<L> &s,
                                        const ImpactPoint &at, int event) {
    const double relative = s.x[L::HAMMER_SPEED] - s.x[L::ANVIL_SPEED];
    switch (event) {
    case IMPACT_FORWARD:
        return -relative;
    case IMPACT_BACKWARD:
        return relative;
    case IMPACT_HEIGHT:
        return self.mode.above ? at.x_rate : -at.x_rate;
    case IMPACT_STOP:
        return -at.x_rate;
    default:
        return 0.0;
    }
}

constexpr unsigned IMPACT_FLIGHT = impact_bit(IMPACT_FORWARD) | impact_bit(IMPACT_BACKWARD) |
                                   impact_bit(IMPACT_HEIGHT) | impact_bit(IMPACT_STOP);

// Switches of free flight that are met and left again within the step: where their function turns.
template <class L>
VGROOVE_INLINE unsigned impact_grazed(const ImpactSolver<L> &self, unsigned candidates) {
    unsigned turned = 0u;
    for (unsigned left = candidates & IMPACT_FLIGHT; left != 0u; left &= left - 1u) {
        const int event = __builtin_ctz(left);
        if (impact_event_rate(self, self.state, self.point, event) < 0.0 &&
            impact_event_rate(self, self.step.end, self.step.end_point, event) > 0.0)
            turned |= 1u << event;
    }
    return turned;
}

// Share of the step just tried at which a switch happens that is met at its end, or within it where
// its function turns. Negative: it is not met.
template <class L>
VGROOVE_INLINE double impact_instant(ImpactSolver<L> &self, double h, int event, bool met,
                                     double width_s) {
    ImpactMet at{1.0, impact_event_value<L>(self.model, self.mode, self.step.end,
                                            self.step.end_point, event)};
    if constexpr (!L::EXACT) {
        SeriesSwitch sum;
        if (self.step.by_series && series_switch<L>(self, event, sum)) {
            const double from =
                impact_event_value<L>(self.model, self.mode, self.state, self.point, event);
            return series_instant<L>(self, sum, from, at.value, width_s) / h;
        }
    }
    if (!met) {
        const double from = impact_event_rate(self, self.state, self.point, event);
        at.share =
            from / (from - impact_event_rate(self, self.step.end, self.step.end_point, event));
        at.value = impact_value_between(self, h, at.share, event);
        if (at.value >= 0.0)
            return -1.0;
    }
    return impact_locate(self, h, event, at, width_s);
}

// The earliest of the switches met at the end of the step just tried, or within it where they
// turned; its share of the step.
template <class L>
__attribute__((noinline)) int impact_earliest(ImpactSolver<L> &self, double h, unsigned met,
                                              unsigned turned, double width_s, double &share) {
    impact_interpolate(self, h);
    int event = -1;
    share = 1.0;
    for (unsigned left = met | turned; left != 0u; left &= left - 1u) {
        const int candidate = __builtin_ctz(left);
        const double found =
            impact_instant(self, h, candidate, (met & (1u << candidate)) != 0u, width_s);
        if (found >= 0.0 && (event < 0 || found < share)) {
            event = candidate;
            share = found;
        }
    }
    return event;
}

// The step just tried is taken up to a share of it; with a switch, slope and point are those of its
// instant.
template <class L>
__attribute__((noinline)) void impact_take(ImpactSolver<L> &self, double share, int event) {
    const double h = self.step.h, torque = self.point.joint_nm, rate = impact_torque_rate(self);
    if (self.observer)
        self.observer->step(self, h, share);
    if (share != 1.0)
        impact_interpolate(self, h);
    impact_accept(self, h * share, share == 1.0 ? self.step.end : impact_between(self, share));
    if (self.history)
        self.history->push_back({self.drive.time_s, h * share, event});
    self.slope = self.step.end_slope;
    self.point = self.step.end_point;
    if (share != 1.0)
        self.point = impact_sight<L>(self.model, self.drive, self.mode, 0.0, self.state);
    if (self.recorder.any)
        blows_torque(self.recorder, h * share, torque, rate, self.point.joint_nm,
                     share == 1.0 ? impact_torque_rate(self) : 0.0);
    if (event >= 0)
        impact_switch(self, event);
}

// Step length that the error of the step just tried allows; a step cut short by the end of the
// stretch does not shorten it.
template <class L>
__attribute__((noinline)) void impact_adapt(ImpactSolver<L> &self, double h, double factor,
                                            bool switches) {
    const double allowed =
        min_of(h * min_of(factor, 5.0), self.step.flight ? IMPACT_FLIGHT_MAX_S : IMPACT_STEP_MAX_S);
    if (self.step.by_series) {
        self.level_s = SERIES_NEXT_S;
        return;
    }
    const bool cut = h < 0.99 * self.level_s;
    const bool kept =
        self.step.flight && allowed > h && allowed < 1.25 * h;  // whose weights are at hand
    if (!switches && !kept && (!cut || allowed > self.level_s))
        self.level_s = allowed;
}

// Length of the next step: what the error allows, in equal parts up to a horizon that is near.
template <class L> VGROOVE_INLINE double impact_length(const ImpactSolver<L> &self) {
    double level = self.level_s;
    if constexpr (!L::EXACT)
        level = min_of(level, min_of(self.step.by_series ? IMPACT_STEP_MAX_S : ring_longest(self),
                                     flight_longest(self)));
    else
        level = min_of(level, IMPACT_STEP_MAX_S);
    if (self.horizon_s > 1e3 * level || self.horizon_s <= IMPACT_SAME_S)
        return level;
    const double pieces = std::ceil(self.horizon_s / level - 1e-6);
    return pieces > 1.0 ? self.horizon_s / pieces : self.horizon_s;
}

// EXACT: the instant of a switch is reached by a step of its own, which may just miss it.
template <class L> VGROOVE_INLINE void impact_reach_switch(ImpactSolver<L> &self) {
    const int event = self.step.event;
    impact_attempt(self, self.step.h * self.step.share);
    if (impact_event_value<L>(self.model, self.mode, self.step.end, self.step.end_point, event) <
        0.0)
        self.step.event = event;
}

// Whether the hammer, touching nothing, rises above the lugs or comes down into a gap in the step
// just tried: that changes no force, and the step holds.
template <class L> VGROOVE_INLINE bool impact_passes_height(const ImpactSolver<L> &self) {
    const Impact &m = self.model;
    if (self.mode.place != ContactPlace::NONE || self.step.end_point.x >= m.travel_m)
        return false;
    if (!self.mode.above)
        return true;
    const double from = impact_relative<L>(m, self.state),
                 to = impact_relative<L>(m, self.step.end);
    return impact_lap(m, from) > m.overlap_rad &&
           std::floor(from / m.period_rad) == std::floor(to / m.period_rad) &&
           impact_lap(m, to) > m.overlap_rad;
}

// The first switch of the step just tried, and its share of it.
template <class L> VGROOVE_INLINE void impact_find_switch(ImpactSolver<L> &self, double h) {
    ImpactStep<L> &t = self.step;
    const unsigned possible = impact_possible(self.model, self.mode, self.drive);
    const unsigned met = impact_met<L>(self.model, self.mode, possible, t.end, t.end_point);
    unsigned turned = impact_grazed(self, possible & ~met);
    if constexpr (!L::EXACT)
        if (t.by_series)
            turned |= series_grazed(self, possible & ~met);
    if (!L::EXACT && met == impact_bit(IMPACT_HEIGHT) && turned == 0u && impact_passes_height(self))
        t.event = IMPACT_HEIGHT;
    else if ((met | turned) != 0u)
        t.event = impact_earliest(self, h, met, turned, L::EXACT ? 1e-12 : 1e-9, t.share);
}

// What the next step needs beside slope and point: fast mode's anvil and series.
template <class L> VGROOVE_INLINE void impact_prepare(ImpactSolver<L> &self) {
    if (self.fresh)
        impact_refresh(self);
    self.step.by_series = false;
    if constexpr (!L::EXACT)
        ring_begin(self);
    if (!series_applies(self))
        return;
    self.step.by_series = true;
    series_expand(self);
    self.level_s = series_longest(self);
}

// Tries steps from the state until one holds, up to its first switch.
template <class L> __attribute__((noinline)) void impact_try(ImpactSolver<L> &self) {
    ImpactStep<L> &t = self.step;
    impact_prepare(self);
    for (;;) {
        const double h = impact_length(self);
        const double factor = impact_attempt(self, h);
        if (t.error <= 1.0 && (L::EXACT || !ring_overlooked(self, h))) {
            impact_find_switch(self, h);
            impact_adapt(self, h, factor, t.share != 1.0);
            if (L::EXACT && t.event >= 0)
                impact_reach_switch(self);
            return;
        }
        self.level_s = t.error <= 1.0 ? RING_STEP / std::sqrt(self.model.ring_square)
                                      : h * max_of(factor, 0.2);
        self.stats.rejected += 1.0;
        if (!(h > IMPACT_STEP_MIN_S))
            throw std::runtime_error("impact mechanism: the state is no longer finite");
    }
}

template <class L> VGROOVE_INLINE void impact_run_adaptive(ImpactSolver<L> &self, double length_s) {
    self.horizon_s = length_s;
    while (self.horizon_s > 0.0) {
        impact_try(self);
        const double h = self.step.h * self.step.share;
        self.horizon_s = self.step.share == 1.0 && h >= self.horizon_s - IMPACT_SAME_S
                             ? 0.0
                             : self.horizon_s - h;
        impact_take(self, self.step.share, self.step.event);
    }
}

template <class L> VGROOVE_INLINE void impact_run_on(ImpactSolver<L> &self, double length_s) {
    double to = self.into_s + length_s;
    for (;;) {
        if (!self.ahead)
            impact_try(self);
        self.ahead = true;
        const double reach = self.step.h * self.step.share;
        if (to <= reach + IMPACT_SAME_S) {
            self.into_s = min_of(to, reach);
            return;
        }
        to -= reach;
        self.horizon_s -= reach;
        self.ahead = false;
        impact_take(self, self.step.share, self.step.event);
    }
}

template <class L> VGROOVE_INLINE void impact_cut_inline(ImpactSolver<L> &self) {
    if (!self.ahead)
        return;
    self.ahead = false;
    const bool whole = self.into_s >= self.step.h * self.step.share - IMPACT_SAME_S;
    self.horizon_s -= self.into_s;
    if (whole)
        impact_take(self, self.step.share, self.step.event);
    else if (self.into_s > 0.0)
        impact_take(self, self.into_s / self.step.h, -1);
    self.fresh = self.fresh || !whole;
    self.into_s = 0.0;
}

// Whether the next stretch of length h is stiff: a flank is touched or within reach, or the anvil
// still rings.
template <class L> VGROOVE_INLINE bool impact_is_stiff(const ImpactSolver<L> &self, double h) {
    const ImpactMode &mode = self.mode;
    if (mode.place != ContactPlace::NONE || !mode.frozen)
        return true;
    if (mode.above)
        return false;
    const double relative = impact_relative<L>(self.model, self.state);
    const double reach =
        1.5 * h * std::fabs(self.state.x[L::HAMMER_SPEED] - self.state.x[L::ANVIL_SPEED]);
    return mode.forward_rad - relative < reach || relative - mode.backward_rad < reach;
}

// One step without error control. At most two switches are located in it, those beyond are taken at
// its end.
template <class L> VGROOVE_INLINE void impact_fixed_piece(ImpactSolver<L> &self, double h) {
    for (int cut = 0; cut <= IMPACT_CUTS_MAX; ++cut) {
        if (self.fresh)
            impact_refresh(self);
        impact_attempt(self, h);
        const unsigned possible = impact_possible(self.model, self.mode, self.drive);
        const unsigned met =
            impact_met<L>(self.model, self.mode, possible, self.step.end, self.step.end_point);
        double share = 1.0;
        const int event = met != 0u && cut < IMPACT_CUTS_MAX
                              ? impact_earliest(self, h, met, 0u, 1e-8, share)
                              : -1;
        self.fresh = met != 0u;
        impact_take(self, share, event);
        if (event < 0)
            break;
        h *= 1.0 - share;
    }
    impact_freeze(self);
}

// Steps of fixed_s with bounded work: one piece each in flight, pieces of at most IMPACT_PIECE_S
// where it is stiff.
template <class L>
__attribute__((noinline)) void impact_run_fixed(ImpactSolver<L> &self, double length_s) {
    const double steps = std::ceil(length_s / self.fixed_s - 1e-6);
    const double h = length_s / steps;
    const int pieces = static_cast<int>(std::ceil(h / IMPACT_PIECE_S - 1e-6));
    for (double step = 0.0; step < steps; step += 1.0) {
        const int count = impact_is_stiff(self, h) ? pieces : 1;
        for (int n = 0; n < count; ++n)
            impact_fixed_piece(self, h / count);
    }
    if (!std::isfinite(self.state.x[STATE_SPEED] + self.state.x[L::HAMMER_ANGLE] +
                       self.state.x[L::ANVIL_ANGLE]))
        throw std::runtime_error("impact mechanism: the fixed step is too long for this tool");
}

template <class L> VGROOVE_INLINE void impact_run_any(ImpactSolver<L> &self, double length_s) {
    if (!L::EXACT && self.fixed_s > 0.0)
        impact_run_fixed(self, length_s);
    else
        impact_run_adaptive(self, length_s);
}

template <class L> void impact_run(ImpactSolver<L> &self, double length_s) {
    if (L::EXACT || self.fixed_s > 0.0)
        impact_run_any(self, length_s);
    else
        impact_run_on(self, length_s);
}
template <class L> void impact_cut(ImpactSolver<L> &self) {
    impact_cut_inline(self);
}

template void impact_run<FastLayout>(ImpactSolver<FastLayout> &, double);
template void impact_run<FullLayout>(ImpactSolver<FullLayout> &, double);
template void impact_run<AuditLayout>(ImpactSolver<AuditLayout> &, double);
template void impact_refresh<FastLayout>(ImpactSolver<FastLayout> &);
template void impact_refresh<FullLayout>(ImpactSolver<FullLayout> &);
template void impact_refresh<AuditLayout>(ImpactSolver<AuditLayout> &);
template void impact_cut<FastLayout>(ImpactSolver<FastLayout> &);
template void impact_cut<FullLayout>(ImpactSolver<FullLayout> &);
template void impact_cut<AuditLayout>(ImpactSolver<AuditLayout> &);

}  // namespace vgroove
