// ADC counts of the current sensor to amperes: offset from rest, gain a parameter, limits of the
// trip in counts.
#ifndef VGROOVE_DRIVERS_CURRENT_SENSE_H
#define VGROOVE_DRIVERS_CURRENT_SENSE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/units.h"

#define CURRENT_SENSE_REST_SAMPLES_LOG2 10u  // samples of a calibration at rest, about 0.2 s
#define CURRENT_SENSE_REST_SPREAD_Q4                                                               \
    320  // 20 counts (2.5 A): further from mid-scale is a broken sensor, not an offset

typedef struct {
    int16_t gain_a_q15;  // per count
    int16_t offset_q4;   // counts
    uint32_t rest_sum;
    uint16_t rest_count;
} CurrentSense;

typedef struct {
    uint16_t low;  // counts that do not trip
    uint16_t high;
} CurrentLimits;

void current_sense_init(CurrentSense *self, int16_t gain_a_q15, int16_t offset_q4);

// Mean of 1..8 samples in counts Q4.
int16_t current_sense_mean_q4(uint16_t sum, uint8_t count);
int16_t current_sense_a_q9(const CurrentSense *self, int16_t mean_q4, bool *saturated);

// Counts within +-trip_a_q9, at most what the ADC can tell from its ends.
CurrentLimits current_sense_limits(const CurrentSense *self, int16_t trip_a_q9);

// Collects samples taken at rest; true when there are enough and the mean has become the offset.
// `*implausible` when it was refused.
void current_sense_rest_begin(CurrentSense *self);
bool current_sense_rest(CurrentSense *self, uint16_t sum, uint8_t count, bool *implausible);

#endif
