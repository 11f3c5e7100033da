// The columns of a log that drive the plant: time, command, measured bus, load, open bridge
// (docs/spec/gap.md, section 1).
#ifndef VGROOVE_PLANT_DRIVETRAIN_LOG_INPUT_HPP
#define VGROOVE_PLANT_DRIVETRAIN_LOG_INPUT_HPP

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivetrain/model.hpp"

namespace vgroove {

// An empty vector is an absent column. Row r closes the interval from row r - 1.
struct LogInput {
    std::vector<double> time_s;
    InputKind kind = InputKind::DUTY;
    std::vector<double> command_start, command_end;  // at both ends of the row's interval
    std::vector<double> bus_v;                       // measured bus, where it drives the model
    std::vector<double> load_nm;                     // at the end of the row
    std::vector<double> open;                        // 1: the bridge is open in the row's interval
    LoadKind load_kind = LoadKind::NONE;
    // Rows that are not simulated have means over their interval here, the others NaN: the square
    // of the current, A^2, and the current that the bus delivers, A. They drive heat and charge.
    std::vector<double> skipped_a2, skipped_bus_a;
};

inline bool log_input_skips(const LogInput &in, std::size_t row) {
    return !in.skipped_a2.empty() && !std::isnan(in.skipped_a2[row]);
}

// Mean length of the rows that are simulated
double log_input_interval_s(const LogInput &in);

// Sets command_start and command_end from a column: a straight line from row to row where the
// change is within the slew rate, else a step at the interval's start. slew_per_s NaN: steps only.
// A change that exceeds the rate by at most slew_slack, the resolution of the command, is a line
// too. Missing samples hold the last value.
void log_input_set_command(LogInput &in, const double *command, double slew_per_s,
                           double slew_slack);

// Missing samples hold the last value; missing ones before the first are `initial`.
std::vector<double> hold_missing(const double *column, std::size_t count, double initial);

// Throws std::invalid_argument, which begins with `caller`, for time stamps that do not increase.
void log_input_check_time(const LogInput &in, const char *caller);

// Largest magnitude in a column
double log_input_peak(const std::vector<double> &column);

// Whether the bridge switches while the command runs from start to end: not at a constant duty of 0
// or +-1
inline bool log_input_switches(double start, double end) {
    const double peak = std::max(std::fabs(start), std::fabs(end));
    const double least = std::min(std::fabs(start), std::fabs(end));
    return !(start == end && (peak == 0.0 || peak >= 1.0)) && peak > 0.0 && least < 1.0;
}

// Calls work() and puts "parameter set n: " in front of the message of its exception, where the
// batch has more than one set.
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

}  // namespace vgroove

#endif
