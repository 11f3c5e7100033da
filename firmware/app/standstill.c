// Standstill, see standstill.h.
#include "app/standstill.h"

// Time to run down from a speed, at most the whole.
static uint16_t run_down_ms(uint16_t rpm_q1) {
    const uint16_t ms = (uint16_t)(((uint32_t)rpm_q1 * (uint32_t)(2u * STANDSTILL_RUN_DOWN_MS)) >> 16);
    return ms < STANDSTILL_RUN_DOWN_MS ? ms : STANDSTILL_RUN_DOWN_MS;
}

bool standstill_step(Standstill *self, const StandstillInputs *in) {
    if (in->lost) {
        self->unseen_ms = STANDSTILL_RUN_DOWN_MS;
    } else if (in->ended_rpm_q1 > 0u) {
        const uint16_t ms = run_down_ms(in->ended_rpm_q1);
        self->unseen_ms = ms > self->unseen_ms ? ms : self->unseen_ms;
    } else if (self->unseen_ms > 0u && in->coasts) {
        self->unseen_ms--;
    }
    self->turned = false;
    return self->unseen_ms == 0u;
}
