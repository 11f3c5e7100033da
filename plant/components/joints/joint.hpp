// Joints under the anvil: an elastic twist up to slip torques that depend on the head angle; bolts,
// disc springs, wood screws (physics.md section 6).
#ifndef VGROOVE_PLANT_COMPONENTS_JOINTS_JOINT_HPP
#define VGROOVE_PLANT_COMPONENTS_JOINTS_JOINT_HPP

#include "components/loads.hpp"
#include "components/parameters.hpp"

namespace vgroove {

constexpr int JOINT_SEGMENTS_MAX = 8;
constexpr double DAMPING_LEAST_S = 1e-6;  // damping below stiffness * this is read as that: the
                                          // twist of a slipping joint needs a rate
constexpr double YOUNG_PA = 206e9;        // DIN EN 16984
constexpr double POISSON = 0.3;
constexpr double FLAT_SLOPE_NM_PER_RAD =
    700;  // a stack of disc springs that lies flat is a hard joint (E)

// Slip torques within one stretch of the head angle: c0 + c1 th + c2 th^2 + c3 th^3.
struct JointSegment {
    double from_rad, to_rad;
    double forward[4], backward[4];
};

struct Joint {
    double stiffness, damping, damping_inverse;
    bool of_load;  // slip torque is the load column, both ways
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

Joint joint_from(const Parameters &p, LoadKind kind);
int joint_segment_at(const Joint &p, double head_rad);

// DIN EN 16984: F = 4 E / (1 - nu^2) t^4 / (K1 De^2) (s / t) [(h0 / t - s / t)(h0 / t - s / 2t) +
// 1], K1 = (1 / pi) ((d - 1) / d)^2 / ((d + 1) / (d - 1) - 2 / ln d)
struct DiscSpring {
    double outer_m, inner_m, thickness_m, cone_m;
};
double disc_spring_force(const DiscSpring &p, double deflection_m);

// Stack of n parallel, i series: F_T = n F, s_T = i s, L0 = i (l0 + (n - 1) t), l0 = t + h0
double disc_stack_force(const DiscSpring &p, double parallel, double series, double deflection_m);
double disc_stack_length(const DiscSpring &p, double parallel, double series);

// VDI 2230 at 90 % of yield: F_M = 0.9 Rp A / sqrt(1 + 3 (1.5 d2 / dS (P / (pi d2) + 1.155 mu))^2),
// M_A = F_M (0.16 P + 0.58 d2 mu + D_Km / 2 mu_K)
struct Bolt {
    double pitch_m = 2e-3, flank_m = 14.701e-3, core_m = 13.546e-3, head_m = 20e-3,
           yield_pa = 1100e6;  // M16, class 12.9
};
double bolt_preload(const Bolt &p, double thread_friction);
double bolt_torque(const Bolt &p, double force_n, double thread_friction, double head_friction);

}  // namespace vgroove

#endif
