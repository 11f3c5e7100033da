// What the three lock-step tools share: a PWM period from the bridge command to the measured
// current and bus and the edges of the Hall wheel.
#ifndef VGROOVE_PLANT_LOCKSTEP_BODY_HPP
#define VGROOVE_PLANT_LOCKSTEP_BODY_HPP

#include <cstdint>
#include <deque>

#include "components/hall_wheel.hpp"
#include "components/parameters.hpp"

namespace vgroove {

// Duty and dead time hold over the period. dead: share of the bus lost to dead time, 0 where the
// bridge does not switch.
struct BridgeCommand {
    bool coast;
    double duty, dead;
};

// Angle and speed of the motor shaft as the Hall wheel shows them
struct WheelReading {
    double angle, speed;
};

// One tool over one period
class LockstepTool {
public:
    virtual ~LockstepTool() = default;
    // load_nm: at the end of the period
    virtual void run_period(const BridgeCommand &command, double load_nm) = 0;
    virtual double measured_current() const = 0;  // at the end, A
    virtual double measured_bus() const = 0;      // mean, V
    virtual WheelReading wheel() const = 0;       // at the end
};

// Faults of the Hall sensor: lost edges, and a delay in CPU cycles
struct HallFaults {
    double dropout_probability = 0.0;
    std::int64_t delay_cycles = 0;
};

// Effects hall_dropout, and speed_lag in the form of a delay
HallFaults hall_faults(const Parameters &p);

class LockstepBody {
public:
    LockstepBody(HallWheel wheel, const HallFaults &faults, std::uint64_t seed);
    // Takes the wheel's angle and speed as those at the start of the next period.
    void begin(const LockstepTool &tool);
    PeriodResult period(LockstepTool &tool, const BridgeCommand &command, double load_nm);

private:
    HallWheel wheel_;
    HallFaults faults_;
    Noise dropout_;
    std::deque<std::int64_t> edges_;  // CPU cycles since the start of the run, not yet delivered
    std::int64_t cycles_ = 0;         // at the start of the period
    WheelReading reading_{0.0, 0.0};
};

}  // namespace vgroove

#endif
