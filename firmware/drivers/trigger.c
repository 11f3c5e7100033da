// Trigger and switches, see trigger.h.
#include "drivers/trigger.h"

#include "core/divide.h"
#include "hal/hal.h"

#define FACTOR_Q 7u

_Static_assert(TRIGGER_DEBOUNCE_TICKS == 5u, "the bit planes look for 5");

void trigger_init(Trigger *self) {
    *self = (Trigger){.stable = HAL_SWITCH_CONTACT};
}

void trigger_set_ends(Trigger *self, uint16_t low_count, uint16_t high_count) {
    const uint16_t span = high_count > low_count ? (uint16_t)(high_count - low_count) : 1u;
    self->low_count = low_count;
    self->high_count = high_count;
    self->factor_q7 = divide_u32((uint32_t)1 << (15u + FACTOR_Q), span);
}

void trigger_set_travel(Trigger *self, uint16_t counts) {
    uint16_t begin = self->low_count;
    if (self->travel_q15 == 0) {
        begin += TRIGGER_HYSTERESIS_COUNT;
    }
    if (counts <= begin) {
        self->travel_q15 = 0;
    } else if (counts >= self->high_count) {
        self->travel_q15 = INT16_MAX;
    } else {
        self->travel_q15 =
            (int16_t)(((uint32_t)(uint16_t)(2u * (counts - self->low_count)) * self->factor_q7) >>
                      (FACTOR_Q + 1u));
    }
}

// Debounce counters as bit planes: plane k holds bit k of the count of each switch, so that all are
// counted at once.
void trigger_set_switches(Trigger *self, uint8_t raw) {
    const uint8_t differs = raw ^ self->stable;
    if (differs == 0u) {
        self->ticks[0] = 0;
        self->ticks[1] = 0;
        self->ticks[2] = 0;
        return;
    }
    const uint8_t one = self->ticks[0];
    const uint8_t two = self->ticks[1];
    self->ticks[0] = (uint8_t)(~one & differs);
    self->ticks[1] = (two ^ one) & differs;
    self->ticks[2] = (self->ticks[2] ^ (two & one)) & differs;
    const uint8_t reached =
        (uint8_t)(self->ticks[2] & ~self->ticks[1] & self->ticks[0]);  // 5 = TRIGGER_DEBOUNCE_TICKS
    self->stable ^= reached;
    self->ticks[0] &= (uint8_t)~reached;
    self->ticks[2] &= (uint8_t)~reached;
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

bool trigger_implausible(const Trigger *self) {
    return !trigger_contact(self) && self->travel_q15 > INT16_MAX / 2;
}
