// Rows of a log: each is one or several stretches with command and load as straight lines, and the
// measured quantities at its end.
#ifndef VGROOVE_PLANT_DRIVETRAIN_ROWS_HPP
#define VGROOVE_PLANT_DRIVETRAIN_ROWS_HPP

#include <algorithm>
#include <cmath>
#include <limits>

#include "drivetrain/log.hpp"
#include "drivetrain/settle.hpp"
#include "drivetrain/solver.hpp"

namespace vgroove {

constexpr std::size_t CANCEL_CHECK_ROWS = 64;  // rows between two checks for cancellation
constexpr std::size_t NOT_EXHAUSTED = std::numeric_limits<std::size_t>::max();
// Times below these shares, of a row's interval and of a stretch, count as rounding errors.
constexpr double SAME_INSTANT = 1e-9, ROW_END = 1e-12;

// Position of a lane in the log. Effects transport_delay and clock_skew shift the command column
// against the rows.
struct Cursor {
    double row_scale;      // true seconds per second of the time stamps
    double command_scale;  // seconds of the command column per true second
    double delay_s;
    double row_remaining_s;  // true time to the end of the row
    double now_s;            // true time since the first row
    std::size_t command_row;
};

inline Cursor cursor_from(const Parameters &p) {
    const double skew = 1.0 + p.effects.clock_skew.relative;
    Cursor c{};
    c.row_scale = p.effects.clock_skew.command_clock != 0.0 ? 1.0 : 1.0 / skew;
    c.command_scale = skew;
    c.delay_s = p.effects.transport_delay.delay_s;
    return c;
}

template <class V, int N> struct Group {
    Solver<V, N> solver;
    Parameters parameters[LaneTraits<V>::COUNT];
    Cursor cursor[LaneTraits<V>::COUNT];
    std::size_t batch_row[LaneTraits<V>::COUNT];
    std::size_t
        exhausted_row[LaneTraits<V>::COUNT];  // first row that the step budget did not reach
    int lanes;                                // in use; the others repeat the first
    Cancellation *cancellation;
};

template <class V, int N>
VGROOVE_INLINE void drive_command(Solver<V, N> &s, const LogInput &in, int lane, std::size_t row,
                                  double from, double scale) {
    Drive<V> &d = s.drive;
    const double start = in.command_start[row], end = in.command_end[row];
    double rate = 0.0;
    if (start != end)
        rate = (end - start) / (in.time_s[row] - in.time_s[row - 1]);
    set(d.command, lane, start == end ? end : start + rate * from);
    set(d.command_rate, lane, rate * scale);
    set(d.open, lane, in.open.empty() ? 0.0 : in.open[row]);
    const bool switches = log_input_switches(start, end) && !(get(d.open, lane) > 0.0);
    set(d.dead, lane, switches ? get(s.model.bridge.dead_share, lane) : 0.0);
}

// EFFECT_COMMAND_SHIFT: the command column is read at other times than the other columns, because
// it acts with a delay or its time stamps come from a clock of another rate. Returns the time
// stamp, s, in the command column whose value acts at the cursor.
inline double command_instant(const Cursor &c, const LogInput &in) {
    return in.time_s[0] + (c.now_s - c.delay_s) * c.command_scale;
}

// Advances the cursor to the row of the command column whose value acts just after the time `at`,
// s, of that column.
inline void advance_command_row(Cursor &c, const LogInput &in, double at) {
    const std::size_t last = in.time_s.size() - 1;
    while (c.command_row < last &&
           in.time_s[c.command_row] - at <=
               SAME_INSTANT * (in.time_s[c.command_row + 1] - in.time_s[c.command_row]))
        ++c.command_row;
}

// Sets the command that row `row` of the command column has at the time `at`, s; the one at its end
// where `at` is later.
template <class V, int N>
VGROOVE_INLINE void shifted_command(Solver<V, N> &s, const LogInput &in, int lane, std::size_t row,
                                    double at, double scale) {
    const double begin = in.time_s[row > 0 ? row - 1 : 0];
    drive_command(s, in, lane, row, std::min(at, in.time_s[row]) - begin, scale);
}

// Sets the command that acts at the cursor and returns the time, s, for which it stays in one row
// of the command column, at most the rest of the log's present row.
template <class V, int N>
VGROOVE_INLINE double shifted_stretch(Group<V, N> &g, const LogInput &in, int lane) {
    Cursor &c = g.cursor[lane];
    const double at = command_instant(c, in);
    advance_command_row(c, in, at);
    const double left = (in.time_s[c.command_row] - at) / c.command_scale;
    shifted_command(g.solver, in, lane, c.command_row, at, c.command_scale);
    if (left <= 0.0)
        set(g.solver.drive.command_rate, lane, 0.0);
    const bool ends_in_row = left > 0.0 && left < c.row_remaining_s * (1.0 - SAME_INSTANT);
    return ends_in_row ? left : c.row_remaining_s;
}

// Sets the command of a row at which the simulation starts. Where the command changes at the time
// of that row, `before` selects the value before the change, otherwise the one after it.
template <class V, int N>
VGROOVE_INLINE void command_at_start(Group<V, N> &g, const LogInput &in, int lane, bool before) {
    Cursor &c = g.cursor[lane];
    const double at = command_instant(c, in);
    advance_command_row(c, in, at);
    const std::size_t row = c.command_row;
    const bool begins =
        row > 0 && at - in.time_s[row - 1] <= SAME_INSTANT * (in.time_s[row] - in.time_s[row - 1]);
    shifted_command(g.solver, in, lane, before && begins ? row - 1 : row, at, 0.0);
}

// Time since the row's start in seconds of the time stamps; 0 in its first stretch
VGROOVE_INLINE double row_elapsed_s(const Cursor &c, const LogInput &in, std::size_t row) {
    const double length = in.time_s[row] - in.time_s[row - 1];
    return c.row_remaining_s == length * c.row_scale ? 0.0
                                                     : length - c.row_remaining_s / c.row_scale;
}

// Length up to the instant at which the load changes its sign: |TL| is a straight line along a
// stretch.
VGROOVE_INLINE double same_sign_stretch(double load_nm, double rate, double length) {
    const double zero = rate != 0.0 ? -load_nm / rate : -1.0;
    return zero > SAME_INSTANT * length && zero < length * (1.0 - SAME_INSTANT) ? zero : length;
}

template <class V, int N>
VGROOVE_INLINE bool next_stretch(Group<V, N> &g, const LogInput &in, std::size_t row, int lane) {
    Cursor &c = g.cursor[lane];
    Solver<V, N> &s = g.solver;
    if (c.row_remaining_s <= 0.0 || s.exhausted[lane])
        return false;
    double length = c.row_remaining_s;
    if (s.model.effects & EFFECT_COMMAND_SHIFT)
        length = shifted_stretch(g, in, lane);
    else
        drive_command(s, in, lane, row, row_elapsed_s(c, in, row), 1.0 / c.row_scale);
    if (s.model.effects & EFFECT_LOAD_DEPENDENT_FRICTION)
        length =
            same_sign_stretch(get(s.drive.load_nm, lane), get(s.drive.load_rate, lane), length);
    set(s.drive.time_s, lane, c.now_s);
    c.now_s += length;
    c.row_remaining_s -= length;
    if (c.row_remaining_s < ROW_END * length)
        c.row_remaining_s = 0.0;
    solver_begin(s, lane, length);
    return true;
}

// Measured supply voltage of a row, without the gain error of its sensor
template <class V, int N>
VGROOVE_INLINE void drive_bus(Group<V, N> &g, const LogInput &in, std::size_t row, int lane) {
    if (!in.bus_v.empty())
        set(g.solver.drive.bus_v, lane,
            in.bus_v[row] / (1.0 + g.parameters[lane].effects.supply_gain.relative));
}

template <class V, int N>
VGROOVE_INLINE void begin_row(Group<V, N> &g, const LogInput &in, std::size_t row, int lane) {
    Cursor &c = g.cursor[lane];
    Solver<V, N> &s = g.solver;
    c.now_s = (in.time_s[row - 1] - in.time_s[0]) * c.row_scale;
    c.row_remaining_s = (in.time_s[row] - in.time_s[row - 1]) * c.row_scale;
    drive_bus(g, in, row, lane);
    if (in.load_kind == LoadKind::TORQUE) {
        set(s.drive.load_nm, lane, in.load_nm[row - 1]);
        set(s.drive.load_rate, lane, (in.load_nm[row] - in.load_nm[row - 1]) / c.row_remaining_s);
    }
    set(s.state.x[STATE_CURRENT_TIME], lane, 0.0);
    set(s.state.x[STATE_BUS_TIME], lane, 0.0);
    solver_grant_steps(s, lane, 1, in.time_s[row] - in.time_s[row - 1]);
}

template <class V, int N>
VGROOVE_INLINE void reset_lane(Group<V, N> &g, const LogInput &in, std::size_t row, int lane,
                               const double *start, bool first) {
    Solver<V, N> &s = g.solver;
    set(s.drive.load_nm, lane, in.load_kind == LoadKind::TORQUE ? in.load_nm[row] : 0.0);
    set(s.drive.load_rate, lane, 0.0);
    Cursor &c = g.cursor[lane];
    c.now_s = (in.time_s[row] - in.time_s[0]) * c.row_scale;
    c.row_remaining_s = 0.0;
    set(s.drive.time_s, lane, c.now_s);
    settle_shaft(s, lane, start, first);
}

// Speed and angle of one row. wheel: speed and angle of the eccentric Hall wheel.
template <class V> struct WheelState { V speed, angle; };
template <class V, int N>
VGROOVE_INLINE void write_shaft(const Group<V, N> &g, std::size_t at, int lane,
                                const WheelState<V> &wheel, const LogOutput &out) {
    const State<V, N> &x = g.solver.state;
    const Parameters &p = g.parameters[lane];
    out.speed_rad_s[at] = get(x.x[STATE_SPEED], lane);
    out.angle_rad[at] = get(x.x[STATE_ANGLE], lane);
    double speed = get(wheel.speed, lane), angle = get(wheel.angle, lane);
    if constexpr (N > STATE_CORE_COUNT) {
        if (g.solver.model.effects & EFFECT_SPEED_LAG) {
            speed = get(x.x[STATE_SPEED_FILTER], lane);
            angle -= p.effects.speed_lag.time_constant_s * speed;  // w_f = (th - th_f) / T
        }
    }
    out.speed_measured_rad_s[at] = speed * (1.0 + p.effects.speed_gain.relative);
    out.angle_measured_rad[at] = angle * (1.0 + p.effects.speed_gain.relative);
}

// A lane whose step budget is used up has NaN from that row on; the first such row is kept.
template <class V, int N>
VGROOVE_INLINE void write_exhausted(Group<V, N> &g, std::size_t at, std::size_t row, int lane,
                                    const LogOutput &out) {
    for (double *column : {out.current_a, out.supply_v, out.speed_rad_s, out.speed_measured_rad_s,
                           out.angle_rad, out.angle_measured_rad})
        column[at] = std::numeric_limits<double>::quiet_NaN();
    g.exhausted_row[lane] = std::min(g.exhausted_row[lane], row);
}

template <class V, int N>
VGROOVE_PART void write_row(Group<V, N> &g, const LogInput &in, std::size_t row, bool start,
                            const LogOutput &out) {
    const Solver<V, N> &s = g.solver;
    const WheelState<V> wheel{
        sensors_wheel_speed<V>(s.model.sensors, s.model.effects, s.state.x[STATE_SPEED],
                               s.state.x[STATE_ANGLE]),
        sensors_wheel_angle<V>(s.model.sensors, s.model.effects, s.state.x[STATE_ANGLE])};
    const Electrical<V> e = drivetrain_electrical<V, N>(s.model, s.drive, s.mode, V{}, s.state);
    for (int lane = 0; lane < g.lanes; ++lane) {
        const Parameters &p = g.parameters[lane];
        const std::size_t at = g.batch_row[lane] * in.time_s.size() + row;
        const double seconds =
            start ? 1.0 : (in.time_s[row] - in.time_s[row - 1]) * g.cursor[lane].row_scale;
        const double current = start ? get(s.state.x[STATE_CURRENT], lane)
                                     : get(s.state.x[STATE_CURRENT_TIME], lane) / seconds;
        const double bus =
            start ? get(e.bus_v, lane) : get(s.state.x[STATE_BUS_TIME], lane) / seconds;
        out.current_a[at] = sensors_measured_current(p, current);
        out.supply_v[at] = bus * (1.0 + p.effects.supply_gain.relative);
        write_shaft(g, at, lane, wheel, out);
        if (s.exhausted[lane])
            write_exhausted(g, at, row, lane, out);
    }
    if constexpr (N > STATE_WORK_IN) {
        double *energy = out.energy_j + row * ENERGY_COLUMNS;
        for (int n = 0; n < ENERGY_COLUMNS - 1; ++n)
            energy[n] = get(s.state.x[STATE_WORK_IN + n], 0);
        energy[ENERGY_COLUMNS - 1] = get(drivetrain_stored<V, N>(s.model, s.state), 0);
    }
}

// Lanes whose start has no current begin at the steady-state current of the interval that follows.
template <class V, int N>
VGROOVE_INLINE void settle_currents(Group<V, N> &g, const LogInput &in, const LogStarts &starts,
                                    std::size_t which) {
    Solver<V, N> &s = g.solver;
    bool wanted[LaneTraits<V>::COUNT], any = false;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const std::size_t batch = starts.per_row ? g.batch_row[lane] * starts.rows.size() : 0;
        wanted[lane] = std::isnan(starts.state[3 * (batch + which)]);
        any = any || wanted[lane];
    }
    if (!any)
        return;
    const Drive<V> at_row = s.drive;
    const std::size_t next = std::min(starts.rows[which] + 1, in.time_s.size() - 1);
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        if (s.model.effects & EFFECT_COMMAND_SHIFT)
            command_at_start(g, in, lane, false);
        else
            drive_command(s, in, lane, next, 0.0, 0.0);
        drive_bus(g, in, next, lane);
    }
    if (s.model.input == InputKind::CURRENT)
        follow_command(s, wanted);
    else
        settle_current(s, wanted);
    s.drive = at_row;
}

