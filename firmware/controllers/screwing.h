// Precise screwing: less power once it impacts, learns how far a blow turns the screw, and stops by
// itself when the head is seated.
//
// How far a blow turns the screw is measured, not guessed from a level: between two blows the
// spindle turns from lug to lug and by the screw's own turn. The ripple of the speed tells the
// blows; it is sampled once a Hall pitch, so evenly in angle, and compared with a wave of six
// pitches, which is about half a lug: at the power used here the hammer's ripple is strongest twice
// a lug. By as much as the ripple's phase against that wave moves in six pitches the screw has
// turned more or less than the wave assumes. Power, supply and trigger do not enter. The torque is
// inverse to the turn: `rise` is the learned turn over the present one.
//
//            impacts             settled, learned           rise > ONSET               rises like a
//            ramp
//   RUN_IN -----------> SETTLE -------------------> TRACK <---------------> SUSPECT
//   -------------------> SEATED: stop, bridge open
//      ^                 ^  | small turn: more power         falls back, or
//      '-- no blows      '--'                                level for too long: wood, learned
#ifndef VGROOVE_CONTROLLERS_SCREWING_H
#define VGROOVE_CONTROLLERS_SCREWING_H

#include "controllers/blow.h"
#include "controllers/controller.h"

typedef enum {
    SCREWING_RUN_IN,
    SCREWING_SETTLE,
    SCREWING_TRACK,
    SCREWING_SUSPECT,
    SCREWING_SEATED
} ScrewingState;

#define SCREWING_AXES 3u

typedef struct {
    uint16_t pulses;       // Hall edges a turn of the motor
    uint16_t turn_q8;      // turns of the motor from lug to lug
    int16_t share_q15;     // of the trigger's duty, once it impacts
    int16_t least_mv;      // at the motor: less power is not taken, the hammer would stand still
    int16_t small_deg_q4;  // a blow's turn of the screw below which it gets more power, by what it
                           // lacks
    int16_t rise_q8;       // seat: torque over the learned one, at least
} ScrewingSetpoints;

// Turns of the screw a blow, in 1/364 degree where from lug to lug is 180 (two lugs).
typedef struct {
    uint8_t state;
    uint8_t stage;      // of what follows on the end of a wave
    uint8_t place;      // of the next pitch in the wave
    uint8_t left;       // waves of SETTLE
    int16_t share_q15;  // of the trigger's duty
    int16_t least_q15;  // duty
    int16_t duty_q15;   // on its way
    uint16_t
        excess;  // of six pitches of the spindle above 90 degrees, in 2^16 of 90 degrees, as are:
    uint16_t phase;  // of the ripple, last
    int16_t half;    // turn in the last wave
    int16_t turn;    // of a blow, in the last two waves
    int16_t last_turn, before_last;
    int16_t now;  // averaged
    int16_t learned;
    uint16_t turned;  // since the onset
    int16_t rise_q8;
    int16_t base_q8;                                    // the rise at the onset
    int16_t over_q8;                                    // above it, in the last wave
    int32_t area;                                       // of that, over what turned
    uint16_t sum[SCREWING_AXES], twice[SCREWING_AXES];  // of the speeds, and of these sums in this
                                                        // wave, on axes 60 degrees apart
    uint16_t last[SCREWING_AXES], before[SCREWING_AXES];  // the waves before
    int16_t found[SCREWING_AXES];
} Screwing;

void screwing_start(Screwing *self, const ScrewingSetpoints *set);
int16_t screwing_step(Screwing *self, const ScrewingSetpoints *set, const ControllerInputs *in,
                      const Blow *blow);
uint8_t screwing_state(const Screwing *self);
uint8_t screwing_stop_reason(const Screwing *self);

// Torque over the learned one, Q8; 0 until it is learned.
int16_t screwing_estimate(const Screwing *self);

#endif
