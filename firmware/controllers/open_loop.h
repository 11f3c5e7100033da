// Plain mode: the duty follows the trigger at a limited rate.
#ifndef VGROOVE_CONTROLLERS_OPEN_LOOP_H
#define VGROOVE_CONTROLLERS_OPEN_LOOP_H

#include "controllers/controller.h"

typedef struct {
    int16_t slew_q15;  // duty a tick
    int16_t duty_q15;
} OpenLoop;

int16_t open_loop_step(OpenLoop *self, const ControllerInputs *in);

#endif
