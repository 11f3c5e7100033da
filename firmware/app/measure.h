// Measurements of a tick from the drivers, in units.
#ifndef VGROOVE_APP_MEASURE_H
#define VGROOVE_APP_MEASURE_H

#include <stdbool.h>
#include <stdint.h>

#include "drivers/adc_sequence.h"
#include "drivers/current_sense.h"
#include "drivers/hall_speed.h"
#include "drivers/trigger.h"

typedef struct {
    int16_t current_a_q9;
    int16_t speed_rpm_q1;
    uint16_t supply_mv;
    uint16_t supply_25mv;  // in the unit of the FAST frame
    int16_t temperature_c_q4;
    uint8_t flags;  // TELEMETRY_FLAGS_* of this tick
    AdcTick adc;    // of this tick
    bool trigger_lost;
    bool temperature_lost;
    bool standstill;  // by the Hall sensor alone, then by standstill.h
} Measurement;

// The slow channels keep their last value; all else is of this tick.
void measure_analog(Measurement *self, AdcSequence *adc, const CurrentSense *current,
                    Trigger *trigger, int16_t bus_gain_mv_q8);
void measure_speed(Measurement *self, HallSpeed *hall);

#endif
