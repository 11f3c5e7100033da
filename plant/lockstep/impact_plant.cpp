// The impact tool over an interval: commands and their delay go into the solver, means and values
// at the end come out of the step that reaches beyond it.
#include "lockstep/impact_plant.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>

#include "impact/interpolant.hpp"
#include "lockstep/body.hpp"

namespace vgroove {

constexpr double SAME_INSTANT_S = 1e-12;

struct TimedCommand {
    double from_s;
    BridgeCommand command;
};

struct ImpactBody {
    Parameters parameters;
    LockstepBody lockstep;
    std::deque<TimedCommand> commands{
        {0.0, {true, 0.0, 0.0}}};  // the one in force, then those that act later
    double now_s = 0.0, period_s, load_nm = 0.0;

    ImpactBody(const Parameters &p, HallWheel wheel, std::uint64_t seed)
        : parameters(p),
          lockstep(std::move(wheel), hall_faults(p), seed),
          period_s(PERIOD_S / (1.0 + p.effects.clock_skew.relative)) {}

    virtual ~ImpactBody() = default;
    virtual std::unique_ptr<ImpactBody> copy() const = 0;
    virtual void run(double seconds, const BridgeCommand &c, double load_rate) = 0;
    virtual double measured_current() const = 0;
    virtual double measured_bus() const = 0;
    virtual WheelReading wheel() const = 0;
    virtual void begin_means() = 0;
    virtual AdvanceResult now() const = 0;
    virtual AdvanceResult result(double seconds) const = 0;
    virtual double kelvin() const = 0;
    virtual ImpactStats statistics() const = 0;
    virtual std::vector<Blow> take_blows() = 0;

    double dead_share() const {
        return 2.0 * parameters.effects.dead_time.dead_time_s * parameters.bridge_pwm_hz;
    }

    void run_period(const BridgeCommand &c, double load_end_nm) {
        run_interval(period_s, {c.coast, c.duty, c.dead + dead_share()}, load_end_nm);
    }

    // Runs an interval with the commands in force in it; effect transport_delay: each command acts
    // that much later than it is given.
    void run_interval(double seconds, const BridgeCommand &given, double load_end_nm) {
        begin_means();
        const double rate = (load_end_nm - load_nm) / seconds;
        if (parameters.effects.transport_delay.delay_s == 0.0) {
            run(seconds, given, rate);
            now_s += seconds;
        } else {
            commands.push_back({now_s + parameters.effects.transport_delay.delay_s, given});
            run_delayed(seconds, rate);
        }
        load_nm = load_end_nm;
    }

