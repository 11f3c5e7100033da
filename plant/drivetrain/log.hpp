// simulate_log: the drivetrain driven by the rows of a log, for many parameter sets at once.
#ifndef VGROOVE_PLANT_DRIVETRAIN_LOG_HPP
#define VGROOVE_PLANT_DRIVETRAIN_LOG_HPP

#include <cstddef>
#include <vector>

#include "drivetrain/log_input.hpp"
#include "numeric/cancellation.hpp"
#include "numeric/lanes.hpp"

namespace vgroove {

// Views of row-major arrays of batch rows x log rows; all of them are filled. A batch row is one
// parameter set.
struct LogOutput {
    double *current_a, *supply_v, *speed_rad_s, *speed_measured_rad_s, *angle_rad,
        *angle_measured_rad;
    double *energy_j = nullptr;  // log rows x ENERGY_COLUMNS, only with audit_log
};

// Energies since the first start: source, loss of supply and bridge, of winding and brushes, of
// friction, of the coupler's damping, work against the load; and the stored energy of the instant
constexpr int ENERGY_COLUMNS = 7;
extern const char *const ENERGY_NAMES[ENERGY_COLUMNS];

struct LogStarts {
    std::vector<std::size_t> rows;  // increasing
    // current, speed, angle for each start, for each batch row when per_row; a current of NaN is
    // the steady-state current of the interval that follows
    const double *state = nullptr;
    bool per_row = false;
};

struct SimulateOptions {
    int threads = 1;
    // Runge-Kutta for every drivetrain; else exact where it is linear, by exponential steps where
    // it is stiff
    bool adaptive = false;
    double tolerance = 0.0;  // of Runge-Kutta, local error over scale; 0: SOLVER_TOLERANCE
    // smallest number of parameter sets that are simulated together in one vector, 2 to 8
    std::size_t least_lanes = vgroove::least_lanes();
    Cancellation *cancellation = nullptr;
    bool keep_unfinished = false;  // rows that the step budget does not reach are NaN, instead of
                                   // std::runtime_error
};

// theta: batch x PARAMETER_COUNT. The results of a parameter set do not depend on the batch or the
// number of threads, to the last bit. Throws std::invalid_argument for an impossible set and
// std::runtime_error for one whose step budget is used up.
void simulate_log(const LogInput &in, const double *theta, std::size_t batch,
                  const LogStarts &starts, const SimulateOptions &options, const LogOutput &out);

// One parameter set with its energies, out.energy_j: work_in = losses + work_load + change of
// stored, as long as no further start resets the state.
void audit_log(const LogInput &in, const double *theta, const LogStarts &starts,
               const LogOutput &out);

}  // namespace vgroove

#endif
