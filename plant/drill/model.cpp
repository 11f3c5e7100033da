// Equations, guards and mode changes of the drill driver; its solvers are in drill_solvers.cpp and
// drill_real_time.cpp.
#include "drill/model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace vgroove {

constexpr double SAME_INSTANT_S = 1e-12;
constexpr double NEVER_S = std::numeric_limits<double>::infinity();

void drill_check(const DrillParameters &p) {
    for (const DrillParameter &entry : DRILL_PARAMETERS) {
        const double value = p.*entry.member;
        if (!std::isfinite(value))
            throw std::invalid_argument(std::string(entry.name) + " must be finite");
        if (entry.range == DrillRange::POSITIVE && value <= 0.0)
            throw std::invalid_argument(std::string(entry.name) + " must be above 0");
        if (entry.range == DrillRange::NOT_NEGATIVE && value < 0.0)
            throw std::invalid_argument(std::string(entry.name) + " must be at least 0");
    }
    if (std::fabs(p.duty) > 1.0)
        throw std::invalid_argument("drive.duty must be within +-1");
    if (p.breakaway_ratio < 1.0)
        throw std::invalid_argument("load.breakaway_ratio must be at least 1");
}

// d: 0 to drive.duty along the ramp; full while pulse mode drives
double drill_duty(const DrillParameters &p, const DrillMode &m, double time_s) {
    if (m.control != DrillControl::NORMAL)
        return m.control == DrillControl::DRIVE ? std::copysign(1.0, p.duty) : 0.0;
    return time_s < p.ramp_s ? p.duty * time_s / p.ramp_s : p.duty;
}

DrillInput drill_input(const DrillParameters &p, const DrillMode &m, double time_s) {
    DrillInput in{0.0, 0.0, 0.0};
    if (m.bridge == DrillBridge::CLOSED) {
        in.terminal_v = drill_duty(p, m, time_s) * p.supply_v;
        in.terminal_v_per_s = m.control == DrillControl::NORMAL && time_s < p.ramp_s
                                  ? p.duty / p.ramp_s * p.supply_v
                                  : 0.0;
    } else if (m.bridge == DrillBridge::DIODES) {
        in.terminal_v = m.diode * p.supply_v;
    }
    in.load_nm = time_s >= p.load_from_s && time_s < p.load_to_s ? p.load_nm : 0.0;
    return in;
}

DrillInput drill_later(const DrillInput &in, double later_s) {
    return {in.terminal_v + in.terminal_v_per_s * later_s, in.terminal_v_per_s, in.load_nm};
}

static FrictionLaw<double> load_law(const DrillParameters &p, double load_nm) {
    return {p.breakaway_ratio * load_nm, load_nm,           p.load_viscous,
            p.breakaway_rad_s,           p.threshold_rad_s, p.decay_s_per_rad};
}

double drill_load_torque(const DrillParameters &p, double load_nm, double chuck_rad_s) {
    if (load_nm == 0.0)
        return 0.0;
    const FrictionLaw<double> law = load_law(p, load_nm);
    return p.exponential != 0.0 ? friction_law_exponential<double>(law, chuck_rad_s)
                                : friction_law_stribeck<double>(law, chuck_rad_s);
}

double drill_load_slope(const DrillParameters &p, double load_nm, double chuck_rad_s) {
    if (load_nm == 0.0)
        return 0.0;
    const FrictionLaw<double> law = load_law(p, load_nm);
    return p.exponential != 0.0 ? friction_law_exponential_slope<double>(law, chuck_rad_s)
                                : friction_law_stribeck_slope<double>(law, chuck_rad_s);
}

// K e + C (w / N - wc)
static double gripping_torque(const DrillParameters &p, const DrillVector &x) {
    return p.shaft_stiffness * x[DRILL_TWIST] +
           p.shaft_damping * (x[DRILL_SPEED] / p.ratio - x[DRILL_CHUCK]);
}

// T = K e + C e' while the clutch grips, +-clutch_nm while it slips
double drill_shaft_torque(const DrillParameters &p, const DrillMode &m, const DrillVector &x) {
    return m.clutch == 0 ? gripping_torque(p, x) : m.clutch * p.clutch_nm;
}

