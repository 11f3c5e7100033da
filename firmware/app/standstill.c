// Standstill, see standstill.h.
#include "app/standstill.h"

#include "core/inline.h"

// Run-down time from a speed, at most STANDSTILL_RUN_DOWN_MS.
static uint16_t run_down_ms(uint16_t rpm) {
    const uint16_t ms = (uint16_t)(((uint32_t)rpm * (uint32_t)(4u * STANDSTILL_RUN_DOWN_MS)) >> 16);
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
static uint16_t gained_rpm(const Standstill *self) {
    const uint16_t most = (uint16_t)(self->driven_compare * STANDSTILL_RPM_PER_COUNT);
    const uint16_t gained = (uint16_t)(self->driven_ms * STANDSTILL_RPM_PER_MS);
    if (self->driven_ms == STANDSTILL_STARTED_MS && self->stood) {
        return 0;
    }
    return gained < most ? gained : most;
}

bool standstill_step(Standstill *self, const StandstillInputs *in) {
    uint16_t rpm = in->ended_rpm_q1 / 2u;
    if (in->coasts) {
        rpm = (uint16_t)(rpm + gained_rpm(self));  // at most 32,767 + 16,320
        self->driven_ms = 0;
    }
    if (in->lost) {
        self->unseen_ms = STANDSTILL_RUN_DOWN_MS;
    } else if (rpm > 0u) {
        const uint16_t ms = run_down_ms(rpm);
        self->unseen_ms = ms > self->unseen_ms ? ms : self->unseen_ms;
    } else if (self->unseen_ms > 0u && in->coasts) {
        self->unseen_ms--;
    }
    self->turned = false;
    return self->unseen_ms == 0u;
}
