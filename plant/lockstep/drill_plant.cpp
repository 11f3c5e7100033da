// One period of the drill driver: command, dead time, pack and load into the real-time solver,
// edges of the Hall wheel out of the motor's angle.
#include "lockstep/drill_plant.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "components/bridge.hpp"
#include "drill/solvers.hpp"

namespace vgroove {

constexpr double WHOLE_STEPS = 1e-6;  // how far from a whole number of steps an interval may be

struct DrillPlant::Body {
    DrillParameters parameters;
    double supply_ohm, step_s;
    HallWheel wheel;
    DrillRealTime solver;
    double load_nm = 0.0, chuck_nm = 0.0;  // of the command at the end of the last period; Tc
    std::deque<std::int64_t> edges;
    std::int64_t cycles = 0;
    Noise dropout{};

    Body(const DrillParameters &p, double ohm, HallWheel w, double h)
        : parameters(p),
          supply_ohm(ohm),
          step_s(h),
          wheel(std::move(w)),
          solver(p, h) {}
};

DrillPlant::DrillPlant(const DrillParameters &p, double supply_ohm, HallWheel wheel,
                       double step_s) {
    if (!(supply_ohm >= 0.0))
        throw std::invalid_argument("supply.resistance_ohm must be at least 0");
    if (supply_ohm > 0.0 && p.pulse != 0.0)
        throw std::invalid_argument(
            "pulse mode without a board has no pack resistance: supply.resistance_ohm must be 0");
    body_.reset(new Body(p, supply_ohm, std::move(wheel), step_s));
}

DrillPlant::~DrillPlant() = default;
DrillPlant::DrillPlant(DrillPlant &&) noexcept = default;

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

// v = (d - dead S(i)) Vs, S(i) = i / ir within +-1, ir = max(0.2 A, |d| (1 - |d|) Vs / (2 L f))
static double effective_duty(const DrillParameters &p, double duty, double dead, double bus,
                             double current_a) {
    const double share = std::fabs(duty);
    if (share == 0.0 || share >= 1.0 || dead == 0.0)
        return duty;
    const Bridge<double> bridge{0.0, PERIOD_S / (2.0 * p.inductance_h), 0.0};
    return duty -
           dead * bridge_sign<double>(bridge, current_a, bridge_ripple<double>(bridge, duty, bus));
}

// Tc in the middle of the period
static double chuck_torque(const DrillParameters &p, const DrillSystem &s, double middle_s,
                           double command_nm) {
    const double window = middle_s >= p.load_from_s && middle_s < p.load_to_s ? p.load_nm : 0.0;
    const double past_rad =
        s.sums[DRILL_CHUCK_ANGLE] + s.x[DRILL_CHUCK] * (middle_s - s.time_s) - p.rise_from_rad;
    return std::max(window + std::min(p.rise_nm_per_rad * std::max(past_rad, 0.0), p.rise_most_nm) +
                        command_nm,
                    0.0);
}

PeriodResult DrillPlant::period(bool coast, double duty, double dead, double load_nm) {
    if (!(std::fabs(duty) <= 1.0))
        throw std::invalid_argument("duty must be within +-1");
    Body &b = *body_;
    const DrillSystem &s = b.solver.system();
    const double current = s.x[DRILL_CURRENT], angle = s.sums[DRILL_ANGLE],
                 speed = s.x[DRILL_SPEED], charge = s.sums[DRILL_CHARGE];
    const double bus = b.parameters.supply_v - b.supply_ohm * (coast ? 0.0 : duty * current);
    b.chuck_nm =
        chuck_torque(b.parameters, s, s.time_s + 0.5 * b.step_s, 0.5 * (b.load_nm + load_nm));
    b.load_nm = load_nm;
    b.solver.command({coast, coast ? 0.0 : effective_duty(b.parameters, duty, dead, bus, current),
                      bus, b.chuck_nm});
    b.solver.step();
    const double mean_a = (s.sums[DRILL_CHARGE] - charge) / b.step_s;
    const Sweep sweep{angle, speed, s.sums[DRILL_ANGLE], s.x[DRILL_SPEED]};
    if (sweep.end_angle != sweep.angle && !b.wheel.edge_rad.empty())
        hall_wheel_edges(b.wheel, sweep, 0.0, b.dropout, b.cycles, b.edges);
    PeriodResult r{s.x[DRILL_CURRENT],
                   b.parameters.supply_v - b.supply_ohm * (coast ? 0.0 : duty * mean_a),
                   0,
                   {}};
    hall_wheel_take(b.edges, b.cycles, r);
    b.cycles += PERIOD_CYCLES;
    return r;
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
