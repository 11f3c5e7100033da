// A run of the drill driver by one of its solvers: a variable-step reference with located events,
// explicit Euler and classical Runge-Kutta with fixed steps, the real-time mode.
#ifndef VGROOVE_PLANT_DRILL_RUN_HPP
#define VGROOVE_PLANT_DRILL_RUN_HPP

#include <vector>

#include "drill/events.hpp"
#include "numeric/cancellation.hpp"

namespace vgroove {

enum class DrillSolver { REFERENCE, EULER, RK4, REAL_TIME };

struct DrillRequest {
    DrillSolver solver = DrillSolver::REFERENCE;
    double duration_s = 4.0;
    double step_s = 0.0;      // of the fixed-step solvers
    double tolerance = 1e-8;  // of the reference: local error over drill_scales
    double step_max_s = 0.0;  // of the reference; 0: a fiftieth of the run
    double row_s = 0.0;       // interval of the rows; 0: every step
    bool timed = false;       // measure the execution time of every fixed step
    Cancellation *cancellation = nullptr;
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
    std::vector<double> rows;          // row-major, DRILL_ROW_COUNT a row
    std::vector<DrillStep> steps;      // reference: all accepted steps
    std::vector<DrillStep> marks;      // events; with fixed steps at the end of the step
    std::vector<double> execution_ns;  // timed fixed steps
    std::size_t rejected = 0;  // reference: trial steps that were too coarse or located an event
    double diverged_s = 0.0;   // time at which a fixed-step solver diverged; 0: it did not
};

// Throws std::invalid_argument for parameters or a request outside their range.
DrillRun drill_run(const DrillParameters &p, const DrillRequest &request);

DrillRun drill_run_reference(const DrillParameters &p,
                             const DrillRequest &request);                        // reference.cpp
DrillRun drill_run_fixed(const DrillParameters &p, const DrillRequest &request);  // fixed_steps.cpp

constexpr std::size_t DRILL_CHECK_STEPS = 256;  // steps between two checks for cancellation
inline void drill_check_cancelled(const DrillRequest &request, std::size_t step) {
    if (request.cancellation && step % DRILL_CHECK_STEPS == 0)
        request.cancellation->check();
}

}  // namespace vgroove

#endif
