// Hard joint: a bolt whose head begins to turn at the run torque and stiffens with the head angle
// (docs/spec/model.md, section 6).
#include "components/joints/joint.hpp"

namespace vgroove {

// Slip torque: run torque + slope th; backwards run torque + loosen_ratio slope th. A head that
// has turned back behind its start (th < 0) slips at the run torque. Effect thread_friction scales
// both.
static void hard_slip(const Parameters &p, double at_rad, JointSegment &s) {
    const double slope = at_rad > 0.0 ? p.load.slip_slope_nm_per_rad : 0.0;
    const double factor = 1.0 + p.effects.thread_friction.relative;
    joint_add_line(s.forward, {0.0, p.load.run_torque_nm, slope}, factor);
    joint_add_line(s.backward, {0.0, p.load.run_torque_nm, slope * p.load.loosen_ratio}, factor);
}

static std::vector<double> hard_breakpoints(const Parameters &) {
    return {0.0};
}

const JointKind HARD_JOINT{LoadKind::HARD_JOINT, hard_breakpoints, hard_slip};

}  // namespace vgroove
