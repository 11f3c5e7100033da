// Slip torques of each joint as polynomials of the head angle, with the effects of mechanism and
// load folded in.
#include "components/joints/joint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace vgroove {

constexpr double PI = 3.141592653589793;
constexpr double EVERYWHERE = std::numeric_limits<double>::infinity();

static double disc_k1(const DiscSpring &p) {
    const double d = p.outer_m / p.inner_m;
    const double rim = (d - 1.0) / d;
    return rim * rim / ((d + 1.0) / (d - 1.0) - 2.0 / std::log(d)) / PI;
}

// F = scale s (h0 - s)(h0 - s / 2) + scale t^2 s, in N per m^3
static double disc_scale(const DiscSpring &p) {
    return 4.0 * YOUNG_PA / (1.0 - POISSON * POISSON) * p.thickness_m /
           (disc_k1(p) * p.outer_m * p.outer_m);
}

double disc_spring_force(const DiscSpring &p, double s) {
    return disc_scale(p) * s *
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

struct Line {
    double at_rad, nm, slope;
};

static void add_line(double *c, const Line &l, double factor) {
    c[0] += factor * (l.nm - l.slope * l.at_rad);
    c[1] += factor * l.slope;
}

// Run torque, then slope * head angle; the slope's part times loosen_ratio backwards. A head behind
// its start has no slope's part.
static void hard_segment(const Parameters &p, double at_rad, JointSegment &s) {
    const double slope = at_rad > 0.0 ? p.joint_slope : 0.0;
    const double factor = 1.0 + p.thread_friction_relative;
    add_line(s.forward, {0.0, p.joint_run_nm, slope}, factor);
    add_line(s.backward, {0.0, p.joint_run_nm, slope * p.joint_loosen_ratio}, factor);
}

// Stack force over the head angle as a cubic, times the bolt's levers; backwards the pitch's part
// changes sign. Flat, it is a hard joint.
static void disc_segment(const Parameters &p, double at_rad, JointSegment &s) {
    const DiscSpring disc{p.disc_outer_m, p.disc_inner_m, p.disc_thickness_m, p.disc_cone_m};
    const double per_rad = p.bolt_pitch_m / (2.0 * PI * p.disc_series);  // deflection of one spring
    const double start = p.joint_from_turns * p.bolt_pitch_m / p.disc_series;
    const double factor = 1.0 + p.thread_friction_relative;
    const double friction =
        factor * (0.58 * p.bolt_flank_m + 0.5 * p.bolt_head_m) * p.bolt_friction;
    const double pitch = 0.16 * p.bolt_pitch_m;
    const double loosening = 1.0 - p.joint_hysteresis_relative;
    add_line(s.forward, {0.0, p.joint_run_nm, 0.0}, factor);
    add_line(s.backward, {0.0, p.joint_run_nm, 0.0}, factor);
    const double deflection = start + per_rad * at_rad;
    if (deflection <= 0.0)
        return;
    const double scale = p.disc_parallel * disc_scale(disc);
    if (deflection >= p.disc_cone_m) {
        const double flat_rad = (p.disc_cone_m - start) / per_rad;
        const double flat_n = scale * p.disc_cone_m * p.disc_thickness_m * p.disc_thickness_m;
        add_line(s.forward, {flat_rad, (friction + pitch) * flat_n, FLAT_SLOPE_NM_PER_RAD}, 1.0);
        add_line(
            s.backward,
            {flat_rad, (friction - pitch) * flat_n, FLAT_SLOPE_NM_PER_RAD * p.joint_loosen_ratio},
            loosening);
        return;
    }
    // F(u) = scale (a u - 1.5 h0 u^2 + 0.5 u^3), u = start + per_rad th
    const double h = p.disc_cone_m, a = h * h + p.disc_thickness_m * p.disc_thickness_m, u = start;
    const double c[4] = {scale * u * (a - u * (1.5 * h - 0.5 * u)),
                         scale * per_rad * (a - 3.0 * h * u + 1.5 * u * u),
                         scale * per_rad * per_rad * (1.5 * u - 1.5 * h),
                         scale * per_rad * per_rad * per_rad * 0.5};
    for (int n = 0; n < 4; ++n) {
        s.forward[n] += (friction + pitch) * c[n];
        s.backward[n] += (friction - pitch) * loosening * c[n];
    }
}

struct ScrewStations {
    double entry_rad, seat_rad, strip_rad,
        stripped_rad;  // head angles: the tip enters, the head touches, the thread strips, has
                       // stripped
};

static ScrewStations screw_stations(const Parameters &p) {
    const double entry = -2.0 * PI * p.joint_from_turns;
    const double seat = entry + 2.0 * PI * p.screw_turns;
    const double strip = seat + p.screw_seat_deg * PI / 180.0;
    return {entry, seat, strip,
            strip + std::max(1.0 - p.screw_stripped_ratio, 0.0) *
                        PI};  // half the seat torque per 90 degrees
}

static void wood_segment(const Parameters &p, double at_rad, JointSegment &s) {
    const ScrewStations w = screw_stations(p);
    Line line{w.stripped_rad, p.screw_stripped_ratio * p.screw_seat_nm, 0.0};
    if (at_rad < w.entry_rad)
        line = {0.0, 0.0, 0.0};
    else if (at_rad < w.seat_rad)
        line = {w.entry_rad, p.screw_start_nm,
                (p.screw_end_nm - p.screw_start_nm) / (w.seat_rad - w.entry_rad)};
    else if (at_rad < w.strip_rad)
        line = {w.seat_rad, p.screw_end_nm,
                (p.screw_seat_nm - p.screw_end_nm) / (w.strip_rad - w.seat_rad)};
    else if (at_rad < w.stripped_rad)
        line = {w.strip_rad, p.screw_seat_nm, -p.screw_seat_nm / PI};
    const double factor = 1.0 + p.thread_friction_relative;
    add_line(s.forward, line, factor);
    add_line(s.backward, line, factor * p.joint_loosen_ratio);
}

static std::vector<double> breakpoints(const Parameters &p, LoadKind kind) {
    std::vector<double> at;
    if (kind == LoadKind::HARD_JOINT)
        at = {0.0};
    if (kind == LoadKind::WOOD_SCREW) {
        const ScrewStations w = screw_stations(p);
        at = {w.entry_rad, w.seat_rad, w.strip_rad, w.stripped_rad};
    }
    if (kind == LoadKind::DISC_SPRING) {
        const double entry = -2.0 * PI * p.joint_from_turns;
        at = {entry, entry + 2.0 * PI * p.disc_series * p.disc_cone_m / p.bolt_pitch_m};
    }
    if (p.knot_nm != 0.0 && kind != LoadKind::LOCKED) {
        at.push_back(p.knot_from_rad);
        at.push_back(p.knot_to_rad);
    }
    std::sort(at.begin(), at.end());
    at.erase(std::unique(at.begin(), at.end()), at.end());
    return at;
}

static JointSegment segment_between(const Parameters &p, LoadKind kind, double from_rad,
                                    double to_rad) {
    JointSegment s{from_rad, to_rad, {0.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 0.0}};
    const double low =
        std::isfinite(from_rad) ? from_rad : (std::isfinite(to_rad) ? to_rad - 1.0 : 0.0);
    const double high = std::isfinite(to_rad) ? to_rad : low + 1.0;
    const double at = 0.5 * (low + high);
    if (kind == LoadKind::LOCKED)
        s.forward[0] = s.backward[0] = EVERYWHERE;
    if (kind == LoadKind::HARD_JOINT)
        hard_segment(p, at, s);
    if (kind == LoadKind::DISC_SPRING)
        disc_segment(p, at, s);
    if (kind == LoadKind::WOOD_SCREW)
        wood_segment(p, at, s);
    if (p.knot_nm != 0.0 && at > p.knot_from_rad && at < p.knot_to_rad) {
        s.forward[0] += p.knot_nm;
        s.backward[0] += p.knot_nm * p.joint_loosen_ratio;
    }
    return s;
}

Joint joint_from(const Parameters &p, LoadKind kind) {
    Joint j{};
    j.stiffness = p.joint_stiffness * (1.0 + p.joint_stiffness_relative);
    j.damping = std::max(p.joint_damping, j.stiffness * DAMPING_LEAST_S);
    j.damping_inverse = 1.0 / j.damping;
    j.of_load = kind == LoadKind::TORQUE;
    double from = -EVERYWHERE;
    for (const double to : breakpoints(p, kind)) {
        j.segment[j.count++] = segment_between(p, kind, from, to);
        from = to;
    }
    j.segment[j.count++] = segment_between(p, kind, from, EVERYWHERE);
    return j;
}

int joint_segment_at(const Joint &p, double head_rad) {
    int n = 0;
    while (n + 1 < p.count && head_rad >= p.segment[n].to_rad)
        ++n;
    return n;
}

}  // namespace vgroove
