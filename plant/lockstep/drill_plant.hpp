// The drill driver in lock-step: with a board, one PWM period a call; with any other controller,
// one interval a call.
#ifndef VGROOVE_PLANT_LOCKSTEP_DRILL_PLANT_HPP
#define VGROOVE_PLANT_LOCKSTEP_DRILL_PLANT_HPP

#include <cstdint>
#include <memory>

#include "components/hall_wheel.hpp"
#include "drill/events.hpp"

namespace vgroove {

// An interval: current and bus as means, the largest shaft torque, the others at its end
struct DrillInterval {
    double current_a, supply_v, shaft_peak_nm, speed_rad_s, angle_rad, chuck_rad_s, chuck_angle_rad,
        shaft_nm, load_nm;
    double slipped_s;  // time during which the clutch slipped
};

// The load at the chuck is the friction law with Tc = torque_nm between from_s and to_s, plus
// rise_nm_per_rad times the chuck's angle past rise_from_rad up to rise_most_nm, plus the load
// torque of each period.
class DrillPlant {
public:
    // supply_ohm: of the pack. step_s: length of a period; 510 CPU cycles with a board.
    DrillPlant(const DrillParameters &p, double supply_ohm, HallWheel wheel, double step_s);
    ~DrillPlant();
    DrillPlant(DrillPlant &&) noexcept;
    DrillPlant(const DrillPlant &);

    // As DrivePlant::period. Pulse mode of the parameters replaces the duty (docs/spec/model.md,
    // section 7): for runs without a board.
    PeriodResult period(bool coast, double duty, double dead, double load_nm);

    // A whole number of periods; the duty runs linearly from `duty_from` to `duty`.
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
