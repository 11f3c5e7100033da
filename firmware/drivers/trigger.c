// Trigger and switches, see trigger.h.
#include "drivers/trigger.h"

#include "hal/hal.h"

#define SWITCHES 4u
#define FACTOR_Q 7u

void trigger_set_ends(Trigger *self, uint16_t low_count, uint16_t high_count) {
    const uint16_t span = high_count > low_count ? (uint16_t)(high_count - low_count) : 1u;
    self->low_count = low_count;
    self->high_count = high_count;
    self->factor_q7 = ((uint32_t)1 << (15u + FACTOR_Q)) / span;
}

void trigger_set_travel(Trigger *self, uint16_t counts) {
    if (counts <= self->low_count) {
        self->travel_q15 = 0;
    } else if (counts >= self->high_count) {
        self->travel_q15 = INT16_MAX;
    } else {
        self->travel_q15 = (int16_t)(((uint32_t)(counts - self->low_count) * self->factor_q7) >> FACTOR_Q);
    }
}

void trigger_set_switches(Trigger *self, uint8_t raw) {
    const uint8_t differs = raw ^ self->stable;
    for (uint8_t k = 0; k < SWITCHES; k++) {
        const uint8_t bit = (uint8_t)(1u << k);
        if ((differs & bit) == 0u) {
            self->ticks[k] = 0;
        } else if (++self->ticks[k] >= TRIGGER_DEBOUNCE_TICKS) {
            self->stable ^= bit;
            self->ticks[k] = 0;
        }
    }
}

bool trigger_contact(const Trigger *self) {
    return (self->stable & HAL_SWITCH_CONTACT) != 0u;
}

bool trigger_reverse(const Trigger *self) {
    return (self->stable & HAL_SWITCH_REVERSE) != 0u;
}

uint8_t trigger_mode(const Trigger *self) {
    return (uint8_t)(self->stable >> HAL_SWITCH_MODE_SHIFT);
}

bool trigger_pressed(const Trigger *self) {
    return trigger_contact(self) && self->travel_q15 > 0;
}
