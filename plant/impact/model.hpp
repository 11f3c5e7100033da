// The impact mechanism behind the drivetrain: layout of its state, modes and constants
// (docs/spec/model.md, sections 4 to 6 and 8).
#ifndef VGROOVE_PLANT_IMPACT_MODEL_HPP
#define VGROOVE_PLANT_IMPACT_MODEL_HPP

#include "components/contact.hpp"
#include "components/joints/joint.hpp"
#include "components/v_groove.hpp"
#include "drivetrain/model.hpp"

namespace vgroove {

// A coupler's inertia below this is raised to it, kg m2.
constexpr double OUTPUT_INERTIA_LEAST = 1e-6;

// Layout of the state: first the drivetrain's, then the mechanism's. FULL: with the states of
// effects and of a second output body; without it the code for them is left out
// (impact_needs_full). AUDIT: with energies.
template <bool FULL_STATES, bool AUDITED> struct ImpactLayout {
    static constexpr bool FULL = FULL_STATES, AUDIT = AUDITED;
    static constexpr bool EXACT = AUDITED;  // accuracy of located events, impact/solver.hpp
    static constexpr int HAMMER_ANGLE =
        FULL ? STATE_FULL_COUNT : STATE_CORE_COUNT;  // rad, 0 at the start
    static constexpr int HAMMER_SPEED = HAMMER_ANGLE + 1;
    static constexpr int ANVIL_ANGLE = HAMMER_ANGLE + 2;
    static constexpr int ANVIL_SPEED = HAMMER_ANGLE + 3;
    static constexpr int TWIST = HAMMER_ANGLE + 4;        // rad, elastic twist e of the joint
    static constexpr int LUG_IMPULSE = HAMMER_ANGLE + 5;  // N m s, integral of the lug torque
    static constexpr int ARM_ANGLE = HAMMER_ANGLE + 6;
    static constexpr int ARM_SPEED = HAMMER_ANGLE + 7;
    static constexpr int HOUSING_TIME =
        HAMMER_ANGLE + 8;  // N m s, integral of the housing reaction
    static constexpr int CORE_COUNT = HAMMER_ANGLE + 9;
    static constexpr int OUTPUT_SPEED = CORE_COUNT;       // rad/s, second output body
    static constexpr int COUPLER_TWIST = CORE_COUNT + 1;  // rad, anvil less second body
    static constexpr int FULL_COUNT = FULL ? CORE_COUNT + 2 : CORE_COUNT;
    static constexpr int WORK_IN = FULL_COUNT;            // J, source
    static constexpr int LOSS_ELECTRIC = FULL_COUNT + 1;  // J, supply, bridge, winding, brushes
    static constexpr int LOSS_FRICTION =
        FULL_COUNT + 2;  // J, motor and gear friction, backlash flanks
    static constexpr int LOSS_GROOVE = FULL_COUNT + 3;   // J, balls
    static constexpr int LOSS_CONTACT = FULL_COUNT + 4;  // J, damping and friction of contacts
    static constexpr int LOSS_JOINT = FULL_COUNT + 5;    // J, damping, slip, coupler damping
    static constexpr int COUNT = AUDIT ? FULL_COUNT + 6 : FULL_COUNT;
};
using FastLayout = ImpactLayout<false, false>;
using FullLayout = ImpactLayout<true, false>;
using AuditLayout = ImpactLayout<true, true>;
template <class L> using ImpactState = State<double, L::COUNT>;

// Hammer lug on either flank of an anvil lug, or on its top; hammer at the end stop
enum class ContactPlace { NONE, FORWARD, BACKWARD, TOP, STOP };

// Discrete modes. Within one combination of modes the derivative is a smooth function.
struct ImpactMode {
    Mode<double> drive;
    ContactPlace place;
    bool above;                // the hammer is above the lugs, else in the gap before lug `lug`
    bool approaching, ramped;  // contact: penetration grows; its damping has the full value
    double forward_rad, backward_rad;  // relative angles at the end and the start of the gap
    long lug;                          // number of the lug at the end of the gap, 0 for the first
    int slip;                          // joint: -1 backwards, 0 sticks, 1 forwards
    int segment;                       // of the joint
    double roll;                       // groove: sign of q', 0 while the balls stick
    double axial_sign;                 // sign of the force through the balls
    bool ringing;  // fast mode: the untouched anvil rings on its joint in closed form
    bool frozen;   // anvil and joint are at rest
};

struct Impact {
    Drivetrain<double> drive;
    VGroove groove;
    Contact contact;
    Joint joint;
    bool two_bodies;     // backlash: motor and spindle move separately
    bool second_output;  // coupler or pendulum behind the anvil
    bool flank_friction;
    bool ball_friction;
    double ratio, ratio_inverse;
    double motor_inertia;  // rotor with added_inertia
    double spindle_inertia,
        spindle_inertia_inverse;  // at the spindle: with N^2 J_motor when one body
    double hammer_inertia, hammer_inertia_inverse, hammer_mass;
    double preload_n, rate_n_per_m;
    double lug_height_m, lug_radius_m, overlap_rad, period_rad, travel_m, start_rad;
    double anvil_inertia, anvil_inertia_inverse;
    // Anvil (JA) on its sticking joint (K, C): C / (2 JA), K / JA, sqrt |K / JA - (C / (2 JA))^2|;
    // ring_swings: the damping is less than critical
    double ring_decay, ring_square, ring_rate;
    bool ring_swings;
    // Hammer and spindle on the spring, on a flank of the groove: square of the natural frequency
    // of the groove angle, and the spindle's share in a change of that angle
    double swing_square, swing_share;
    double coupler_stiffness, coupler_damping, output_inertia, output_inertia_inverse;
    double pendulum_nm, zero_rad;
    double arm_inertia_inverse, arm_stiffness, arm_damping;
    // Weights of errors: 1 / stall current, 1 / free speed at the motor and at the anvil, 1 / angle
    double current_weight, speed_weight, output_weight, angle_weight;
};

// Throws std::invalid_argument, which names the parameter that is out of range.
Impact impact_from(const Parameters &p, LoadKind load, InputKind input, bool bus_measured,
                   double command_peak);

// Effects that a layout has
template <class L>
constexpr std::uint32_t IMPACT_EFFECTS = L::FULL ? ~std::uint32_t{0}
                                                 : static_cast<std::uint32_t>(EFFECT_DEAD_TIME);

// Whether the parameters need states or terms that only the FULL layout has
VGROOVE_INLINE bool impact_needs_full(const Impact &m) {
    return (m.drive.effects & ~IMPACT_EFFECTS<FastLayout>) != 0u ||
           m.drive.input != InputKind::DUTY || m.drive.bus_measured || m.two_bodies ||
           m.second_output || m.flank_friction || m.ball_friction;
}

// States to the compiler what impact_needs_full excludes: without the FULL layout it leaves out the
// code for it.
template <class L> VGROOVE_INLINE void impact_assume_layout(const Impact &m) {
    if constexpr (!L::FULL)
        if (impact_needs_full(m))
            __builtin_unreachable();
}

}  // namespace vgroove

#endif
