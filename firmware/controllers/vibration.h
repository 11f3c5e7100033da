// Low vibration: a soft first blow, fast ones after it, and on a hard joint the motor voltage at
// which the hammer lands smoothly.
//
// The housing shakes most when the hammer lands on top of a lug instead of behind it. That happens
// during the run-up, when the spindle is too fast for a soft landing and too slow for the hammer to
// pass the lug. The controller therefore approaches the joint with a low voltage, lets the hammer
// climb over the first lug with the remaining momentum, and applies the surge current as soon as
// the hammer is released, so that the next climb is fast enough.
//
//             speed dips             angle turned            duty reaches the trigger's
//   APPROACH ------------> CLIMB --------------------> SURGE ---------------------------> RUN
//      |      (hammer meets    (hammer released,               (or 100 ms elapsed)         ^
//      |       the anvil)       or 100 ms elapsed)                                         |
//      '-- 90 ms without a dip, the shaft turned at the start, or trigger times bus voltage
//          below 15.4 V: as the plain mode --------------------------------------------------'
//
// The speed is that of the Hall sensor (method 1) or computed from current and duty (method 2).
#ifndef VGROOVE_CONTROLLERS_VIBRATION_H
#define VGROOVE_CONTROLLERS_VIBRATION_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum { VIBRATION_APPROACH, VIBRATION_CLIMB, VIBRATION_SURGE, VIBRATION_RUN } VibrationPhase;

typedef struct {
    uint16_t method;           // CONTROLLER_METHOD_*
    int16_t approach_q15;      // duty until the hammer meets the anvil
    int16_t climb_q15;         // duty at the start of the climb
    int16_t climb_per_ms_q15;  // its rate, so that the hammer cannot get stuck on the lug
    uint16_t climb_turn_q8;    // motor turns from the dip to the hammer's release
    int16_t surge_a_q9;        // current from the hammer's release to the duty of the trigger
    int16_t hard_share_q15;    // hard joint: back-EMF below this share of the motor voltage
    uint16_t hard_mv;          // motor voltage on a hard joint
    uint16_t motor_mohm;       // winding
    uint16_t motor_rpm_per_v;  // speed constant
} VibrationSetpoints;

typedef struct {
    uint8_t phase;  // VIBRATION_*
    uint8_t phase_ms;
    uint8_t prepared;  // computations done, PREPARE_* in vibration.c
    int16_t duty_q15;
    int16_t limit_q15;    // duty limit on a hard joint
    uint16_t top_mv;      // greatest back-EMF of the approach
    uint16_t turned;      // angle since the dip, mV ms / 16
    uint16_t least_q15;   // least trigger of a soft start
    uint16_t climb_turn;  // angle at which the hammer is released
    int16_t surge_a_q9;   // current after the release
    uint16_t mohm_q7;
    uint16_t mv_per_rpm_q12;  // back-EMF per 0.5 rpm
    uint16_t rise_q16;        // duty Q15 per current Q9 through the winding
} Vibration;

void vibration_start(Vibration *self, const VibrationSetpoints *set);
int16_t vibration_step(Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in,
                       const Blow *blow);
uint8_t vibration_state(const Vibration *self);
uint8_t vibration_stop_reason(const Vibration *self);

// Duty limit on a hard joint, Q15.
int16_t vibration_estimate(const Vibration *self);

#endif
