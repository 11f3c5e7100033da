// State of the drivetrain, the command and load that act on it, and the discrete modes of friction
// and bridge.
#ifndef VGROOVE_PLANT_COMPONENTS_STATE_HPP
#define VGROOVE_PLANT_COMPONENTS_STATE_HPP

#include "numeric/lanes.hpp"
#include "numeric/state_vector.hpp"

namespace vgroove {

// CORE: states of every drivetrain. FULL: with those of effects that have states of their own.
// AUDIT: with energies.
enum StateIndex {
    STATE_CURRENT,       // A
    STATE_SPEED,         // rad/s, motor shaft
    STATE_ANGLE,         // rad, motor shaft
    STATE_CURRENT_TIME,  // A s, integral of the current as the sensor shows it
    STATE_BUS_TIME,      // V s, integral of the bus voltage
    STATE_CORE_COUNT,
    STATE_CHARGE = STATE_CORE_COUNT,  // C, drawn from the supply
    STATE_POLARISATION,               // V
    STATE_HEAT,                       // K above the cold winding
    STATE_CURRENT_FILTER,             // A
    STATE_SPEED_FILTER,               // rad/s
    STATE_OUTPUT_SPEED,               // rad/s, output side, referred to the motor shaft
    STATE_TWIST,  // rad, motor angle less output angle, referred to the motor shaft
    STATE_FULL_COUNT,
    STATE_WORK_IN = STATE_FULL_COUNT,  // J, from the supply's open-circuit source or the stated
                                       // terminal voltage or current
    STATE_LOSS_BUS,                    // J, supply resistance, dead time, switches
    STATE_LOSS_WINDING,                // J, copper and brushes
    STATE_LOSS_FRICTION,               // J, bearings and gear
    STATE_LOSS_COUPLER,                // J, damping between motor and output
    STATE_WORK_LOAD,                   // J, against the load torque
    STATE_AUDIT_COUNT,
};

// Command and load along one stretch of time, in which both are straight lines.
template <class V> struct Drive {
    V command, command_rate;  // duty, V or A, and its change per second
    V load_nm, load_rate;     // N m at the output, opposing motion, and its change per second
    V bus_v;                  // measured bus, V; used where the bus is measured
    V open;                   // 1: all switches of the bridge are open
    V dead;    // share of the bus lost to dead time, 2 dead_time pwm_hz while the bridge switches
    V time_s;  // since the first row, at the start of the stretch
};

// A body slides forwards (+1), backwards (-1) or sticks (0). The diodes of an open bridge conduct a
// current of the sign `diode`, or block (0).
template <class V> struct Mode {
    V slide, output_slide;
    V diode;
};

VGROOVE_INLINE double sign_of(double x) {
    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : 0.0);
}

}  // namespace vgroove

#endif
