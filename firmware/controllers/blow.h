// Blows of the hammer, from the valleys that each swing of it leaves in the motor's speed; shared
// by the controllers of the impact tool.
//
// Signal: the Hall speed, or the speed that the current tells, (duty supply - R i) rpm/V: a dip of
// the speed is a peak of the current. The hammer brakes the motor while it climbs and lets go when
// it has passed a lug, or come down on one: a valley, found by a hysteresis of a share of the
// learned ripple. The angle that the motor has turned since the last blow tells the rest, since
// from lug to lug it cannot be less than gear / lugs, and the joint's own turn, which is learned,
// comes to it: soon after a hit comes the notch that it left itself, before 0.66 of the angle a
// second swing on the same lug, and 0.56 beyond each lug there was another whose valley was not
// seen.
#ifndef VGROOVE_CONTROLLERS_BLOW_H
#define VGROOVE_CONTROLLERS_BLOW_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/controller.h"

typedef enum { BLOW_SOURCE_SPEED, BLOW_SOURCE_CURRENT } BlowSource;

typedef struct {
    uint16_t turn_q8;     // turns of the motor from lug to lug on a joint that holds: gear / lugs
    uint16_t source;      // BLOW_SOURCE_*
    uint16_t motor_mohm;  // winding
    uint16_t motor_rpm_per_v;  // of back-EMF
} BlowSetpoints;

typedef struct {
    // Event of this tick.
    uint8_t lugs;     // struck: 0 none, 1, more where valleys were not seen
    bool busy;        // more was computed than in most ticks
    uint8_t repeats;  // of the last blow: how often each lug is struck again at its speed; these
                      // are no blows

    // Of the drive.
    bool impacting;  // hits follow one another
    uint16_t
        count;  // blows, without repeats; one that left no valley counts when the angle says so

    // Of the last hit that stands for one or two lugs.
    uint16_t period_q4;  // ms, of one lug

    // Running.
    uint16_t mean_period_q7;  // ms, over about 8 blows; these two a tick after the blow
    int16_t spread_q15;       // mean deviation of the periods from it, as a share of it
    int16_t ripple_rpm;       // between the highest and the lowest speed from hit to hit
    int16_t base_rpm;         // mean speed, over 16 ms

    // Own.
    int16_t speed_rpm;    // by the source
    int16_t signal_rpm;   // less the mean
    int16_t high_rpm;     // from hit to hit
    int16_t extreme_rpm;  // last valley or top
    int16_t hysteresis_rpm;
    bool rising;
    bool even;                    // the hammer swings once a lug
    uint8_t seen;                 // blows: 0 none yet, 1, 2 the period is known, 3
    uint8_t work;                 // still to be done in the next tick
    uint16_t over_rpm, step_rpm;  // which is over / step
    uint8_t last_fraction_q4;     // of a tick, between the crossing of the hysteresis and the tick
                                  // that saw it
    uint8_t since_ms, since_hit_ms;  // the last blow, the last hit
    int16_t angle, hit_angle;        // since the last blow; at the last hit. rpm ms / 64
    int16_t late_angle;              // what it was over, or short of it
    int16_t lug_angle, mean_angle;   // from lug to lug: at least; as learned
    int16_t blow_angle;              // from a blow to where the next may be
    int16_t ahead_angle;             // where a lug is counted although it left no valley
    int16_t again_rpm;               // below it a lug is struck again
    uint16_t rpm_per_mv_q15, rpm_per_a_q7;
    uint16_t deviation_q8;
} Blow;

// A drive begins.
void blow_start(Blow *self, const BlowSetpoints *set);

// Once a tick while it lasts, before the controller.
void blow_step(Blow *self, const BlowSetpoints *set, const ControllerInputs *in);

#endif
