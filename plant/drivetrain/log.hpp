// The plant's two faces: simulate_log drives it by the rows of a log, many parameter sets at once;
// DrivePlant keeps step with a board.
#ifndef VGROOVE_PLANT_DRIVETRAIN_LOG_HPP
#define VGROOVE_PLANT_DRIVETRAIN_LOG_HPP

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivetrain/model.hpp"
#include "numeric/watch.hpp"

namespace vgroove {

// Rows of a log as the gap contract's section 1 reads them. Empty vectors are absent columns.
struct LogInput {
    std::vector<double> time_s;
    InputKind kind = InputKind::DUTY;
    std::vector<double> command_start, command_end;  // of the interval that the row closes
    std::vector<double> bus_v;                       // measured bus, when it drives the model
    std::vector<double> load_nm;                     // at the end of the row
    std::vector<double> open;  // 1: the bridge is open in the interval that the row closes
    LoadKind load_kind = LoadKind::NONE;
};

// Fills command_start and command_end from a column: straight lines up to the slew rate, else
// steps; slew_per_s NaN: steps. A step beyond the rate by no more than slew_slack still counts as a
// ramp (the command's own resolution). Missing samples hold the last value.
void log_input_set_command(LogInput &in, const double *command, double slew_per_s,
                           double slew_slack);

// Missing samples hold the last value; missing ones before the first take `initial`.
std::vector<double> hold_missing(const double *column, std::size_t count, double initial);

// Views of row-major arrays of batch rows x log rows; all of them are filled.
struct LogOutput {
    double *current_a, *supply_v, *speed_rad_s, *speed_measured_rad_s, *angle_rad,
        *angle_measured_rad;
    double *energy_j = nullptr;  // log rows x ENERGY_COLUMNS, only with audit_log
};

// Since the first start: source, supply and bridge loss, winding and brush loss, friction, coupler
// damping, load; and what is stored now.
constexpr int ENERGY_COLUMNS = 7;
extern const char *const ENERGY_NAMES[ENERGY_COLUMNS];

struct LogStarts {
    std::vector<std::size_t> rows;  // increasing
    const double *state =
        nullptr;  // current, speed, angle for each start, for each batch row when per_row
    bool per_row = false;
};

struct SimulateOptions {
    int threads = 1;
    bool adaptive = false;   // Runge-Kutta everywhere: the reference mode; else exact where the
                             // drivetrain is linear between events
    double tolerance = 0.0;  // of Runge-Kutta, local error over scale; 0: the usual one
    Watch *watch = nullptr;  // asked now and then whether the run is still wanted
    bool keep_unfinished = false;  // rows that a run's bounded steps do not reach are NaN, instead
                                   // of std::runtime_error
};

// "parameter set n: ..." before what an exception says of one of several.
template <class Work>
void naming_the_set(std::size_t batch_row, std::size_t batch, const Work &work) {
    const std::string name = batch > 1 ? "parameter set " + std::to_string(batch_row) + ": " : "";
    try {
        work();
    } catch (const std::invalid_argument &error) {
        throw std::invalid_argument(name + error.what());
    } catch (const std::runtime_error &error) {
        throw std::runtime_error(name + error.what());
    }
}

// theta: batch x PARAMETER_COUNT. Same inputs give the same bytes whatever the batch and the
// threads. The work is bounded by the rows.
void simulate_log(const LogInput &in, const double *theta, std::size_t batch,
                  const LogStarts &starts, const SimulateOptions &options, const LogOutput &out);

// One parameter set with its energies, out.energy_j: work_in = losses + work_load + change of
// stored, unless a further start resets the state.
void audit_log(const LogInput &in, const double *theta, const LogStarts &starts,
               const LogOutput &out);

}  // namespace vgroove

#endif
