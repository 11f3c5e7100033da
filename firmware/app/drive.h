// Compare value of the bridge from the state machine's command: controller, ramp, fold-back,
// direction.
#ifndef VGROOVE_APP_DRIVE_H
#define VGROOVE_APP_DRIVE_H

#include <stdint.h>

#include "app/app.h"

// Compare value for the next tick; H_BRIDGE_COAST: the bridge is open.
int16_t drive_step(App *app);

#endif
