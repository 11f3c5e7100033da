// Duty profile: the host commands the duty frame by frame, within the limits of the trigger.
//
// Active in mode duty from the first accepted frame on. The duty never exceeds the trigger's and is
// 0 while the trigger is released; states, faults and fold-back act as in any drive. When no frame
// has arrived for PROFILE_HOLD_MS, the drive ends as if a controller had stopped it: the bridge is
// open until the trigger is released. A profile that ends while the trigger is released returns
// the duty to the trigger.
#ifndef VGROOVE_APP_PROFILE_H
#define VGROOVE_APP_PROFILE_H

#include <stdbool.h>
#include <stdint.h>

#define PROFILE_HOLD_MS 50u

typedef enum {
    PROFILE_NONE,    // the trigger sets the duty
    PROFILE_ACTING,  // the host sets the duty
} ProfileState;

typedef struct {
    int16_t duty_q15;  // last commanded; below 0: open bridge
    uint8_t left_ms;   // time left until the drive ends without another frame
    bool acts;
} Profile;

// A frame has arrived.
void profile_take(Profile *self, int16_t duty_q15);

// Once a tick; `drives`: a drive is going on.
void profile_tick(Profile *self, bool drives);

ProfileState profile_state(const Profile *self);

// Duty to be driven at this trigger, CONTROLLER_COAST or CONTROLLER_STOP.
int16_t profile_duty(const Profile *self, int16_t travel_q15);

#endif
