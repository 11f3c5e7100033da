// How the command column of a log is read: lines within the slew rate, steps, missing samples.
#include "drivetrain/log_input.hpp"

#include <algorithm>
#include <cmath>

namespace vgroove {

std::vector<double> hold_missing(const double *column, std::size_t count, double initial) {
    std::vector<double> held(count);
    double last = initial;
    for (std::size_t row = 0; row < count; ++row) {
        last = std::isnan(column[row]) ? last : column[row];
        held[row] = last;
    }
    return held;
}

void log_input_set_command(LogInput &in, const double *command, double slew_per_s,
                           double slew_slack) {
    const std::size_t count = in.time_s.size();
    in.command_end = hold_missing(command, count, 0.0);
    in.command_start = in.command_end;
    if (std::isnan(slew_per_s))
        return;
    for (std::size_t row = 1; row < count; ++row) {
        const double allowed = slew_per_s * (in.time_s[row] - in.time_s[row - 1]) + slew_slack;
        const double change = std::fabs(in.command_end[row] - in.command_end[row - 1]);
        if (change <= allowed * (1.0 + 1e-9))
            in.command_start[row] = in.command_end[row - 1];
    }
}

void log_input_check_time(const LogInput &in, const char *caller) {
    for (std::size_t row = 1; row < in.time_s.size(); ++row)
        if (!(in.time_s[row] > in.time_s[row - 1]))
            throw std::invalid_argument(std::string(caller) + ": time_s must increase");
}

double log_input_interval_s(const LogInput &in) {
    double total = in.time_s.back() - in.time_s.front();
    std::size_t count = in.time_s.size() - 1;
    for (std::size_t row = 1; row < in.skipped_a2.size(); ++row) {
        if (!log_input_skips(in, row))
            continue;
        total -= in.time_s[row] - in.time_s[row - 1];
        --count;
    }
    return count > 0 ? total / static_cast<double>(count) : 0.0;
}

double log_input_peak(const std::vector<double> &column) {
    double peak = 0.0;
    for (const double x : column)
        peak = std::max(peak, std::fabs(x));
    return peak;
}

}  // namespace vgroove
