// Joint under the anvil: an elastic twist, limited to slip torques that depend on the head angle
// th, the angle of the screw's head since the start (docs/spec/model.md, section 6).
#ifndef VGROOVE_PLANT_COMPONENTS_JOINTS_JOINT_HPP
#define VGROOVE_PLANT_COMPONENTS_JOINTS_JOINT_HPP

#include <vector>

#include "components/loads.hpp"
#include "components/parameters.hpp"

namespace vgroove {

constexpr int JOINT_SEGMENTS_MAX = 8;
// The least damping is the stiffness times this time: the twist of a slipping joint relaxes at the
// rate stiffness / damping, which must stay finite.
constexpr double JOINT_RELAXATION_LEAST_S = 1e-6;

// Slip torques within one range of the head angle: c0 + c1 th + c2 th^2 + c3 th^3.
struct JointSegment {
    double from_rad, to_rad;
    double forward[4], backward[4];
};

struct Joint {
    double stiffness, damping, damping_inverse;
    bool of_load;  // the slip torque is the log's load column, both ways
    int count;
    JointSegment segment[JOINT_SEGMENTS_MAX];
};

struct SlipTorques {
    double forward_nm, backward_nm;
};

VGROOVE_INLINE double joint_polynomial(const double *c, double x) {
    return c[0] + x * (c[1] + x * (c[2] + x * c[3]));
}

VGROOVE_INLINE SlipTorques joint_slip(const Joint &p, int segment, double head_rad,
                                      double load_nm) {
    if (p.of_load)
        return {load_nm, load_nm};
    const JointSegment &s = p.segment[segment];
    return {joint_polynomial(s.forward, head_rad), joint_polynomial(s.backward, head_rad)};
}

// The joint of a load kind, with the effects that act on it. A load that is no joint gives a joint
// that slips at 0.
Joint joint_from(const Parameters &p, LoadKind kind);
int joint_segment_at(const Joint &p, double head_rad);

// One kind of joint: the head angles at which its slip torque changes its law, and the slip torques
// around a head angle at_rad that is not such an angle, added to a segment's coefficients.
struct JointKind {
    LoadKind kind;
    std::vector<double> (*breakpoints)(const Parameters &p);
    void (*slip)(const Parameters &p, double at_rad, JointSegment &s);
};

// A new joint: its entry with the rig keys in hil/vgroove/gap/catalogue/loads/, its file, a line
// here, in JOINT_KINDS (joint.cpp), in VGROOVE_LOADS (loads.hpp) and in CMakeLists.txt.
extern const JointKind LOCKED_JOINT;  // joint.cpp
extern const JointKind HARD_JOINT;    // hard.cpp
extern const JointKind DISC_JOINT;    // disc.cpp
extern const JointKind WOOD_JOINT;    // wood.cpp

// A straight line of the slip torque over the head angle
struct SlipLine {
    double at_rad, nm, slope;
};

// Adds factor (nm + slope (th - at_rad)) to the coefficients c.
inline void joint_add_line(double *c, const SlipLine &l, double factor) {
    c[0] += factor * (l.nm - l.slope * l.at_rad);
    c[1] += factor * l.slope;
}

}  // namespace vgroove

#endif
