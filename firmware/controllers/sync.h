// Synchronisation: keeps the hammer in step with the lugs, whatever the battery and the trigger.
//
// The swing of the hammer and the time from lug to lug fit together in a band of the motor's mean
// voltage, duty times bus, that hardly depends on load and supply (docs/controllers/sync.md). While
// the tool impacts the duty is that which gives the level; the trigger moves the level within the
// band, and what the blows show trims it:
//   method 1, speed: depth of the dips that the blows leave in the speed. Deep: the hammer falls
//   out of step below the band; shallow: it comes too
//                    high, above the band;
//   method 2, current: mean current of a blow, held near a setpoint; an uneven current ripple, the
//   same sign as deep dips, goes before it.
//
//            impacts                                dips of twice the limit
//   PLAIN ----------> HOLD (level = base + trim) ------------------------> SEEK (trim rises fast)
//     ^                 |        ^                                           |
//     '-----------------'        '-------------------------------------------'
//     no blow any more, or the trigger nearly released: the duty is the trigger's; the trim is kept
//     for the drive
#ifndef VGROOVE_CONTROLLERS_SYNC_H
#define VGROOVE_CONTROLLERS_SYNC_H

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum { SYNC_PLAIN, SYNC_HOLD, SYNC_SEEK } SyncState;

typedef struct {
    uint16_t method;        // CONTROLLER_METHOD_*; the blows must come from the same source
    int16_t low_mv;         // level at the lightest trigger that this controller answers to
    int16_t high_mv;        // level at full trigger
    int16_t depth_min_q15;  // dips shallower than this share of the speed lower the level
    int16_t depth_max_q15;  // deeper ones raise it
    int16_t current_a_q9;   // method 2: mean of a blow
} SyncSetpoints;

typedef struct {
    uint8_t state;
    uint8_t turn;     // what is done next
    bool heard;       // a blow that has not trimmed yet
    int16_t trim_mv;  // learned in this drive
    int16_t level_mv;
    int16_t goal_q15;       // duty that gives the level
    int16_t duty_q15;       // on its way there
    uint16_t supply_mv_q1;  // slow
    int16_t current_a_q9;   // slow
} Sync;

void sync_start(Sync *self, const SyncSetpoints *set);
int16_t sync_step(Sync *self, const SyncSetpoints *set, const ControllerInputs *in,
                  const Blow *blow);
uint8_t sync_state(const Sync *self);
uint8_t sync_stop_reason(const Sync *self);

// Level, mV.
int16_t sync_estimate(const Sync *self);

#endif
