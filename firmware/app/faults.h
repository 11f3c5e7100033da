// Faults: when each is found. They latch; the state machine clears them at a released trigger.
//
// | fault            | found when |
// | over_current     | one sample beyond the trip; the ADC interrupt has opened the bridge already
// | | under_voltage    | bus below the limit for 10 ms | | stall            | driven at 6 % or
// more, no edge for the stall time, current like that of a shaft that stands | | sensor_lost      |
// driven, no edge for the stall time, current like that of a shaft that turns; temperature or
// current sensor out of its range | | over_temperature | bridge above the limit for 100 ms | |
// adc_cadence      | the ring of samples did not hold what the cadence says | | overrun          |
// a tick began more than two ticks late |
#ifndef VGROOVE_APP_FAULTS_H
#define VGROOVE_APP_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "app/measure.h"

typedef struct {
    uint16_t under_voltage_mv;
    int16_t over_temperature_c_q4;
    uint16_t stall_ms;
} FaultLimits;

// What the drive did in the tick just measured.
typedef struct {
    int16_t compare;  // in force, H_BRIDGE_COAST
    bool new_edge;
    bool goes_on;  // a drive does, though its controller may have opened the bridge for the tick
} FaultsDrive;

typedef struct {
    uint8_t active;  // conditions that hold now, TELEMETRY_FAULTS_*
    uint8_t latched;
    uint8_t under_voltage_ms;
    uint8_t over_temperature_ms;
    uint8_t temperature_lost_ms;
    uint16_t no_edge_ms;       // driven, since the last edge: what a controller opens or lets rest
                               // between does not begin it anew
    uint8_t settled_ms;        // since the bridge was last open, up to FAULTS_SETTLED_MS
    bool current_implausible;  // offset at rest out of range
    bool overrun;
} Faults;

void faults_step(Faults *self, const Measurement *m, const FaultLimits *limits,
                 const FaultsDrive *drive);

// The current of the first ticks after an open bridge says nothing: it rises with L / R = 0.5 ms
// behind a tick of arming (physics.md).
#define FAULTS_SETTLED_MS 4u

// Whether the current is that of a driven shaft that stands.
bool faults_draws_like_standing(const Measurement *m, int16_t compare);

// Forgets what no longer holds.
void faults_clear(Faults *self);

#endif
