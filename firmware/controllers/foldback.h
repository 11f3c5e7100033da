// Fold-back: reduces the duty while the current exceeds a limit below the over-current trip, and
// raises it while a braking current does.
//
// Integral controller on the excess current. Its integral either lowers the duty or raises it, and
// ends at 0. Two ticks pass between a duty and the
// mean current that it causes. The plant's gain G is at most Vs / R = 20.5 V / 0.19 ohm = 108 A per
// unit duty, since the electrical time constant of 0.5 ms is below a tick. The closed loop
// z^2 (z - 1) + g G is stable for g G < 0.618; g = 0.0025 per A and tick gives 0.27.
#ifndef VGROOVE_CONTROLLERS_FOLDBACK_H
#define VGROOVE_CONTROLLERS_FOLDBACK_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    int16_t limit_a_q9;
    int32_t limit_q23;   // change of the duty per tick by a current of the limit
    int32_t change_q23;  // of the duty; negative while the tool drives, positive while it brakes
    bool active;         // change_q23 is not 0
} Foldback;

void foldback_init(Foldback *self, int16_t limit_a_q9);
void foldback_reset(Foldback *self);  // the bridge is open

// Allowed duty 0..32767 for the requested one; current counts in the direction of the drive.
int16_t foldback_step(Foldback *self, int16_t requested_q15, int16_t current_a_q9);

bool foldback_active(const Foldback *self);

#endif
