// Telemetry: selects the frames of a tick within the byte budget of the line and packs them in
// python-can's serial format.
//
// A frame is 0xAA, time (uint32 LE, ms), 8, id (uint32 LE), data[0..6], CRC-8 over id, time and
// data[0..6], 0xBB. FAST is sent every `fast_divider` ticks without delay. Slow frames use the
// remaining bytes, at most one per tick: BOOT first, then STATE, CONTROL and the others (ACK,
// HEALTH, PARAM, PARAM_TABLE) in turn. The budget grows by baud/10,000 bytes per tick whether or
// not the UART has drained, so that the bytes sent depend on the inputs alone. They need at most
// TELEMETRY_QUEUE_BYTES in the UART's queue.
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

// Parameters of a dump; the values belong to the caller.
typedef struct {
    const int16_t *value;
    uint8_t count;
    TelemetryParamTable table;  // telemetry.c sets table_count and table_crc16
} TelemetryParams;

// Contents of all frames of a tick except FAST. telemetry.c sets the counters, state_tick,
// control_tick and the CRC of the parameters.
typedef struct {
    uint32_t now_ms;
    TelemetryState state;
    TelemetryControl control;
    TelemetryHealth health;
    TelemetryParams params;
    bool hold_slow;   // no slow frame in this tick, which has other work
    bool hold_state;  // `state` and `control` are not updated in this tick
} TelemetryInputs;

typedef struct {
    TelemetryBoot boot;
    TelemetryState state;  // last sent or pending
    TelemetryControl control;
    TelemetryAck ack;
    int32_t current_sum;  // over the ticks since the last FAST frame
    uint16_t supply_sum;
    uint16_t budget;           // 1/100 byte
    uint16_t budget_per_tick;  // 1/100 byte
    uint16_t ms_in_second;
    uint16_t dump_crc16;   // without the last parameter while crc_pending
    int16_t dumped_value;  // of the last parameter
    uint16_t slow_id;
    uint8_t slow[TELEMETRY_DATA_BYTES];  // data of a slow frame, completed in the next tick
    uint8_t slow_crc_seed;
    bool slow_packed;
    uint8_t ticks_to_fast;
    uint8_t fast_counter;
    uint8_t dump_next;   // next parameter of the dump; count: PARAM_TABLE, TELEMETRY_NONE: none
    uint8_t read_index;  // requested parameter, TELEMETRY_NONE: none
    bool crc_pending;
    bool boot_pending;
    bool ack_pending;
    bool health_pending;
    bool health_packed;
    bool state_pending;
    bool control_pending;
    uint8_t turn;  // kind of the next slow frame, TURN_*
} Telemetry;

#define TELEMETRY_NONE 0xFFu

// `boot`: without protocol_version; fast_divider is raised to what `baud` can carry.
void telemetry_init(Telemetry *self, const TelemetryBoot *boot, uint8_t baud);

// Frames of this tick, a slow one before the fast one, each in its slot; returns their number. A
// slow frame takes two ticks: data, then CRC and header.
uint8_t telemetry_frames(Telemetry *self, const TelemetryInputs *in, const TelemetryFast *fast,
                         uint8_t *const place[2]);

// The same frames one after the other in `out`; returns their bytes.
uint8_t telemetry_tick(Telemetry *self, const TelemetryInputs *in, const TelemetryFast *fast,
                       uint8_t out[TELEMETRY_TICK_BYTES_MAX]);

// Whether a slow frame has been packed and waits for its CRC and sending.
bool telemetry_sends_slow(const Telemetry *self);

// Whether this tick packs a slow frame, or takes a parameter into the CRC of a dump, unless one is
// sent that has been packed.
bool telemetry_packs(const Telemetry *self);

// Whether the next tick may send HEALTH: its inputs must be set only then.
bool telemetry_health_due(const Telemetry *self);

// Whether this tick has packed HEALTH: the caller may restart the maxima in it.
bool telemetry_health_sent(const Telemetry *self);

// Requests BOOT, all parameters and PARAM_TABLE, with the present STATE and HEALTH between them.
void telemetry_dump(Telemetry *self);

// Requests the PARAM frame of one parameter.
void telemetry_read(Telemetry *self, uint8_t index);

// Acknowledges a command; the next command must wait until the frame is sent.
void telemetry_ack(Telemetry *self, const TelemetryAck *ack);
bool telemetry_ack_pending(const Telemetry *self);

#endif
