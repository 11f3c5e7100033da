// What the ADC converts when, and which results a tick may use: as many as the exact cadence says,
// however late an interrupt was.
//
// One conversion in every fourth PWM period, 7 or 8 a tick. The 16 slots are 12 x current, 2 x bus,
// trigger, temperature.
#ifndef VGROOVE_DRIVERS_ADC_SEQUENCE_H
#define VGROOVE_DRIVERS_ADC_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>

#define ADC_SEQUENCE_SLOTS 16u
#define ADC_SEQUENCE_RING ADC_SEQUENCE_SLOTS  // one place a slot: two ticks' worth
#define ADC_SEQUENCE_TOP_COUNT 1023u

// What a tick's samples come to.
typedef struct {
    uint16_t current_sum;
    uint8_t current_count;
    uint8_t fresh;       // bit HAL_ADC_*: that channel has a new value in `latest`
    uint16_t latest[4];  // by HAL_ADC_*
    bool lost;           // the ring did not hold what the cadence says; it has been resynchronised
    bool trips;          // a current sample was beyond the trip
    bool saturated;      // and at an end of the scale
} AdcTick;

typedef struct {
    volatile uint16_t trip_low;   // least current counts that are allowed
    volatile uint16_t trip_high;  // and greatest
    uint8_t next_channel;   // of the conversion after the one that completes next: known before the
                            // interrupt, so that it can be set first of all
    volatile uint8_t head;  // conversions so far, modulo 256: head modulo 16 is the slot and the
                            // place in the ring
    uint8_t tail;           // conversions taken so far
    int16_t cycles_ahead;   // of the tick, since the newest sample that it may use; negative before
                            // the first
    volatile uint8_t low[ADC_SEQUENCE_RING];
    volatile uint8_t high[ADC_SEQUENCE_RING];
    uint8_t after[ADC_SEQUENCE_SLOTS];  // channel two slots on; in RAM and beside the samples,
                                        // where the interrupt reaches it at once
} AdcSequence;

void adc_sequence_init(AdcSequence *self);
void adc_sequence_set_trip(AdcSequence *self, uint16_t low, uint16_t high);

// Begin of a tick: takes the samples that belong to it.
void adc_sequence_tick(AdcSequence *self, AdcTick *out);

uint8_t adc_sequence_channel(uint8_t slot);

// Interrupt: keeps the result and goes on to the next slot; true: the bridge must open.
bool adc_sequence_on_result(AdcSequence *self, uint16_t counts);

#endif
