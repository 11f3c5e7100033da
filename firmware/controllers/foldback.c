// Fold-back, see foldback.h.
#include "controllers/foldback.h"

#include "core/inline.h"

#define GAIN_Q14 41  // 0.0025 per A: Q9 A times Q14 is Q23 duty
#define DUTY_MAX_Q23 ((int32_t)INT16_MAX << 8)

void foldback_init(Foldback *self, int16_t limit_a_q9) {
    self->limit_a_q9 = limit_a_q9;
    self->limit_q23 = (int32_t)limit_a_q9 * GAIN_Q14;
    foldback_reset(self);
}

void foldback_reset(Foldback *self) {
    self->change_q23 = 0;
    self->active = false;
}

// The integral lowers or raises the duty by its size, and ends at 0.
INLINE_NEVER static int32_t integrated(const Foldback *self, int16_t current_a_q9) {
    const bool lowers = self->change_q23 < 0 || (self->change_q23 == 0 && current_a_q9 > 0);
    const int32_t by_current_q23 = (int32_t)current_a_q9 * GAIN_Q14;
    int32_t size_q23 =
        lowers ? by_current_q23 - self->change_q23 : self->change_q23 - by_current_q23;
    size_q23 -= self->limit_q23;
    if (size_q23 < 0) {
        return 0;
    }
    size_q23 = size_q23 > DUTY_MAX_Q23 ? DUTY_MAX_Q23 : size_q23;
    return lowers ? -size_q23 : size_q23;
}

// Sum within the range of the duty, in 16 bits.
static int16_t raised(int16_t duty_q15, int16_t change_q15) {
    const int16_t sum_q15 = (int16_t)((uint16_t)duty_q15 + (uint16_t)change_q15);
    if (sum_q15 >= 0) {
        return (duty_q15 & change_q15) < 0 ? 0 : sum_q15;
    }
    return (duty_q15 | change_q15) < 0 ? 0 : INT16_MAX;
}

int16_t foldback_step(Foldback *self, int16_t requested_q15, int16_t current_a_q9) {
    if (!self->active && current_a_q9 <= self->limit_a_q9 && current_a_q9 >= -self->limit_a_q9) {
        return (int16_t)(requested_q15 < 0 ? 0 : requested_q15);  // most ticks
    }
    self->change_q23 = integrated(self, current_a_q9);
    self->active = self->change_q23 != 0;
    return raised(requested_q15, (int16_t)(self->change_q23 >> 8));
}

bool foldback_active(const Foldback *self) {
    return self->active;
}