// L i^2 / 2 + J w^2 / 2 + Jc wc^2 / 2 + K e^2 / 2
double drill_stored_energy(const DrillParameters &p, const DrillVector &x) {
    return 0.5 * (p.inductance_h * x[DRILL_CURRENT] * x[DRILL_CURRENT] +
                  p.motor_inertia * x[DRILL_SPEED] * x[DRILL_SPEED] +
                  p.chuck_inertia * x[DRILL_CHUCK] * x[DRILL_CHUCK] +
                  p.shaft_stiffness * x[DRILL_TWIST] * x[DRILL_TWIST]);
}

// L i' = v - R i - k w;  J w' = k i - b w - Tc sign(w) - T / N;  e' = (T - K e) / C;  Jc wc' = T -
// Tload(wc) work_in' = v i;  R i^2;  (b w + Tc sign(w)) w;  C e'^2;  T (w / N - wc - e');  Tload wc
DrillRates drill_rates(const DrillParameters &p, const DrillMode &m, const DrillInput &in,
                       const DrillVector &x) {
    const double i = x[DRILL_CURRENT], w = x[DRILL_SPEED], chuck = x[DRILL_CHUCK];
    const double torque = drill_shaft_torque(p, m, x);
    const double load = drill_load_torque(p, in.load_nm, chuck);
    const double friction = p.motor_viscous * w + m.slide * p.motor_coulomb_nm;
    const double turning = w / p.ratio - chuck;
    const double twisting =
        m.clutch == 0 ? turning : (torque - p.shaft_stiffness * x[DRILL_TWIST]) / p.shaft_damping;
    DrillRates r;
    r.core[DRILL_CURRENT] =
        m.bridge == DrillBridge::BLOCKED
            ? 0.0
            : (in.terminal_v - p.resistance_ohm * i - p.constant * w) / p.inductance_h;
    r.core[DRILL_SPEED] =
        m.slide == 0 ? 0.0 : (p.constant * i - friction - torque / p.ratio) / p.motor_inertia;
    r.core[DRILL_TWIST] = twisting;
    r.core[DRILL_CHUCK] = (torque - load) / p.chuck_inertia;
    r.sums << i, w, chuck, in.terminal_v * i, p.resistance_ohm * i * i, friction * w,
        p.shaft_damping * twisting * twisting, torque * (turning - twisting), load * chuck;
    return r;
}

using DrillRow = Eigen::Matrix<double, 1, DRILL_CORE_COUNT>;

DrillSlopes drill_slopes(const DrillParameters &p, const DrillMode &m, const DrillInput &in,
                         const DrillVector &x) {
    const double i = x[DRILL_CURRENT], w = x[DRILL_SPEED], chuck = x[DRILL_CHUCK];
    const double torque = drill_shaft_torque(p, m, x);
    const double load_slope = drill_load_slope(p, in.load_nm, chuck);
    const DrillRow turning{0.0, 1.0 / p.ratio, 0.0, -1.0};
    const bool grips = m.clutch == 0;
    const DrillRow torque_by =
        grips
            ? DrillRow(p.shaft_damping * turning + p.shaft_stiffness * DrillRow::Unit(DRILL_TWIST))
            : DrillRow::Zero();
    const DrillRow twisting_by =
        grips ? turning
              : DrillRow(-p.shaft_stiffness / p.shaft_damping * DrillRow::Unit(DRILL_TWIST));
    const double twisting = grips ? w / p.ratio - chuck
                                  : (torque - p.shaft_stiffness * x[DRILL_TWIST]) / p.shaft_damping;
    const double lost = w / p.ratio - chuck - twisting;
    DrillSlopes j;
    j.core.setZero();
    j.sums.setZero();
    j.core_time.setZero();
    j.sums_time.setZero();
    if (m.bridge != DrillBridge::BLOCKED) {
        j.core.row(DRILL_CURRENT) << -p.resistance_ohm / p.inductance_h,
            -p.constant / p.inductance_h, 0.0, 0.0;
        j.core_time[DRILL_CURRENT] = in.terminal_v_per_s / p.inductance_h;
    }
    if (m.slide != 0)
        j.core.row(DRILL_SPEED) =
            (DrillRow(p.constant, -p.motor_viscous, 0.0, 0.0) - torque_by / p.ratio) /
            p.motor_inertia;
    j.core.row(DRILL_TWIST) = twisting_by;
    j.core.row(DRILL_CHUCK) =
        (torque_by - load_slope * DrillRow::Unit(DRILL_CHUCK)) / p.chuck_inertia;
    j.sums(DRILL_CHARGE, DRILL_CURRENT) = 1.0;
    j.sums(DRILL_ANGLE, DRILL_SPEED) = 1.0;
    j.sums(DRILL_CHUCK_ANGLE, DRILL_CHUCK) = 1.0;
    j.sums(DRILL_WORK_IN, DRILL_CURRENT) = in.terminal_v;
    j.sums_time[DRILL_WORK_IN] = in.terminal_v_per_s * i;
    j.sums(DRILL_LOSS_WINDING, DRILL_CURRENT) = 2.0 * p.resistance_ohm * i;
    j.sums(DRILL_LOSS_MOTOR, DRILL_SPEED) =
        2.0 * p.motor_viscous * w + m.slide * p.motor_coulomb_nm;
    j.sums.row(DRILL_LOSS_SHAFT) = 2.0 * p.shaft_damping * twisting * twisting_by;
    j.sums.row(DRILL_LOSS_CLUTCH) = torque_by * lost + torque * (turning - twisting_by);
    j.sums(DRILL_WORK_LOAD, DRILL_CHUCK) =
        load_slope * chuck + drill_load_torque(p, in.load_nm, chuck);
    return j;
}

