// Constants of the impact tool from the flat parameters, including the effects that change a
// coefficient, and the checks of their ranges.
#include "impact/model.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

namespace vgroove {

constexpr double TURN_RAD = 6.283185307179586;
constexpr double ANGLE_SCALE_RAD = 0.01;  // for errors: of the order of the twist in a blow

// message: a printf format for the two numbers that contradict each other
static void require_together(bool holds, const char *message, double a, double b) {
    if (holds)
        return;
    char text[200];
    std::snprintf(text, sizeof text, message, a, b);
    throw std::invalid_argument(text);
}

// The hammer must be able to rise above the lugs, and must start in a gap between them.
static void check_lugs(const Impact &m, const Parameters &p) {
    require_together(m.travel_m > m.lug_height_m,
                     "mechanism.travel_rad lets the hammer rise by %.4g m: it must be more than "
                     "mechanism.lug_height_m, %.4g",
                     m.travel_m, m.lug_height_m);
    const double place = m.start_rad - m.period_rad * std::floor(m.start_rad / m.period_rad);
    require_together(place == 0.0 || place >= m.overlap_rad,
                     "mechanism.hammer_start_rad %.4g starts the hammer on a lug: it may be "
                     "from -%.4g to 0 rad, before the anvil's lug",
                     p.hammer_start_rad, m.period_rad - m.overlap_rad);
}

static void check_impact(const Parameters &p) {
    require_parameter(p.hammer_inertia_kg_m2 > 0.0,
                      "mechanism.hammer_inertia_kg_m2 must be positive");
    require_parameter(p.hammer_mass_kg > 0.0, "mechanism.hammer_mass_kg must be positive");
    require_parameter(p.anvil_inertia_kg_m2 > 0.0,
                      "mechanism.anvil_inertia_kg_m2 must be positive");
    require_parameter(p.groove_lead_m_per_rad > 0.0,
                      "mechanism.groove_lead_m_per_rad must be positive");
    require_parameter(p.groove_radius_m > 0.0, "mechanism.groove_radius_m must be positive");
    require_parameter(p.lug_count >= 1.0 && p.lug_count == std::floor(p.lug_count),
                      "mechanism.lug_count must be a whole number above 0");
    require_together(p.lug_overlap_rad > 0.0 && p.lug_overlap_rad < TURN_RAD / p.lug_count,
                     "mechanism.lug_overlap_rad %.4g leaves no gap between the lugs: it must be "
                     "above 0 and below a turn over mechanism.lug_count, %.4g",
                     p.lug_overlap_rad, TURN_RAD / p.lug_count);
    require_parameter(p.lug_radius_m > 0.0, "mechanism.lug_radius_m must be positive");
    require_together(
        p.lug_height_m - p.effects.lug_wear.height_m > 0.0,
        "mechanism.lug_height_m %.4g must be more than effects.lug_wear.height_m, %.4g",
        p.lug_height_m, p.effects.lug_wear.height_m);
    require_parameter(p.contact_stiffness > 0.0,
                      "mechanism.contact_stiffness_n_per_m must be positive");
    require_parameter(p.contact_ramp_m > 0.0, "mechanism.contact_ramp_m must be positive");
    require_parameter(p.contact_exponent >= 1.0, "mechanism.contact_exponent must be at least 1");
    require_parameter(p.friction_speed_m_per_s > 0.0,
                      "mechanism.friction_speed_m_per_s must be positive");
    require_parameter(p.load.stiffness_nm_per_rad * (1.0 + p.effects.joint_stiffness.relative) >
                          0.0,
                      "load.stiffness_nm_per_rad must be positive");
    require_parameter(p.arm_inertia_kg_m2 > 0.0, "mechanism.arm_inertia_kg_m2 must be positive");
    require_parameter(p.spring_rate_n_per_m * (1.0 + p.effects.spring_rate.relative) >= 0.0,
                      "mechanism.spring_rate_n_per_m must not be negative");
}

static void set_groove_and_hammer(Impact &m, const Parameters &p) {
    const double hammer_lead =
        p.hammer_groove_lead > 0.0 ? p.hammer_groove_lead : p.groove_lead_m_per_rad;
    const double hammer_radius =
        p.hammer_groove_radius > 0.0 ? p.hammer_groove_radius : p.groove_radius_m;
    m.groove.lead =
        v_groove_lead(p.groove_lead_m_per_rad, p.groove_radius_m, hammer_lead, hammer_radius);
    m.groove.vertex = std::max(p.vertex_rad, VERTEX_LEAST_RAD);
    m.groove.vertex2 = m.groove.vertex * m.groove.vertex;
    m.groove.ball_arm = v_groove_ball_arm(p.effects.groove_friction.coefficient, m.groove.lead,
                                          0.5 * (p.groove_radius_m + hammer_radius));
    m.ball_friction = m.groove.ball_arm > 0.0;
    m.hammer_inertia = p.hammer_inertia_kg_m2;
    m.hammer_inertia_inverse = 1.0 / p.hammer_inertia_kg_m2;
    m.hammer_mass = p.hammer_mass_kg;
    m.preload_n = p.spring_preload_n * (1.0 + p.effects.spring_preload.relative);
    m.rate_n_per_m = p.spring_rate_n_per_m * (1.0 + p.effects.spring_rate.relative);
    m.travel_m = v_groove_at(m.groove, p.travel_rad).x;
}

static void set_lugs(Impact &m, const Parameters &p) {
    m.lug_height_m = p.lug_height_m - p.effects.lug_wear.height_m;
    m.lug_radius_m = p.lug_radius_m;
    m.overlap_rad = p.lug_overlap_rad;
    m.period_rad = TURN_RAD / p.lug_count;
    m.start_rad = p.hammer_start_rad;
    m.contact = {
        p.contact_stiffness,     p.contact_damping * (1.0 + p.effects.impact_damping.relative),
        p.contact_ramp_m,        p.contact_exponent,
        p.friction_static,       p.friction_kinetic,
        p.friction_speed_m_per_s};
    m.flank_friction = p.friction_static != 0.0 || p.friction_kinetic != 0.0;
    check_lugs(m, p);
}

// Effect coupler_compliance, behind the anvil: J2 = inertia_kg_m2, c = 2 damping_ratio
// sqrt(stiffness J2). A pendulum is attached to the second body.
static void set_output(Impact &m, const Parameters &p, LoadKind load) {
    const bool coupler = std::isfinite(p.effects.coupler_compliance.stiffness_nm_per_rad),
               pendulum = load == LoadKind::PENDULUM;
    const double mass = load_inertia(p, load);
    m.joint = joint_from(p, load);
    m.anvil_inertia = p.anvil_inertia_kg_m2;
    m.anvil_inertia_inverse = 1.0 / p.anvil_inertia_kg_m2;
    m.ring_decay = 0.5 * m.joint.damping * m.anvil_inertia_inverse;
    m.ring_square = m.joint.stiffness * m.anvil_inertia_inverse;
    m.ring_swings = m.ring_square > m.ring_decay * m.ring_decay;
    m.ring_rate = std::sqrt(std::fabs(m.ring_square - m.ring_decay * m.ring_decay));
    m.second_output = coupler || pendulum;
    m.output_inertia = std::max(mass + (coupler ? p.effects.coupler_compliance.inertia_kg_m2 : 0.0),
                                OUTPUT_INERTIA_LEAST);
    m.output_inertia_inverse = 1.0 / m.output_inertia;
    m.coupler_stiffness =
        coupler ? p.effects.coupler_compliance.stiffness_nm_per_rad : m.joint.stiffness;
    m.coupler_damping =
        coupler
            ? 2.0 * p.effects.coupler_compliance.damping_ratio *
                  std::sqrt(p.effects.coupler_compliance.stiffness_nm_per_rad * m.output_inertia)
            : m.joint.damping;
    m.pendulum_nm = pendulum ? p.load.mass_kg * GRAVITY_M_S2 * p.load.length_m : 0.0;
    m.zero_rad = p.load.zero_rad;
}

// Parameters of the drivetrain alone: coupler and load act behind the anvil.
static Parameters drivetrain_parameters(const Parameters &p) {
    Parameters d = p;
    d.effects.coupler_compliance.stiffness_nm_per_rad = OFF_AT_INFINITY;
    d.effects.coupler_compliance.inertia_kg_m2 = 0.0;
    d.load.mass_kg = 0.0;
    return d;
}

static void set_drive(Impact &m, const Parameters &p, InputKind input, bool bus_measured,
                      double command_peak) {
    const Parameters d = drivetrain_parameters(p);
    m.drive.effects = effects_of(d, 0.0);
    m.drive.input = input;
    m.drive.bus_measured = bus_measured;
    m.drive.load.kind = LoadKind::NONE;
    drivetrain_set_lane(m.drive, 0, d, command_peak, 1e-3);
    m.two_bodies = (m.drive.effects & EFFECT_TWO_BODIES) != 0u;
    m.ratio = p.gearbox_ratio;
    m.ratio_inverse = 1.0 / p.gearbox_ratio;
    m.motor_inertia = p.motor_inertia_kg_m2 + p.effects.added_inertia.kg_m2;
    m.spindle_inertia =
        p.gearbox_output_inertia + (m.two_bodies ? 0.0 : m.ratio * m.ratio * m.motor_inertia);
    m.spindle_inertia_inverse = 1.0 / m.spindle_inertia;
}

Impact impact_from(const Parameters &p, LoadKind load, InputKind input, bool bus_measured,
                   double command_peak) {
    check_parameters(p, input != InputKind::CURRENT);
    check_impact(p);
    require_parameter(
        load != LoadKind::FREE,
        "a free load turns without an impact mechanism; under one load.kind = none is free");
    Impact m{};
    set_drive(m, p, input, bus_measured, command_peak);
    set_groove_and_hammer(m, p);
    set_lugs(m, p);
    set_output(m, p, load);
    const double both = m.spindle_inertia_inverse + m.hammer_inertia_inverse;
    const double lead2 = m.groove.lead * m.groove.lead;
    m.swing_square = both * m.rate_n_per_m * lead2 / (1.0 + both * m.hammer_mass * lead2);
    m.swing_share = m.spindle_inertia_inverse / both;
    m.arm_inertia_inverse = 1.0 / p.arm_inertia_kg_m2;
    m.arm_stiffness = p.arm_stiffness;
    m.arm_damping = p.arm_damping;
    m.current_weight = 1.0 / m.drive.current_scale;
    m.speed_weight = 1.0 / m.drive.speed_scale;
    m.output_weight = m.ratio * m.speed_weight;
    m.angle_weight = 1.0 / ANGLE_SCALE_RAD;
    return m;
}

}  // namespace vgroove
