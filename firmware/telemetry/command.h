// Parser of inbound frames: finds frames in the byte stream, checks the CRC, and recognises a
// repeated command.
//
// A command is acknowledged before the next one is parsed, so that each gets its ACK. Expensive
// work is done in separate steps, in ticks that read no bytes:
//     if (!telemetry_ack_pending(&telemetry)) {
//         if (command_reading(&parser)) {
//             while (command_reading(&parser) && uart_receive(&uart, &byte))
//                 command_byte(&parser, byte);
//         } else if (command_step(&parser, &command)) {
//             if (command.fresh) command.result = execute(&command);
//             command_answered(&parser, &command, &telemetry);
//         }
//     }
#ifndef VGROOVE_TELEMETRY_COMMAND_H
#define VGROOVE_TELEMETRY_COMMAND_H

#include <stdbool.h>
#include <stdint.h>

#include "telemetry/telemetry.h"

#define COMMAND_SEQUENCE_AT 6u  // data byte of every inbound frame

typedef struct {
    uint16_t id;
    const uint8_t *data;  // in the parser's buffer, valid until its next step
    uint8_t sequence;
    uint8_t result;  // TELEMETRY_ACK_RESULT_*
    bool fresh;      // to be executed: intact and not a repetition
} Command;

typedef enum {
    COMMAND_READING,   // expects the next byte
    COMMAND_COMPLETE,  // all bytes of a frame received
    COMMAND_CHECKED,   // CRC computed
    COMMAND_RESYNC,    // the bytes are no frame: searches the beginning of one among them
} CommandPhase;

typedef struct {
    uint8_t buffer[TELEMETRY_FRAME_BYTES];
    uint8_t count;
    uint8_t phase;   // CommandPhase
    bool intact;     // in CHECKED: the CRC is right
    uint8_t errors;  // bytes outside frames and frames with a bad CRC; saturates
    uint8_t last_result;
    uint8_t last_sequence;
    uint8_t last_crc;
    uint16_t last_id;  // 0: none
} CommandParser;

// Whether a byte is expected, which command_byte() takes.
bool command_reading(const CommandParser *self);
void command_byte(CommandParser *self, uint8_t byte);

// A step while no byte is expected: true when it returns a command in `out`, false when it has
// checked the CRC or searched for the beginning of a frame.
bool command_step(CommandParser *self, Command *out);

// Takes one received byte with all following steps; true when it completes a frame, returned in
// `out`.
bool command_next(CommandParser *self, uint8_t byte, Command *out);

// Sends the ACK with `command->result`.
void command_answered(CommandParser *self, const Command *command, Telemetry *telemetry);

#endif
