// What the tool reports, when: frames in python-can's serial format, chosen from a byte budget that
// the line can carry.
//
// A frame is 0xAA, time (uint32 LE, ms), 8, id (uint32 LE), data[0..6], CRC-8 over id, time and
// data[0..6], 0xBB. FAST goes out every `fast_divider` ticks and never waits; slow frames take what
// is left, at most one a tick: BOOT, then STATE, CONTROL and the others (ACK, HEALTH, PARAM and
// PARAM_TABLE) in turn. The budget grows by baud/10,000 bytes a tick whether or not the UART has
// drained, so what is sent is a function of the inputs alone; TELEMETRY_QUEUE_BYTES bounds what the
// UART's ring must hold.
#ifndef VGROOVE_TELEMETRY_H
#define VGROOVE_TELEMETRY_H

#include <stdbool.h>
#include <stdint.h>

#include "telemetry/telemetry_signals.h"

#define TELEMETRY_FRAME_BYTES 19u
#define TELEMETRY_TICK_BYTES_MAX (2u * TELEMETRY_FRAME_BYTES)
#define TELEMETRY_QUEUE_BYTES (3u * TELEMETRY_FRAME_BYTES)

enum {
    TELEMETRY_BAUD_250000,
    TELEMETRY_BAUD_115200,
};

// Parameters as a dump sends them; the values stay with their owner.
typedef struct {
    const int16_t *value;
    uint8_t count;
    TelemetryParamTable table;  // table_count and table_crc16 are filled in here
} TelemetryParams;

// All that one tick reports, but for FAST. Counters, state_tick, control_tick and the CRC of the
// parameters are filled in by the module.
typedef struct {
    uint32_t now_ms;
    TelemetryState state;
    TelemetryControl control;
    TelemetryHealth health;
    TelemetryParams params;
    bool hold_slow;   // the tick has other work: no slow frame now
    bool hold_state;  // nor is there a new state
} TelemetryInputs;

typedef struct {
    TelemetryBoot boot;
    TelemetryState state;  // last reported or waiting
    TelemetryControl control;
    TelemetryAck ack;
    int32_t current_sum;  // over the ticks since the last FAST frame
    uint16_t supply_sum;
    uint16_t budget;           // 1/100 byte
    uint16_t budget_per_tick;  // 1/100 byte
    uint16_t ms_in_second;
    uint16_t dump_crc16;  // of the parameters dumped so far, but for the last while dumped_waits
    int16_t dumped_value;
    uint16_t slow_id;
    uint8_t slow[TELEMETRY_DATA_BYTES];  // data of a slow frame that the next tick completes
    uint8_t slow_crc_seed;
    bool slow_packed;
    uint8_t ticks_to_fast;
    uint8_t fast_counter;
    uint8_t dump_next;   // next parameter of the dump, count: PARAM_TABLE, TELEMETRY_NONE: nothing
    uint8_t read_index;  // parameter asked for, TELEMETRY_NONE: nothing
    bool dumped_waits;
    bool boot_waits;
    bool ack_waits;
    bool health_waits;
    bool health_went;
    bool state_waits;
    bool control_waits;
    uint8_t turn;  // whose frame goes next: TURN_*
} Telemetry;

#define TELEMETRY_NONE 0xFFu

// `boot` without protocol_version and with the wished fast_divider, which becomes what `baud`
// carries at least.
void telemetry_init(Telemetry *self, const TelemetryBoot *boot, uint8_t baud);

// Frames of this tick, a slow one before the fast one, each into its place; returns how many. A
// slow one takes two ticks: data first, CRC then.
uint8_t telemetry_frames(Telemetry *self, const TelemetryInputs *in, const TelemetryFast *fast,
                         uint8_t *const place[2]);

// The same one after the other into `out`; returns their bytes.
uint8_t telemetry_tick(Telemetry *self, const TelemetryInputs *in, const TelemetryFast *fast,
                       uint8_t out[TELEMETRY_TICK_BYTES_MAX]);

// A slow frame waits, and the line will have caught up for it with the next tick.
bool telemetry_slow_waits(const Telemetry *self);

// Whether the next tick may send HEALTH: only then must its inputs be filled in.
bool telemetry_health_due(const Telemetry *self);

// True in the tick that took the figures of a HEALTH frame: the owner of the figures may restart
// its maxima.
bool telemetry_health_sent(const Telemetry *self);

// BOOT, all parameters, PARAM_TABLE; STATE and HEALTH as they are now between them.
void telemetry_dump(Telemetry *self);

// The PARAM frame of one parameter.
void telemetry_read(Telemetry *self, uint8_t index);

// The answer to a command; the next command must wait until it is sent.
void telemetry_ack(Telemetry *self, const TelemetryAck *ack);
bool telemetry_ack_waits(const Telemetry *self);

#endif
