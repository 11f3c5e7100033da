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

// Faults of the Hall sensor: probability that an edge is lost, and a delay in CPU cycles
struct HallFaults {
    double dropout_probability = 0.0;
    std::int64_t delay_cycles = 0;
};

// Effects hall_dropout, and speed_lag in the form of a delay
HallFaults hall_faults(const Parameters &p);

// A tool has
//   void run_period(const BridgeCommand &, double load_nm)   load_nm: at the end of the period
//   double measured_current() const                          at the end, A
//   double measured_bus() const                              mean, V
//   WheelReading wheel() const                               at the end
class LockstepBody {
public:
    LockstepBody(HallWheel wheel, const HallFaults &faults, std::uint64_t seed);

    // Takes the wheel's angle and speed as those at the start of the next period.
    template <class Tool> void begin(const Tool &tool) { reading_ = tool.wheel(); }

    template <class Tool>
    PeriodResult period(Tool &tool, const BridgeCommand &command, double load_nm) {
        tool.run_period(command, load_nm);
        add_edges(tool.wheel());
        PeriodResult r{tool.measured_current(), tool.measured_bus(), 0, {}};
        hall_wheel_take(edges_, cycles_, r);
        cycles_ += PERIOD_CYCLES;
        return r;
    }

private:
    void add_edges(const WheelReading &end);  // of the motion since the last reading

    HallWheel wheel_;
    HallFaults faults_;
    Noise dropout_;
    std::deque<std::int64_t> edges_;  // CPU cycles since the start of the run, not yet delivered
    std::int64_t cycles_ = 0;         // at the start of the period
    WheelReading reading_{0.0, 0.0};
};

}  // namespace vgroove

#endif
