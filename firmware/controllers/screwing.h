// Precise screwing: less power once it impacts, learns how far a blow turns the screw, and stops by itself when the head is seated.
//
// How far a blow turns the screw is measured, not guessed from a level: between two blows the spindle turns from lug to lug and by the screw's own turn.
// The ripple of the speed tells the blows; it is sampled once a Hall pitch, so evenly in angle, and compared with an oscillator that turns with the
// spindle. Its phase against the oscillator (over one turn of it, each half turn) is what the screw turned more or less than assumed. Power, supply and
// trigger do not enter. The torque is inverse to the turn: `rise` is the learned turn over the present one.
//
//            impacts             settled, learned           rise > ONSET               rise, angle enough
//   RUN_IN -----------> SETTLE -------------------> TRACK <---------------> SUSPECT ---------------------> SEATED: stop, bridge open
//      ^                  ^    small turn: more power |  falls back           | too steep for a seat: the edge of a knot
//      |                  '---------------------------'                       v
//      '-- no blows       '--- TRACK <-- falls back, or turned on so far: learned anew -- KNOT -- rises on: SEATED
#ifndef VGROOVE_CONTROLLERS_SCREWING_H
#define VGROOVE_CONTROLLERS_SCREWING_H

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum { SCREWING_RUN_IN, SCREWING_SETTLE, SCREWING_TRACK, SCREWING_SUSPECT, SCREWING_KNOT, SCREWING_SEATED } ScrewingState;

typedef enum { SCREWING_POWER_SOFT, SCREWING_POWER_HARD, SCREWING_POWER_FULL } ScrewingPower;

#define SCREWING_RING 20u

typedef struct {
    uint16_t pulses;           // Hall edges a turn of the motor
    uint16_t turn_q8;          // turns of the motor from lug to lug
    int16_t share_q15;         // of the trigger's duty, once it impacts
    int16_t share_hard_q15;    // where a blow turns the screw by little
    int16_t hard_turn_deg_q4;  // less than this; all of it below half of it
    int16_t rise_q8;           // seat: torque over the learned one, at least
} ScrewingSetpoints;

// Angles of the screw in 1/32 degree where from lug to lug is 180 (two lugs), those of the ring and behind it in 1/8 degree.
typedef struct {
    uint8_t state;
    uint8_t power;   // SCREWING_POWER_*, SETTLE and after
    uint8_t stage;   // of what follows on the end of a half turn
    uint8_t known;   // half turns since the start, saturates
    uint8_t count;   // since the power was changed, saturates
    uint8_t behind;  // half turns since the onset
    uint8_t held;    // half turns in which it has looked like a seat
    uint8_t filled;
    uint16_t pitch;     // angle of a Hall pitch
    uint16_t step;      // of the phase a pitch
    uint16_t per_step;  // 2^24 / step
    uint16_t phase;     // of the oscillator, 2^16 a turn
    int16_t assumed;    // turn of the screw a blow that the oscillator assumes
    uint16_t found;     // phase of the ripple, last
    int16_t last_rpm_q1, mean_rpm_q1;
    int16_t cos_sum, sin_sum, rest_sum;           // of this half turn
    int16_t cos_before, sin_before, rest_before;  // of the one before
    int16_t x, y, rest;                           // of a turn that has ended
    int16_t head;                                 // angle of the screw, 1/32 degree
    int16_t head_q3;                              // the same up to the last half turn, 1/8 degree
    int16_t onset_q3;                             // where the rise began
    int16_t turn_q4, learned_q4;                  // turn a half turn of the oscillator, 1/8 degree: now, learned
    int16_t rise_q8, raw_q8, edge_q8;
    int16_t share_q15;              // of the trigger's duty, on its way
    uint8_t turned[SCREWING_RING];  // in each half turn, 1/8 degree, more by TURNED_BIAS
} Screwing;

void screwing_start(Screwing *self, const ScrewingSetpoints *set);
int16_t screwing_step(Screwing *self, const ScrewingSetpoints *set, const ControllerInputs *in, const Blow *blow);
uint8_t screwing_state(const Screwing *self);
uint8_t screwing_stop_reason(const Screwing *self);

// Torque over the learned one, Q8; 0 until it is learned.
int16_t screwing_estimate(const Screwing *self);

#endif