DrillVector drill_scales(const DrillParameters &p) {
    const double free = p.supply_v / p.constant;
    return {p.supply_v / p.resistance_ohm, free, p.clutch_nm / p.shaft_stiffness, free / p.ratio};
}

void DrillCharge::push(double time_s, double charge, double current_a, bool always) {
    if (!always && count_ > 0 && time_s - at(count_ - 1).time_s < spacing_s_)
        return;
    while (count_ > 2 && at(1).time_s <= time_s - window_s_) {
        first_ = (first_ + 1) % points_.size();
        --count_;
    }
    if (count_ == points_.size()) {
        std::rotate(points_.begin(), points_.begin() + static_cast<std::ptrdiff_t>(first_),
                    points_.end());
        first_ = 0;
        points_.resize(2 * count_);
    }
    points_[(first_ + count_++) % points_.size()] = {time_s, charge, current_a};
}

// (q(t) - q(t - window)) / window; q between two points is the cubic through both and their
// currents
double DrillCharge::average(double time_s, double charge) const {
    const double then_s = time_s - window_s_;
    std::size_t low = 0, high = count_ - 1;
    if (then_s <= at(low).time_s)
        return (charge - at(low).charge) / window_s_;
    while (high - low > 1) {
        const std::size_t middle = (low + high) / 2;
        (at(middle).time_s < then_s ? low : high) = middle;
    }
    const Point &a = at(low), &b = at(high);
    const double h = b.time_s - a.time_s;
    const double u = h > 0.0 ? std::min((then_s - a.time_s) / h, 1.0) : 1.0;
    const double rise = b.charge - a.charge;
    const double then =
        a.charge + rise * u +
        u * (1.0 - u) * ((1.0 - u) * (a.current_a * h - rise) + u * (rise - b.current_a * h));
    return (charge - then) / window_s_;
}

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
    const double torque = gripping_torque(p, x);
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

static int sign_of(double x) {
    return x > 0.0 ? 1 : (x < 0.0 ? -1 : 0);
}

// At rest: held up to Tc, else off the way it is driven.
static DrillMark settle_motor(DrillSystem &s) {
    const bool rested = s.mode.slide == 0;
    s.mode.slide = 0;
    s.x[DRILL_SPEED] = 0.0;
    const double torque = resting_torque(s, s.x);
    if (std::fabs(torque) > s.p.motor_coulomb_nm)
        s.mode.slide = sign_of(torque);
    return rested ? DrillMark::BREAK_AWAY : DrillMark::MOTOR_RESTS;
}

static DrillMark settle_clutch(DrillSystem &s) {
    const double torque = gripping_torque(s.p, s.x);
    s.mode.clutch = std::fabs(torque) > s.p.clutch_nm ? sign_of(torque) : 0;
    return s.mode.clutch != 0 ? DrillMark::CLUTCH_SLIPS : DrillMark::CLUTCH_GRIPS;
}

static void set_bridge(DrillSystem &s, bool open) {
    s.mode.diode = open ? -sign_of(s.x[DRILL_CURRENT]) : 0;
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
