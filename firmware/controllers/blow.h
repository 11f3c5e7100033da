// Blow detection: counts the hammer's blows from the valleys that each of its swings leaves in the
// motor's speed; shared by the controllers of the impact tool.
//
// Signal: the Hall speed, or the speed computed from the current, (duty supply - R i) rpm/V, in
// which a valley of the speed is a peak of the current. The hammer brakes the motor while it climbs
// and releases it when it has passed a lug or landed on one. The valley in between is detected with
// a hysteresis of a share of the learned ripple. The angle that the motor has turned since the last
// blow classifies the valley. From lug to lug the motor turns at least gear / lugs, plus the
// joint's own rotation, which is learned as mean_angle:
//   - soon after a blow: a second valley of that blow itself, ignored
//   - before 0.69 mean_angle: a second swing on the same lug, a repeat
//   - each 0.56 mean_angle beyond a lug: one more lug whose valley was not detected
#ifndef VGROOVE_CONTROLLERS_BLOW_H
#define VGROOVE_CONTROLLERS_BLOW_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/controller.h"

typedef enum { BLOW_SOURCE_SPEED, BLOW_SOURCE_CURRENT } BlowSource;

typedef struct {
    uint16_t turn_q8;          // motor turns from lug to lug of a held anvil: gear / lugs
    uint16_t source;           // BLOW_SOURCE_*
    uint16_t motor_mohm;       // winding
    uint16_t motor_rpm_per_v;  // speed constant
} BlowSetpoints;

typedef struct {
    // Event of this tick.
    uint8_t lugs;     // blows: 0, 1, more where the valleys of previous ones were not detected
    bool busy;        // the detection used more cycles than in most ticks
    uint8_t repeats;  // further landings on each lug at the speed of the last blow, not counted

    // Of the drive.
    bool impacting;  // a second valley has been detected, and the last one 160 ms ago at most
    uint16_t count;  // blows without repeats; includes those whose angle passed without a valley

    // Of the last valley that stands for one or two lugs.
    uint16_t period_q4;  // ms per lug

    // Running means; the first two are updated 1 to 6 ticks after the blow.
    uint16_t mean_period_q7;  // ms, over about 8 blows
    int16_t spread_q15;       // mean deviation of the period from its mean, as a share of the mean
    int16_t ripple_rpm;       // highest less lowest speed between two valleys, learned
    int16_t base_rpm;         // mean speed, over 16 ms

    // Internal.
    int16_t speed_rpm;    // of the source
    int16_t signal_rpm;   // speed_rpm - base_rpm
    int16_t high_rpm;     // greatest signal since the last valley
    int16_t extreme_rpm;  // last minimum or maximum of the signal
    int16_t hysteresis_rpm;
    bool rising;
    bool even;                       // small ripple: the hammer swings once per lug
    uint8_t seen;                    // blows detected, up to 3: see SEEN_* in blow.c
    uint8_t work;                    // computation left for the next tick
    uint8_t fraction_q4;             // of a tick, from crossing the hysteresis to the tick's end
    uint8_t last_fraction_q4;        // the same of the last blow
    uint8_t since_ms, since_hit_ms;  // time since the last blow, since the last valley
    int16_t angle, hit_angle;        // since the last blow; at the last valley. rpm ms / 64
    int16_t charge_q1;               // current integrated over time since the last blow, A ms
    int16_t late_angle;              // share of the last blow's angle that belongs to the next one
    int16_t last_angle, off_angle;   // at the last blow; what it adds to mean_angle, times 8
    int16_t lug_angle, mean_angle;   // from lug to lug: least, learned
    int16_t blow_angle;              // 0.69 mean_angle: least angle from blow to blow
    int16_t ahead_angle;             // beyond it a blow counts without a valley
    int16_t again_rpm;               // mean speed below which the hammer lands on a lug again
    uint16_t rpm_per_mv_q15, rpm_per_a_q7;
    uint16_t deviation_q8;
} Blow;

// A drive begins.
void blow_start(Blow *self, const BlowSetpoints *set);

// Once a tick of the drive, before the controller's step.
void blow_step(Blow *self, const BlowSetpoints *set, const ControllerInputs *in);

#endif
