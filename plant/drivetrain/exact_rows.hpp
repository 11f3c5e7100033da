// Blocks of rows of a linear run: the affine maps of eight rows in one vector, then current and
// speed from row to row, then the measured quantities.
//
// A block assumes that its modes do not change. From the first row in which they may change, and
// while an open bridge carries current, the solver with its events takes over. Each run is computed
// alone, so that its result does not depend on the batch.
#ifndef VGROOVE_PLANT_DRIVETRAIN_EXACT_ROWS_HPP
#define VGROOVE_PLANT_DRIVETRAIN_EXACT_ROWS_HPP

#include "drivetrain/rows.hpp"

namespace vgroove {

constexpr int BLOCK_VECTORS = 8;
constexpr int BLOCK_WIDTH = LaneTraits<Lanes8>::COUNT;
constexpr int BLOCK_ROWS = BLOCK_VECTORS * BLOCK_WIDTH;

using ExactGroup = Group<double, STATE_CORE_COUNT>;

struct Block {
    FlowConstants constants;
    double bus_scale;  // measured bus to true bus
    int vectors;
    FlowInput<Lanes8> in[BLOCK_VECTORS];
    Flow<Lanes8> flow[BLOCK_VECTORS];
    bool complete;                                          // the modes of all its rows are certain
    double current[BLOCK_ROWS + 1], speed[BLOCK_ROWS + 1];  // at the start and at the rows' ends
};

// Eight numbers from p on, which need not be aligned
VGROOVE_INLINE Lanes8 block_load(const double *p) {
    Lanes8 v;
    std::memcpy(&v, p, sizeof v);
    return v;
}

VGROOVE_INLINE void block_store(double *p, const Lanes8 &v, int count) {
    std::memcpy(p, &v, static_cast<std::size_t>(count) * sizeof(double));
}

// The values of eight rows from `row` on; rows past the end repeat the last one.
VGROOVE_INLINE Lanes8 block_column(const std::vector<double> &column, std::size_t row,
                                   std::size_t end) {
    if (row + BLOCK_WIDTH <= end)
        return block_load(column.data() + row);
    Lanes8 v;
    for (int lane = 0; lane < BLOCK_WIDTH; ++lane)
        v[lane] = column[std::min(row + static_cast<std::size_t>(lane), end - 1)];
    return v;
}

VGROOVE_INLINE void block_fill(FlowInput<Lanes8> &f, const ExactGroup &g, const LogInput &in,
                               std::size_t row, std::size_t end, double bus_scale) {
    const Drivetrain<double> &m = g.solver.model;
    const Lanes8 stamp =
        block_column(in.time_s, row, end) - block_column(in.time_s, row - 1, end - 1);
    const Lanes8 start = block_column(in.command_start, row, end),
                 stop = block_column(in.command_end, row, end);
    f.h = stamp * g.cursor[0].row_scale;
    f.command = start;
    f.command_rate = (stop - start) / f.h;
    f.load_nm = f.load_rate = Lanes8{};
    if (in.load_kind == LoadKind::TORQUE) {
        f.load_nm = block_column(in.load_nm, row - 1, end - 1) * m.load.ratio_inverse;
        f.load_rate = (block_column(in.load_nm, row, end) * m.load.ratio_inverse - f.load_nm) / f.h;
    }
    f.bus_v = m.bus_measured ? block_column(in.bus_v, row, end) * bus_scale
                             : splat<Lanes8>(m.supply.open_circuit_v);
}

VGROOVE_INLINE bool block_any(const Lanes8 &v) {
    bool any = false;
    for (int lane = 0; lane < BLOCK_WIDTH; ++lane)
        any = any || v[lane] != 0.0;
    return any;
}

// Current and speed at the ends of the rows, one row after the other
VGROOVE_INLINE void block_chain(Block &b, double i, double w) {
    b.current[0] = i;
    b.speed[0] = w;
    for (int v = 0; v < b.vectors; ++v) {
        const Flow<Lanes8> &f = b.flow[v];
        for (int lane = 0; lane < BLOCK_WIDTH; ++lane) {
            const double next = (f.e11[lane] * i + f.g1[lane]) + f.e12[lane] * w;
            w = (f.e21[lane] * i + f.g2[lane]) + f.e22[lane] * w;
            i = next;
            b.current[v * BLOCK_WIDTH + lane + 1] = i;
            b.speed[v * BLOCK_WIDTH + lane + 1] = w;
        }
    }
}

// Positive where the shaft certainly slides the same way during the whole row: the speed at both
// ends is larger than its slope at either end would change it in half a row.
VGROOVE_INLINE Lanes8 block_slides(const FlowConstants &c, const FlowInput<Lanes8> &in,
                                   double inertia_inverse, const Lanes8 &i0, const Lanes8 &i1,
                                   const Lanes8 &w0, const Lanes8 &w1) {
    const FlowTorque<Lanes8> t = flow_torque<Lanes8>(c, in);
    const double k = c.conducts * c.constant;
    const Lanes8 half = in.h * (0.5 * inertia_inverse);
    const Lanes8 rise0 = (k * i0 + t.torque_nm - c.viscous * w0) * half;
    const Lanes8 rise1 = (k * i1 + t.torque_nm + in.h * t.rate - c.viscous * w1) * half;
    const Lanes8 swings = in.h > c.swing_s ? c.swing * (abs_of<Lanes8>(i0) + abs_of<Lanes8>(i1)) +
                                                 abs_of<Lanes8>(w1 - w0)
                                           : Lanes8{};
    const Lanes8 rises = max_of<Lanes8>(abs_of<Lanes8>(rise0), abs_of<Lanes8>(rise1));
    return min_of<Lanes8>(c.slide * w0, c.slide * w1) - max_of<Lanes8>(rises, swings);
}

// Positive where friction and load certainly hold the shaft during the whole row: the current stays
// between its start and the steady values at both ends of the row.
VGROOVE_INLINE Lanes8 block_holds(const FlowConstants &c, const FlowInput<Lanes8> &in,
                                  const Friction<double> &f, const Lanes8 &i0) {
    const Lanes8 last = in.command + in.h * in.command_rate;
    const Lanes8 source = c.volts ? splat<Lanes8>(1.0) : in.bus_v;
    const Lanes8 first_a = c.current_input ? in.command : in.command * source / c.resistance_ohm;
    const Lanes8 last_a = c.current_input ? last : last * source / c.resistance_ohm;
    Lanes8 high = max_of<Lanes8>(first_a, last_a), low = min_of<Lanes8>(first_a, last_a);
    if (!c.current_input) {
        high = max_of<Lanes8>(high, i0) * c.conducts;
        low = min_of<Lanes8>(low, i0) * c.conducts;
    }
    const Lanes8 load_end = in.load_nm + in.h * in.load_rate;
    const Lanes8 carried = max_of<Lanes8>(min_of<Lanes8>(in.load_nm, load_end), Lanes8{});
    const Lanes8 friction =
        f.coulomb_nm +
        c.load_relative * min_of<Lanes8>(abs_of<Lanes8>(in.load_nm), abs_of<Lanes8>(load_end));
    const Lanes8 forwards = carried + friction + f.forward_nm,
                 backwards = carried + friction + f.backward_nm;
    const Lanes8 one = c.constant * high, other = c.constant * low;
    const Lanes8 reserve = min_of<Lanes8>(forwards - max_of<Lanes8>(one, other),
                                          backwards + min_of<Lanes8>(one, other));
    return reserve >= 0.0 ? splat<Lanes8>(1.0) : splat<Lanes8>(-1.0);
}

// Number of rows, from the block's first on, in which the modes certainly do not change
VGROOVE_INLINE int block_certain(const Block &b, const Drivetrain<double> &m, bool open, int rows) {
    const FlowConstants &c = b.constants;
    for (int v = 0; v < b.vectors; ++v) {
        const int at = v * BLOCK_WIDTH;
        const Lanes8 i0 = block_load(b.current + at), i1 = block_load(b.current + at + 1);
        const Lanes8 w0 = block_load(b.speed + at), w1 = block_load(b.speed + at + 1);
        const FlowInput<Lanes8> &in = b.in[v];
        Lanes8 fit = c.slide != 0.0 ? block_slides(c, in, m.gear.inertia_inverse, i0, i1, w0, w1)
                                    : block_holds(c, in, m.friction, i0);
        if (open) {
            const Lanes8 emf =
                std::fabs(c.constant) * max_of<Lanes8>(abs_of<Lanes8>(w0), abs_of<Lanes8>(w1));
            fit = min_of<Lanes8>(fit, in.bus_v - emf);
        }
        if (c.load_relative != 0.0)
            fit =
                in.load_nm * (in.load_nm + in.h * in.load_rate) >= 0.0 ? fit : splat<Lanes8>(-1.0);
        const Lanes8 error_a = abs_of<Lanes8>(b.flow[v].d1 * i0 + b.flow[v].d2 * w0 + b.flow[v].d0);
        fit = min_of<Lanes8>(fit, SOLVER_RAMP_ERROR * m.current_scale - error_a);
        for (int lane = 0; lane < BLOCK_WIDTH; ++lane)
            if (!(fit[lane] > 0.0) || at + lane >= rows)
                return at + lane;
    }
    return rows;
}

VGROOVE_INLINE Sensors<Lanes8> block_wheel(const Sensors<double> &p) {
    return {Lanes8{}, Lanes8{}, splat<Lanes8>(p.hall_amplitude), splat<Lanes8>(p.hall_phase)};
}

// Writes the first `count` rows of vector v. angle: at the vector's start, and afterwards at its
// last row.
VGROOVE_INLINE void block_write(const Block &b, const ExactGroup &g, std::size_t at, int v,
                                int count, double &angle, const LogOutput &out) {
    const FlowConstants &c = b.constants;
    const FlowInput<Lanes8> &in = b.in[v];
    const Flow<Lanes8> &f = b.flow[v];
    const Drivetrain<double> &m = g.solver.model;
    const Parameters &p = g.parameters[0];
    const double *current = b.current + v * BLOCK_WIDTH, *speed = b.speed + v * BLOCK_WIDTH;
    const Lanes8 i = block_load(current), w = block_load(speed), w1 = block_load(speed + 1);
    const Lanes8 mean = c.current_input ? in.command + 0.5 * in.h * in.command_rate
                                        : (f.f11 * i + f.f12 * w + f.m1) / in.h;
    const Lanes8 turned = f.f21 * i + f.f22 * w + f.m2;
    Lanes8 th;
    for (int lane = 0; lane < BLOCK_WIDTH; ++lane)
        th[lane] = angle += turned[lane];
    angle = th[count - 1];
    const Lanes8 measured =
        mean * (1.0 + p.effects.current_gain.relative) + p.effects.current_offset.offset_a;
    const Lanes8 clipped = min_of<Lanes8>(
        max_of<Lanes8>(measured, splat<Lanes8>(-p.effects.current_saturation.limit_a)),
        splat<Lanes8>(p.effects.current_saturation.limit_a));
    const Lanes8 bus = in.bus_v - c.supply_ohm * (f.b1 * i + f.b2 * w + f.b0) / in.h;
    const double gain = 1.0 + p.effects.speed_gain.relative;
    block_store(out.current_a + at, clipped, count);
    block_store(out.supply_v + at, bus * (1.0 + p.effects.supply_gain.relative), count);
    block_store(out.speed_rad_s + at, w1, count);
    block_store(out.angle_rad + at, th, count);
    block_store(out.speed_measured_rad_s + at,
                sensors_wheel_speed<Lanes8>(block_wheel(m.sensors), m.effects, w1, th) * gain,
                count);
    block_store(out.angle_measured_rad + at,
                sensors_wheel_angle<Lanes8>(block_wheel(m.sensors), m.effects, th) * gain, count);
}

// Sets the solver to the end of row `last`.
VGROOVE_INLINE void block_hand_over(const Block &b, ExactGroup &g, const LogInput &in,
                                    std::size_t last, int rows, double angle) {
    Solver<double, STATE_CORE_COUNT> &s = g.solver;
    s.state.x[STATE_CURRENT] = b.current[rows];
    s.state.x[STATE_SPEED] = b.speed[rows];
    s.state.x[STATE_ANGLE] = angle;
    flush_tiny(s.state);
    s.mode.slide = b.constants.slide;
    s.mode.diode = 0.0;
    g.cursor[0].now_s = (in.time_s[last] - in.time_s[0]) * g.cursor[0].row_scale;
    solver_grant_steps(s, 0, rows, 0.0);
}

// Computes the rows from `row` on, before `end` and within one block, as far as their modes are
// certain; returns their number.
VGROOVE_INLINE int block_run(Block &b, ExactGroup &g, const LogInput &in, std::size_t row,
                             std::size_t end, const LogOutput &out) {
    Solver<double, STATE_CORE_COUNT> &s = g.solver;
    const bool open = !in.open.empty() && in.open[row] > 0.0 && s.model.input != InputKind::CURRENT;
    b.complete = false;
    if (open && s.state.x[STATE_CURRENT] != 0.0)
        return 0;
    int rows = static_cast<int>(end - row);
    for (int n = 1; n < rows && !in.open.empty(); ++n)
        rows = in.open[row + static_cast<std::size_t>(n)] == in.open[row] ? rows : n;
    b.constants = flow_constants(s.model, sign_of(s.state.x[STATE_SPEED]), open, 0.0);
    b.vectors = (rows + BLOCK_WIDTH - 1) / BLOCK_WIDTH;
    const std::size_t stop = row + static_cast<std::size_t>(rows);
    for (int v = 0; v < b.vectors; ++v) {
        block_fill(b.in[v], g, in, row + static_cast<std::size_t>(v * BLOCK_WIDTH), stop,
                   b.bus_scale);
        b.flow[v] = flow_of<Lanes8>(b.constants, b.in[v], block_any(b.in[v].command_rate));
    }
    block_chain(b, s.state.x[STATE_CURRENT], s.state.x[STATE_SPEED]);
    const int certain = block_certain(b, s.model, open, rows);
    b.complete = certain == rows;
    rows = certain;
    double angle = s.state.x[STATE_ANGLE];
    const std::size_t at = g.batch_row[0] * in.time_s.size() + row;
    for (int v = 0; v * BLOCK_WIDTH < rows; ++v)
        block_write(b, g, at + static_cast<std::size_t>(v * BLOCK_WIDTH), v,
                    std::min(rows - v * BLOCK_WIDTH, BLOCK_WIDTH), angle, out);
    if (rows > 0)
        block_hand_over(b, g, in, row + static_cast<std::size_t>(rows) - 1, rows, angle);
    return rows;
}

// The run of one parameter set: in blocks where the modes are certain, else row by row
VGROOVE_INLINE void run_exact_rows(ExactGroup &g, const LogInput &in, const LogStarts &starts,
                                   const LogOutput &out) {
    Block b;
    b.bus_scale = 1.0 / (1.0 + g.parameters[0].effects.supply_gain.relative);
    const bool shifted = (g.solver.model.effects & EFFECT_COMMAND_SHIFT) != 0u;
    std::size_t which = 0, width = BLOCK_ROWS;
    for (std::size_t row = starts.rows.front(); row < in.time_s.size();) {
        if (g.cancellation)
            g.cancellation->check();
        if (which < starts.rows.size() && starts.rows[which] == row) {
            reset_group(g, in, starts, which++);
            write_row(g, in, row++, true, out);
            continue;
        }
        const std::size_t last = which < starts.rows.size() ? starts.rows[which] : in.time_s.size();
        if (!shifted && !g.solver.exhausted[0]) {
            row += static_cast<std::size_t>(
                block_run(b, g, in, row, std::min(last, row + width), out));
            width = b.complete ? std::min<std::size_t>(2 * width, BLOCK_ROWS) : BLOCK_WIDTH;
            if (b.complete)
                continue;
        }
        step_row<true>(g, in, row);
        write_row(g, in, row++, false, out);
    }
}

}  // namespace vgroove

#endif
