// ADC slots and cadence, see adc_sequence.h.
#include "drivers/adc_sequence.h"

#include "core/flash.h"
#include "hal/hal.h"

#define CHANNEL_SHIFT 14u
#define TAG_SHIFT (CHANNEL_SHIFT - 8u)
#define COUNTS_MASK 0x3FFu
#define SAMPLES_A_TICK (HAL_CYCLES_PER_TICK / HAL_CYCLES_PER_SAMPLE)
#define CYCLES_BEYOND (HAL_CYCLES_PER_TICK % HAL_CYCLES_PER_SAMPLE)
#define FIRST_USABLE (HAL_FIRST_SAMPLE_CYCLES + HAL_LATENCY_CYCLES)
#define LATE_SAMPLES 6u  // conversions during the longest wait of a tick for its turn; more left over means that the count has slipped
#define LEFT_BEHIND 2u   // after a surplus, so that the next tick is not short

static const uint8_t slots[ADC_SEQUENCE_SLOTS] FLASH_TABLE = {
    HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_BUS, HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_TRIGGER,     HAL_ADC_CURRENT,
    HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_BUS, HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_CURRENT, HAL_ADC_TEMPERATURE, HAL_ADC_CURRENT,
};

void adc_sequence_init(AdcSequence *self) {
    // The sample "before the first" ends one cadence before the first usable one.
    *self = (AdcSequence){.trip_low = 0u, .trip_high = ADC_SEQUENCE_TOP_COUNT, .cycles_ahead = (int16_t)(HAL_CYCLES_PER_SAMPLE - FIRST_USABLE)};
}

void adc_sequence_set_trip(AdcSequence *self, uint16_t low, uint16_t high) {
    const uint8_t lock = hal_lock();
    self->trip_low = low;
    self->trip_high = high;
    hal_unlock(lock);
}

bool adc_sequence_trips(const AdcSequence *self, const AdcSample *sample) {
    return sample->channel == HAL_ADC_CURRENT && (sample->counts < self->trip_low || sample->counts > self->trip_high);
}

uint8_t adc_sequence_due(AdcSequence *self, bool *lost) {
    const uint8_t held = ring_count_words(&self->ring);
    uint8_t due = SAMPLES_A_TICK;
    self->cycles_ahead = (int16_t)(self->cycles_ahead + (int16_t)CYCLES_BEYOND);
    if (self->cycles_ahead >= (int16_t)HAL_CYCLES_PER_SAMPLE) {
        self->cycles_ahead = (int16_t)(self->cycles_ahead - (int16_t)HAL_CYCLES_PER_SAMPLE);
        due++;
    }
    if (held >= due && held <= due + LATE_SAMPLES && !self->overflowed) {
        return due;
    }
    *lost = true;
    self->overflowed = false;
    return held > due ? (uint8_t)(held - LEFT_BEHIND) : held;
}

AdcSample adc_sequence_take(AdcSequence *self) {
    const uint16_t word = ring_peek_word(&self->ring);
    ring_drop_word(&self->ring);
    return (AdcSample){.counts = word & COUNTS_MASK, .channel = (uint8_t)(word >> CHANNEL_SHIFT)};
}

uint8_t adc_sequence_channel(uint8_t slot) {
    return FLASH_U8(&slots[slot % ADC_SEQUENCE_SLOTS]);
}

uint8_t adc_sequence_on_result(AdcSequence *self, uint16_t counts, bool *trip) {
    const uint8_t channel = self->channel;
    const uint16_t tag = (uint16_t)((uint16_t)(uint8_t)(channel << TAG_SHIFT) << 8);
    if (!ring_push_word(&self->ring, counts | tag)) {
        self->overflowed = true;
    }
    *trip = channel == HAL_ADC_CURRENT && (counts < self->trip_low || counts > self->trip_high);
    const uint8_t slot = (uint8_t)((self->slot + 1u) % ADC_SEQUENCE_SLOTS);
    const uint8_t next = FLASH_U8(&slots[slot]);
    self->slot = slot;
    self->channel = next;
    return next;
}
