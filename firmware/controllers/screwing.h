// Precise screwing: reduces the power while impacting, measures how far each blow turns the screw,
// and stops when the screw head is seated.
//
// Between two blows the spindle turns from lug to lug plus the rotation of the screw. The Hall
// speed is sampled once per Hall pitch, hence evenly in angle, and correlated with a wave of six
// pitches, about half a lug: at this power the speed ripple is strongest twice per lug. The change
// of the ripple's phase over six pitches is the screw's rotation beyond what the wave assumes;
// power, supply and trigger have no influence on it. The torque is inversely proportional to the
// rotation per blow: `rise` is the learned rotation over the present one.
//
//   from     to       condition
//   RUN_IN   SETTLE   impacts
//   SETTLE   SETTLE   small rotation per blow: more power
//   SETTLE   TRACK    rotation per blow learned
//   TRACK    SUSPECT  rise above ONSET
//   SUSPECT  TRACK    rise below ONSET, or constant for too long: denser wood, learned
//   SUSPECT  SEATED   the rise grows linearly with the angle: stop
//   any      RUN_IN   no blows, except in SEATED
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
    uint16_t pulses;       // Hall edges per turn of the motor
    uint16_t turn_q8;      // motor turns from lug to lug
    int16_t share_q15;     // of the trigger's duty while impacting
    int16_t least_mv;      // least motor voltage while impacting: below, the hammer stops swinging
    int16_t small_deg_q4;  // rotation per blow below which the power is raised in proportion
    int16_t rise_q8;       // least ratio of present to learned torque at the seat
} ScrewingSetpoints;

// Rotations of the screw are in 1/364 degree, for two lugs (180 degrees from lug to lug).
typedef struct {
    uint8_t state;
    uint8_t stage;      // next computation of the finished wave, Stage in screwing.c
    uint8_t place;      // of the next pitch in the wave
    uint8_t left;       // waves left of SETTLE
    int16_t share_q15;  // of the trigger's duty, while impacting
    int16_t least_q15;  // duty of the least motor voltage; 0: not computed yet
    int16_t duty_q15;   // returned last, follows the requested one at SLEW
    uint16_t excess;    // six pitches of the spindle less 90 degrees, 2^16 = 90 degrees, as phase
    uint16_t phase;     // of the ripple in the last wave
    int16_t half;       // rotation in the last wave, in 1/728 degree
    int16_t turn;       // rotation per blow, from the last two waves
    int16_t last_turn, before_last;
    int16_t now;      // rotation per blow, averaged
    int16_t learned;  // rotation per blow, reference of the rise
    uint16_t turned;  // rotation since the onset of the rise
    int16_t rise_q8;  // learned over averaged rotation
    int16_t base_q8;  // rise at the onset
    int16_t over_q8;  // rise above base_q8 in the last wave
    int32_t area;     // integral of over_q8 over the rotation
    // On SCREWING_AXES axes, 60 degrees of the wave apart: running sums of the speeds (`sum`); sums
    // of `sum` over this wave (`twice`), the last wave and the one before; their difference
    // (`found`).
    uint16_t sum[SCREWING_AXES], twice[SCREWING_AXES];
    uint16_t last[SCREWING_AXES], before[SCREWING_AXES];
    int16_t found[SCREWING_AXES];
} Screwing;

void screwing_start(Screwing *self, const ScrewingSetpoints *set);
int16_t screwing_step(Screwing *self, const ScrewingSetpoints *set, const ControllerInputs *in,
                      const Blow *blow);
uint8_t screwing_state(const Screwing *self);
uint8_t screwing_stop_reason(const Screwing *self);

// Present over learned torque, Q8; 0 until it is learned.
int16_t screwing_estimate(const Screwing *self);

#endif
