// Torque control: tightens a joint to a torque by the level at which the tool hammers, without
// knowing the joint.
//
// The level is the voltage that the motor makes of itself, k w + R i with the nominal R: what the
// bridge gives less what supply, heat and winding take from it. Held there, a joint takes every
// supply and winding alike, and stops turning at a torque that belongs to the level (torque_map.h).
// A soft joint would take long to get there: it is hammered on a higher level, and stopped by the
// current, which rises as its blows turn it less.
//
//               blows                  current of a hard joint            settle_ms
//     RUN ----------------> LEVEL --------------------------> SETTLE ----------------> OVER
//     (reached)
//      |                      |  current of a soft one
//      | low target           +-----------------------------> RAISED
//      +---------------------------------------------------->    |  current of the target, or
//      RAISED_MS |                                                         +-------------------->
//      OVER (reached, missed, timeout) | target or supply out of reach
//      +-----------------------------------------------------------------------------> OVER
//      (unreachable)
//     bridge fully on for 0.3 s without holding the level -> OVER (missed)
#ifndef VGROOVE_CONTROLLERS_TORQUE_H
#define VGROOVE_CONTROLLERS_TORQUE_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum {
    TORQUE_RUN,     // before the first blows
    TORQUE_LEVEL,   // on the level of the target, looking at the joint
    TORQUE_SETTLE,  // a hard joint: until blows no longer turn it
    TORQUE_RAISED,  // a soft joint: until the current says the target
    TORQUE_OVER,
} TorqueState;

typedef struct {
    int16_t target_nm;
} TorqueSetpoints;

typedef struct {
    TorqueState state;
    ControllerReason reason;
    uint8_t row;         // of the target in torque_map
    uint16_t ticks;      // in this state; in LEVEL and RAISED from the arrival on
    uint8_t full_looks;  // with the bridge fully on, in one go
    uint8_t gathered;    // ticks in the sum of currents, 1 to 3
    int16_t sum_a_q7;
    int16_t duty_q15;
    int16_t level_mv;  // wished now
    int16_t goal_mv;   // where it is going
    int16_t settled_a_q8;
    int16_t raised_mv;
    int16_t stop_a_q8;
    int16_t estimate_nm;
    int32_t excess_mv_q16;  // what supply, heat and winding take beyond the nominal, filtered once
    int32_t taken_mv_q16;   // and twice
    int32_t quick_a_q24;    // current, filtered once,
    int32_t current_a_q24;  // twice
    int32_t slow_a_q24;     // and thrice
} Torque;

// Whether the step just made filtered current and voltage, which costs most.
static inline bool torque_has_measured(const Torque *self) {
    return self->gathered == 0u;
}

void torque_start(Torque *self, const TorqueSetpoints *set);
int16_t torque_step(Torque *self, const TorqueSetpoints *set, const ControllerInputs *in,
                    const Blow *blow);
uint8_t torque_state(const Torque *self);
uint8_t torque_stop_reason(const Torque *self);

// Torque reached in 0.1 N m, 0 while it is not known.
int16_t torque_estimate(const Torque *self);

#endif
