// ADC slots and sampling schedule, see adc_sequence.h.
#include "drivers/adc_sequence.h"

#include <stddef.h>

#include "core/flash.h"
#include "hal/hal.h"

#define SAMPLES_PER_TICK (HAL_CYCLES_PER_TICK / HAL_CYCLES_PER_SAMPLE)
#define CYCLES_BEYOND (HAL_CYCLES_PER_TICK % HAL_CYCLES_PER_SAMPLE)
#define FIRST_USABLE (HAL_FIRST_SAMPLE_CYCLES + HAL_LATENCY_CYCLES)
#define LATE_SAMPLES 6u  // conversions during the longest delay of a tick; more: the count is wrong
#define LEFT_BEHIND 2u   // samples kept after a surplus, so that the next tick has enough

#define BUS_EVERY 8u  // of these every second one is the bus

_Static_assert(offsetof(AdcSequence, high) == offsetof(AdcSequence, low) + ADC_SEQUENCE_RING,
               "sample_of");

static const uint8_t slots[ADC_SEQUENCE_SLOTS] FLASH_TABLE = {
    HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_BUS,         HAL_ADC_CURRENT,
    HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_TRIGGER,     HAL_ADC_CURRENT,
    HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_BUS,         HAL_ADC_CURRENT,
    HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_TEMPERATURE, HAL_ADC_CURRENT,
};

void adc_sequence_init(AdcSequence *self) {
    // The time before the first sample is one sampling interval.
    *self = (AdcSequence){.trip_high = ADC_SEQUENCE_TOP_COUNT,
                          .next_channel = adc_sequence_channel(1),
                          .cycles_ahead = (int16_t)(HAL_CYCLES_PER_SAMPLE - FIRST_USABLE)};
    for (uint8_t slot = 0; slot < ADC_SEQUENCE_SLOTS; slot++) {
        self->after[slot] = adc_sequence_channel((uint8_t)(slot + 2u));
    }
}

void adc_sequence_set_trip(AdcSequence *self, uint16_t low, uint16_t high) {
    const uint8_t lock = hal_lock();
    self->trip_low = low;
    self->trip_high = high;
    hal_unlock(lock);
}

// Number of samples that belong to the beginning tick; sets `*lost` when the ring does not hold as
// many as the schedule requires.
static uint8_t samples_due(AdcSequence *self, bool *lost) {
    const uint8_t held = (uint8_t)(self->head - self->tail);
    uint8_t due = SAMPLES_PER_TICK;
    self->cycles_ahead = (int16_t)(self->cycles_ahead + (int16_t)CYCLES_BEYOND);
    if (self->cycles_ahead >= (int16_t)HAL_CYCLES_PER_SAMPLE) {
        self->cycles_ahead = (int16_t)(self->cycles_ahead - (int16_t)HAL_CYCLES_PER_SAMPLE);
        due++;
    }
    if (held >= due && (uint8_t)(held - due) <= LATE_SAMPLES) {
        return due;
    }
    *lost = true;
    if (held <= due) {
        return held;
    }
    self->tail = (uint8_t)(self->head - LEFT_BEHIND);
    return 0;
}

// Two comparisons: a single one of (counts - low) needs two more registers in the interrupt, 8
// cycles.
static bool trips(const AdcSequence *self, uint16_t counts) {
    return counts < self->trip_low || counts > self->trip_high;
}

// Low and high byte by one address: the arrays are adjacent.
static uint16_t sample_of(const AdcSequence *self, uint8_t slot) {
    const volatile uint8_t *place =
        (const volatile uint8_t *)self + offsetof(AdcSequence, low) + slot % ADC_SEQUENCE_RING;
    return (uint16_t)(place[0] | (uint16_t)((uint16_t)place[ADC_SEQUENCE_RING] << 8));
}

// Stores a sample that is none of the current; returns the bit of its channel.
static uint8_t take_other(AdcTick *out, uint8_t slot, uint16_t counts) {
    if (slot % BUS_EVERY == ADC_SEQUENCE_OTHER_AT) {
        out->latest[HAL_ADC_BUS] = counts;
        return 1u << HAL_ADC_BUS;  // no variable shift
    }
    const uint8_t channel = adc_sequence_channel(slot);
    out->latest[channel] = counts;
    return channel == HAL_ADC_TRIGGER ? 1u << HAL_ADC_TRIGGER : 1u << HAL_ADC_TEMPERATURE;
}

// Counts of a marked sample, beyond the trip; saturated samples are a subset of these.
static uint16_t unmarked(AdcTick *out, uint16_t marked) {
    const uint16_t counts = (uint16_t)(marked & ~ADC_SEQUENCE_MARK);
    out->trips = true;
    if (counts == 0u || counts == ADC_SEQUENCE_TOP_COUNT) {
        out->saturated = true;
    }
    return counts;
}

void adc_sequence_tick(AdcSequence *self, AdcTick *out) {
    out->lost = false;
    out->trips = false;
    out->saturated = false;
    uint8_t due = samples_due(self, &out->lost);
    uint8_t slot = self->tail;
    self->tail = (uint8_t)(slot + due);
    uint16_t sum = 0;
    uint8_t count = 0;
    uint8_t fresh = 0;
    for (; due > 0u; due--, slot++) {
        uint16_t counts = sample_of(self, slot);
        if (slot % ADC_SEQUENCE_OTHER_EVERY == ADC_SEQUENCE_OTHER_AT) {
            fresh |= take_other(out, slot, counts);
            continue;
        }
        if ((counts & ADC_SEQUENCE_MARK) != 0u) {
            counts = unmarked(out, counts);
        }
        sum = (uint16_t)(sum + counts);
        count++;
    }
    out->fresh = fresh;
    out->current_sum = sum;
    out->current_count = count;
}

uint8_t adc_sequence_channel(uint8_t slot) {
    return FLASH_U8(&slots[slot % ADC_SEQUENCE_SLOTS]);
}

// `head` may move before the sample is stored, since nothing interrupts it; that frees a register.
bool adc_sequence_on_result(AdcSequence *self, uint16_t counts) {
    const uint8_t head = self->head;
    const uint8_t at = head % ADC_SEQUENCE_RING;
    self->head = (uint8_t)(head + 1u);
    self->low[at] = (uint8_t)counts;
    self->next_channel = self->after[at];
    const bool beyond =
        head % ADC_SEQUENCE_OTHER_EVERY != ADC_SEQUENCE_OTHER_AT && trips(self, counts);
    self->high[at] = (uint8_t)(beyond ? (counts | ADC_SEQUENCE_MARK) >> 8 : counts >> 8);
    return beyond;
}
