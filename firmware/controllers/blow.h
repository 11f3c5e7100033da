// Blows of the hammer, from the dips that they leave in the motor's speed.
#ifndef VGROOVE_CONTROLLERS_BLOW_H
#define VGROOVE_CONTROLLERS_BLOW_H

#include "controllers/controller.h"

typedef struct {
    bool struck;         // a blow was found in this tick
    bool repeat;         // it is one on the same lug as the blow before
    bool impacting;      // blows follow one another
    uint16_t count;      // of this drive, without repeats
    uint16_t period_ms;  // between the last two
    int16_t high_rpm_q1;
    int16_t low_rpm_q1;
    uint16_t since_ms;
    bool falling;
} Blow;

// A drive begins.
void blow_start(Blow *self);

// Once a tick while it lasts, before the controller.
void blow_step(Blow *self, const ControllerInputs *in);

#endif
