// ADC schedule: which channel is converted when, and which results belong to a tick. Their number
// follows from the exact sampling times, independent of interrupt latency.
//
// One conversion in every fourth PWM period, 7 or 8 a tick. The 16 slots are 12 x current, 2 x bus,
// trigger, temperature.
#ifndef VGROOVE_DRIVERS_ADC_SEQUENCE_H
#define VGROOVE_DRIVERS_ADC_SEQUENCE_H

#include <stdbool.h>
#include <stdint.h>

#define ADC_SEQUENCE_SLOTS 16u
#define ADC_SEQUENCE_RING ADC_SEQUENCE_SLOTS  // two ticks
#define ADC_SEQUENCE_TOP_COUNT 1023u
#define ADC_SEQUENCE_MARK 0x8000u  // of a sample that the interrupt has found beyond the trip

// Every fourth slot, from the third on, is not a current sample: found without a table.
#define ADC_SEQUENCE_OTHER_EVERY 4u
#define ADC_SEQUENCE_OTHER_AT 2u

// Samples of a tick.
typedef struct {
    uint16_t current_sum;
    uint8_t current_count;
    uint8_t fresh;       // bit HAL_ADC_*: that channel has a new value in `latest`
    uint16_t latest[4];  // by HAL_ADC_*
    bool lost;           // wrong number of samples in the ring, resynchronised
    bool trips;          // a current sample was beyond the trip
    bool saturated;      // and at an end of the scale
} AdcTick;

typedef struct {
    volatile uint16_t trip_low;   // least current counts within the trip
    volatile uint16_t trip_high;  // greatest
    uint8_t next_channel;   // selected in the next ADC interrupt, before it reads the result: the
                            // channel of the conversion that follows
    volatile uint8_t head;  // conversions so far, modulo 256; modulo 16: slot and index in the ring
    uint8_t tail;           // conversions used so far
    int16_t cycles_ahead;   // from the newest usable sample to the tick; negative before the first
    volatile uint8_t low[ADC_SEQUENCE_RING];
    volatile uint8_t high[ADC_SEQUENCE_RING];
    uint8_t after[ADC_SEQUENCE_SLOTS];  // channel two slots ahead; in RAM, for the interrupt
} AdcSequence;

void adc_sequence_init(AdcSequence *self);
void adc_sequence_set_trip(AdcSequence *self, uint16_t low, uint16_t high);

// Beginning of a tick: takes the samples that belong to it.
void adc_sequence_tick(AdcSequence *self, AdcTick *out);

uint8_t adc_sequence_channel(uint8_t slot);

// Interrupt: stores the result and advances the slot; true: the bridge must be opened.
bool adc_sequence_on_result(AdcSequence *self, uint16_t counts);

#endif
