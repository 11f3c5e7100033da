// H-bridge, sign-magnitude PWM with synchronous rectification: converts a signed compare value into
// an order to the timer, which an interrupt of the tick timer applies.
//
// Leg A switches, leg B is static. With the signed compare value c, the motor voltage v and the bus
// voltage Vs: forward, leg B low, v = c / 255 Vs; reverse, leg B high and leg A at c_A = 255 - |c|,
// v = (c_A / 255 - 1) Vs. c = 0 brakes.
//
//            c                  c, same leg B
//   OPEN --------> ARMED ---------------------> DRIVING --+
//    ^  leg B set,   |    OCR written, enabled    |   ^----+ c, same leg B
//    +---------------+----------------------------+
//       coast, the other leg B, or a trip
//
// The order is applied at the tick or 256 cycles later, whichever writes both compare registers at
// least HAL_APPLY_MARGIN_CYCLES before the TOP that latches them. The PWM period in which a command
// takes effect is thus independent of interrupt latency.
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
    uint8_t phase;  // HBridgePhase after the order
    bool leg_b_high;
    int16_t compare;     // signed compare value of the two below
    uint8_t high_below;  // compare values of leg A
    uint8_t low_above;
} HBridgeOrder;

typedef struct {
    HBridgeOrder staged;     // written by the tick, read by the interrupts
    volatile bool tripped;   // set by the ADC interrupt: open until the tick clears it
    uint16_t cycles_to_top;  // from the next tick to the next TOP
    int16_t staged_compare;  // applied from the next tick on
    int16_t next_compare;    // applied in the tick that has begun
    int16_t row_compare;     // applied in the tick just measured, a row of the log
    uint8_t dead_counts;
} HBridge;

// The bridge is open after a reset until an order is applied.
void h_bridge_init(HBridge *self, uint8_t dead_counts);

// Signed compare value of a duty, rounded to nearest.
int16_t h_bridge_compare(int16_t duty_q15);

// Compare values of leg A for c in 0..255, `dead_counts` apart unless leg A does not switch.
void h_bridge_leg_a(HBridgeOrder *order, uint8_t compare, uint8_t dead_counts);

// Call h_bridge_next_row() at the beginning of a tick: moves staged_compare to next_compare and
// that to row_compare (a row of the log is one tick). Call h_bridge_stage() at the end of a tick:
// orders `compare` (-255..255 or H_BRIDGE_COAST) for the next tick.
void h_bridge_next_row(HBridge *self);
void h_bridge_stage(HBridge *self, int16_t compare);

// Records in the rows that the interrupt has opened the bridge. The trip is cleared with its fault.
void h_bridge_note_trip(HBridge *self);
void h_bridge_clear_trip(HBridge *self);

// Interrupts.
void h_bridge_on_apply(const HBridge *self);
void h_bridge_on_trip(HBridge *self);

#endif
