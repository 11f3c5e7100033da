// The drill driver in lock-step: with a board a PWM period at a time, or with any controller an
// interval at a time.
#ifndef VGROOVE_PLANT_LOCKSTEP_DRILL_PLANT_HPP
#define VGROOVE_PLANT_LOCKSTEP_DRILL_PLANT_HPP

#include <cstdint>
#include <memory>

#include "components/hall_wheel.hpp"
#include "drill/model.hpp"

namespace vgroove {

// What an interval came to: means of current and bus, the largest shaft torque, the rest at its
// end.
struct DrillInterval {
    double current_a, supply_v, shaft_peak_nm, speed_rad_s, angle_rad, chuck_rad_s, chuck_angle_rad,
        shaft_nm, load_nm;
    double slipped_s;  // how long the clutch slipped
};

// The load at the chuck is the friction law over Tc = what the parameters put on between from_s and
// to_s + rise_nm_per_rad times the chuck's angle past rise_from_rad, at most rise_most_nm, + the
// torque that comes with each period.
class DrillPlant {
public:
    // supply_ohm: of the pack. step_s: of period(), 510 CPU cycles unless the plant runs alone.
    DrillPlant(const DrillParameters &p, double supply_ohm, HallWheel wheel, double step_s);
    ~DrillPlant();
    DrillPlant(DrillPlant &&) noexcept;

    // As DrivePlant::period. With the parameters' pulse mode on, it replaces the duty as physics.md
    // section 7 has it: for runs without a board.
    PeriodResult period(bool coast, double duty, double dead, double load_nm);

    // A whole number of steps; the duty runs straight from `duty_from` to `duty`.
    DrillInterval advance(double seconds, double duty_from, double duty, bool coast,
                          double load_nm);

    const DrillSystem &system() const;
    double time_s() const;
    double load_nm() const;  // Tc of the last period
    double shaft_nm() const;

private:
    struct Body;
    std::unique_ptr<Body> body_;
};

}  // namespace vgroove

#endif
