// One period of the drill driver: command, dead time, pack resistance and load go into the
// real-time solver.
#include "lockstep/drill_plant.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "components/bridge.hpp"
#include "drill/real_time.hpp"
#include "lockstep/body.hpp"

namespace vgroove {

// An interval may differ from a whole number of steps by this share of a step (rounding).
constexpr double WHOLE_STEPS = 1e-6;

// Duty without dead time that gives the same voltage: v = (d - dead S(i)) Vs, S(i) = i / ir within
// +-1, ir = max(0.2 A, |d| (1 - |d|) Vs / (2 L f))
static double effective_duty(const DrillParameters &p, double duty, double dead, double bus,
                             double current_a) {
    const double share = std::fabs(duty);
    if (share == 0.0 || share >= 1.0 || dead == 0.0)
        return duty;
    const Bridge<double> bridge{0.0, PERIOD_S / (2.0 * p.inductance_h), 0.0, 0.0};
    return duty -
           dead * bridge_sign<double>(bridge, current_a, bridge_ripple<double>(bridge, duty, bus));
}

// Coulomb torque Tc of the load at middle_s, the middle of the period
static double chuck_torque(const DrillParameters &p, const DrillSystem &s, double middle_s,
                           double command_nm) {
    const double window = middle_s >= p.load_from_s && middle_s < p.load_to_s ? p.load_nm : 0.0;
    const double past_rad =
        s.sums[DRILL_CHUCK_ANGLE] + s.x[DRILL_CHUCK] * (middle_s - s.time_s) - p.rise_from_rad;
    return std::max(window + std::min(p.rise_nm_per_rad * std::max(past_rad, 0.0), p.rise_most_nm) +
                        command_nm,
                    0.0);
}

struct DrillPlant::Body {
    DrillParameters parameters;
    double supply_ohm, step_s;
    DrillRealTime solver;
    LockstepBody lockstep;
    double load_nm = 0.0;   // of the command at the end of the last period
    double chuck_nm = 0.0;  // Tc of the last period
    double bus_v = 0.0;     // mean of the last period

    Body(const DrillParameters &p, double ohm, HallWheel w, double h)
        : parameters(p),
          supply_ohm(ohm),
          step_s(h),
          solver(p, h),
          lockstep(std::move(w), HallFaults{}, 0) {}

    void run_period(const BridgeCommand &c, double load_end_nm) {
        const DrillSystem &s = solver.system();
        const double current = s.x[DRILL_CURRENT], charge = s.sums[DRILL_CHARGE];
        const double bus = parameters.supply_v - supply_ohm * (c.coast ? 0.0 : c.duty * current);
        chuck_nm =
            chuck_torque(parameters, s, s.time_s + 0.5 * step_s, 0.5 * (load_nm + load_end_nm));
        load_nm = load_end_nm;
        const double duty =
            c.coast ? 0.0 : effective_duty(parameters, c.duty, c.dead, bus, current);
        solver.command({c.coast, duty, bus, chuck_nm});
        solver.step();
        const double mean_a = (s.sums[DRILL_CHARGE] - charge) / step_s;
        bus_v = parameters.supply_v - supply_ohm * (c.coast ? 0.0 : c.duty * mean_a);
    }

    double measured_current() const { return solver.system().x[DRILL_CURRENT]; }
    double measured_bus() const { return bus_v; }
    WheelReading wheel() const {
        const DrillSystem &s = solver.system();
        return {s.sums[DRILL_ANGLE], s.x[DRILL_SPEED]};
    }
};

DrillPlant::DrillPlant(const DrillParameters &p, double supply_ohm, HallWheel wheel,
                       double step_s) {
    if (!(supply_ohm >= 0.0))
        throw std::invalid_argument("supply.resistance_ohm must be at least 0");
    if (supply_ohm > 0.0 && p.pulse != 0.0)
        throw std::invalid_argument(
            "pulse mode without a board has no pack resistance: supply.resistance_ohm must be 0");
    body_ = std::make_unique<Body>(p, supply_ohm, std::move(wheel), step_s);
    body_->lockstep.begin(*body_);
}

DrillPlant::~DrillPlant() = default;
DrillPlant::DrillPlant(DrillPlant &&) noexcept = default;
DrillPlant::DrillPlant(const DrillPlant &other) : body_(std::make_unique<Body>(*other.body_)) {}

const DrillSystem &DrillPlant::system() const {
    return body_->solver.system();
}
double DrillPlant::time_s() const {
    return system().time_s;
}
double DrillPlant::load_nm() const {
    return body_->chuck_nm;
}
double DrillPlant::shaft_nm() const {
    const DrillSystem &s = system();
    return drill_shaft_torque(s.p, s.mode, s.x);
}

PeriodResult DrillPlant::period(bool coast, double duty, double dead, double load_nm) {
    if (!(std::fabs(duty) <= 1.0))
        throw std::invalid_argument("duty must be within +-1");
    return body_->lockstep.period(*body_, {coast, duty, dead}, load_nm);
}

DrillInterval DrillPlant::advance(double seconds, double duty_from, double duty, bool coast,
                                  double load_nm) {
    const Body &b = *body_;
    const double steps = std::round(seconds / b.step_s);
    if (!(steps >= 1.0) || std::fabs(seconds / b.step_s - steps) > WHOLE_STEPS)
        throw std::invalid_argument("the drill driver advances by a whole number of steps of " +
                                    std::to_string(1e6 * b.step_s) + " us");
    const DrillSystem &s = system();
    const double charge = s.sums[DRILL_CHARGE], load_from_nm = b.load_nm;
    DrillInterval r{};
    for (double n = 0.0; n < steps; n += 1.0) {
        const double here = duty_from + (duty - duty_from) * (n + 0.5) / steps;
        r.supply_v +=
            period(coast, here, 0.0, load_from_nm + (load_nm - load_from_nm) * (n + 1.0) / steps)
                .supply_v /
            steps;
        r.shaft_peak_nm = std::max(r.shaft_peak_nm, std::fabs(shaft_nm()));
        r.slipped_s += s.mode.clutch != 0 ? b.step_s : 0.0;
    }
    r.current_a = (s.sums[DRILL_CHARGE] - charge) / (steps * b.step_s);
    r.speed_rad_s = s.x[DRILL_SPEED];
    r.angle_rad = s.sums[DRILL_ANGLE];
    r.chuck_rad_s = s.x[DRILL_CHUCK];
    r.chuck_angle_rad = s.sums[DRILL_CHUCK_ANGLE];
    r.shaft_nm = shaft_nm();
    r.load_nm = b.chuck_nm;
    return r;
}

}  // namespace vgroove
