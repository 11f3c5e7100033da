// Hardware layer for the replay of a log: a tick gets the measured values of a row of the log. It
// takes the place of a hardware layer and of app/measure.c; everything else is the firmware.
//
// The state of the firmware is a block of measured_bytes() bytes: a copy of the block is a copy of
// the firmware, so that a replay can follow several hypotheses on inputs that the log does not
// hold.
#ifndef VGROOVE_HAL_MEASURED_H
#define VGROOVE_HAL_MEASURED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MEASURED_EEPROM_BYTES 1024u
#define MEASURED_DEBOUNCE_TICKS 5  // TRIGGER_DEBOUNCE_TICKS
#define MEASURED_COAST (-512)      // compare value of an open bridge

// Inputs of one tick.
typedef struct {
    int16_t current_a_q9;
    int16_t speed_rpm_q1;
    uint16_t supply_mv;
    uint16_t trigger_counts;  // used in the ticks in which the ADC schedule has a trigger sample
    uint8_t switches;         // debounced, HAL_SWITCH_*
    uint8_t edges;            // Hall edges in the tick
} MeasuredInputs;

// Result of one tick.
typedef struct {
    int16_t compare;  // applied in the tick, -255..255 or MEASURED_COAST
    uint8_t state;    // code of the signal `state` in a STATE frame
} MeasuredOutputs;

size_t measured_bytes(void);

// Writes the state after a start with this EEPROM (MEASURED_EEPROM_BYTES).
void measured_start(void *block, const uint8_t *eeprom);

void measured_tick(void *block, const MeasuredInputs *inputs, MeasuredOutputs *outputs);

// Whether the next tick takes a sample of the trigger.
bool measured_takes_trigger(const void *block);

// Travel of a trigger that has been pulled before, for a number of ADC counts.
uint16_t measured_travel_q15(const void *block, uint16_t counts);

// Hash of everything that acts on later duties. `sample_ticks`: ticks to the sample that replaces
// the travel, 0 where it remains. A travel that the ramp of the duty does not reach before is left
// out.
uint64_t measured_key(const void *block, uint8_t sample_ticks);

#ifdef __cplusplus
}
#endif

#endif
