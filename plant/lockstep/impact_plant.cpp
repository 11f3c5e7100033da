// Lock-step face of the impact tool: commands and their delay, the solver over an interval, edges
// of the Hall wheel out of the angle.
#include "lockstep/impact_plant.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
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
    virtual void run(double seconds, const TimedCommand &c, double load_from_nm,
                     double load_rate) = 0;
    virtual void adopt() = 0;  // the parameters, once they are there
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
    mutable ImpactSolver<L> solver{};  // looking into a step shapes its interpolant
    double charge_as = 0.0, bus_vs = 0.0,
           housing_nms = 0.0;       // integrals at the start of the interval
    mutable ImpactState<L> seen{};  // state at the end of an interval, as it was given away,
    mutable double seen_s = -1.0;   // and when

    void run(double seconds, const TimedCommand &c, double load_from_nm,
             double load_rate) override {
        const double share = std::fabs(c.duty);
        const double dead = !c.coast && share > 0.0 && share < 1.0 ? c.dead : 0.0;
        solver.model.drive.effects &= ~static_cast<std::uint32_t>(EFFECT_DEAD_TIME);
        if (dead > 0.0)
            solver.model.drive.effects |= EFFECT_DEAD_TIME;
        impact_stretch(solver,
                       {c.duty, 0.0, c.coast ? 1.0 : 0.0, dead, 0.0, load_from_nm, load_rate},
                       now_s, seconds);
    }

    void adopt() override { solver.parameters = &parameters; }

    double present(int n) const { return impact_present_of(solver, n); }

    void reset_means() override {
        if (seen_s == now_s) {
            charge_as = seen.x[STATE_CURRENT_TIME];
            bus_vs = seen.x[STATE_BUS_TIME];
            housing_nms = seen.x[L::HOUSING_TIME];
            return;
        }
        charge_as = present(STATE_CURRENT_TIME);
        bus_vs = present(STATE_BUS_TIME);
        housing_nms = present(L::HOUSING_TIME);
    }

    AdvanceResult now() const override {
        const ImpactState<L> x = impact_present(solver);
        ImpactState<L> ds{};
        const ImpactPoint at =
            impact_derivative<L>(solver.model, solver.drive, solver.mode, solver.into_s, x, ds);
        return {at.i,
                at.bus_v,
                x.x[STATE_SPEED],
                x.x[STATE_ANGLE],
                at.joint_nm,
                x.x[L::ANVIL_ANGLE],
                at.head_rad,
                1e3 * at.x,
                at.housing_nm,
                x.x[L::ARM_ANGLE]};
    }

    // Means and values of this instant, from one look into the step; the whole derivative only
    // where it decides the joint's torque.
    AdvanceResult result(double seconds) const override {
        if (solver.model.second_output)
            return meant(now(), impact_present(solver), seconds);
        const ImpactState<L> x = impact_present(solver);
        const ImpactPoint at =
            impact_sight<L>(solver.model, solver.drive, solver.mode, solver.into_s, x);
        const AdvanceResult r{0.0,
                              0.0,
                              x.x[STATE_SPEED],
                              x.x[STATE_ANGLE],
                              at.joint_nm,
                              x.x[L::ANVIL_ANGLE],
                              at.head_rad,
                              1e3 * at.x,
                              0.0,
                              x.x[L::ARM_ANGLE]};
        return meant(r, x, seconds);
    }

    AdvanceResult meant(AdvanceResult r, const ImpactState<L> &x, double seconds) const {
        seen = x;
        seen_s = now_s;
        r.current_a =
            sensors_read_current(parameters, (x.x[STATE_CURRENT_TIME] - charge_as) / seconds);
        r.supply_v =
            (x.x[STATE_BUS_TIME] - bus_vs) / seconds * (1.0 + parameters.supply_gain_relative);
        r.housing_nm = (x.x[L::HOUSING_TIME] - housing_nms) / seconds;
        return r;
    }

    double sensed_current() const override {
        const bool lags = L::FULL && (solver.model.drive.effects & EFFECT_CURRENT_LAG);
        return sensors_read_current(parameters,
                                    present(lags ? static_cast<int>(STATE_CURRENT_FILTER)
                                                 : static_cast<int>(STATE_CURRENT)));
    }

    double mean_bus(double seconds) const override {
        return (present(STATE_BUS_TIME) - bus_vs) / seconds *
               (1.0 + parameters.supply_gain_relative);
    }

    double filtered_speed() const { return L::FULL ? present(STATE_SPEED_FILTER) : 0.0; }

    double seen_angle() const override {
        const Drivetrain<double> &d = solver.model.drive;
        return sensors_seen_angle(d.sensors, d.effects, parameters, present(STATE_ANGLE),
                                  filtered_speed());
    }

    double seen_speed() const override {
        const Drivetrain<double> &d = solver.model.drive;
        return sensors_seen_speed(d.sensors, d.effects, parameters, present(STATE_SPEED),
                                  present(STATE_ANGLE), filtered_speed());
    }

    double kelvin() const override { return L::FULL ? present(STATE_HEAT) : 0.0; }

    ImpactStats statistics() const override { return solver.stats; }

    // Those whose contact is over and whose torque has passed its peak; the last one stays, it
    // names the lug of the next.
    std::vector<Blow> take_blows() override {
        BlowRecorder &r = solver.recorder;
        const bool settled =
            !r.open && (r.blows.empty() ||
                        std::fabs(now().anvil_torque_nm) < 0.5 * r.blows.back().peak_torque_nm);
        const std::size_t done = r.blows.size() - (settled ? 0 : 1);
        const std::vector<Blow> fresh(r.blows.begin() +
                                          static_cast<std::ptrdiff_t>(std::min(taken, done)),
                                      r.blows.begin() + static_cast<std::ptrdiff_t>(done));
        taken = std::max(taken, done);
        const std::size_t spare =
            taken > 0 && r.blows.size() > 1 ? std::min(taken, r.blows.size() - 1) : 0;
        r.blows.erase(r.blows.begin(), r.blows.begin() + static_cast<std::ptrdiff_t>(spare));
        taken -= spare;
        return fresh;
    }

