// Torque control: tightens a joint of unknown stiffness to a target torque.
//
// The controlled variable is the level, the motor's voltage k w + R i: speed w, current i, nominal
// torque constant k and resistance R. A feed-forward adds the voltage that supply, heating and
// winding tolerance consume. At a constant level blows stop turning a joint at a torque that
// belongs to the level (torque_map.h), whatever the supply and the winding. A soft joint would take
// too long to get there: it is hammered on a raised level until the current, which rises as the
// blows turn the joint less, reaches that of the target torque.
//
//   from    to      condition
//   RUN     LEVEL   blows
//   RUN     RAISED  blows, and a target too low for a hard joint to settle at
//   RUN     OVER    target out of range, or supply too low (unreachable)
//   LEVEL   SETTLE  current of a hard joint
//   LEVEL   RAISED  current of a soft joint
//   SETTLE  OVER    settle time elapsed (reached, missed)
//   RAISED  OVER    current of the target, or RAISED_MS elapsed (reached, missed, timeout)
//   any     OVER    level not held for 0.3 s (missed; in RUN unreachable)
#ifndef VGROOVE_CONTROLLERS_TORQUE_H
#define VGROOVE_CONTROLLERS_TORQUE_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/blow.h"
#include "controllers/controller.h"
#include "controllers/torque_map.h"

typedef enum {
    TORQUE_RUN,     // before the first blows
    TORQUE_LEVEL,   // on the level of the target, until the current separates hard from soft joints
    TORQUE_SETTLE,  // hard joint: until blows do not turn it any further
    TORQUE_RAISED,  // soft joint: until the current is that of the target
    TORQUE_OVER,
} TorqueState;

typedef struct {
    int16_t target_nm;
} TorqueSetpoints;

typedef struct {
    TorqueState state;
    ControllerReason reason;
    uint8_t row;              // of the target in torque_map
    uint16_t ticks;           // in this state; in LEVEL and RAISED from reaching the level on
    uint8_t short_decisions;  // consecutive decisions with less than the duty of the level
    uint8_t gathered;         // ticks in sum_a_q7, 1 to 3
    bool entered;             // whether the last step entered a state
    int16_t sum_a_q7;         // of currents
    int16_t duty_q15;
    int16_t level_mv;      // requested
    int16_t goal_mv;       // level_mv moves towards it
    int16_t settled_a_q8;  // these three: row of torque_map.h
    int16_t raised_mv;
    int16_t stop_a_q8;
    int16_t estimate_nm;
    int32_t excess_mv_q16;  // voltage beyond the nominal motor's, low-pass filtered once
    int32_t taken_mv_q16;   // and twice: the feed-forward
    int32_t quick_a_q24;    // current, low-pass filtered once,
    int32_t current_a_q24;  // twice
    int32_t slow_a_q24;     // and three times
} Torque;

// Whether the last step did one of its two most expensive computations: the filters of current and
// voltage, or a change of state.
static inline bool torque_was_heavy(const Torque *self) {
    return self->gathered == 0u || self->entered;
}

void torque_start(Torque *self, const TorqueSetpoints *set);
int16_t torque_step(Torque *self, const TorqueSetpoints *set, const ControllerInputs *in,
                    const Blow *blow);
uint8_t torque_state(const Torque *self);
uint8_t torque_stop_reason(const Torque *self);

// Reached torque in 0.1 N m, 0 while it is unknown.
int16_t torque_estimate(const Torque *self);

#endif
