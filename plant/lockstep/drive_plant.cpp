// One PWM period of the drivetrain: the delayed command, dead time and load go into the solver.
#include "lockstep/drive_plant.hpp"

#include <cmath>
#include <deque>
#include <stdexcept>
#include <string>
#include <utility>

#include "drivetrain/settle.hpp"
#include "drivetrain/solver.hpp"
#include "lockstep/body.hpp"

namespace vgroove {

using DriveSolver = Solver<double, STATE_FULL_COUNT>;

// A function of its own that the compiler flattens: the solver's loop in one piece.
__attribute__((flatten)) static void run_solver(DriveSolver &s, double period_s) {
    s.allowed_s = 1.0;
    flush_tiny(s.state);
    solver_grant_steps(s, 0, 1, period_s);
    solver_begin(s, 0, period_s);
    solver_run<false>(
        s, [](int) __attribute__((always_inline)) { return false; });
}

struct DrivePlant::Body {
    DriveSolver solver{};
    Parameters parameters;
    LockstepBody lockstep;
    std::deque<BridgeCommand> commands;  // effect transport_delay in whole periods
    double period_s;

    Body(const Parameters &p, HallWheel wheel, std::uint64_t seed)
        : parameters(p),
          lockstep(std::move(wheel), hall_faults(p), seed),
          commands(delay_periods(p), BridgeCommand{true, 0.0, 0.0}),
          period_s(PERIOD_S / (1.0 + p.effects.clock_skew.relative)) {}

    static std::size_t delay_periods(const Parameters &p) {
        return static_cast<std::size_t>(
            std::llround(p.effects.transport_delay.delay_s /
                         (PERIOD_S / (1.0 + p.effects.clock_skew.relative))));
    }

    void set_drive(const BridgeCommand &c, double load_nm) {
        const double share = std::fabs(c.duty);
        const bool switches = !c.coast && share > 0.0 && share < 1.0;
        Drive<double> &d = solver.drive;
        d.command = c.duty;
        d.command_rate = 0.0;
        d.open = c.coast ? 1.0 : 0.0;
        d.dead = switches ? c.dead + solver.model.bridge.dead_share : 0.0;
        d.load_rate = (load_nm - d.load_nm) / period_s;
        solver.state.x[STATE_CURRENT_TIME] = 0.0;
        solver.state.x[STATE_BUS_TIME] = 0.0;
    }

    void run_period(const BridgeCommand &command, double load_nm) {
        commands.push_back(command);
        set_drive(commands.front(), load_nm);
        commands.pop_front();
        run_solver(solver, period_s);
        if (solver.exhausted[0])
            throw std::runtime_error("DrivePlant needs too many steps at " +
                                     std::to_string(solver.drive.time_s) +
                                     " s: " + fastest_parameter(parameters));
        solver.drive.load_nm = load_nm;
    }

    double measured_current() const {
        const bool lags = (solver.model.effects & EFFECT_CURRENT_LAG) != 0u;
        return sensors_measured_current(
            parameters, solver.state.x[lags ? STATE_CURRENT_FILTER : STATE_CURRENT]);
    }

    double measured_bus() const {
        return solver.state.x[STATE_BUS_TIME] / period_s *
               (1.0 + parameters.effects.supply_gain.relative);
    }

    WheelReading wheel() const {
        const double *x = solver.state.x;
        const Drivetrain<double> &m = solver.model;
        const ShaftMotion shaft{x[STATE_SPEED], x[STATE_ANGLE], x[STATE_SPEED_FILTER]};
        return {sensors_measured_angle(m.sensors, m.effects, parameters, shaft),
                sensors_measured_speed(m.sensors, m.effects, parameters, shaft)};
    }
};

DrivePlant::DrivePlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed) {
    check_parameters(p, true);
    body_ = std::make_unique<Body>(p, std::move(wheel), seed);
    DriveSolver &s = body_->solver;
    s.model.effects = effects_of(p, load_inertia(p, load)) | EFFECT_DEAD_TIME;
    s.model.input = InputKind::DUTY;
    s.model.load.kind = load;
    drivetrain_set_lane(s.model, 0, p, p.supply_voltage_v, PERIOD_S);
    solver_prepare(s, 0.0);
    reset(0.0, 0.0, 0.0);
}

DrivePlant::~DrivePlant() = default;
DrivePlant::DrivePlant(DrivePlant &&) noexcept = default;
DrivePlant::DrivePlant(const DrivePlant &other) : body_(std::make_unique<Body>(*other.body_)) {}

void DrivePlant::reset(double current_a, double speed_rad_s, double angle_rad) {
    const double start[3] = {current_a, speed_rad_s, angle_rad};
    settle_shaft(body_->solver, 0, start);
    body_->lockstep.begin(*body_);
}

PeriodResult DrivePlant::period(bool coast, double duty, double dead, double load_nm) {
    return body_->lockstep.period(*body_, {coast, duty, dead}, load_nm);
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
