// Runs of the drill driver: variable-step reference with event location, fixed-step explicit Euler
// and RK4, and the real-time mode.
#ifndef VGROOVE_PLANT_DRILL_SOLVERS_HPP
#define VGROOVE_PLANT_DRILL_SOLVERS_HPP

#include <memory>
#include <vector>

#include "drill/model.hpp"
#include "numeric/watch.hpp"

namespace vgroove {

enum class DrillSolver { REFERENCE, EULER, RK4, REAL_TIME };

struct DrillRequest {
    DrillSolver solver = DrillSolver::REFERENCE;
    double duration_s = 4.0;
    double step_s = 0.0;  // of the fixed-step solvers
    double tolerance =
        1e-8;  // of the reference: local error over the size of each state (drill_scales)
    double step_max_s = 0.0;  // of the reference; 0: a fiftieth of the run
    double row_s = 0.0;       // distance of the rows; 0: every step
    bool timed = false;       // measure the execution time of every fixed step
    Watch *watch = nullptr;   // asked now and then whether the run is still wanted
};

enum DrillColumn {
    DRILL_ROW_TIME,
    DRILL_ROW_CORE,
    DRILL_ROW_SHAFT = DRILL_ROW_CORE + DRILL_CORE_COUNT,
    DRILL_ROW_DUTY,
    DRILL_ROW_CONTROL,
    DRILL_ROW_STORED,
    DRILL_ROW_SUMS,
    DRILL_ROW_COUNT = DRILL_ROW_SUMS + DRILL_SUM_COUNT
};
extern const char *const DRILL_ROW_NAMES[DRILL_ROW_COUNT];

struct DrillStep {
    double time_s, length_s;  // its end
    DrillMark mark;           // what ended it, or NONE
};

struct DrillRun {
    std::vector<double> rows;      // row-major, DRILL_ROW_COUNT a row
    std::vector<DrillStep> steps;  // reference: all accepted ones
    std::vector<DrillStep>
        marks;  // what happened when; fixed-step solvers see it at the end of the step
    std::vector<double> execution_ns;  // timed fixed steps
    std::size_t rejected =
        0;  // reference: attempts thrown away, by their error or to locate an event
    double diverged_s = 0.0;  // when a fixed-step solver left every physical range; 0: it did not
};

// Throws std::invalid_argument for parameters or a request outside their range.
DrillRun drill_run(const DrillParameters &p, const DrillRequest &request);

// What a board asks for over the next step, and the load that the tool meets in it.
struct DrillCommand {
    bool open;
    double duty, bus_v, load_nm;
};

// The real-time mode by itself: bounded work per step, nothing allocated in step().
class DrillRealTime {
public:
    DrillRealTime(const DrillParameters &p, double step_s);
    ~DrillRealTime();
    void step();
    // From now on these take the place of the parameters' ramp, supply and timed load.
    void command(const DrillCommand &c);
    const DrillSystem &system() const;
    // Where the changes within the steps are noted, if anywhere; for records, not for real time.
    std::vector<DrillStep> *marks = nullptr;
    // Linear advances that the last step took, and that a step can take at most: its pieces, and
    // the search for the changes it may locate.
    int advances() const;
    int advances_max() const;

    struct Body;

private:
    std::unique_ptr<Body> body_;
};

}  // namespace vgroove

#endif
