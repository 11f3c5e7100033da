// Equations of the drill driver: inputs, rates of the state and of the integrals, their
// derivatives.
#include "drill/model.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace vgroove {

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

// d: from 0 to drive.duty along the ramp; +-1 while pulse mode drives
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

// Shaft torque that a gripping clutch carries: K e + C (w / N - wc)
double drill_gripping_torque(const DrillParameters &p, const DrillVector &x) {
    return p.shaft_stiffness * x[DRILL_TWIST] +
           p.shaft_damping * (x[DRILL_SPEED] / p.ratio - x[DRILL_CHUCK]);
}

// T = K e + C e' while the clutch grips, +-clutch_nm while it slips
double drill_shaft_torque(const DrillParameters &p, const DrillMode &m, const DrillVector &x) {
    return m.clutch == 0 ? drill_gripping_torque(p, x) : m.clutch * p.clutch_nm;
}

// Stored energy: L i^2 / 2 + J w^2 / 2 + Jc wc^2 / 2 + K e^2 / 2
double drill_stored_energy(const DrillParameters &p, const DrillVector &x) {
    return 0.5 * (p.inductance_h * x[DRILL_CURRENT] * x[DRILL_CURRENT] +
                  p.motor_inertia * x[DRILL_SPEED] * x[DRILL_SPEED] +
                  p.chuck_inertia * x[DRILL_CHUCK] * x[DRILL_CHUCK] +
                  p.shaft_stiffness * x[DRILL_TWIST] * x[DRILL_TWIST]);
}

// State: L i' = v - R i - k w;  J w' = k i - b w - Tc sign(w) - T / N;  e' = (T - K e) / C;
// Jc wc' = T - Tload(wc), e: twist, wc: chuck speed, T: shaft torque.
// Rates of the sums: i, w, wc, work_in' = v i; losses in winding R i^2, motor (b w + Tc sign(w)) w,
// shaft C e'^2, clutch T (w / N - wc - e'); work_load' = Tload wc
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

}  // namespace vgroove
