// Low vibration: the first blow is taken softly, the next ones at speed, and a hard joint with the
// voltage at which the hammer lands smoothly.
//
// What shakes the housing most is the hammer that comes down on top of a lug instead of behind it:
// it happens while the tool gets going, when the spindle is too fast for a soft landing and too
// slow for the hammer to pass the lug. So the tool approaches the joint with little voltage, lets
// the hammer climb over the first lug with what its momentum has left, and gives all it may in the
// instant in which the hammer is let go: then the next climb is quick enough.
//
//   APPROACH --speed dips: the hammer has met the anvil--> CLIMB --angle turned: the hammer is let
//   go--> SURGE --duty reaches the trigger--> RUN
//      |                                                     | 100 ms: all the same | 100 ms: all
//      the same         ^
//      +--90 ms without a dip, or the shaft turned at the start: as the plain mode
//      ------------------------------------------------------+
//
// "Speed" is that of the Hall sensor (method 1) or the one that current and duty tell (method 2).
#ifndef VGROOVE_CONTROLLERS_VIBRATION_H
#define VGROOVE_CONTROLLERS_VIBRATION_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum { VIBRATION_APPROACH, VIBRATION_CLIMB, VIBRATION_SURGE, VIBRATION_RUN } VibrationPhase;

typedef struct {
    uint16_t method;
    int16_t approach_q15;      // duty until the hammer meets the anvil
    int16_t climb_q15;         // duty with which it begins to climb
    int16_t climb_per_ms_q15;  // and what is added to it each ms, so that it does not stay there
    uint16_t climb_turn_q8;    // turns of the motor from the dip to the hammer's release
    int16_t surge_a_q9;        // current from there to full duty
    int16_t hard_share_q15;    // of the back-EMF in the motor's voltage: less is a hard joint
    uint16_t hard_mv;          // motor voltage that a hard joint is hit with
    uint16_t motor_mohm;       // winding
    uint16_t motor_rpm_per_v;  // of back-EMF
} VibrationSetpoints;

typedef struct {
    uint8_t phase;  // VIBRATION_*
    uint8_t phase_ms;
    uint8_t prepared;  // ticks of preparation done
    int16_t duty_q15;
    int16_t limit_q15;    // on a hard joint
    uint16_t top_mv;      // highest back-EMF of the approach
    uint16_t turned;      // since the dip, mV ms / 16
    uint16_t climb_turn;  // where the hammer is let go
    int16_t surge_a_q9;   // current from there on
    uint16_t mohm_q7;
    uint16_t mv_per_rpm_q12;  // back-EMF of a speed Q1
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