template <class V, int N>
VGROOVE_PART void reset_group(Group<V, N> &g, const LogInput &in, const LogStarts &starts,
                              std::size_t which) {
    const std::size_t row = starts.rows[which];
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        const std::size_t batch = starts.per_row ? g.batch_row[lane] * starts.rows.size() : 0;
        reset_lane(g, in, row, lane, starts.state + 3 * (batch + which), which == 0);
        if (g.solver.model.effects & EFFECT_COMMAND_SHIFT) {
            command_at_start(g, in, lane, true);
        } else {
            drive_command(g.solver, in, lane, row, 0.0, 0.0);
            set(g.solver.drive.command, lane, in.command_end[row]);
        }
        drive_bus(g, in, row, lane);
    }
    settle_currents(g, in, starts, which);
}

// x after `seconds` of x' = gain - rate x with constant gain and rate
inline double relaxed(double x, double gain, double rate, double seconds) {
    const double grown = rate * seconds;
    const double share = grown != 0.0 ? -std::expm1(-grown) / grown : 1.0;
    return x * std::exp(-grown) + gain * seconds * share;
}

// Charge, polarisation (components/supply.hpp) and heat (components/motor.hpp) of one lane
template <class V, int N>
inline void skip_slow_states(Solver<V, N> &s, int lane, double square_a2, double bus_a,
                             double seconds) {
    const Drivetrain<V> &m = s.model;
    if (m.effects & EFFECT_SUPPLY_DROOP) {
        const double rate = get(m.supply.polarisation_rate, lane);
        set(s.state.x[STATE_CHARGE], lane, get(s.state.x[STATE_CHARGE], lane) + bus_a * seconds);
        set(s.state.x[STATE_POLARISATION], lane,
            relaxed(get(s.state.x[STATE_POLARISATION], lane),
                    get(m.supply.polarisation_ohm, lane) * bus_a * rate, rate, seconds));
    }
    if (m.effects & EFFECT_WINDING_HEATING) {
        const double gain =
            get(m.motor.kelvin_per_joule, lane) * square_a2 * get(m.motor.resistance_ohm, lane);
        const double rate = get(m.motor.cooling_rate, lane) - gain * COPPER_PER_KELVIN;
        set(s.state.x[STATE_HEAT], lane,
            relaxed(get(s.state.x[STATE_HEAT], lane), gain, rate, seconds));
    }
}

