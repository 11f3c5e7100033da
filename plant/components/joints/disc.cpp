// Stack of disc springs under a bolt: the slip torque follows from the stack's force through the
// bolt formula (docs/spec/model.md, section 6).
#include "components/joints/disc.hpp"

#include <cmath>

#include "components/joints/joint.hpp"

namespace vgroove {

constexpr double PI = 3.141592653589793;
// A stack that lies flat is a hard joint with this slope (estimate).
constexpr double FLAT_SLOPE_NM_PER_RAD = 700;

static double disc_k1(const DiscSpring &p) {
    const double d = p.outer_m / p.inner_m;
    const double rim = (d - 1.0) / d;
    return rim * rim / ((d + 1.0) / (d - 1.0) - 2.0 / std::log(d)) / PI;
}

double disc_spring_scale(const DiscSpring &p) {
    return 4.0 * YOUNG_PA / (1.0 - POISSON * POISSON) * p.thickness_m /
           (disc_k1(p) * p.outer_m * p.outer_m);
}

double disc_spring_force(const DiscSpring &p, double s) {
    return disc_spring_scale(p) * s *
           ((p.cone_m - s) * (p.cone_m - 0.5 * s) + p.thickness_m * p.thickness_m);
}

double disc_stack_force(const DiscSpring &p, double parallel, double series, double deflection_m) {
    return parallel * disc_spring_force(p, deflection_m / series);
}

double disc_stack_length(const DiscSpring &p, double parallel, double series) {
    return series * (p.cone_m + parallel * p.thickness_m);
}

double bolt_preload(const Bolt &p, double mu) {
    const double stress_m = 0.5 * (p.flank_m + p.core_m);
    const double shear = 1.5 * p.flank_m / stress_m * (p.pitch_m / (PI * p.flank_m) + 1.155 * mu);
    return 0.9 * p.yield_pa * 0.25 * PI * stress_m * stress_m /
           std::sqrt(1.0 + 3.0 * shear * shear);
}

double bolt_torque(const Bolt &p, double force_n, double thread_friction, double head_friction) {
    return force_n *
           (0.16 * p.pitch_m + 0.58 * p.flank_m * thread_friction + 0.5 * p.head_m * head_friction);
}

// Torque per force of the bolt: its friction, and its pitch, which changes sign backwards. Effect
// thread_friction scales the friction, effect joint_hysteresis multiplies the torque backwards by
// `loosening`.
struct BoltLevers {
    double friction_m, pitch_m, loosening;
};

static BoltLevers bolt_levers(const Parameters &p) {
    const double factor = 1.0 + p.effects.thread_friction.relative;
    return {factor * (0.58 * p.load.bolt_flank_m + 0.5 * p.load.bolt_head_m) * p.load.friction,
            0.16 * p.load.bolt_pitch_m, 1.0 - p.effects.joint_hysteresis.relative};
}

// The stack's force over the head angle, as a cubic: F(u) = scale (a u - 1.5 h0 u^2 + 0.5 u^3), a =
// h0^2 + t^2, u = start + per_rad th the deflection of one spring
struct StackForce {
    double scale, start_m, per_rad;
};

static StackForce stack_force(const Parameters &p) {
    const DiscSpring disc{p.load.disc_outer_m, p.load.disc_inner_m, p.load.disc_thickness_m,
                          p.load.disc_cone_m};
    return {p.load.parallel * disc_spring_scale(disc),
            p.load.from_turns * p.load.bolt_pitch_m / p.load.series,
            p.load.bolt_pitch_m / (2.0 * PI * p.load.series)};
}

static void add_compressing(const Parameters &p, const StackForce &f, const BoltLevers &b,
                            JointSegment &s) {
    const double h = p.load.disc_cone_m,
                 a = h * h + p.load.disc_thickness_m * p.load.disc_thickness_m, u = f.start_m;
    const double c[4] = {f.scale * u * (a - u * (1.5 * h - 0.5 * u)),
                         f.scale * f.per_rad * (a - 3.0 * h * u + 1.5 * u * u),
                         f.scale * f.per_rad * f.per_rad * (1.5 * u - 1.5 * h),
                         f.scale * f.per_rad * f.per_rad * f.per_rad * 0.5};
    for (int n = 0; n < 4; ++n) {
        s.forward[n] += (b.friction_m + b.pitch_m) * c[n];
        s.backward[n] += (b.friction_m - b.pitch_m) * b.loosening * c[n];
    }
}

static void add_flat(const Parameters &p, const StackForce &f, const BoltLevers &b,
                     JointSegment &s) {
    const double flat_rad = (p.load.disc_cone_m - f.start_m) / f.per_rad;
    const double flat_n =
        f.scale * p.load.disc_cone_m * p.load.disc_thickness_m * p.load.disc_thickness_m;
    const double back_slope = FLAT_SLOPE_NM_PER_RAD * p.load.loosen_ratio;
    joint_add_line(s.forward,
                   {flat_rad, (b.friction_m + b.pitch_m) * flat_n, FLAT_SLOPE_NM_PER_RAD}, 1.0);
    joint_add_line(s.backward, {flat_rad, (b.friction_m - b.pitch_m) * flat_n, back_slope},
                   b.loosening);
}

// Slip torque: run torque + F(th) (friction + pitch); backwards run torque + F(th) (friction -
// pitch)
static void disc_slip(const Parameters &p, double at_rad, JointSegment &s) {
    const StackForce force = stack_force(p);
    const BoltLevers levers = bolt_levers(p);
    const double factor = 1.0 + p.effects.thread_friction.relative;
    joint_add_line(s.forward, {0.0, p.load.run_torque_nm, 0.0}, factor);
    joint_add_line(s.backward, {0.0, p.load.run_torque_nm, 0.0}, factor);
    const double deflection = force.start_m + force.per_rad * at_rad;
    if (deflection <= 0.0)
        return;
    if (deflection >= p.load.disc_cone_m)
        add_flat(p, force, levers, s);
    else
        add_compressing(p, force, levers, s);
}

// Where the bolt begins to compress the stack, and where the stack lies flat
static std::vector<double> disc_breakpoints(const Parameters &p) {
    const double entry = -2.0 * PI * p.load.from_turns;
    return {entry, entry + 2.0 * PI * p.load.series * p.load.disc_cone_m / p.load.bolt_pitch_m};
}

const JointKind DISC_JOINT{LoadKind::DISC_SPRING, disc_breakpoints, disc_slip};

}  // namespace vgroove
