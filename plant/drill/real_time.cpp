// The drill driver's real-time mode: fixed steps of bounded work that are stable for any stiffness
// of the shaft and any length of the step.
//
// Between two events everything but the chuck's friction law is linear, so that a stretch is
// advanced by a matrix exponential computed beforehand. The law's torque is constant over a
// stretch, at its value at the stretch's end (implicit, one scalar equation): exact where the law
// is flat, stable where it is steep. A step is divided into pieces of at most PIECE_S; an event
// within a piece is located by bisection, with the matrices of halved lengths, to one tick.
#include "drill/real_time.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <unsupported/Eigen/MatrixFunctions>

namespace vgroove {

namespace {

constexpr double PIECE_S = 100e-6;
constexpr int LOCATE_LEVELS = 12;  // a tick is a piece / 4096: 24 ns or less
constexpr int LOCATED_MAX = 16;    // events located in one step; later ones end with their piece
constexpr int TIMED_MAX = 16;      // timed changes in a step of at most 1 s: pulse mode, load, ramp
constexpr double NEVER_S = std::numeric_limits<double>::infinity();
constexpr int BISECTIONS_MAX = 40;  // for the chuck speed

// Linear state: the core, charge, both angles. Linear input: terminal voltage and its slope, signs
// of motor friction and clutch, load torque.
enum { LINEAR_SUMS = DRILL_CORE_COUNT, LINEAR_STATES = LINEAR_SUMS + 3 };
enum {
    INPUT_VOLT = LINEAR_STATES,
    INPUT_VOLT_RATE,
    INPUT_SLIDE,
    INPUT_CLUTCH,
    INPUT_LOAD,
    LINEAR_COUNT
};
using Square = Eigen::Matrix<double, LINEAR_COUNT, LINEAR_COUNT>;
using Advance = Eigen::Matrix<double, LINEAR_STATES, LINEAR_COUNT>;
using Linear = Eigen::Matrix<double, LINEAR_COUNT, 1>;

// The same equations as drill_rates, as rows of a matrix
Square linear_rates(const DrillParameters &p, bool conducts, bool slides, bool grips) {
    Square a = Square::Zero();
    Eigen::Matrix<double, 1, LINEAR_COUNT> torque, turning;
    torque.setZero();
    turning.setZero();
    turning[DRILL_SPEED] = 1.0 / p.ratio;
    turning[DRILL_CHUCK] = -1.0;
    if (grips)
        torque = p.shaft_damping * turning;
    torque[grips ? int(DRILL_TWIST) : int(INPUT_CLUTCH)] = grips ? p.shaft_stiffness : p.clutch_nm;
    if (conducts) {
        a(DRILL_CURRENT, DRILL_CURRENT) = -p.resistance_ohm / p.inductance_h;
        a(DRILL_CURRENT, DRILL_SPEED) = -p.constant / p.inductance_h;
        a(DRILL_CURRENT, INPUT_VOLT) = 1.0 / p.inductance_h;
    }
    if (slides) {
        a.row(DRILL_SPEED) = -torque / (p.ratio * p.motor_inertia);
        a(DRILL_SPEED, DRILL_CURRENT) += p.constant / p.motor_inertia;
        a(DRILL_SPEED, DRILL_SPEED) -= p.motor_viscous / p.motor_inertia;
        a(DRILL_SPEED, INPUT_SLIDE) -= p.motor_coulomb_nm / p.motor_inertia;
    }
    a.row(DRILL_TWIST) = grips ? turning : (torque / p.shaft_damping).eval();
    if (!grips)
        a(DRILL_TWIST, DRILL_TWIST) -= p.shaft_stiffness / p.shaft_damping;
    a.row(DRILL_CHUCK) = torque / p.chuck_inertia;
    a(DRILL_CHUCK, INPUT_LOAD) -= 1.0 / p.chuck_inertia;
    a(LINEAR_SUMS + DRILL_CHARGE, DRILL_CURRENT) = 1.0;
    a(LINEAR_SUMS + DRILL_ANGLE, DRILL_SPEED) = 1.0;
    a(LINEAR_SUMS + DRILL_CHUCK_ANGLE, DRILL_CHUCK) = 1.0;
    a(INPUT_VOLT, INPUT_VOLT_RATE) = 1.0;
    return a;
}

// Chuck speed w with w = free + push (law(w) - law0), by bisection. free: speed after the stretch
// if the law's torque stayed at law0; push: change of the speed per N m of that torque, negative.
// The bracket follows from the bound of the law's torque: breakaway torque (with a margin of a
// tenth) and viscous part.
double chuck_speed(const DrillParameters &p, double load_nm, double free, double push,
                   double law0) {
    const auto over = [&](double w) {
        return w - free - push * (drill_load_torque(p, load_nm, w) - law0);
    };
    const double width = -push * (1.1 * p.breakaway_ratio * load_nm + std::fabs(law0) +
                                  p.load_viscous * std::fabs(free));
    double low = free - width, high = free + width;
    for (int n = 0; n < BISECTIONS_MAX && high - low > 1e-12 * (1.0 + std::fabs(free)); ++n) {
        const double middle = 0.5 * (low + high);
        (over(middle) < 0.0 ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

}  // namespace

struct DrillRealTime::Body {
    DrillSystem s;
    double step_s, tick_s, start_s = 0.0;
    std::size_t steps = 0;
    int levels;  // the finest; a step has 2^levels ticks
    long piece_ticks;
    int advances_taken = 0;
    std::vector<Advance, Eigen::aligned_allocator<Advance>>
        advances;  // 8 kinds of mode x (levels + 1)

    Body(const DrillParameters &p, double h)
        : s(p, DRILL_CHARGE_SPACING_S, drill_charge_points(p)),
          step_s(h) {}
};

static std::size_t variant_of(const DrillMode &m) {
    return (m.bridge != DrillBridge::BLOCKED ? 1u : 0u) | (m.slide != 0 ? 2u : 0u) |
           (m.clutch == 0 ? 4u : 0u);
}

DrillRealTime::DrillRealTime(const DrillParameters &p, double step_s) {
    drill_check(p);
    if (!(step_s >= 1e-7 && step_s <= 1.0))
        throw std::invalid_argument("step_s of the real-time mode must be within 1e-7 and 1 s");
    body_.reset(new Body(p, step_s));
    int pieces = 0;
    while (std::ldexp(step_s, -pieces) > PIECE_S)
        ++pieces;
    body_->levels = pieces + LOCATE_LEVELS;
    body_->piece_ticks = 1L << LOCATE_LEVELS;
    body_->tick_s = std::ldexp(step_s, -body_->levels);
    for (unsigned variant = 0; variant < 8; ++variant) {
        const Square a =
            linear_rates(p, (variant & 1u) != 0, (variant & 2u) != 0, (variant & 4u) != 0);
        for (int level = 0; level <= body_->levels; ++level)
            body_->advances.push_back(
                (a * std::ldexp(step_s, -level)).exp().topRows<LINEAR_STATES>());
    }
}

DrillRealTime::~DrillRealTime() = default;
DrillRealTime::DrillRealTime(const DrillRealTime &other)
    : body_(std::make_unique<Body>(*other.body_)) {}
const DrillSystem &DrillRealTime::system() const {
    return body_->s;
}
int DrillRealTime::advances_max() const {
    return (1 << (body_->levels - LOCATE_LEVELS)) +
           (2 * LOCATED_MAX + TIMED_MAX) * (LOCATE_LEVELS + 1);
}
int DrillRealTime::advances() const {
    return body_->advances_taken;
}

void DrillRealTime::command(const DrillCommand &c) {
    DrillSystem &s = body_->s;
    s.p.duty = c.duty;
    s.p.ramp_s = 0.0;
    s.p.supply_v = c.bus_v;
    s.p.load_nm = c.load_nm;
    s.p.load_from_s = -NEVER_S;
    s.p.load_to_s = NEVER_S;
    drill_command_bridge(s, c.open);
}

namespace {

// Linear state and input at the start of a stretch, with the law's torque at the speed there
Linear linear_of(const DrillSystem &s, const DrillInput &in) {
    Linear z;
    z.head<DRILL_CORE_COUNT>() = s.x;
    z.segment<3>(LINEAR_SUMS) = s.sums.head<3>();
    z.tail<5>() << in.terminal_v, in.terminal_v_per_s, s.mode.slide, s.mode.clutch,
        drill_load_torque(s.p, in.load_nm, s.x[DRILL_CHUCK]);
    return z;
}

// State after a stretch
using End = Eigen::Matrix<double, LINEAR_STATES, 1>;

End advanced(const DrillParameters &p, const Advance &by, const Linear &z, double load_nm) {
    End end = by * z;
    const double law0 = z[INPUT_LOAD];
    if (load_nm == 0.0 || drill_load_torque(p, load_nm, end[DRILL_CHUCK]) == law0)
        return end;
    const double push = by(DRILL_CHUCK, INPUT_LOAD);
    const double w = chuck_speed(p, load_nm, end[DRILL_CHUCK], push, law0);
    return end + by.col(INPUT_LOAD) * ((w - end[DRILL_CHUCK]) / push);
}

long largest_power_of_two(long n) {
    long power = 1;
    while (2 * power <= n)
        power *= 2;
    return power;
}

}  // namespace

// A trial stretch: the system after it
struct StretchTrial {
    End end;
    double time_s;
    DrillGuards guards;
};

static StretchTrial try_stretch(const DrillRealTime::Body &b, long at, long size) {
    const DrillSystem &s = b.s;
    const int level =
        b.levels - static_cast<int>(std::lround(std::log2(static_cast<double>(size))));
    const DrillInput in = drill_input(s.p, s.mode, s.time_s);
    const Advance &by = b.advances[variant_of(s.mode) * static_cast<std::size_t>(b.levels + 1) +
                                   static_cast<std::size_t>(level)];
    StretchTrial t;
    t.end = advanced(s.p, by, linear_of(s, in), in.load_nm);
    t.time_s = b.start_s + static_cast<double>(at + size) * b.tick_s;
    t.guards = drill_guards(s, t.time_s, t.end.head<DRILL_CORE_COUNT>(),
                            t.end[LINEAR_SUMS + DRILL_CHARGE]);
    return t;
}

// Ticks from the step's start to the next timed change, or to the step's end
static long next_stop(const DrillRealTime::Body &b, long at) {
    const long ticks = 1L << b.levels;
    const double next = (drill_next_time(b.s) - b.start_s) / b.tick_s;
    return next < static_cast<double>(ticks) ? std::max(at + 1, static_cast<long>(std::ceil(next)))
                                             : ticks;
}

static DrillMark accept_stretch(DrillSystem &s, const StretchTrial &t, bool met) {
    s.time_s = t.time_s;
    s.x = t.end.head<DRILL_CORE_COUNT>();
    s.sums.head<3>() = t.end.tail<3>();
    const DrillMark switched = met ? drill_switch(s, t.guards) : DrillMark::NONE;
    const DrillMark timed = drill_timers(s);
    const DrillMark mark = timed != DrillMark::NONE ? timed : switched;
    s.charge.push(s.time_s, s.sums[DRILL_CHARGE], s.x[DRILL_CURRENT], mark != DrillMark::NONE);
    return mark;
}

// A located event costs at most two descents through the levels, a timed change one:
// advances_max().
void DrillRealTime::step() {
    Body &b = *body_;
    long size_max = b.piece_ticks;
    int located = 0;
    b.advances_taken = 0;
    for (long at = 0; at < 1L << b.levels;) {
        const long size = std::min(size_max, largest_power_of_two(next_stop(b, at) - at));
        const StretchTrial t = try_stretch(b, at, size);
        ++b.advances_taken;
        const bool met = drill_any(t.guards);
        if (met && size > 1 && located < LOCATED_MAX) {
            size_max = size / 2;
            continue;
        }
        at += size;
        located += met ? 1 : 0;
        const DrillMark mark = accept_stretch(b.s, t, met);
        if (marks != nullptr && mark != DrillMark::NONE)
            marks->push_back({b.s.time_s, b.step_s, mark});
        const bool searching = !met && size_max > 1 && size_max < b.piece_ticks;
        size_max = searching ? size_max / 2 : b.piece_ticks;
    }
    b.start_s = static_cast<double>(++b.steps) * b.step_s;
    b.s.time_s = b.start_s;
}

}  // namespace vgroove