// A row that is not simulated: the shaft keeps its state, and the slow states follow the measured
// current in closed form.
template <class V, int N>
VGROOVE_PART void skip_row(Group<V, N> &g, const LogInput &in, std::size_t row) {
    Solver<V, N> &s = g.solver;
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        Cursor &c = g.cursor[lane];
        const double seconds = (in.time_s[row] - in.time_s[row - 1]) * c.row_scale;
        if constexpr (N > STATE_HEAT)
            skip_slow_states(s, lane, in.skipped_a2[row], in.skipped_bus_a[row], seconds);
        c.now_s += seconds;
        c.row_remaining_s = 0.0;
        set(s.drive.time_s, lane, c.now_s);
        set(s.state.x[STATE_CURRENT_TIME], lane, 0.0);
        set(s.state.x[STATE_BUS_TIME], lane, 0.0);
    }
}

// Begins a row in every lane.
template <class V, int N>
VGROOVE_PART void begin_rows(Group<V, N> &g, const LogInput &in, std::size_t row) {
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        begin_row(g, in, row, lane);
    flush_tiny(g.solver.state);
}

// EXACT: the drivetrain is linear between events.
template <bool EXACT, class V, int N>
VGROOVE_INLINE void step_row(Group<V, N> &g, const LogInput &in, std::size_t row) {
    if (log_input_skips(in, row))
        return skip_row(g, in, row);
    begin_rows(g, in, row);
    solver_run<EXACT>(
        g.solver, [&](int lane)
                      __attribute__((always_inline)) { return next_stretch(g, in, row, lane); });
}

template <class V, int N>
VGROOVE_INLINE void run_group(Group<V, N> &g, const LogInput &in, const LogStarts &starts,
                              const LogOutput &out) {
    std::size_t which = 0;
    for (std::size_t row = starts.rows.front(); row < in.time_s.size(); ++row) {
        if (g.cancellation && row % CANCEL_CHECK_ROWS == 0)
            g.cancellation->check();
        if (row > starts.rows.front())
            step_row<false>(g, in, row);
        const bool start = which < starts.rows.size() && starts.rows[which] == row;
        if (start)
            reset_group(g, in, starts, which++);
        write_row(g, in, row, start, out);
    }
}

}  // namespace vgroove

#endif
