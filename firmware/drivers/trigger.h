// Trigger travel, its contact and the switches: dead bands and debouncing. The ramp of the duty is
// in core/slew.h.
#ifndef VGROOVE_DRIVERS_TRIGGER_H
#define VGROOVE_DRIVERS_TRIGGER_H

#include <stdbool.h>
#include <stdint.h>

#define TRIGGER_DEBOUNCE_TICKS 5u
// Counts beyond the lower dead band at which a travel begins; it ends in the dead band. Noise of
// the converter is one count, so that a trigger held at the edge does not open and close the
// bridge.
#define TRIGGER_HYSTERESIS_COUNT 4u

typedef struct {
    uint16_t low_count;   // end of the lower dead band
    uint16_t high_count;  // start of the upper one
    uint32_t factor_q7;   // 2^22 / (high - low): travel per count in Q22
    int16_t travel_q15;   // 0 until the travel has begun
    uint8_t stable;       // debounced, HAL_SWITCH_*
    uint8_t ticks[3];     // bit planes of the time for which each switch has differed from `stable`
} Trigger;

// Starts with the contact closed: a tool that is switched on with the trigger pressed must not
// start.
void trigger_init(Trigger *self);
void trigger_set_ends(Trigger *self, uint16_t low_count, uint16_t high_count);
void trigger_set_travel(Trigger *self, uint16_t counts);
void trigger_set_switches(Trigger *self, uint8_t raw);

bool trigger_contact(const Trigger *self);
bool trigger_reverse(const Trigger *self);
uint8_t trigger_mode(const Trigger *self);

// Pressed: contact closed and travel beyond the lower dead band.
bool trigger_pressed(const Trigger *self);

// Contact open at more than half of the travel: the contact closes at its beginning, so that the
// potentiometer is broken on its ground side, or the contact does not close.
bool trigger_implausible(const Trigger *self);

#endif
