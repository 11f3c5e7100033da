// Sign-magnitude bridge with synchronous rectification: a signed compare value becomes an order to
// the timer, applied by an interrupt of the tick timer.
//
// Leg A switches, leg B is held: low in forward, v = c / 255 Vs; high in reverse, leg A at 255 -
// |c|, v = (c_A / 255 - 1) Vs. c = 0 brakes.
//
//            c                  c, same leg B
//   OPEN --------> ARMED ---------------------> DRIVING --+
//    ^  leg B set,   |    OCR written, enabled    |   ^----+ c, same leg B
//    +---------------+----------------------------+
//       coast, the other leg B, or a trip
//
// The order is applied with the tick or 256 cycles after it, chosen so that both compare registers
// are written at least HAL_APPLY_MARGIN_CYCLES before the TOP that latches them: which period a
// command starts in does not depend on interrupt latency.
#ifndef VGROOVE_DRIVERS_H_BRIDGE_H
#define VGROOVE_DRIVERS_H_BRIDGE_H

#include <stdbool.h>
#include <stdint.h>

#define H_BRIDGE_COAST (-512)

typedef enum {
    H_BRIDGE_OPEN,
    H_BRIDGE_ARMED,
    H_BRIDGE_DRIVING,
} HBridgePhase;

typedef struct {
    uint8_t phase;  // HBridgePhase that it brings about
    bool leg_b_high;
    int16_t compare;     // what leg A's two compare values stand for
    uint8_t high_below;  // compare values of leg A
    uint8_t low_above;
} HBridgeOrder;

typedef struct {
    HBridgeOrder staged;     // written by the tick, read by the interrupts
    volatile bool tripped;   // set by the ADC interrupt: stays open until the tick has seen why
    uint16_t cycles_to_top;  // from the next tick to the next TOP
    int16_t staged_compare;  // in force from the next tick on
    int16_t next_compare;    // in force in the row that has begun
    int16_t row_compare;     // in force in the row that the tick closes
    uint8_t dead_counts;
} HBridge;

// The bridge is open after a reset and stays so until an order is applied.
void h_bridge_init(HBridge *self, uint8_t dead_counts);

// Signed compare value of a duty, rounded to nearest.
int16_t h_bridge_compare(int16_t duty_q15);

// Compare values of leg A for c in 0..255, `dead_counts` apart unless it does not switch at all.
void h_bridge_leg_a(HBridgeOrder *order, uint8_t compare, uint8_t dead_counts);

// Begin of a tick: moves the rows on. End of a tick: orders `compare` (-255..255 or H_BRIDGE_COAST)
// for the next one.
void h_bridge_next_row(HBridge *self);
void h_bridge_stage(HBridge *self, int16_t compare);

// The tick has seen the over-current: what the interrupt did becomes what the rows report. Clearing
// is allowed once the fault is cleared.
void h_bridge_note_trip(HBridge *self);
void h_bridge_clear_trip(HBridge *self);

// Interrupts.
void h_bridge_on_apply(const HBridge *self);
void h_bridge_on_trip(HBridge *self);

#endif
