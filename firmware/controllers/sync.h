// Synchronisation: keeps the hammer in step with the lugs for every supply voltage and trigger.
//
// The hammer's swing takes as long as the spindle needs from lug to lug in a band of the mean motor
// voltage (duty times bus voltage) that hardly depends on load and supply:
// docs/controllers/sync.md. While the tool impacts, the duty is the one that yields this level. The
// trigger moves the level within the band, and the blows trim it:
//   method 1, speed: depth of the valleys that the blows leave in the speed (blow.h). Below the
//     band the hammer falls out of step and the valleys are deep; above it the hammer hits early
//     and they are shallow.
//   method 2, current: mean current, held near a setpoint.
// With either method valleys deeper than twice the limit depth_max_q15 raise the level fast (SEEK).
//
//            impacts                            valleys of twice the limit
//   PLAIN ------------> HOLD (level = base + trim) <--------------------> SEEK (trim rises fast)
//     ^                   |                         valleys below that     |
//     '-------------------+------------------------------------------------'
//       no blows, or trigger below 0.3: duty of the trigger; the trim is kept for the drive
#ifndef VGROOVE_CONTROLLERS_SYNC_H
#define VGROOVE_CONTROLLERS_SYNC_H

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum { SYNC_PLAIN, SYNC_HOLD, SYNC_SEEK } SyncState;

typedef struct {
    uint16_t method;        // CONTROLLER_METHOD_*, also the signal that blows are detected in
    int16_t low_mv;         // level at trigger 0
    int16_t high_mv;        // level at full trigger
    int16_t depth_min_q15;  // valleys below this share of the speed lower the level
    int16_t depth_max_q15;  // valleys above this share raise it
    int16_t current_a_q9;   // method 2: mean current of a blow
} SyncSetpoints;

typedef struct {
    uint8_t state;
    uint8_t turn;       // computation of the next tick, Turn in sync.c
    bool blow_pending;  // a blow has not trimmed the level yet
    bool lug_missed;    // since the last trim a lug has passed without a valley
    bool crossed;       // the level has moved across a range that is out of step: it stays there
    bool falls;         // the next such move is downwards
    uint8_t irregular_blows;  // more than regular ones
    uint8_t settle_blows;     // left until irregular blows count
    int16_t trim_mv;          // learned in this drive
    int16_t level_mv;
    int16_t goal_q15;       // duty that yields the level
    int16_t duty_q15;       // returned last, follows goal_q15 at SLEW_Q15
    uint16_t supply_mv_q1;  // low-pass filtered
    int16_t current_a_q9;   // low-pass filtered
} Sync;

void sync_start(Sync *self, const SyncSetpoints *set);
int16_t sync_step(Sync *self, const SyncSetpoints *set, const ControllerInputs *in,
                  const Blow *blow);
uint8_t sync_state(const Sync *self);
uint8_t sync_stop_reason(const Sync *self);

// Level, mV; 0 in PLAIN.
int16_t sync_estimate(const Sync *self);

#endif
