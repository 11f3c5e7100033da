// Inbound frames out of a stream of bytes: resynchronises after garbage, checks the CRC, recognises
// a command that is sent again.
//
// A command is answered before the next is parsed, so that every command gets its ACK. What costs
// time comes in steps of its own, for ticks that read nothing:
//     if (!telemetry_ack_waits(&telemetry)) {
//         if (command_wants(&parser)) {
//             while (command_wants(&parser) && uart_read(&byte)) command_byte(&parser, byte);
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
    const uint8_t *data;  // in the parser's buffer, until its next step
    uint8_t sequence;
    uint8_t result;  // TELEMETRY_ACK_RESULT_*
    bool fresh;      // to be executed: intact and not the last one sent again
} Command;

enum {
    COMMAND_WANTS,    // the next byte
    COMMAND_WHOLE,    // a frame is complete in form
    COMMAND_CHECKED,  // its CRC has been looked at
    COMMAND_ASTRAY,   // what was received is no frame: one may have begun inside
};

typedef struct {
    uint8_t buffer[TELEMETRY_FRAME_BYTES];
    uint8_t count;
    uint8_t phase;   // COMMAND_*
    bool intact;     // CHECKED: the CRC is right
    uint8_t errors;  // bytes outside frames and frames with a bad CRC; saturates
    uint8_t last_result;
    uint8_t last_sequence;
    uint8_t last_crc;
    uint16_t last_id;  // 0: none yet
} CommandParser;

bool command_wants(const CommandParser *self);
void command_byte(CommandParser *self, uint8_t byte);  // only when wanted

// When no byte is wanted: true when it hands out a command, false when it has checked one or looked
// for the begin of a frame in what there is.
bool command_step(CommandParser *self, Command *out);

// Takes one received byte, with all steps; true when it completes a frame, which is then in `out`.
bool command_next(CommandParser *self, uint8_t byte, Command *out);

// Queues the ACK with `command->result`.
void command_answered(CommandParser *self, const Command *command, Telemetry *telemetry);

#endif
