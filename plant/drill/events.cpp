// Guards of the drill driver and what changes when one of them becomes negative.
#include "drill/events.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vgroove {

constexpr double SAME_INSTANT_S = 1e-12;
constexpr double NEVER_S = std::numeric_limits<double>::infinity();

DrillSystem::DrillSystem(const DrillParameters &parameters, double charge_spacing_s,
                         std::size_t charge_capacity)
    : p(parameters),
      charge(parameters.pulse_average_s, charge_spacing_s, charge_capacity) {
    drill_check(p);
    charge.push(0.0, 0.0, 0.0, true);
}

// Torque that Coulomb friction has to hold at rest: k i - T / N
static double resting_torque(const DrillSystem &s, const DrillVector &x) {
    return s.p.constant * x[DRILL_CURRENT] - drill_shaft_torque(s.p, s.mode, x) / s.p.ratio;
}

DrillGuards drill_guards(const DrillSystem &s, double time_s, const DrillVector &x, double charge) {
    const DrillParameters &p = s.p;
    const DrillMode &m = s.mode;
    DrillGuards g;
    g.fill(1.0);
    g[DRILL_EVENT_MOTOR] = m.slide == 0 ? p.motor_coulomb_nm - std::fabs(resting_torque(s, x))
                                        : m.slide * x[DRILL_SPEED];
    const double torque = drill_gripping_torque(p, x);
    g[DRILL_EVENT_CLUTCH] =
        m.clutch == 0 ? p.clutch_nm - std::fabs(torque) : m.clutch * torque - p.clutch_nm;
    if (m.bridge == DrillBridge::DIODES)
        g[DRILL_EVENT_DIODE] = -m.diode * x[DRILL_CURRENT];
    if (p.pulse == 0.0)
        return g;
    if (m.control == DrillControl::NORMAL)
        g[DRILL_EVENT_PULSE_ON] = p.pulse_on_a - std::fabs(x[DRILL_CURRENT]);
    else if (time_s >= m.pulse_start_s + p.pulse_average_s - SAME_INSTANT_S)
        g[DRILL_EVENT_PULSE_OFF] = std::fabs(s.charge.average(time_s, charge)) - p.pulse_off_a;
    return g;
}

bool drill_any(const DrillGuards &g) {
    return std::any_of(g.begin(), g.end(), [](double value) { return value < 0.0; });
}

static int direction_of(double x) {
    return x > 0.0 ? 1 : (x < 0.0 ? -1 : 0);
}

// Motor at rest: friction holds torques up to Tc; a larger one makes it slide in its direction.
static DrillMark settle_motor(DrillSystem &s) {
    const bool rested = s.mode.slide == 0;
    s.mode.slide = 0;
    s.x[DRILL_SPEED] = 0.0;
    const double torque = resting_torque(s, s.x);
    if (std::fabs(torque) > s.p.motor_coulomb_nm)
        s.mode.slide = direction_of(torque);
    return rested ? DrillMark::BREAK_AWAY : DrillMark::MOTOR_RESTS;
}

static DrillMark settle_clutch(DrillSystem &s) {
    const double torque = drill_gripping_torque(s.p, s.x);
    s.mode.clutch = std::fabs(torque) > s.p.clutch_nm ? direction_of(torque) : 0;
    return s.mode.clutch != 0 ? DrillMark::CLUTCH_SLIPS : DrillMark::CLUTCH_GRIPS;
}

static void set_bridge(DrillSystem &s, bool open) {
    s.mode.diode = open ? -direction_of(s.x[DRILL_CURRENT]) : 0;
    s.mode.bridge = !open ? DrillBridge::CLOSED
                          : (s.mode.diode != 0 ? DrillBridge::DIODES : DrillBridge::BLOCKED);
}

static DrillMark set_control(DrillSystem &s, DrillControl control, double length_s) {
    s.mode.control = control;
    s.mode.switch_s += length_s;
    set_bridge(s, control == DrillControl::COAST);
    return control == DrillControl::COAST
               ? DrillMark::COAST
               : (control == DrillControl::DRIVE ? DrillMark::DRIVE : DrillMark::PULSE_OFF);
}

DrillMark drill_switch(DrillSystem &s, const DrillGuards &g) {
    DrillMark mark = DrillMark::NONE;
    if (g[DRILL_EVENT_CLUTCH] < 0.0)
        mark = settle_clutch(s);
    if (g[DRILL_EVENT_MOTOR] < 0.0)
        mark = settle_motor(s);
    if (g[DRILL_EVENT_DIODE] < 0.0) {
        s.x[DRILL_CURRENT] = 0.0;
        set_bridge(s, true);
        mark = DrillMark::CURRENT_ENDS;
    }
    if (g[DRILL_EVENT_PULSE_OFF] < 0.0)
        mark = set_control(s, DrillControl::NORMAL, 0.0);
    if (g[DRILL_EVENT_PULSE_ON] < 0.0) {
        s.mode.pulse_start_s = s.mode.switch_s = s.time_s;
        set_control(s, DrillControl::COAST, s.p.pulse_coast_s);
        mark = DrillMark::PULSE_ON;
    }
    return mark;
}

DrillMark drill_timers(DrillSystem &s) {
    if (s.mode.control == DrillControl::NORMAL || s.time_s < s.mode.switch_s - SAME_INSTANT_S)
        return DrillMark::NONE;
    const bool coasting = s.mode.control == DrillControl::COAST;
    return set_control(s, coasting ? DrillControl::DRIVE : DrillControl::COAST,
                       coasting ? s.p.pulse_drive_s : s.p.pulse_coast_s);
}

void drill_command_bridge(DrillSystem &s, bool open) {
    if (open)
        s.mode.control = DrillControl::NORMAL;
    if (s.mode.control == DrillControl::NORMAL && open != (s.mode.bridge != DrillBridge::CLOSED))
        set_bridge(s, open);
}

double drill_next_time(const DrillSystem &s) {
    const bool pulsing = s.mode.control != DrillControl::NORMAL;
    const double times[] = {s.p.ramp_s, s.p.load_from_s, s.p.load_to_s,
                            pulsing ? s.mode.switch_s : NEVER_S,
                            pulsing ? s.mode.pulse_start_s + s.p.pulse_average_s : NEVER_S};
    double next = NEVER_S;
    for (const double time : times)
        if (time > s.time_s + SAME_INSTANT_S)
            next = std::min(next, time);
    return next;
}

DrillMark drill_input_mark(const DrillParameters &p, double time_s) {
    const auto at = [time_s](double instant) {
        return std::fabs(time_s - instant) <= SAME_INSTANT_S;
    };
    if (p.load_nm > 0.0 && at(p.load_from_s))
        return DrillMark::LOAD_ON;
    if (p.load_nm > 0.0 && at(p.load_to_s))
        return DrillMark::LOAD_OFF;
    return at(p.ramp_s) ? DrillMark::RAMP_END : DrillMark::NONE;
}

}  // namespace vgroove
