// The drill driver (docs/spec/model.md, section 7): motor and gear, shaft with a slip clutch, chuck
// under a friction load, normal and pulse mode. Its parameters, modes and equations.
#ifndef VGROOVE_PLANT_DRILL_MODEL_HPP
#define VGROOVE_PLANT_DRILL_MODEL_HPP

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "components/friction_law.hpp"

namespace vgroove {

enum class DrillRange { ANY, NOT_NEGATIVE, POSITIVE };

// X(member, name, default, range). SI units, named as rig keys; defaults: docs/spec/model.md,
// section 7 in low gear with parameter step 1, section 4 for the motor.
// clang-format off
#define VGROOVE_DRILL_PARAMETERS(X) \
    X(supply_v,         "supply.voltage_v",                           18.0,     POSITIVE) \
    X(resistance_ohm,   "motor.resistance_ohm",                       0.19,     POSITIVE) \
    X(inductance_h,     "motor.inductance_h",                         100e-6,   POSITIVE) \
    X(constant,         "motor.torque_constant_nm_per_a",             0.0109,   POSITIVE) \
    X(motor_inertia,    "motor.inertia_kg_m2",                        1.6e-5,   POSITIVE) \
    X(motor_viscous,    "motor.viscous_nm_s_per_rad",                 4.5e-6,   NOT_NEGATIVE) \
    X(motor_coulomb_nm, "motor.coulomb_nm",                           0.012,    NOT_NEGATIVE) \
    X(ratio,            "gearbox.ratio",                              31.5,     POSITIVE) \
    X(chuck_inertia,    "gearbox.output_inertia_kg_m2",               2e-4,     POSITIVE) \
    X(shaft_stiffness,  "mechanism.shaft_stiffness_nm_per_rad",       3000.0,   POSITIVE) \
    X(shaft_damping,    "mechanism.shaft_damping_nm_s_per_rad",       0.02,     POSITIVE) \
    X(clutch_nm,        "mechanism.clutch_nm",                        30.0,     POSITIVE) \
    X(pulse,            "mechanism.pulse",                            0.0,      ANY) \
    X(pulse_on_a,       "mechanism.pulse_on_a",                       15.0,     NOT_NEGATIVE) \
    X(pulse_coast_s,    "mechanism.pulse_coast_s",                    0.025,    POSITIVE) \
    X(pulse_drive_s,    "mechanism.pulse_drive_s",                    0.075,    POSITIVE) \
    X(pulse_average_s,  "mechanism.pulse_average_s",                  0.1,      POSITIVE) \
    X(pulse_off_a,      "mechanism.pulse_off_a",                      8.0,      NOT_NEGATIVE) \
    X(load_nm,          "load.torque_nm",                             6.0,      NOT_NEGATIVE) \
    X(load_from_s,      "load.from_s",                                2.0,      ANY) \
    X(load_to_s,        "load.to_s",                                  3.0,      ANY) \
    X(breakaway_ratio,  "load.breakaway_ratio",                       1.2,      ANY) \
    X(breakaway_rad_s,  "load.breakaway_rad_s",                       0.1,      POSITIVE) \
    X(load_viscous,     "load.viscous_nm_s_per_rad",                  0.0,      NOT_NEGATIVE) \
    X(exponential,      "load.exponential",                           0.0,      ANY) \
    X(threshold_rad_s,  "load.threshold_rad_s",                       0.01,     POSITIVE) \
    X(decay_s_per_rad,  "load.decay_s_per_rad",                       10.0,     NOT_NEGATIVE) \
    X(rise_nm_per_rad,  "load.rise_nm_per_rad",                       0.0,      NOT_NEGATIVE) \
    X(rise_from_rad,    "load.rise_from_rad",                         0.0,      ANY) \
    X(rise_most_nm,     "load.rise_most_nm",                          1e8,      NOT_NEGATIVE) \
    X(duty,             "drive.duty",                                 1.0,      ANY) \
    X(ramp_s,           "drive.ramp_s",                               0.3,      NOT_NEGATIVE)
// clang-format on

struct DrillParameters {
#define VGROOVE_DRILL_MEMBER(member, name, value, range) double member = value;
    VGROOVE_DRILL_PARAMETERS(VGROOVE_DRILL_MEMBER)
#undef VGROOVE_DRILL_MEMBER
};

struct DrillParameter {
    const char *name;
    double DrillParameters::*member;
    DrillRange range;
};
#define VGROOVE_DRILL_ENTRY(member, name, value, range)                                            \
    DrillParameter{name, &DrillParameters::member, DrillRange::range},
constexpr DrillParameter DRILL_PARAMETERS[] = {VGROOVE_DRILL_PARAMETERS(VGROOVE_DRILL_ENTRY)};
#undef VGROOVE_DRILL_ENTRY

// Throws std::invalid_argument naming the key of a value outside its physical range.
void drill_check(const DrillParameters &p);

// State: motor current and speed, elastic twist of the shaft (at the output), chuck speed
enum DrillCore { DRILL_CURRENT, DRILL_SPEED, DRILL_TWIST, DRILL_CHUCK, DRILL_CORE_COUNT };
// Integrals that the state does not depend on: charge in A s, angles of motor and chuck in rad, and
// energies in J. Balance: work_in = losses + work_load + change of stored energy
enum DrillSum {
    DRILL_CHARGE,
    DRILL_ANGLE,
    DRILL_CHUCK_ANGLE,
    DRILL_WORK_IN,
    DRILL_LOSS_WINDING,
    DRILL_LOSS_MOTOR,
    DRILL_LOSS_SHAFT,
    DRILL_LOSS_CLUTCH,
    DRILL_WORK_LOAD,
    DRILL_SUM_COUNT
};
using DrillVector = Eigen::Matrix<double, DRILL_CORE_COUNT, 1>;
using DrillSums = Eigen::Matrix<double, DRILL_SUM_COUNT, 1>;

// DIODES: the open bridge carries the current against the bus until it is 0.
enum class DrillBridge { CLOSED, DIODES, BLOCKED };
enum class DrillControl { NORMAL, COAST, DRIVE };  // COAST and DRIVE: the two parts of pulse mode

struct DrillMode {
    int slide = 0;   // of the motor: -1, 0 held by Coulomb friction, 1
    int clutch = 0;  // 0 grips, else the sign of the torque at which it slips
    DrillBridge bridge = DrillBridge::CLOSED;
    int diode = 0;  // sign of the bus across the motor while the diodes conduct
    DrillControl control = DrillControl::NORMAL;
    double pulse_start_s = 0.0,
           switch_s = 0.0;  // start of pulse mode, next change between coast and drive
};

struct DrillInput {
    double terminal_v,
        terminal_v_per_s;  // d Vs and its slope, or the voltage of the conducting diodes
    double load_nm;        // Tc of the friction law at the chuck; 0: no load
};

struct DrillRates {
    DrillVector core;
    DrillSums sums;
};

// Derivatives of the rates, by the state and by time
struct DrillSlopes {
    Eigen::Matrix<double, DRILL_CORE_COUNT, DRILL_CORE_COUNT> core;
    Eigen::Matrix<double, DRILL_SUM_COUNT, DRILL_CORE_COUNT> sums;
    DrillVector core_time;
    DrillSums sums_time;
};

double drill_duty(const DrillParameters &p, const DrillMode &m, double time_s);
DrillInput drill_input(const DrillParameters &p, const DrillMode &m, double time_s);
// The inputs later_s later, within a stretch in which no timed change happens
DrillInput drill_later(const DrillInput &in, double later_s);
double drill_load_torque(const DrillParameters &p, double load_nm, double chuck_rad_s);
double drill_load_slope(const DrillParameters &p, double load_nm, double chuck_rad_s);
double drill_gripping_torque(const DrillParameters &p, const DrillVector &x);
double drill_shaft_torque(const DrillParameters &p, const DrillMode &m, const DrillVector &x);
double drill_stored_energy(const DrillParameters &p, const DrillVector &x);
DrillRates drill_rates(const DrillParameters &p, const DrillMode &m, const DrillInput &in,
                       const DrillVector &x);
DrillSlopes drill_slopes(const DrillParameters &p, const DrillMode &m, const DrillInput &in,
                         const DrillVector &x);
// Scale of each state: stall current, free speed, twist at the clutch's limit, free speed at the
// chuck
DrillVector drill_scales(const DrillParameters &p);

}  // namespace vgroove

#endif