    void run_delayed(double seconds, double load_rate) {
        double left = seconds;
        while (left > 0.0) {
            while (commands.size() > 1 && commands[1].from_s - now_s < SAME_INSTANT_S)
                commands.pop_front();
            const double until = commands.size() > 1 ? commands[1].from_s - now_s : left;
            const double length = until < left ? until : left;
            run(length, commands.front().command, load_rate);
            load_nm += load_rate * length;
            now_s += length;
            left = length == left ? 0.0 : left - length;
        }
    }
};

namespace {

template <class L> struct SolverBody final : ImpactBody {
    mutable ImpactSolver<L> solver{};  // reading a step computes its interpolant
    double charge_as = 0.0, bus_vs = 0.0, housing_nms = 0.0;  // integrals at the interval's start
    mutable ImpactState<L> returned{};  // state of the last result, and its time
    mutable double returned_s = -1.0;

    SolverBody(const Impact &m, const Parameters &p, HallWheel wheel, std::uint64_t seed)
        : ImpactBody(p, std::move(wheel), seed) {
        solver.model = m;
        solver.tolerance = L::EXACT ? IMPACT_TOLERANCE_REFERENCE : IMPACT_TOLERANCE_FAST;
        solver.parameters = &parameters;
        impact_start(solver);
    }

    std::unique_ptr<ImpactBody> copy() const override {
        auto body = std::make_unique<SolverBody<L>>(*this);
        body->solver.parameters = &body->parameters;
        return body;
    }

    void run(double seconds, const BridgeCommand &c, double load_rate) override {
        const double share = std::fabs(c.duty);
        const double dead = !c.coast && share > 0.0 && share < 1.0 ? c.dead : 0.0;
        solver.model.drive.effects &= ~static_cast<std::uint32_t>(EFFECT_DEAD_TIME);
        if (dead > 0.0)
            solver.model.drive.effects |= EFFECT_DEAD_TIME;
        impact_stretch(solver, {c.duty, 0.0, c.coast ? 1.0 : 0.0, dead, 0.0, load_nm, load_rate},
                       now_s, seconds);
    }

    double present(int n) const { return impact_present_of(solver, n); }

    void begin_means() override {
        if (returned_s == now_s) {
            charge_as = returned.x[STATE_CURRENT_TIME];
            bus_vs = returned.x[STATE_BUS_TIME];
            housing_nms = returned.x[L::HOUSING_TIME];
            return;
        }
        charge_as = present(STATE_CURRENT_TIME);
        bus_vs = present(STATE_BUS_TIME);
        housing_nms = present(L::HOUSING_TIME);
    }

    static AdvanceResult result_of(const ImpactPoint &at, const ImpactState<L> &x) {
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

    AdvanceResult now() const override {
        const ImpactState<L> x = impact_present(solver);
        ImpactState<L> ds{};
        return result_of(
            impact_derivative<L>(solver.model, solver.drive, solver.mode, solver.elapsed_s, x, ds),
            x);
    }

    // Means over the interval and values at its end. The derivative is computed only where the
    // torque of the joint depends on it.
    AdvanceResult result(double seconds) const override {
        if (solver.model.second_output)
            return with_means(now(), impact_present(solver), seconds);
        const ImpactState<L> x = impact_present(solver);
        return with_means(result_of(impact_kinematics<L>(solver.model, solver.drive, solver.mode,
                                                         solver.elapsed_s, x),
                                    x),
                          x, seconds);
    }

    AdvanceResult with_means(AdvanceResult r, const ImpactState<L> &x, double seconds) const {
        returned = x;
        returned_s = now_s;
        r.current_a =
            sensors_measured_current(parameters, (x.x[STATE_CURRENT_TIME] - charge_as) / seconds);
        r.supply_v = (x.x[STATE_BUS_TIME] - bus_vs) / seconds *
                     (1.0 + parameters.effects.supply_gain.relative);
        r.housing_nm = (x.x[L::HOUSING_TIME] - housing_nms) / seconds;
        return r;
    }

    double measured_current() const override {
        const bool lags = L::FULL && (solver.model.drive.effects & EFFECT_CURRENT_LAG);
        return sensors_measured_current(parameters,
                                        present(lags ? static_cast<int>(STATE_CURRENT_FILTER)
                                                     : static_cast<int>(STATE_CURRENT)));
    }

    double measured_bus() const override {
        return (present(STATE_BUS_TIME) - bus_vs) / period_s *
               (1.0 + parameters.effects.supply_gain.relative);
    }

    WheelReading wheel() const override {
        const Drivetrain<double> &d = solver.model.drive;
        const ShaftMotion shaft{present(STATE_SPEED), present(STATE_ANGLE),
                                L::FULL ? present(STATE_SPEED_FILTER) : 0.0};
        return {sensors_measured_angle(d.sensors, d.effects, parameters, shaft),
                sensors_measured_speed(d.sensors, d.effects, parameters, shaft)};
    }

    double kelvin() const override { return L::FULL ? present(STATE_HEAT) : 0.0; }

    ImpactStats statistics() const override { return solver.stats; }

    // The last blow stays in the recorder, which compares the next contact's lug with it.
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
    std::size_t taken = 0;  // blows of the recorder that have been returned
};

}  // namespace

ImpactPlant::ImpactPlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed,
                         ImpactAccuracy accuracy, double step_s) {
    const double fixed_s = accuracy == ImpactAccuracy::FIXED ? impact_check_step(step_s) : 0.0;
    const Impact m = impact_from(p, load, InputKind::DUTY, false, 1.0);
    const auto make = [&](auto body) {
        body->solver.fixed_s = fixed_s;
        body_ = std::move(body);
    };
    if (accuracy == ImpactAccuracy::REFERENCE)
        make(std::make_unique<SolverBody<AuditLayout>>(m, p, std::move(wheel), seed));
    else if (impact_needs_full(m))
        make(std::make_unique<SolverBody<FullLayout>>(m, p, std::move(wheel), seed));
    else
        make(std::make_unique<SolverBody<FastLayout>>(m, p, std::move(wheel), seed));
    body_->lockstep.begin(*body_);
}

ImpactPlant::~ImpactPlant() = default;
ImpactPlant::ImpactPlant(ImpactPlant &&) noexcept = default;
ImpactPlant::ImpactPlant(const ImpactPlant &other) : body_(other.body_->copy()) {}

PeriodResult ImpactPlant::period(bool coast, double duty, double dead, double load_nm) {
    return body_->lockstep.period(*body_, {coast, duty, dead}, load_nm);
}

AdvanceResult ImpactPlant::advance(double seconds, double duty, bool coast, double load_nm) {
    if (!(seconds > 0.0) || !std::isfinite(seconds + duty + load_nm))
        throw std::invalid_argument(
            "ImpactPlant.advance: seconds must be above 0, duty and load_nm finite");
    body_->run_interval(seconds, {coast, duty, body_->dead_share()}, load_nm);
    return body_->result(seconds);
}

AdvanceResult ImpactPlant::period_end() const {
    AdvanceResult r = body_->now();
    r.housing_nm = body_->result(body_->period_s).housing_nm;
    return r;
}

AdvanceResult ImpactPlant::now() const {
    return body_->now();
}
double ImpactPlant::time_s() const {
    return body_->now_s;
}
double ImpactPlant::winding_kelvin() const {
    return body_->kelvin();
}

ImpactStats ImpactPlant::statistics() const {
    return body_->statistics();
}

std::vector<Blow> ImpactPlant::take_blows() {
    return body_->take_blows();
}

}  // namespace vgroove
