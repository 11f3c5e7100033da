// A hand-written peer: the impact tool of docs/spec/model.md, section 4, by semi-implicit Euler
// with a fixed step.
//
// Parameters and states are those of impact_tool.py; euler.py builds it with -O3 when the
// comparison runs.
#include <cmath>
#include <cstdint>

namespace {

// In the order of ImpactTool in impact_tool.py.
struct Tool {
    double supply, supply_ohm, resistance, inductance, torque_constant, motor_inertia, viscous,
        coulomb, ratio;
    double spindle_inertia, hammer_inertia, hammer_mass, lead, vertex, travel, preload, rate;
    double pitch, height, radius, overlap, stiffness, damping, ramp;
    double anvil_inertia, joint_stiffness, joint_damping, run, slope, loosen, duty;
};

struct State {
    double current, spindle, spindle_speed, hammer, hammer_speed, anvil, anvil_speed, twist;
};

// Where a lug of the hammer is: in the gap between the anvil's lugs, or above them.
enum class Lugs { GAP, ABOVE };

struct Place {
    Lugs lugs = Lugs::GAP;
    // relative angle of the anvil flank in front of the hammer's lug, or under it
    double flank = 0.0;
};

struct Groove {
    double x, s, ds;
};

inline Groove groove_of(const Tool &p, double q) {
    const double root = std::sqrt(q * q + p.vertex * p.vertex);
    return {p.lead * (root - p.vertex), p.lead * q / root,
            p.lead * p.vertex * p.vertex / (root * root * root)};
}

// Contact force: docs/spec/model.md, section 5, exponent 1.
inline double contact(const Tool &p, double pen, double rate) {
    if (pen <= 0.0)
        return 0.0;
    const double damping = rate > 0.0 ? p.damping * rate * std::fmin(pen / p.ramp, 1.0) : 0.0;
    return p.stiffness * pen + damping;
}

struct Forces {
    double lug_torque, axial;
};

inline Forces lug_forces(const Tool &p, Place &place, double x, double dx, double phi,
                         double dphi) {
    const double gap = p.pitch - p.overlap;
    double ahead = phi - place.flank;  // negative in the gap, 0..overlap over the lug in front
    if (place.lugs == Lugs::GAP) {
        if (x < p.height) {
            const double front = contact(p, p.radius * ahead, p.radius * dphi);
            const double rear = contact(p, p.radius * (-gap - ahead), -p.radius * dphi);
            return {p.radius * (front - rear), 0.0};
        }
        place.lugs = Lugs::ABOVE;
    }
    if (ahead > p.overlap) {
        place.flank += p.pitch;
        ahead -= p.pitch;
    } else if (ahead < -gap) {
        place.flank -= p.pitch;
        ahead += p.pitch;
    }
    if (x >= p.height)
        return {0.0, 0.0};
    if (ahead > 0.0)
        return {0.0, -contact(p, p.height - x, -dx)};
    place.lugs = Lugs::GAP;
    return {0.0, 0.0};
}

// Torque of the joint, and the twist a step later (implicit while it slips: the twist settles
// within 0.1 ms).
inline double joint_step(const Tool &p, State &y, double step) {
    const double gained = p.slope * std::fmax(y.anvil - y.twist, 0.0);
    const double forward = p.run + gained, backward = -p.run - p.loosen * gained;
    const double sticking = p.joint_stiffness * y.twist + p.joint_damping * y.anvil_speed;
    const double torque = std::fmax(backward, std::fmin(forward, sticking));
    if (torque == sticking) {
        y.twist += step * y.anvil_speed;
    } else {
        const double settled = torque / p.joint_stiffness,
                     relax = step * p.joint_stiffness / p.joint_damping;
        y.twist = (y.twist + relax * settled) / (1.0 + relax);
    }
    return torque;
}

inline double friction(const Tool &p, double speed, double drive) {
    if (speed == 0.0)
        return std::fmax(-p.coulomb, std::fmin(p.coulomb, drive));
    return std::copysign(p.coulomb, speed);
}

inline void euler_step(const Tool &p, State &y, Place &place, double step) {
    const double dq = y.spindle_speed - y.hammer_speed;
    const Groove g = groove_of(p, y.spindle - y.hammer);
    const double dx = g.s * dq, travel = groove_of(p, p.travel).x;
    const Forces f =
        lug_forces(p, place, g.x, dx, y.hammer - y.anvil, y.hammer_speed - y.anvil_speed);
    const double stop = contact(p, g.x - travel, dx);
    const double axial = p.preload + p.rate * g.x + f.axial + stop + p.hammer_mass * g.ds * dq * dq;
    const double speed = p.ratio * y.spindle_speed, drive = p.torque_constant * y.current;
    const double spindle =
        p.ratio * (drive - p.viscous * speed - friction(p, speed, drive)) - g.s * axial;
    const double hammer = g.s * axial - f.lug_torque;
    const double ms2 = p.hammer_mass * g.s * g.s,
                 a = p.spindle_inertia + p.ratio * p.ratio * p.motor_inertia, b = p.hammer_inertia;
    const double det = a * b + (a + b) * ms2;
    const double volts = p.duty * (p.supply - p.supply_ohm * p.duty * y.current);
    const double torque = joint_step(p, y, step);
    y.current +=
        step * (volts - p.resistance * y.current - p.torque_constant * speed) / p.inductance;
    y.spindle_speed += step * ((b + ms2) * spindle + ms2 * hammer) / det;
    y.hammer_speed += step * (ms2 * spindle + (a + ms2) * hammer) / det;
    y.anvil_speed += step * (f.lug_torque - torque) / p.anvil_inertia;
    y.spindle += step * y.spindle_speed;
    y.hammer += step * y.hammer_speed;
    y.anvil += step * y.anvil_speed;
}

}  // namespace

// Runs `rows` rows of `steps_per_row` steps from `state` (8 doubles, changed) and writes the states
// at the rows' ends.
extern "C" void vgroove_euler(const double *parameters, double *state, double step,
                              std::int64_t rows, std::int64_t steps_per_row, double *out) {
    const Tool &p = *reinterpret_cast<const Tool *>(parameters);
    State &y = *reinterpret_cast<State *>(state);
    Place place;
    for (std::int64_t row = 0; row < rows; ++row) {
        for (std::int64_t k = 0; k < steps_per_row; ++k)
            euler_step(p, y, place, step);
        reinterpret_cast<State *>(out)[row] = y;
    }
}
