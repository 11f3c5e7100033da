// Faults: when each is found. They latch; the state machine clears them at a released trigger.
//
// | fault            | found when |
// | over_current     | one sample beyond the trip; the ADC interrupt has opened the bridge already |
// | under_voltage    | bus below the limit for 10 ms |
// | stall            | driven, no edge for the stall time, current like that of a shaft that stands |
// | sensor_lost      | driven, no edge for the stall time, current like that of a shaft that turns; temperature or current sensor out of its range |
// | over_temperature | bridge above the limit for 100 ms |
// | adc_cadence      | the ring of samples did not hold what the cadence says |
// | overrun          | a tick began more than two ticks late |
#ifndef VGROOVE_APP_FAULTS_H
#define VGROOVE_APP_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "app/measure.h"

typedef struct {
    uint16_t under_voltage_mv;
    int16_t over_temperature_c;
    uint16_t stall_ms;
} FaultLimits;

typedef struct {
    uint8_t active;  // conditions that hold now, TELEMETRY_FAULTS_*
    uint8_t latched;
    uint8_t under_voltage_ms;
    uint8_t over_temperature_ms;
    uint8_t temperature_lost_ms;
    uint16_t no_edge_ms;
    bool current_implausible;  // offset at rest out of range
    bool overrun;
} Faults;

void faults_step(Faults *self, const Measurement *m, const FaultLimits *limits, int16_t compare, bool new_edge);

// Whether the current is that of a driven shaft that stands.
bool faults_draws_like_standing(const Measurement *m, int16_t compare);

// Forgets what no longer holds.
void faults_clear(Faults *self);

#endif
