// Lag screw in wood: the torque rises with the depth, then in a seating ramp, then the thread
// strips (docs/spec/model.md, section 6).
#include <algorithm>

#include "components/joints/joint.hpp"

namespace vgroove {

constexpr double PI = 3.141592653589793;

// Head angles at which the tip enters the wood, the head touches it, the thread begins to strip and
// is stripped
struct ScrewAngles {
    double entry_rad, seat_rad, strip_rad, stripped_rad;
};

// While the thread strips, the torque falls by half of seat_nm per 90 degrees.
static ScrewAngles screw_angles(const Parameters &p) {
    const double entry = -2.0 * PI * p.load.from_turns;
    const double seat = entry + 2.0 * PI * p.load.turns;
    const double strip = seat + p.load.seat_deg * PI / 180.0;
    return {entry, seat, strip, strip + std::max(1.0 - p.load.stripped_ratio, 0.0) * PI};
}

// Slip torque: 0, then start_nm to end_nm over the turns, end_nm to seat_nm over seat_deg, seat_nm
// down to stripped_ratio seat_nm; backwards times loosen_ratio. Effect thread_friction scales both.
static void wood_slip(const Parameters &p, double at_rad, JointSegment &s) {
    const ScrewAngles w = screw_angles(p);
    SlipLine line{w.stripped_rad, p.load.stripped_ratio * p.load.seat_nm, 0.0};
    if (at_rad < w.entry_rad)
        line = {0.0, 0.0, 0.0};
    else if (at_rad < w.seat_rad)
        line = {w.entry_rad, p.load.start_nm,
                (p.load.end_nm - p.load.start_nm) / (w.seat_rad - w.entry_rad)};
    else if (at_rad < w.strip_rad)
        line = {w.seat_rad, p.load.end_nm,
                (p.load.seat_nm - p.load.end_nm) / (w.strip_rad - w.seat_rad)};
    else if (at_rad < w.stripped_rad)
        line = {w.strip_rad, p.load.seat_nm, -p.load.seat_nm / PI};
    const double factor = 1.0 + p.effects.thread_friction.relative;
    joint_add_line(s.forward, line, factor);
    joint_add_line(s.backward, line, factor * p.load.loosen_ratio);
}

static std::vector<double> wood_breakpoints(const Parameters &p) {
    const ScrewAngles w = screw_angles(p);
    return {w.entry_rad, w.seat_rad, w.strip_rad, w.stripped_rad};
}

const JointKind WOOD_JOINT{LoadKind::WOOD_SCREW, wood_breakpoints, wood_slip};

}  // namespace vgroove
