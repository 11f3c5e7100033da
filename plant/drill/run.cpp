// A run of the drill driver by any of its solvers: checks of the request, and names of its columns.
#include "drill/run.hpp"

#include <stdexcept>

namespace vgroove {

const char *const DRILL_ROW_NAMES[DRILL_ROW_COUNT] = {
    "time_s",        "current_a",      "speed_rad_s",  "twist_rad",
    "chuck_rad_s",   "shaft_nm",       "duty",         "control",
    "stored_j",      "charge_as",      "angle_rad",    "chuck_angle_rad",
    "work_in_j",     "loss_winding_j", "loss_motor_j", "loss_shaft_j",
    "loss_clutch_j", "work_load_j"};

DrillRun drill_run(const DrillParameters &p, const DrillRequest &request) {
    drill_check(p);
    if (p.rise_nm_per_rad != 0.0)
        throw std::invalid_argument("load.rise_nm_per_rad is a load of the lock-step plant alone "
                                    "(vgroove sim, vgroove run)");
    DrillRequest r = request;
    if (!(r.duration_s > 0.0 && r.duration_s <= 3600.0))
        throw std::invalid_argument("duration_s must be above 0 and at most 3600");
    if (r.solver != DrillSolver::REFERENCE) {
        if (!(r.step_s >= 1e-7 && r.step_s <= r.duration_s))
            throw std::invalid_argument("step_s must be at least 1e-7 and at most duration_s");
        return drill_run_fixed(p, r);
    }
    if (!(r.tolerance >= 1e-12 && r.tolerance <= 0.1))
        throw std::invalid_argument("tolerance must be within 1e-12 and 0.1");
    r.step_max_s = r.step_max_s > 0.0 ? r.step_max_s : r.duration_s / 50.0;
    return drill_run_reference(p, r);
}

}  // namespace vgroove
