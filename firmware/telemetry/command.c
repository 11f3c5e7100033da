// Parser of inbound frames, see command.h.
#include "telemetry/command.h"

#include "core/crc.h"
#include "core/inline.h"

#define FRAME_START 0xAAu
#define FRAME_END 0xBBu
#define TIME_AT 1u
#define LENGTH_AT 5u
#define ID_AT 6u
#define DATA_AT 10u
#define CRC_AT 17u
#define END_AT 18u
#define RESYNC_BYTES_MAX 4u  // bytes dropped in one step of the resynchronisation

// Whether the bytes from `first` on, fewer than a frame, can be the beginning of one.
static bool plausible(const CommandParser *self, uint8_t first) {
    const uint8_t count = (uint8_t)(self->count - first);
    if (count > 0u && self->buffer[first] != FRAME_START) {
        return false;
    }
    return count <= LENGTH_AT || self->buffer[first + LENGTH_AT] == TELEMETRY_DATA_BYTES;
}

// Whether the byte is valid at that position of a frame, after its start.
static bool fits(uint8_t at, uint8_t byte) {
    if (at == LENGTH_AT) {
        return byte == TELEMETRY_DATA_BYTES;
    }
    return at != END_AT || byte == FRAME_END;
}

static void count_errors(CommandParser *self, uint8_t bytes) {
    self->errors = (uint8_t)(self->errors > UINT8_MAX - bytes ? UINT8_MAX : self->errors + bytes);
}

// Drops the first byte and following ones that cannot start a frame; true when the next one can, or
// none is left.
INLINE_NEVER static bool resynchronise(CommandParser *self) {
    uint8_t first = 1;
    while (first < RESYNC_BYTES_MAX && !plausible(self, first)) {
        first++;
    }
    self->count = (uint8_t)(self->count - first);
    for (uint8_t k = 0; k < self->count; k++) {
        self->buffer[k] = self->buffer[k + first];
    }
    count_errors(self, first);
    return plausible(self, 0);
}

static uint8_t crc_of(const uint8_t buffer[TELEMETRY_FRAME_BYTES]) {
    const uint8_t crc = crc8_over(CRC8_INIT, &buffer[ID_AT], DATA_AT - ID_AT);
    return (uint8_t)(crc8_over_frame(crc, &buffer[TIME_AT], &buffer[DATA_AT]) ^ CRC8_FINAL_XOR);
}

static void take_frame(const CommandParser *self, Command *out) {
    const uint8_t *id = &self->buffer[ID_AT];
    out->id = (uint16_t)((uint16_t)id[0] | (uint16_t)((uint16_t)id[1] << 8));
    out->data = &self->buffer[DATA_AT];
    out->sequence = self->buffer[DATA_AT + COMMAND_SEQUENCE_AT];
    out->fresh = false;
    if (!self->intact) {
        out->result = TELEMETRY_ACK_RESULT_BAD_CRC;
    } else if (id[2] != 0u || id[3] != 0u) {
        out->result = TELEMETRY_ACK_RESULT_UNKNOWN_ID;
    } else if (out->id == self->last_id && out->sequence == self->last_sequence &&
               self->buffer[CRC_AT] == self->last_crc) {
        out->result = self->last_result;
    } else {
        out->result = TELEMETRY_ACK_RESULT_OK;
        out->fresh = true;
    }
}

bool command_reading(const CommandParser *self) {
    return self->phase == COMMAND_READING;
}

void command_byte(CommandParser *self, uint8_t byte) {
    const uint8_t at = self->count;
    if (at == 0u && byte != FRAME_START) {
        count_errors(self, 1);
        return;
    }
    self->buffer[at] = byte;
    self->count = (uint8_t)(at + 1u);
    if (!fits(at, byte)) {
        self->phase = COMMAND_RESYNC;
    } else if (at == END_AT) {
        self->phase = COMMAND_COMPLETE;
    }
}

bool command_step(CommandParser *self, Command *out) {
    if (self->phase == COMMAND_COMPLETE) {
        self->intact = crc_of(self->buffer) == self->buffer[CRC_AT];
        self->phase = COMMAND_CHECKED;
        return false;
    }
    if (self->phase == COMMAND_RESYNC) {
        self->phase = resynchronise(self) ? COMMAND_READING : COMMAND_RESYNC;
        return false;
    }
    take_frame(self, out);
    if (out->result == TELEMETRY_ACK_RESULT_BAD_CRC) {
        self->phase = COMMAND_RESYNC;  // an intact frame may begin inside
    } else {
        self->phase = COMMAND_READING;
        self->count = 0;
    }
    return true;
}

bool command_next(CommandParser *self, uint8_t byte, Command *out) {
    bool taken = false;
    command_byte(self, byte);
    while (!command_reading(self)) {
        taken = command_step(self, out) || taken;
    }
    return taken;
}

void command_answered(CommandParser *self, const Command *command, Telemetry *telemetry) {
    const TelemetryAck ack = {.ack_command = command->id,
                              .ack_sequence = command->sequence,
                              .ack_result = command->result};
    if (command->fresh) {
        self->last_id = command->id;
        self->last_sequence = command->sequence;
        self->last_crc = self->buffer[CRC_AT];
        self->last_result = command->result;
    }
    telemetry_ack(telemetry, &ack);
}
