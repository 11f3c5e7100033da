// Lock-step face of the impact tool: commands and their delay, the solver over an interval, edges of the Hall wheel out of the angle.
#include "impact_plant.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

namespace vgroove {

struct TimedCommand {
    double from_s;
    bool coast;
    double duty, dead;
};

struct ImpactBody {
    Parameters parameters;
    HallWheel wheel;
    Noise dropout;
    std::deque<TimedCommand> commands;  // in force and still to come
    std::deque<std::int64_t> edges;     // cycles since start at which each is seen
    std::int64_t cycles = 0, edge_delay = 0;
    double now_s = 0.0, period_s = PERIOD_S, load_nm = 0.0;
    Sweep sweep{};

    virtual ~ImpactBody() = default;
    virtual void run(double seconds, const TimedCommand &c, double load_from_nm, double load_rate) = 0;
    virtual void reset_means() = 0;
    virtual AdvanceResult now() const = 0;  // true values of this instant
    virtual AdvanceResult result(double seconds) const = 0;
    virtual double sensed_current() const = 0;
    virtual double mean_bus(double seconds) const = 0;
    virtual double seen_angle() const = 0;
    virtual double seen_speed() const = 0;
    virtual double kelvin() const = 0;
    virtual ImpactStats statistics() const = 0;
    virtual std::vector<Blow> take_blows() = 0;
};

namespace {

template <class L> struct SolverBody final : ImpactBody {
    ImpactSolver<L> solver{};
    std::size_t taken = 0;

    void run(double seconds, const TimedCommand &c, double load_from_nm, double load_rate) override {
        Drive<double> &d = solver.drive;
        const double share = std::fabs(c.duty), open = c.coast ? 1.0 : 0.0;
        const double dead = !c.coast && share > 0.0 && share < 1.0 ? c.dead : 0.0;
        const bool goes_on = d.command == c.duty && d.open == open && d.dead == dead && d.load_rate == load_rate;
        d.command = c.duty;
        d.open = open;
        d.dead = dead;
        d.load_nm = load_from_nm;
        d.load_rate = load_rate;
        if (!goes_on)
            impact_new_stretch(solver);
        impact_run(solver, seconds);
    }

    void reset_means() override {
        double *x = solver.state.x;
        x[STATE_CURRENT_TIME] = x[STATE_BUS_TIME] = x[L::HOUSING_TIME] = 0.0;
    }

    double read_current(double i) const {
        return std::min(std::max(i * (1.0 + parameters.current_gain_relative) + parameters.current_offset_a, -parameters.current_limit_a),
                        parameters.current_limit_a);
    }

    AdvanceResult now() const override {
        const double *x = solver.state.x;
        const ImpactPoint &at = solver.point;
        return {at.i,        at.bus_v,   x[STATE_SPEED], x[STATE_ANGLE], at.joint_nm, x[L::ANVIL_ANGLE],
                at.head_rad, 1e3 * at.x, at.housing_nm,  x[L::ARM_ANGLE]};
    }

    AdvanceResult result(double seconds) const override {
        AdvanceResult r = now();
        r.current_a = read_current(solver.state.x[STATE_CURRENT_TIME] / seconds);
        r.supply_v = mean_bus(seconds);
        r.housing_nm = solver.state.x[L::HOUSING_TIME] / seconds;
        return r;
    }

    double sensed_current() const override {
        double i = solver.state.x[STATE_CURRENT];
        if constexpr (L::FULL)
            i = solver.model.drive.effects & EFFECT_CURRENT_LAG ? solver.state.x[STATE_CURRENT_FILTER] : i;
        return read_current(i);
    }

    double mean_bus(double seconds) const override { return solver.state.x[STATE_BUS_TIME] / seconds * (1.0 + parameters.supply_gain_relative); }

    double seen_angle() const override {
        const Drivetrain<double> &d = solver.model.drive;
        double angle = sensors_wheel_angle<double>(d.sensors, d.effects, solver.state.x[STATE_ANGLE]);
        if constexpr (L::FULL)
            if (d.effects & EFFECT_SPEED_LAG)
                angle -= parameters.speed_lag_s * solver.state.x[STATE_SPEED_FILTER];
        return angle * (1.0 + parameters.speed_gain_relative);
    }

    double seen_speed() const override {
        const Drivetrain<double> &d = solver.model.drive;
        double speed = sensors_wheel_speed<double>(d.sensors, d.effects, solver.state.x[STATE_SPEED], solver.state.x[STATE_ANGLE]);
        if constexpr (L::FULL)
            speed = d.effects & EFFECT_SPEED_LAG ? solver.state.x[STATE_SPEED_FILTER] : speed;
        return speed * (1.0 + parameters.speed_gain_relative);
    }

    double kelvin() const override {
        if constexpr (L::FULL)
            return solver.state.x[STATE_HEAT];
        return 0.0;
    }

    ImpactStats statistics() const override { return solver.stats; }

    std::vector<Blow> take_blows() override {
        const std::vector<Blow> &all = solver.recorder.blows;
        const std::vector<Blow> fresh(all.begin() + static_cast<std::ptrdiff_t>(taken), all.end());
        if (all.size() > 1)  // the last one goes on and names the lug of the next
            solver.recorder.blows.erase(solver.recorder.blows.begin(), solver.recorder.blows.end() - 1);
        taken = solver.recorder.blows.size();
        return fresh;
    }
};

template <class L> std::unique_ptr<ImpactBody> body_of(const Impact &m, double fixed_s) {
    auto body = std::make_unique<SolverBody<L>>();
    body->solver.model = m;
    body->solver.tolerance = L::EXACT ? IMPACT_TOLERANCE_REFERENCE : IMPACT_TOLERANCE_FAST;
    body->solver.fixed_s = fixed_s;
    impact_start(body->solver);
    impact_refresh(body->solver);
    return body;
}

}  // namespace

ImpactPlant::ImpactPlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed, ImpactAccuracy accuracy, double step_s) {
    const double fixed_s = accuracy == ImpactAccuracy::FIXED ? step_s : 0.0;
    Impact m = impact_from(p, load, InputKind::DUTY, false, 1.0);
    m.drive.effects |= EFFECT_DEAD_TIME;
    if (accuracy == ImpactAccuracy::REFERENCE)
        body_ = body_of<AuditLayout>(m, 0.0);
    else
        body_ = impact_needs_full(m) ? body_of<FullLayout>(m, fixed_s) : body_of<FastLayout>(m, fixed_s);
    ImpactBody &b = *body_;
    b.parameters = p;
    b.wheel = std::move(wheel);
    b.dropout.state = seed;
    b.period_s = PERIOD_S / (1.0 + p.clock_skew_relative);
    b.edge_delay = p.speed_lag_delay_form != 0.0 ? std::llround(p.speed_lag_s * CPU_HZ) : 0;
    b.commands.push_back({0.0, true, 0.0, 0.0});
    b.sweep = Sweep{0.0, 0.0, b.seen_angle(), b.seen_speed()};
}

