// Interface of a controller: its inputs, its functions, what a step returns.
//
// A controller NAME has a state struct Name, setpoints NameSetpoints in the units of the parameters
// that they come from, and these functions:
//     void NAME_start(Name *self, const NameSetpoints *set);
//         a drive begins, from rest or with a turning shaft; initialises the whole state
//     int16_t NAME_step(Name *self, const NameSetpoints *set, const ControllerInputs *in,
//                       const Blow *blow);
//         once a tick (1 ms) of the drive; returns the duty 0..32767, CONTROLLER_STOP or
//         CONTROLLER_COAST
//     uint8_t NAME_state(const Name *self);
//         for telemetry: its enumerator, 0..15
//     uint8_t NAME_stop_reason(const Name *self);
//         CONTROLLER_REASON_*
//     int16_t NAME_estimate(const Name *self);
//         for telemetry: defined on the controller's page, 0 if it has none
// All quantities count in the direction of the drive: positive speed and current drive the tool,
// negative current brakes it.
#ifndef VGROOVE_CONTROLLERS_CONTROLLER_H
#define VGROOVE_CONTROLLERS_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    int16_t travel_q15;    // trigger after duty limit and ramp: the duty of the plain mode; a drive
                           // begins with 0, or with the duty that matches a turning shaft
    int16_t speed_rpm_q1;  // over the last Hall pitch, decreasing with the time since its edge
    int16_t current_a_q9;  // mean over the tick
    uint16_t supply_mv;
    int16_t duty_q15;     // applied in the tick just measured, after the fold-back, in steps of the
                          // bridge (1/255); 0 when the bridge was open
    bool coasted;         // the bridge was open in the tick just measured
    int16_t trigger_q15;  // trigger after the duty limit, before the ramp of travel_q15
    uint8_t edges;        // of the Hall sensor in the tick, each one pitch
} ControllerInputs;

// The drive is over: the bridge is open until the trigger is released.
#define CONTROLLER_STOP (-1)

// The bridge is open for this tick, and for the next, in which it is armed before it drives.
#define CONTROLLER_COAST (-2)

// Signal that a controller works with: its setpoint `method`, where it has one.
typedef enum {
    CONTROLLER_METHOD_SPEED = 1,    // speed of the Hall sensor
    CONTROLLER_METHOD_CURRENT = 2,  // motor current, or the speed computed from current and duty
} ControllerMethod;

// Why a controller ended its drive or refused to begin it; the values of signal stop_reason.
typedef enum {
    CONTROLLER_REASON_NONE,
    CONTROLLER_REASON_SEATED,       // the screw head has met the wood
    CONTROLLER_REASON_REACHED,      // target torque reached
    CONTROLLER_REASON_UNREACHABLE,  // target torque out of the tool's range: drive refused
    CONTROLLER_REASON_MISSED,       // ended off the target torque; the estimate is the torque
    CONTROLLER_REASON_CLUTCH,       // torque of the electronic clutch reached
    CONTROLLER_REASON_KICKBACK,     // the shaft jammed
    CONTROLLER_REASON_SENSOR,       // a measured value is implausible; no controller returns it
    CONTROLLER_REASON_TIMEOUT,      // longest duration of the drive exceeded
} ControllerReason;

#endif
