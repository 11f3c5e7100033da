// A PWM period of any lock-step tool, and the Hall edges from its motion.
#include "lockstep/body.hpp"

#include <cmath>
#include <utility>

namespace vgroove {

HallFaults hall_faults(const Parameters &p) {
    return {p.effects.hall_dropout.probability,
            p.effects.speed_lag.delay_form != 0.0
                ? std::llround(p.effects.speed_lag.time_constant_s * CPU_HZ)
                : 0};
}

LockstepBody::LockstepBody(HallWheel wheel, const HallFaults &faults, std::uint64_t seed)
    : wheel_(std::move(wheel)),
      faults_(faults),
      dropout_{seed} {}

void LockstepBody::begin(const LockstepTool &tool) {
    reading_ = tool.wheel();
}

PeriodResult LockstepBody::period(LockstepTool &tool, const BridgeCommand &command,
                                  double load_nm) {
    tool.run_period(command, load_nm);
    const WheelReading before = reading_;
    reading_ = tool.wheel();
    if (reading_.angle != before.angle && !wheel_.edge_rad.empty())
        hall_wheel_edges(wheel_, {before.angle, before.speed, reading_.angle, reading_.speed},
                         faults_.dropout_probability, dropout_, cycles_ + faults_.delay_cycles,
                         edges_);
    PeriodResult r{tool.measured_current(), tool.measured_bus(), 0, {}};
    hall_wheel_take(edges_, cycles_, r);
    cycles_ += PERIOD_CYCLES;
    return r;
}

}  // namespace vgroove
