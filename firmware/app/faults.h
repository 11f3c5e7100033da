// Fault detection. Faults latch; the state machine clears them when the trigger is released.
//
// | fault            | condition                                                                 |
// | over_current     | one sample beyond the trip; the ADC interrupt has opened the bridge       |
// | under_voltage    | bus voltage below the limit for 10 ms                                     |
// | stall            | duty of 6 % or more, no edge for the stall time, current as at rest       |
// | sensor_lost      | the same with the current of a turning shaft; temperature or current      |
// |                  | sensor out of range; trigger at more than half with an open contact; the  |
// |                  | same current in 32 driven ticks with an edge while the speed changes by   |
// |                  | an eighth; more than 3 A for 50 ms through an open bridge; current, bus   |
// |                  | voltage and speed of a drive contradict each other (balance.h)            |
// | over_temperature | bridge above the limit for 100 ms                                         |
// | adc_cadence      | the ring holds more or fewer samples than were scheduled for the tick     |
// | overrun          | a tick began more than two ticks late                                     |
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

// Drive in the tick just measured.
typedef struct {
    int16_t compare;  // applied, or H_BRIDGE_COAST
    bool new_edge;
    bool goes_on;  // a drive is going on, also while its controller opens the bridge
} FaultsDrive;

typedef struct {
    uint8_t active;  // conditions present, TELEMETRY_FAULTS_*
    uint8_t latched;
    uint8_t under_voltage_ms;
    uint8_t over_temperature_ms;
    uint8_t sensor_lost_ms;
    uint16_t no_edge_ms;       // driven without an edge; ticks with an open bridge or a low duty
                               // do not count and do not reset it
    uint8_t settled_ms;        // since the bridge was last open, up to FAULTS_SETTLED_MS
    int16_t frozen_a_q9;       // current that is compared with the next tick's
    int16_t frozen_rpm_q1;     // speed when the current last changed
    uint8_t frozen_ticks;      // driven ticks with an edge since the current last changed
    uint8_t open_current_ms;   // with a current through an open bridge
    bool current_implausible;  // offset at rest out of range
    bool contradiction;        // current, bus voltage and speed do not fit each other (balance.h)
    bool overrun;
} Faults;

void faults_step(Faults *self, const Measurement *m, const FaultLimits *limits,
                 const FaultsDrive *drive);

// Current is not evaluated in the first ticks after an open bridge: the bridge is armed for one
// tick, then the current rises with L / R = 0.5 ms (docs/spec/model.md, section 4).
#define FAULTS_SETTLED_MS 4u

// Whether the current is that of a driven shaft at rest.
bool faults_draws_like_standing(const Measurement *m, int16_t compare);

// Clears the faults whose condition has ended.
void faults_clear(Faults *self);

#endif
