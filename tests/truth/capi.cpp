// The C functions through which Python makes logs and runs a tool in lock-step.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "curve.hpp"
#include "fields.hpp"
#include "tool.hpp"

using truth::Curve;
using truth::Drive;
using truth::Tool;

namespace {

// Part of the delay, drawn again every transport_hold_s. It has a random stream of its own, so that
// all other random numbers are the same with and without it.
class Jitter {
public:
    explicit Jitter(const truth::Params &params)
        : width_s_(params.transport_jitter_s),
          hold_s_(params.transport_hold_s),
          random_(static_cast<std::uint64_t>(params.seed) + 77) {}
    double at(double t) {
        while (width_s_ > 0.0 && t >= until_s_) {
            until_s_ += hold_s_;
            value_s_ = width_s_ * (2.0 * random_.uniform() - 1.0);
        }
        return value_s_;
    }

private:
    double width_s_, hold_s_, until_s_ = 0.0, value_s_ = 0.0;
    truth::RandomStream random_;
};

struct RowOut {
    double current_a, supply_v, speed_rad_s, angle_rad, winding_kelvin;
};

void close_row(Tool &tool, double length, RowOut &row) {
    row = {tool.sums.current_as / length, tool.sums.bus_vs / length, tool.state.speed_rad_s,
           tool.state.angle_rad, tool.state.winding_kelvin};
    tool.sums.current_as = 0.0;
    tool.sums.bus_vs = 0.0;
}

}  // namespace

extern "C" {

struct TruthCommand {
    const double *time_s, *duty, *coast;
    int count;
    const double *load_time_s, *load_nm;
    int load_count;
    const double *bus_time_s, *bus_v;
    int bus_count;
    const double *extra_time_s, *extra_supply_v, *extra_coulomb_nm;
    int extra_count;
    const double *rough_nm;
    int rough_count;
    double rough_step_rad;
};

Tool *truth_new(void) {
    return new Tool();
}

void truth_free(Tool *tool) {
    delete tool;
}

int truth_set(Tool *tool, const char *name, double value) {
    return truth::set_member(truth::find_param(tool->params, name), value);
}

double truth_get(Tool *tool, const char *name) {
    return truth::member_value(truth::find_param(tool->params, name));
}

void truth_start(Tool *tool) {
    tool->start();
}

// Rows end at row_s[0..rows-1]; the first begins at begin_s. Returns the number of edges, which
// truth_edges copies; -1 where the integration diverged.
int truth_run(Tool *tool, const TruthCommand *command, double begin_s, const double *row_s,
              int rows, double *out) {
    tool->start();
    tool->state.time_s = begin_s;
    const double period = 1.0 / tool->params.pwm_hz, levels = tool->params.duty_levels;
    Curve duty(command->time_s, command->duty, command->count),
        coast(command->time_s, command->coast, command->count);
    Curve load(command->load_time_s, command->load_nm, command->load_count);
    Curve bus(command->bus_time_s, command->bus_v, command->bus_count);
    Curve extra_supply(command->extra_time_s, command->extra_supply_v, command->extra_count),
        extra_coulomb(command->extra_time_s, command->extra_coulomb_nm, command->extra_count);
    tool->roughness = {command->rough_nm, command->rough_count, command->rough_step_rad};
    Jitter jitter(tool->params);
    auto *row_out = reinterpret_cast<RowOut *>(out);
    int row = 0;
    double row_begin = begin_s;
    for (std::int64_t n = 0; row < rows; ++n) {
        const double start = begin_s + static_cast<double>(n) * period;
        // the command at the middle of the period, before the delay
        const double commanded =
            start + 0.5 * period - tool->params.transport_delay_s - jitter.at(start);
        Drive drive;
        const double wanted = duty.at(commanded);
        drive.duty = levels > 0.0 ? std::round(wanted * levels) / levels : wanted;
        drive.coast = coast.held(commanded) > 0.5;
        drive.load_nm = load.at(start + 0.5 * period);
        drive.bus_v = command->bus_count > 0 ? bus.held(start + 0.5 * period) : 0.0;
        drive.extra_supply_v = extra_supply.at(start);
        drive.extra_coulomb_nm = extra_coulomb.at(start);
        tool->state.time_s = start;
        tool->begin_period(period, drive);
        while (row < rows && tool->advance(row_s[row])) {
            close_row(*tool, row_s[row] - row_begin, row_out[row]);
            row_begin = row_s[row++];
        }
        if (row < rows) {
            tool->advance(1e300);
        }
    }
    tool->roughness = {};  // the table belongs to the caller
    return std::isfinite(tool->state.angle_rad) ? static_cast<int>(tool->edges.size()) : -1;
}

void truth_edges(const Tool *tool, double *time_s, double *direction) {
    for (std::size_t n = 0; n < tool->edges.size(); ++n) {
        time_s[n] = tool->edges[n].time_s;
        direction[n] = tool->edges[n].direction;
    }
}

struct TruthPeriod {
    double current_a, supply_v;
    std::int32_t edge_count;
    std::int32_t edge_cycle[8];
};

// One lock-step period of 510 cycles of 16 MHz; `dead` is the loss of duty by dead time, as in the
// board's message.
void truth_period(Tool *tool, int coast, double duty, double dead, double load_nm,
                  TruthPeriod *out) {
    constexpr double PERIOD_S = 510.0 / 16e6;
    const auto late =
        static_cast<std::size_t>(std::llround(tool->params.transport_delay_s / PERIOD_S));
    tool->commands.push_back({coast != 0, duty, 0.5 * dead * PERIOD_S, 0.0});
    Drive drive =
        tool->commands.size() > late ? tool->commands.front() : Drive{true, 0.0, 0.0, 0.0};
    if (tool->commands.size() > late) {
        tool->commands.pop_front();
    }
    drive.load_nm = load_nm;
    const double begin = tool->state.time_s;
    tool->edges.clear();
    tool->begin_period(PERIOD_S, drive);
    tool->advance(1e300);
    tool->state.time_s = begin + PERIOD_S;
    out->current_a = tool->sensed_current(tool->state.sensed_a) +
                     tool->params.current_noise_a * tool->random.normal();
    out->supply_v = tool->sensed_supply() + tool->params.supply_noise_v * tool->random.normal();
    out->edge_count = static_cast<std::int32_t>(std::min<std::size_t>(tool->edges.size(), 8));
    for (std::int32_t n = 0; n < out->edge_count; ++n) {
        const double cycle =
            std::floor((tool->edges[static_cast<std::size_t>(n)].time_s - begin) * 16e6);
        out->edge_cycle[n] = static_cast<std::int32_t>(std::clamp(cycle, 0.0, 509.0));
    }
}

// States and energies for the tests, in the order of INSIDE in truth.py.
void truth_inside(const Tool *tool, double *out) {
    const truth::State &s = tool->state;
    const double values[12] = {s.time_s,
                               s.current_a,
                               s.bus_v,
                               s.speed_rad_s,
                               s.angle_rad,
                               s.motor_bristle.deflection_rad,
                               s.motor_bristle.torque_nm,
                               tool->stored_energy(),
                               tool->sums.drawn_j,
                               tool->sums.copper_j,
                               tool->sums.friction_j,
                               tool->sums.load_j};
    std::memcpy(out, values, sizeof values);
}

}  // extern "C"
