// The drill driver with its modes, and its events: motor at rest, clutch, diodes, pulse mode, timed
// changes.
#ifndef VGROOVE_PLANT_DRILL_EVENTS_HPP
#define VGROOVE_PLANT_DRILL_EVENTS_HPP

#include <array>

#include "drill/charge.hpp"
#include "drill/model.hpp"

namespace vgroove {

// Events at which the equations change; each has a guard, a function that becomes negative there.
enum DrillEvent {
    DRILL_EVENT_MOTOR,
    DRILL_EVENT_CLUTCH,
    DRILL_EVENT_DIODE,
    DRILL_EVENT_PULSE_ON,
    DRILL_EVENT_PULSE_OFF,
    DRILL_EVENT_COUNT
};
using DrillGuards = std::array<double, DRILL_EVENT_COUNT>;

struct DrillSystem {
    DrillParameters p;
    DrillMode mode;
    DrillVector x = DrillVector::Zero();
    DrillSums sums = DrillSums::Zero();
    double time_s = 0.0;
    DrillCharge charge;

    // charge_spacing_s, charge_capacity: of the points of the moving average
    explicit DrillSystem(const DrillParameters &parameters, double charge_spacing_s = 0.0,
                         std::size_t charge_capacity = 64);
};

DrillGuards drill_guards(const DrillSystem &s, double time_s, const DrillVector &x, double charge);
bool drill_any(const DrillGuards &g);

// Events that a run records
enum class DrillMark {
    NONE,
    BREAK_AWAY,
    MOTOR_RESTS,
    CLUTCH_SLIPS,
    CLUTCH_GRIPS,
    CURRENT_ENDS,
    PULSE_ON,
    COAST,
    DRIVE,
    PULSE_OFF,
    LOAD_ON,
    LOAD_OFF,
    RAMP_END
};
constexpr const char *DRILL_MARKS[] = {"none",
                                       "motor breaks away",
                                       "motor comes to rest",
                                       "clutch slips",
                                       "clutch grips",
                                       "diodes block",
                                       "pulse mode begins",
                                       "coast begins",
                                       "drive begins",
                                       "normal again",
                                       "load on",
                                       "load off",
                                       "ramp ends"};

// Changes the modes of which a guard is negative, and the state that such a change fixes; returns
// the event.
DrillMark drill_switch(DrillSystem &s, const DrillGuards &g);
// Timed change between coasting and driving in pulse mode; NONE before its time.
DrillMark drill_timers(DrillSystem &s);
// The next instant at which an input or pulse mode changes by time alone; infinite for none
double drill_next_time(const DrillSystem &s);
// Opens or closes the bridge by command. Opening it ends pulse mode. A command to close it is
// ignored in pulse mode, which opens and closes the bridge by itself.
void drill_command_bridge(DrillSystem &s, bool open);
// Event of the inputs at a time: load on or off, end of the ramp; or NONE
DrillMark drill_input_mark(const DrillParameters &p, double time_s);

}  // namespace vgroove

#endif
