// One PWM period of the drivetrain: command, dead time and load into the solver, edges of the Hall
// wheel out of the angle.
#include "lockstep/drive_plant.hpp"

#include <cmath>
#include <deque>
#include <stdexcept>
#include <string>
#include <utility>

#include "components/sensed.hpp"
#include "drivetrain/settle.hpp"
#include "drivetrain/solver.hpp"

namespace vgroove {

struct Command {
    bool coast;
    double duty, dead;
};

using Inner = Solver<double, STATE_FULL_COUNT>;

struct DrivePlant::Body {
    Inner solver;
    Parameters parameters;
    HallWheel wheel;
    Noise dropout;
    std::deque<Command> commands;  // transport delay, whole periods
    std::deque<std::int64_t>
        edges;  // pure delay of the speed sensor: cycles since start at which each is seen
    std::int64_t cycles;  // since start, at the start of the period
    double period_s;
    std::int64_t edge_delay;
    Sweep sweep;
};

static double seen_angle(const Inner &s, const Parameters &p) {
    return sensors_seen_angle(s.model.sensors, s.model.effects, p, s.state.x[STATE_ANGLE],
                              s.state.x[STATE_SPEED_FILTER]);
}

static double seen_speed(const Inner &s, const Parameters &p) {
    const double *x = s.state.x;
    return sensors_seen_speed(s.model.sensors, s.model.effects, p, x[STATE_SPEED], x[STATE_ANGLE],
                              x[STATE_SPEED_FILTER]);
}

DrivePlant::DrivePlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed)
    : body_(new Body{}) {
    check_parameters(p, true);
    Body &b = *body_;
    b.parameters = p;
    b.wheel = std::move(wheel);
    b.dropout.state = seed;
    b.period_s = PERIOD_S / (1.0 + p.clock_skew_relative);
    Drivetrain<double> &m = b.solver.model;
    m.effects = effects_of(p) | EFFECT_DEAD_TIME;
    m.input = InputKind::DUTY;
    m.load.kind = load;
    drivetrain_set_lane(m, 0, p, p.supply_voltage_v, PERIOD_S);
    solver_prepare(b.solver, 0.0);
    if (p.speed_lag_delay_form != 0.0)
        b.edge_delay = std::llround(p.speed_lag_s * CPU_HZ);
    b.commands.assign(static_cast<std::size_t>(std::llround(p.transport_delay_s / b.period_s)),
                      Command{true, 0.0, 0.0});
    reset(0.0, 0.0, 0.0);
}

DrivePlant::~DrivePlant() = default;
DrivePlant::DrivePlant(DrivePlant &&) noexcept = default;

void DrivePlant::reset(double current_a, double speed_rad_s, double angle_rad) {
    const double start[3] = {current_a, speed_rad_s, angle_rad};
    Body &b = *body_;
    settle_shaft(b.solver, 0, start);
    b.sweep.end_angle = seen_angle(b.solver, b.parameters);
    b.sweep.end_speed = seen_speed(b.solver, b.parameters);
}

static void set_period(Inner &s, const Parameters &p, const Command &c, double load_nm,
                       double period_s) {
    Drive<double> &d = s.drive;
    const double share = std::fabs(c.duty);
    d.command = c.duty;
    d.command_rate = 0.0;
    d.open = c.coast ? 1.0 : 0.0;
    d.dead = !c.coast && share > 0.0 && share < 1.0 ? c.dead + 2.0 * p.dead_time_s * p.bridge_pwm_hz
                                                    : 0.0;
    d.load_rate = (load_nm - d.load_nm) / period_s;
    s.state.x[STATE_CURRENT_TIME] = 0.0;
    s.state.x[STATE_BUS_TIME] = 0.0;
}

__attribute__((flatten)) static void run_period(Inner &s, double period_s) {
    s.level_s = 1.0;
    flush_tiny(s.state);
    solver_earn(s, 0, 1, period_s);
    solver_begin(s, 0, period_s);
    solver_run(
        s, [](int) __attribute__((always_inline)) { return false; });
}

static double sensed(const Inner &s, const Parameters &p) {
    const double i = s.model.effects & EFFECT_CURRENT_LAG ? s.state.x[STATE_CURRENT_FILTER]
                                                          : s.state.x[STATE_CURRENT];
    return sensors_read_current(p, i);
}

PeriodResult DrivePlant::period(bool coast, double duty, double dead, double load_nm) {
    Body &b = *body_;
    Inner &s = b.solver;
    b.commands.push_back(Command{coast, duty, dead});
    set_period(s, b.parameters, b.commands.front(), load_nm, b.period_s);
    b.commands.pop_front();
    run_period(s, b.period_s);
    if (s.spent[0])
        throw std::runtime_error("DrivePlant needs too many steps at " +
                                 std::to_string(s.drive.time_s) +
                                 " s: " + fastest_parameter(b.parameters));
    s.drive.load_nm = load_nm;
    const Sweep before = b.sweep;
    b.sweep = Sweep{before.end_angle, before.end_speed, seen_angle(s, b.parameters),
                    seen_speed(s, b.parameters)};
    if (b.sweep.end_angle != b.sweep.angle && !b.wheel.edge_rad.empty())
        hall_wheel_edges(b.wheel, b.sweep, b.parameters.hall_dropout_probability, b.dropout,
                         b.cycles + b.edge_delay, b.edges);
    PeriodResult r{sensed(s, b.parameters),
                   s.state.x[STATE_BUS_TIME] / b.period_s *
                       (1.0 + b.parameters.supply_gain_relative),
                   0,
                   {}};
    hall_wheel_take(b.edges, b.cycles, r);
    b.cycles += PERIOD_CYCLES;
    return r;
}

double DrivePlant::current_a() const {
    return body_->solver.state.x[STATE_CURRENT];
}
double DrivePlant::speed_rad_s() const {
    return body_->solver.state.x[STATE_SPEED];
}
double DrivePlant::angle_rad() const {
    return body_->solver.state.x[STATE_ANGLE];
}
double DrivePlant::time_s() const {
    return body_->solver.drive.time_s;
}
double DrivePlant::winding_kelvin() const {
    return body_->solver.state.x[STATE_HEAT];
}

}  // namespace vgroove
