// What every controller gets and gives.
//
// A controller NAME has a state struct Name, setpoints NameSetpoints in the units of the parameters
// that they come from, and
//     void NAME_start(Name *self, const NameSetpoints *set);   a drive begins, from rest or
//     resumed: state anew int16_t NAME_step(Name *self, const NameSetpoints *set, const
//     ControllerInputs *in, const Blow *blow);   once a tick while it lasts uint8_t
//     NAME_state(const Name *self);                    for telemetry: a number of its own, 0..15
//     uint8_t NAME_stop_reason(const Name *self);              CONTROLLER_REASON_*
//     int16_t NAME_estimate(const Name *self);                 for telemetry: what its page says, 0
//     where it has none
// A step returns the wished duty, 0..32767, or one of the two codes below. It knows only what it is
// given here: what the board measures, at 1 kHz. All quantities count in the direction of the
// drive: positive speed and current drive the tool, negative current brakes it.
#ifndef VGROOVE_CONTROLLERS_CONTROLLER_H
#define VGROOVE_CONTROLLERS_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    int16_t travel_q15;    // trigger behind duty limit and ramp: the duty that the plain mode would
                           // wish; begins anew at 0, or where a turning shaft wants it
    int16_t speed_rpm_q1;  // over the last pitch of the Hall sensor, falling with the time since
                           // its last edge
    int16_t current_a_q9;  // mean over the tick
    uint16_t supply_mv;
    int16_t duty_q15;  // in force in the tick just measured, behind the fold-back, in steps of the
                       // bridge (1/255); 0 when it was open
    bool coasted;      // the bridge was open in the tick just measured
    int16_t trigger_q15;  // trigger behind the duty limit alone: what the ramp of travel_q15 is on
                          // its way to
    uint8_t edges;        // of the Hall sensor in the tick: each one pitch
} ControllerInputs;

#define CONTROLLER_STOP (-1)  // the drive is over: open until the trigger is released
#define CONTROLLER_COAST                                                                           \
    (-2)  // open for this tick; the tick after it is open as well, since the bridge is armed for
          // one before it drives

// Signal that a controller works by: its setpoint `method`, where it has one.
typedef enum {
    CONTROLLER_METHOD_SPEED = 1,    // of the Hall sensor
    CONTROLLER_METHOD_CURRENT = 2,  // motor current, or the speed computed from current and duty
} ControllerMethod;

// Why a controller ended its drive, or would not begin it.
typedef enum {
    CONTROLLER_REASON_NONE,
    CONTROLLER_REASON_SEATED,       // the screw's head has met the wood
    CONTROLLER_REASON_REACHED,      // the torque aimed at
    CONTROLLER_REASON_UNREACHABLE,  // the torque aimed at is beyond what the tool can do here:
                                    // refused
    CONTROLLER_REASON_MISSED,       // ended beside the torque aimed at: the estimate says where
    CONTROLLER_REASON_CLUTCH,
    CONTROLLER_REASON_KICKBACK,
    CONTROLLER_REASON_SENSOR,   // what was measured cannot be
    CONTROLLER_REASON_TIMEOUT,  // went on for longer than it may
} ControllerReason;

#endif
