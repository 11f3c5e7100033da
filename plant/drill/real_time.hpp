// The drill driver's real-time mode: fixed steps of bounded work.
#ifndef VGROOVE_PLANT_DRILL_REAL_TIME_HPP
#define VGROOVE_PLANT_DRILL_REAL_TIME_HPP

#include <memory>
#include <vector>

#include "drill/run.hpp"

namespace vgroove {

// Command and load of the next steps
struct DrillCommand {
    bool open;
    double duty, bus_v, load_nm;
};

// Bounded work per step; step() allocates no memory.
class DrillRealTime {
public:
    DrillRealTime(const DrillParameters &p, double step_s);
    ~DrillRealTime();
    DrillRealTime(const DrillRealTime &);  // the copy records no events
    void step();
    // Replaces ramp, supply and timed load of the parameters.
    void command(const DrillCommand &c);
    const DrillSystem &system() const;
    // Where events within the steps are recorded; null in real time, because a record allocates.
    std::vector<DrillStep> *marks = nullptr;
    // Number of linear advances (matrix products) of the last step, and its upper bound: those of
    // the pieces of a step and of the location of its events.
    int advances() const;
    int advances_max() const;

    struct Body;  // data of the solver, defined in real_time.cpp

private:
    std::unique_ptr<Body> body_;
};

}  // namespace vgroove

#endif
