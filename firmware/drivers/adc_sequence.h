// What the ADC converts when, and which results a tick may use: as many as the exact cadence says, however late an interrupt was.
//
// One conversion in every fourth PWM period, 7 or 8 a tick. The 16 slots are 12 x current, 2 x bus, trigger, temperature.
#ifndef VGROOVE_DRIVERS_ADC_SEQUENCE_H
#define VGROOVE_DRIVERS_ADC_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/ring.h"

#define ADC_SEQUENCE_SLOTS 16u
#define ADC_SEQUENCE_TOP_COUNT 1023u

typedef struct {
    uint16_t counts;
    uint8_t channel;  // HAL_ADC_*
} AdcSample;

typedef struct {
    RingWords ring;               // channel in bits 14 and 15, counts below
    volatile uint16_t trip_low;   // current counts that are still allowed
    volatile uint16_t trip_high;
    volatile uint8_t slot;        // of the conversion that completes next
    volatile uint8_t channel;     // of that slot
    volatile bool overflowed;
    int16_t cycles_ahead;         // of the tick, since the newest sample that it may use; negative before the first
} AdcSequence;

void adc_sequence_init(AdcSequence *self);
void adc_sequence_set_trip(AdcSequence *self, uint16_t low, uint16_t high);
bool adc_sequence_trips(const AdcSequence *self, const AdcSample *sample);

// Begin of a tick: how many samples belong to it. `*lost` becomes true when the ring does not hold what the cadence says; it is then resynchronised.
uint8_t adc_sequence_due(AdcSequence *self, bool *lost);
AdcSample adc_sequence_take(AdcSequence *self);

uint8_t adc_sequence_channel(uint8_t slot);

// Interrupt: keeps the result and goes on to the next slot, whose channel it returns; true in `*trip`: the bridge must open.
uint8_t adc_sequence_on_result(AdcSequence *self, uint16_t counts, bool *trip);

#endif
