// Joints from the parameters: segments of the head angle with polynomial slip torques, and the
// effects that act on every joint.
#include "components/joints/joint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vgroove {

constexpr double UNLIMITED = std::numeric_limits<double>::infinity();

static std::vector<double> no_breakpoints(const Parameters &) {
    return {};
}

// A head that never turns
static void locked_slip(const Parameters &, double, JointSegment &s) {
    s.forward[0] = s.backward[0] = UNLIMITED;
}

const JointKind LOCKED_JOINT{LoadKind::LOCKED, no_breakpoints, locked_slip};

static const JointKind *const JOINT_KINDS[] = {&LOCKED_JOINT, &HARD_JOINT, &DISC_JOINT,
                                               &WOOD_JOINT};

static const JointKind *find_kind(LoadKind kind) {
    for (const JointKind *joint : JOINT_KINDS)
        if (joint->kind == kind)
            return joint;
    return nullptr;
}

static bool has_knot(const Parameters &p, LoadKind kind) {
    return p.effects.wood_knot.torque_nm != 0.0 && kind != LoadKind::LOCKED;
}

static std::vector<double> breakpoints_of(const Parameters &p, LoadKind kind) {
    const JointKind *joint = find_kind(kind);
    std::vector<double> at = joint ? joint->breakpoints(p) : std::vector<double>{};
    if (has_knot(p, kind)) {
        at.push_back(p.effects.wood_knot.from_rad);
        at.push_back(p.effects.wood_knot.to_rad);
    }
    std::sort(at.begin(), at.end());
    at.erase(std::unique(at.begin(), at.end()), at.end());
    return at;
}

// A head angle within a segment that may be unbounded
static double within(double from_rad, double to_rad) {
    const double low =
        std::isfinite(from_rad) ? from_rad : (std::isfinite(to_rad) ? to_rad - 1.0 : 0.0);
    const double high = std::isfinite(to_rad) ? to_rad : low + 1.0;
    return 0.5 * (low + high);
}

// Effect wood_knot: torque_nm more between two head angles, backwards times loosen_ratio
static JointSegment segment_between(const Parameters &p, LoadKind kind, double from_rad,
                                    double to_rad) {
    JointSegment s{from_rad, to_rad, {0.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 0.0}};
    const double at = within(from_rad, to_rad);
    if (const JointKind *joint = find_kind(kind))
        joint->slip(p, at, s);
    if (has_knot(p, kind) && at > p.effects.wood_knot.from_rad && at < p.effects.wood_knot.to_rad) {
        s.forward[0] += p.effects.wood_knot.torque_nm;
        s.backward[0] += p.effects.wood_knot.torque_nm * p.load.loosen_ratio;
    }
    return s;
}

Joint joint_from(const Parameters &p, LoadKind kind) {
    Joint j{};
    j.stiffness = p.load.stiffness_nm_per_rad * (1.0 + p.effects.joint_stiffness.relative);
    j.damping = std::max(p.load.damping_nm_s_per_rad, j.stiffness * JOINT_RELAXATION_LEAST_S);
    j.damping_inverse = 1.0 / j.damping;
    j.of_load = kind == LoadKind::TORQUE;
    double from = -UNLIMITED;
    for (const double to : breakpoints_of(p, kind)) {
        j.segment[j.count++] = segment_between(p, kind, from, to);
        from = to;
    }
    j.segment[j.count++] = segment_between(p, kind, from, UNLIMITED);
    return j;
}

int joint_segment_at(const Joint &p, double head_rad) {
    int n = 0;
    while (n + 1 < p.count && head_rad >= p.segment[n].to_rad)
        ++n;
    return n;
}

}  // namespace vgroove