private:
    std::size_t taken = 0;
};

template <class L> std::unique_ptr<ImpactBody> body_of(const Impact &m, double fixed_s) {
    auto body = std::make_unique<SolverBody<L>>();
    body->solver.model = m;
    body->solver.tolerance = L::EXACT ? IMPACT_TOLERANCE_REFERENCE : IMPACT_TOLERANCE_FAST;
    body->solver.fixed_s = fixed_s;
    impact_start(body->solver);
    return body;
}

}  // namespace

ImpactPlant::ImpactPlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed,
                         ImpactAccuracy accuracy, double step_s) {
    const double fixed_s = accuracy == ImpactAccuracy::FIXED ? impact_check_step(step_s) : 0.0;
    const Impact m = impact_from(p, load, InputKind::DUTY, false, 1.0);
    if (accuracy == ImpactAccuracy::REFERENCE)
        body_ = body_of<AuditLayout>(m, 0.0);
    else
        body_ = impact_needs_full(m) ? body_of<FullLayout>(m, fixed_s)
                                     : body_of<FastLayout>(m, fixed_s);
    ImpactBody &b = *body_;
    b.parameters = p;
    b.adopt();
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
    run_interval(
        b, b.period_s,
        {0.0, coast, duty, dead + 2.0 * b.parameters.dead_time_s * b.parameters.bridge_pwm_hz},
        load_nm);
    b.sweep = Sweep{b.sweep.end_angle, b.sweep.end_speed, b.seen_angle(), b.seen_speed()};
    if (b.sweep.end_angle != b.sweep.angle && !b.wheel.edge_rad.empty())
        hall_wheel_edges(b.wheel, b.sweep, b.parameters.hall_dropout_probability, b.dropout,
                         b.cycles + b.edge_delay, b.edges);
    PeriodResult r{b.sensed_current(), b.mean_bus(b.period_s), 0, {}};
    hall_wheel_take(b.edges, b.cycles, r);
    b.cycles += PERIOD_CYCLES;
    return r;
}

AdvanceResult ImpactPlant::advance(double seconds, double duty, bool coast, double load_nm) {
    if (!(seconds > 0.0) || !std::isfinite(seconds + duty + load_nm))
        throw std::invalid_argument(
            "ImpactPlant.advance: seconds must be above 0, duty and load_nm finite");
    ImpactBody &b = *body_;
    run_interval(b, seconds,
                 {0.0, coast, duty, 2.0 * b.parameters.dead_time_s * b.parameters.bridge_pwm_hz},
                 load_nm);
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