ImpactPlant::~ImpactPlant() = default;
ImpactPlant::ImpactPlant(ImpactPlant &&) noexcept = default;

// Runs an interval with the commands in force in it: each acts transport_delay after it is given.
static void run_interval(ImpactBody &b, double seconds, const TimedCommand &given, double load_nm) {
    b.reset_means();
    const double rate = (load_nm - b.load_nm) / seconds;
    if (b.parameters.transport_delay_s == 0.0) {
        b.run(seconds, given, b.load_nm, rate);
        b.now_s += seconds;
        b.load_nm = load_nm;
        return;
    }
    TimedCommand late = given;
    late.from_s = b.now_s + b.parameters.transport_delay_s;
    b.commands.push_back(late);
    double left = seconds;
    while (left > 0.0) {
        while (b.commands.size() > 1 && b.commands[1].from_s - b.now_s < 1e-12)
            b.commands.pop_front();
        const double until = b.commands.size() > 1 ? b.commands[1].from_s - b.now_s : left;
        const double length = until < left ? until : left;
        b.run(length, b.commands.front(), b.load_nm, rate);
        b.load_nm += rate * length;
        b.now_s += length;
        left = length == left ? 0.0 : left - length;
    }
    b.load_nm = load_nm;
}

PeriodResult ImpactPlant::period(bool coast, double duty, double dead, double load_nm) {
    ImpactBody &b = *body_;
    run_interval(b, b.period_s, {0.0, coast, duty, dead + 2.0 * b.parameters.dead_time_s * b.parameters.bridge_pwm_hz}, load_nm);
    b.sweep = Sweep{b.sweep.end_angle, b.sweep.end_speed, b.seen_angle(), b.seen_speed()};
    if (b.sweep.end_angle != b.sweep.angle && !b.wheel.edge_rad.empty())
        hall_wheel_edges(b.wheel, b.sweep, b.parameters.hall_dropout_probability, b.dropout, b.cycles + b.edge_delay, b.edges);
    PeriodResult r{b.sensed_current(), b.mean_bus(b.period_s), 0, {}};
    hall_wheel_take(b.edges, b.cycles, r);
    b.cycles += PERIOD_CYCLES;
    return r;
}

AdvanceResult ImpactPlant::advance(double seconds, double duty, bool coast, double load_nm) {
    ImpactBody &b = *body_;
    run_interval(b, seconds, {0.0, coast, duty, 2.0 * b.parameters.dead_time_s * b.parameters.bridge_pwm_hz}, load_nm);
    return b.result(seconds);
}

AdvanceResult ImpactPlant::period_end() const {
    AdvanceResult r = body_->now();
    r.housing_nm = body_->result(body_->period_s).housing_nm;
    return r;
}

double ImpactPlant::current_a() const {
    return body_->now().current_a;
}
double ImpactPlant::speed_rad_s() const {
    return body_->now().speed_rad_s;
}
double ImpactPlant::angle_rad() const {
    return body_->now().angle_rad;
}
double ImpactPlant::time_s() const {
    return body_->now_s;
}
double ImpactPlant::winding_kelvin() const {
    return body_->kelvin();
}
double ImpactPlant::hammer_mm() const {
    return body_->now().hammer_mm;
}
double ImpactPlant::anvil_torque_nm() const {
    return body_->now().anvil_torque_nm;
}
double ImpactPlant::anvil_angle_rad() const {
    return body_->now().anvil_angle_rad;
}
double ImpactPlant::head_rad() const {
    return body_->now().head_rad;
}
double ImpactPlant::housing_nm() const {
    return body_->now().housing_nm;
}
double ImpactPlant::arm_rad() const {
    return body_->now().arm_rad;
}

ImpactStats ImpactPlant::statistics() const {
    return body_->statistics();
}

std::vector<Blow> ImpactPlant::take_blows() {
    return body_->take_blows();
}

}  // namespace vgroove
