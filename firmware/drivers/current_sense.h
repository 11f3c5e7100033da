// Current from ADC counts: offset measured at rest, gain from a parameter, trip limits in counts.
#ifndef VGROOVE_DRIVERS_CURRENT_SENSE_H
#define VGROOVE_DRIVERS_CURRENT_SENSE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/units.h"

#define CURRENT_SENSE_REST_SAMPLES_LOG2 10u  // samples of the offset calibration, about 0.2 s
#define CURRENT_SENSE_REST_SPREAD_Q4 320     // 20 counts (2.5 A) off mid-scale: a sensor fault

typedef struct {
    int16_t gain_a_q15;  // per count
    int16_t offset_q4;   // counts
    uint32_t rest_sum;
    uint16_t rest_count;
} CurrentSense;

typedef struct {
    uint16_t low;  // counts within the trip
    uint16_t high;
} CurrentLimits;

void current_sense_init(CurrentSense *self, int16_t gain_a_q15, int16_t offset_q4);

// Mean of 1..8 samples in counts Q4.
int16_t current_sense_mean_q4(uint16_t sum, uint8_t count);
int16_t current_sense_a_q9(const CurrentSense *self, int16_t mean_q4, bool *saturated);

// Counts within +-trip_a_q9, limited so that the ends of the ADC scale trip.
CurrentLimits current_sense_limits(const CurrentSense *self, int16_t trip_a_q9);

// Adds samples taken at rest; true when there are enough and their mean has become the offset.
// `*implausible`: the mean was rejected.
void current_sense_rest_begin(CurrentSense *self);
bool current_sense_rest(CurrentSense *self, uint16_t sum, uint8_t count, bool *implausible);

#endif
