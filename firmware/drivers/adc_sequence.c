// ADC slots and cadence, see adc_sequence.h.
#include "drivers/adc_sequence.h"

#include "core/flash.h"
#include "hal/hal.h"

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
    *self = (AdcSequence){.trip_span = ADC_SEQUENCE_TOP_COUNT,
                          .channel = adc_sequence_channel(0),
                          .next_channel = adc_sequence_channel(1),
                          .cycles_ahead = (int16_t)(HAL_CYCLES_PER_SAMPLE - FIRST_USABLE)};
}

void adc_sequence_set_trip(AdcSequence *self, uint16_t low, uint16_t high) {
    const uint8_t lock = hal_lock();
    self->trip_low = low;
    self->trip_span = (uint16_t)(high - low);
    hal_unlock(lock);
}

// How many samples belong to the tick that begins; `*lost` becomes true when the ring does not hold what the cadence says.
static uint8_t samples_due(AdcSequence *self, bool *lost) {
    const uint8_t held = (uint8_t)(self->head - self->tail);
    uint8_t due = SAMPLES_A_TICK;
    self->cycles_ahead = (int16_t)(self->cycles_ahead + (int16_t)CYCLES_BEYOND);
    if (self->cycles_ahead >= (int16_t)HAL_CYCLES_PER_SAMPLE) {
        self->cycles_ahead = (int16_t)(self->cycles_ahead - (int16_t)HAL_CYCLES_PER_SAMPLE);
        due++;
    }
    if (held >= due && held <= due + LATE_SAMPLES) {
        return due;
    }
    *lost = true;
    if (held <= due) {
        return held;
    }
    self->tail = (uint8_t)(self->head - LEFT_BEHIND);
    return 0;
}

// Below the least allowed value the difference wraps round and is large.
static bool trips(const AdcSequence *self, uint16_t counts) {
    return (uint16_t)(counts - self->trip_low) > self->trip_span;
}

static void take_current(AdcTick *out, uint16_t counts) {
    out->current_sum = (uint16_t)(out->current_sum + counts);
    out->current_count++;
    if (counts < out->current_least) {
        out->current_least = counts;
    }
    if (counts > out->current_greatest) {
        out->current_greatest = counts;
    }
}

void adc_sequence_tick(AdcSequence *self, AdcTick *out) {
    *out = (AdcTick){.current_least = ADC_SEQUENCE_TOP_COUNT};
    for (uint8_t due = samples_due(self, &out->lost); due > 0u; due--) {
        const uint8_t at = self->tail % ADC_SEQUENCE_RING;
        const uint8_t channel = adc_sequence_channel(self->tail);
        const uint16_t counts = (uint16_t)(self->low[at] | (uint16_t)((uint16_t)self->high[at] << 8));
        self->tail++;
        if (channel == HAL_ADC_CURRENT) {
            take_current(out, counts);
        } else {
            out->latest[channel] = counts;
            out->fresh = (uint8_t)(out->fresh | (1u << channel));
        }
    }
    out->trips = out->current_count > 0u && (trips(self, out->current_least) || trips(self, out->current_greatest));
}

uint8_t adc_sequence_channel(uint8_t slot) {
    return FLASH_U8(&slots[slot % ADC_SEQUENCE_SLOTS]);
}

bool adc_sequence_on_result(AdcSequence *self, uint16_t counts) {
    const uint8_t head = self->head;
    const uint8_t channel = self->channel;
    self->low[head % ADC_SEQUENCE_RING] = (uint8_t)counts;
    self->high[head % ADC_SEQUENCE_RING] = (uint8_t)(counts >> 8);
    self->head = (uint8_t)(head + 1u);
    self->channel = self->next_channel;
    self->next_channel = FLASH_U8(&slots[(uint8_t)(head + 2u) % ADC_SEQUENCE_SLOTS]);
    return channel == HAL_ADC_CURRENT && trips(self, counts);
}
