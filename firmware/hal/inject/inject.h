// Exchange of sensor counts and bridge commands with a host that simulates the tool in real time
// (docs/hil.md). Takes the place of the analogue inputs, the Hall capture, the switches and the
// gates; drivers and application above hal.h are those of every other build.
//
// For each tick m of 1 ms the host sends the ADC samples and Hall edges of that tick (SENSE
// frames). When they have arrived intact, the board executes tick m at its next timer interrupt,
// and answers with the bridge command, which acts from tick m + 1 on (DRIVE frame). A tick whose
// inputs are missing is postponed: the firmware's time stands still, so a late host changes when a
// tick runs, not what it computes. After INJECT_SAFE_TICKS timer interrupts without inputs the
// bridge is opened, and the tick that follows sets the fault overrun. Frames have the form of the
// telemetry's, with the number of the tick in place of the time.
#ifndef VGROOVE_HAL_INJECT_H
#define VGROOVE_HAL_INJECT_H

#include <stdbool.h>
#include <stdint.h>

#include "app/app.h"
#include "core/ring.h"

#ifdef __cplusplus
extern "C" {
#endif

#define INJECT_BAUD 1000000u
#define INJECT_SAFE_TICKS 5u     // timer ticks without inputs until the bridge is opened
#define INJECT_HELLO_TICKS 100u  // between two DRIVE frames while no inputs arrive

#define INJECT_FRAME 19u
#define INJECT_SAMPLES 8u  // most of a tick
#define INJECT_EDGES 3u
#define INJECT_SEND_BYTES 128u  // an answer and the telemetry of two ticks

// Identifiers of the frames, layouts in firmware/hal/inject/hil.dbc.
enum {
    INJECT_ID_SENSE_A = 128,      // samples 0 to 3, their number, switches
    INJECT_ID_SENSE_B = 129,      // samples 4 to 7, number of edges
    INJECT_ID_SENSE_EDGES = 130,  // their times, sent only where there are edges
    INJECT_ID_DRIVE = 131,
    INJECT_ID_COMMANDS = 512,  // from this one on, frames are the application's
};

// Bits of the first byte of DRIVE.
enum {
    INJECT_COAST = 1,
    INJECT_LATER = 2,  // the command acts 256 cycles after the tick (hal_apply_at)
    INJECT_SAFE = 4,   // opened because inputs were missing
    INJECT_IDLE = 8,   // no run has begun since the reset
};

// Inputs of one tick. `parts`: bit 0 SENSE_A, bit 1 SENSE_B, bit 2 SENSE_EDGES have arrived.
typedef struct {
    uint32_t tick;
    uint8_t parts;
    uint8_t sample_count;
    uint8_t switches;
    uint8_t edge_count;
    uint8_t packed[10];                 // 8 samples of 10 bits, little endian
    uint16_t edge_cycle[INJECT_EDGES];  // from the tick before, 1..16,000
} InjectInputs;

typedef struct {
    RingBytes received;
    uint8_t frame[INJECT_FRAME];  // being assembled
    uint8_t count;
    volatile uint8_t errors;  // damaged frames and lost bytes; saturates
    InjectInputs inputs[2];   // of the next two ticks, by parity
    uint32_t done;            // ticks executed since the run began
    bool runs;
    bool restarts;  // inputs of tick 0 have arrived
    bool repeats;   // inputs of an executed tick have arrived: its answer was lost
    uint32_t repeat_tick;
    uint8_t missing;      // timer ticks without inputs since the last executed one; saturates
    uint8_t clock_ticks;  // timer ticks, modulo 256
    uint8_t hello;        // timer ticks since the last DRIVE
    uint8_t command[INJECT_FRAME];  // for the application, from tick `command_tick` on
    uint32_t command_tick;
    bool command_waits;
    uint32_t latest;                 // greatest tick whose inputs are complete
    uint8_t drive[2][INJECT_FRAME];  // answers of the last two ticks, by parity
    volatile uint8_t send[INJECT_SEND_BYTES];
    volatile uint8_t send_head;  // pushes so far, modulo 256
    volatile uint8_t send_tail;  // pops so far
    bool armed, enabled, leg_b_high, apply_later;
    uint8_t high_below, low_above;
    uint8_t switches;  // of the tick being executed
} Inject;

extern Inject inject;

void inject_init(App *app, uint32_t build_hash);

// Main loop: takes the received bytes apart, as far as they have arrived.
void inject_decode(void);

// Whether the send queue has room for the answer and the telemetry of a tick: only then may the
// next one begin.
bool inject_has_room(void);

// Main loop, once per timer tick: executes the tick whose inputs are complete, or counts a missing
// one. `clock_count`: time since the timer tick in steps of 4 us, for the host's clock estimate.
void inject_timer_tick(App *app, uint32_t build_hash, uint8_t clock_count);

// The interrupts push to `received` and pop from `send` themselves (avr_main.c).

#ifdef __cplusplus
}
#endif

#endif
