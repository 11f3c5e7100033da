// Fold-back, see foldback.h.
#include "controllers/foldback.h"

#include "core/fixed.h"
#include "core/inline.h"

#define GAIN_Q14 41  // 0.0025 per A: Q9 A times Q14 is Q23 duty
#define DUTY_MAX_Q23 ((int32_t)INT16_MAX << 8)

void foldback_init(Foldback *self, int16_t limit_a_q9) {
    *self = (Foldback){.limit_a_q9 = limit_a_q9};
}

INLINE_NEVER static int32_t integrated(int32_t share_q23, int32_t excess_a_q9) {
    return fixed_clamp_i32(share_q23 + excess_a_q9 * GAIN_Q14, 0, DUTY_MAX_Q23);
}

int16_t foldback_step(Foldback *self, int16_t requested_q15, int16_t current_a_q9) {
    if (!self->active && current_a_q9 <= self->limit_a_q9 && current_a_q9 >= -self->limit_a_q9) {
        return (int16_t)(requested_q15 < 0 ? 0 : requested_q15);  // most ticks
    }
    if (self->less_q23 > 0 || current_a_q9 > self->limit_a_q9) {
        self->less_q23 = integrated(self->less_q23, (int32_t)current_a_q9 - self->limit_a_q9);
    }
    if (self->more_q23 > 0 || current_a_q9 < -self->limit_a_q9) {
        self->more_q23 = integrated(self->more_q23, -(int32_t)current_a_q9 - self->limit_a_q9);
    }
    self->active = self->less_q23 > 0 || self->more_q23 > 0;
    const int32_t allowed_q15 = requested_q15 + ((self->more_q23 - self->less_q23) >> 8);
    return (int16_t)fixed_clamp_i32(allowed_q15, 0, INT16_MAX);
}

bool foldback_active(const Foldback *self) {
    return self->active;
}
