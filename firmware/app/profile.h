// A duty profile that the host performs: it commands a duty frame by frame, and the trigger allows
// it.
//
// Acts in mode duty from the first frame on that is accepted. It never drives more than the
// trigger, and not at all while that is released: states, faults and the fold-back are those of any
// drive. When no frame has come for PROFILE_HOLD_MS the drive is over, as a controller ends one:
// the bridge stays open until the trigger is released. A profile that has ended at a released
// trigger leaves it to the hand again.
#ifndef VGROOVE_APP_PROFILE_H
#define VGROOVE_APP_PROFILE_H

#include <stdbool.h>
#include <stdint.h>

#define PROFILE_HOLD_MS 50u

typedef enum {
    PROFILE_NONE,    // the trigger sets the duty
    PROFILE_ACTING,  // the host sets it
} ProfileState;

typedef struct {
    int16_t duty_q15;  // commanded last; below 0: the bridge is to be open
    uint8_t left_ms;   // for which it holds still
    bool acts;
} Profile;

// A frame.
void profile_take(Profile *self, int16_t duty_q15);

// Once a tick; `drives`: a drive goes on.
void profile_tick(Profile *self, bool drives);

ProfileState profile_state(const Profile *self);

// What is to be driven with this trigger: a duty, CONTROLLER_COAST or CONTROLLER_STOP.
int16_t profile_wish(const Profile *self, int16_t travel_q15);

#endif
