// Hall edges of the lock-step tools, and their faults.
#include "lockstep/body.hpp"

#include <cmath>
#include <utility>

#include "components/effects.hpp"

namespace vgroove {

HallFaults hall_faults(const Parameters &p) {
    return {p.effects.hall_dropout.probability,
            p.effects.speed_lag.lag_form == LAG_DELAY
                ? std::llround(p.effects.speed_lag.time_constant_s * CPU_HZ)
                : 0};
}

LockstepBody::LockstepBody(HallWheel wheel, const HallFaults &faults, std::uint64_t seed)
    : wheel_(std::move(wheel)),
      faults_(faults),
      dropout_{seed} {}

void LockstepBody::add_edges(const WheelReading &end) {
    const WheelReading from = reading_;
    reading_ = end;
    if (end.angle != from.angle && !wheel_.edge_rad.empty())
        hall_wheel_edges(wheel_, {from.angle, from.speed, end.angle, end.speed},
                         faults_.dropout_probability, dropout_, cycles_ + faults_.delay_cycles,
                         edges_);
}

}  // namespace vgroove
