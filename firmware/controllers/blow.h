// Blows of the hammer, from the valleys that each swing of it leaves in the motor's speed; shared by the controllers of the impact tool.
//
// Signal: the Hall speed, or the speed that the current tells, (duty supply - R i) rpm/V: a dip of the speed is a peak of the current. The hammer brakes
// the motor while it climbs and lets go when it has passed a lug, or come down on one: a valley, found by a hysteresis of a share of the learned
// ripple. The angle that the motor has turned since the last blow tells the rest, since from lug to lug it cannot be less than gear / lugs: soon after a
// hit comes the notch that it left itself, before 0.62 of a lug's angle a second swing on the same lug (repeat), and beyond 1.65 of it a valley was too
// shallow to be seen: two lugs were reached.
#ifndef VGROOVE_CONTROLLERS_BLOW_H
#define VGROOVE_CONTROLLERS_BLOW_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/controller.h"

typedef enum { BLOW_SOURCE_SPEED, BLOW_SOURCE_CURRENT } BlowSource;

typedef struct {
    uint16_t turn_q8;          // turns of the motor from lug to lug on a joint that holds: gear / lugs
    uint16_t source;           // BLOW_SOURCE_*
    uint16_t motor_mohm;       // winding
    uint16_t motor_rpm_per_v;  // of back-EMF
} BlowSetpoints;

typedef struct {
    // Event of this tick.
    bool struck;   // the hammer has hit: a blow or a repeat
    bool repeat;   // on the lug of the last blow
    bool busy;     // more was computed than in most ticks
    uint8_t lugs;  // reached by this hit: 0 a repeat, 1, 2 where the blow before was not seen

    // Of the drive.
    bool impacting;  // hits follow one another
    uint16_t count;  // blows, without repeats
    uint16_t repeats;
    uint16_t since_ms;  // since the last blow, saturates

    // Of the last blow, from the one before to it, repeats included; a tick after it.
    uint16_t period_q4;  // ms, of one lug
    int16_t speed_mean_rpm_q1;
    uint16_t turn_q8;  // turns of the motor per lug: what exceeds the setpoint is the joint's own, times the gear

    // Running; two ticks after a blow.
    uint16_t mean_period_q4;  // ms, over about 8 blows
    int16_t spread_q15;       // mean deviation of the periods from it, as a share of it
    int16_t ripple_rpm_q1;    // between the highest and the lowest speed from hit to hit

    // Own.
    int16_t speed_rpm_q1;    // by the source
    uint16_t base_rpm_q2;    // its slow part
    int16_t signal_rpm_q1;   // what is left
    int16_t high_rpm_q1;     // from hit to hit
    int16_t extreme_rpm_q1;  // last valley or top
    int16_t hysteresis_rpm_q1;
    bool rising;
    bool even;                          // the hammer swings once a lug
    uint8_t blows_seen;                 // 0 none yet, 1, 2 the period is known, ...
    uint8_t last_fraction_q4;           // of a tick, between the crossing of the hysteresis and the tick that saw it
    uint16_t over_rpm_q1, step_rpm_q1;  // which is over / step
    uint8_t last_lugs;
    uint16_t angle, hit_angle;  // since the last blow; at the last hit. rpm Q1 ms / 16
    uint16_t late_angle;        // of the last blow
    uint16_t last_angle, last_ms;
    uint8_t work;  // still to be done, a piece a tick
    uint16_t dead_angle, even_angle, repeat_angle, late_from_angle, two_angle, forget_angle;
    uint16_t rpm_per_mv_q15, rpm_per_a_q7;
    uint16_t supply_mv_q1;
    uint16_t since_hit_ms;
    uint16_t deviation_q8;
} Blow;

// A drive begins.
void blow_start(Blow *self, const BlowSetpoints *set);

// Once a tick while it lasts, before the controller.
void blow_step(Blow *self, const BlowSetpoints *set, const ControllerInputs *in);

#endif
