// Fold-back: reduces the duty while the current exceeds a limit below the over-current trip, and
// raises it while a braking current does.
//
// Integral controller on the excess of the current over the limit. The integral is a change of the
// duty: it is negative after a driving current, positive after a braking one, and returns to 0 once
// the current is below the limit. Two ticks pass between a duty and the mean current that it
// causes. The electrical time constant of 0.5 ms is below a tick, so that the plant is a gain G
// from duty to current, at most Vs / R = 20.5 V / 0.19 ohm = 108 A per unit duty. With the
// controller's gain g the characteristic polynomial is z^2 (z - 1) + g G, stable for g G < 0.618; g
// = 0.0025 per A and tick gives 0.27.
#ifndef VGROOVE_CONTROLLERS_FOLDBACK_H
#define VGROOVE_CONTROLLERS_FOLDBACK_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    int16_t limit_a_q9;
    int32_t limit_q23;   // g limit_a: what the integral changes in a tick by that much excess
    int32_t change_q23;  // the integral: change of the duty, < 0 driving, > 0 braking
    bool active;         // change_q23 is not 0
} Foldback;

void foldback_init(Foldback *self, int16_t limit_a_q9);
void foldback_reset(Foldback *self);  // the bridge is open

// Allowed duty 0..32767 for the requested one; current counts in the direction of the drive.
int16_t foldback_step(Foldback *self, int16_t requested_q15, int16_t current_a_q9);

bool foldback_active(const Foldback *self);

#endif
