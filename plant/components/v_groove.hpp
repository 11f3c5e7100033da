// V-groove: balls between spindle and hammer turn their relative angle q into an axial retraction x
// of the hammer (docs/spec/model.md, section 4).
#ifndef VGROOVE_PLANT_COMPONENTS_V_GROOVE_HPP
#define VGROOVE_PLANT_COMPONENTS_V_GROOVE_HPP

#include <cmath>

#include "numeric/lanes.hpp"

namespace vgroove {

// A vertex rounding e_v below this is raised to it, so that the curvature of the groove stays
// finite.
constexpr double VERTEX_LEAST_RAD = 1e-3;

struct VGroove {
    double lead;      // l, m/rad
    double vertex2;   // e_v^2, rad^2
    double vertex;    // e_v, rounding of the vertex, rad
    double ball_arm;  // m: friction torque on q per axial force, 0 without groove_friction
};

// Lead l of the grooves of spindle (J) and hammer (S) together, r: radius of a groove, g: its slope
// angle, r tan g: its lead, B: ball.
// x = rJ tan gJ |thJB| + rS tan gS |thSB|, thJB = share thSJ, share = (rS / cos gS) / (rJ / cos gJ
// + rS / cos gS); r / cos g = sqrt(r^2 + lead^2)
VGROOVE_INLINE double v_groove_lead(double spindle_lead, double spindle_radius, double hammer_lead,
                                    double hammer_radius) {
    const double spindle = std::sqrt(spindle_radius * spindle_radius + spindle_lead * spindle_lead);
    const double hammer = std::sqrt(hammer_radius * hammer_radius + hammer_lead * hammer_lead);
    const double share = hammer / (spindle + hammer);
    return spindle_lead * share + hammer_lead * (1.0 - share);
}

// Effect groove_friction: torque on q = coefficient |axial force| r / cos(atan(l / r))
VGROOVE_INLINE double v_groove_ball_arm(double coefficient, double lead, double radius) {
    return coefficient * std::sqrt(radius * radius + lead * lead);
}

struct GroovePoint {
    double x;            // m
    double s;            // dx / dq, m/rad
    double c;            // ds / dq, m/rad^2
    double square, run;  // q^2 + e_v^2 and l q: s^2 = run^2 / square needs no square root
};

// x = l (sqrt(q^2 + e_v^2) - e_v), s = l q / sqrt(q^2 + e_v^2),
// s' = ds / dq = l e_v^2 / sqrt(q^2 + e_v^2)^3
VGROOVE_INLINE GroovePoint v_groove_at(const VGroove &p, double q) {
    const double square = q * q + p.vertex2, run = p.lead * q;
    const double root = std::sqrt(square);
    const double inverse = 1.0 / root;
    return {p.lead * (root - p.vertex), run * inverse,
            p.lead * p.vertex2 * inverse * inverse * inverse, square, run};
}

}  // namespace vgroove

#endif
