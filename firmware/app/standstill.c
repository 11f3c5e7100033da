// Standstill, see standstill.h.
#include "app/standstill.h"

#include "core/inline.h"

// Run-down time from a speed, at most STANDSTILL_RUN_DOWN_MS.
static uint16_t run_down_ms(uint16_t rpm_q1) {
    const uint16_t ms =
        (uint16_t)(((uint32_t)rpm_q1 * (uint32_t)(2u * STANDSTILL_RUN_DOWN_MS)) >> 16);
    return ms < STANDSTILL_RUN_DOWN_MS ? ms : STANDSTILL_RUN_DOWN_MS;
}

INLINE_NEVER bool standstill_driven(Standstill *self, int16_t compare) {
    const uint8_t magnitude = (uint8_t)(compare < 0 ? -compare : compare);
    if (self->driven_ms == 0u || magnitude > self->driven_compare) {
        self->driven_compare = magnitude;
    }
    if (self->driven_ms < STANDSTILL_STARTED_MS) {
        self->driven_ms++;
    }
    return self->driven_ms == STANDSTILL_STARTED_MS;
}

// Upper bound of the speed that the drive has given the shaft since the last edge.
static uint16_t gained_rpm_q1(const Standstill *self) {
    const uint16_t most = (uint16_t)(self->driven_compare * STANDSTILL_RPM_Q1_PER_COUNT);
    const uint16_t gained = (uint16_t)(self->driven_ms * STANDSTILL_RPM_Q1_PER_MS);
    if (self->driven_ms == STANDSTILL_STARTED_MS && self->stood) {
        return 0;
    }
    return gained < most ? gained : most;
}

bool standstill_step(Standstill *self, const StandstillInputs *in) {
    uint16_t rpm_q1 = in->ended_rpm_q1;
    if (in->coasts) {
        rpm_q1 = (uint16_t)(rpm_q1 + gained_rpm_q1(self));
        self->driven_ms = 0;
    }
    if (in->lost) {
        self->unseen_ms = STANDSTILL_RUN_DOWN_MS;
    } else if (rpm_q1 > 0u) {
        const uint16_t ms = run_down_ms(rpm_q1);
        self->unseen_ms = ms > self->unseen_ms ? ms : self->unseen_ms;
    } else if (self->unseen_ms > 0u && in->coasts) {
        self->unseen_ms--;
    }
    self->turned = false;
    return self->unseen_ms == 0u;
}
