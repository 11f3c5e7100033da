// Telemetry and parameters of the firmware as a shared library for tests in Python: plain
// functions, and an EEPROM that fails on request.
#include <stddef.h>
#include <string.h>

#include "app/param_command.h"
#include "app/param_store.h"
#include "core/crc.h"
#include "telemetry/command.h"
#include "telemetry/telemetry.h"

#define EEPROM_BYTES 1024u

typedef struct {
    Telemetry telemetry;
    CommandParser parser;
    ParamStore store;
} ShimBoard;

void shim_eeprom_set(const uint8_t *bytes);
void shim_eeprom_get(uint8_t *bytes);
void shim_eeprom_busy(uint8_t steps);
void shim_eeprom_fail_at(uint32_t write, uint8_t garbage);
uint32_t shim_eeprom_writes(void);
size_t shim_board_bytes(void);
void shim_board_init(ShimBoard *board, const TelemetryBoot *boot, uint8_t baud);
uint8_t shim_board_tick(ShimBoard *board, const TelemetryInputs *wanted, const TelemetryFast *fast,
                        uint8_t *out);
uint8_t shim_board_receive(ShimBoard *board, uint8_t byte, bool idle, uint8_t *result);
ParamStore *shim_board_store(ShimBoard *board);
CommandParser *shim_board_parser(ShimBoard *board);
uint8_t shim_crc8(const uint8_t *data, uint16_t count);
uint16_t shim_crc16(const uint8_t *data, uint16_t count);

static uint8_t eeprom[EEPROM_BYTES];
static uint32_t writes;
static uint32_t fail_at;
static uint8_t fail_with;
static uint8_t busy_steps;
static uint8_t busy;

bool hal_eeprom_ready(void) {
    if (busy > 0u) {
        busy--;
        return false;
    }
    return true;
}

uint8_t hal_eeprom_read(uint16_t address) {
    return eeprom[address];
}

// Write number `fail_at` (counted from 1) leaves a random byte; later ones do nothing, since the
// power has failed.
void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    writes++;
    busy = busy_steps;
    if (fail_at == 0u || writes < fail_at) {
        eeprom[address] = value;
    } else if (writes == fail_at) {
        eeprom[address] = fail_with;
    }
}

void shim_eeprom_set(const uint8_t *bytes) {
    memcpy(eeprom, bytes, sizeof eeprom);
    writes = 0;
    fail_at = 0;
    busy = 0;
}

void shim_eeprom_get(uint8_t *bytes) {
    memcpy(bytes, eeprom, sizeof eeprom);
}

void shim_eeprom_busy(uint8_t steps) {
    busy_steps = steps;
}

void shim_eeprom_fail_at(uint32_t write, uint8_t garbage) {
    writes = 0;
    fail_at = write;
    fail_with = garbage;
}

uint32_t shim_eeprom_writes(void) {
    return writes;
}

size_t shim_board_bytes(void) {
    return sizeof(ShimBoard);
}

void shim_board_init(ShimBoard *board, const TelemetryBoot *boot, uint8_t baud) {
    memset(board, 0, sizeof *board);
    param_load(&board->store);
    telemetry_init(&board->telemetry, boot, baud);
}

uint8_t shim_board_tick(ShimBoard *board, const TelemetryInputs *wanted, const TelemetryFast *fast,
                        uint8_t *out) {
    TelemetryInputs in = *wanted;
    in.params = param_report(&board->store);
    param_step(&board->store);
    return telemetry_tick(&board->telemetry, &in, fast, out);
}

// Takes a byte. 0: no complete frame, 1: a command was executed, 2: a command was acknowledged
// only, 3: the byte was not taken, since an ACK is pending.
uint8_t shim_board_receive(ShimBoard *board, uint8_t byte, bool idle, uint8_t *result) {
    Command command;
    if (telemetry_ack_pending(&board->telemetry)) {
        return 3;
    }
    if (!command_next(&board->parser, byte, &command)) {
        return 0;
    }
    if (command.fresh) {
        command.result = param_command(&board->store, &board->telemetry, &command, idle);
    }
    command_answered(&board->parser, &command, &board->telemetry);
    *result = command.result;
    return command.fresh ? 1u : 2u;
}

ParamStore *shim_board_store(ShimBoard *board) {
    return &board->store;
}

CommandParser *shim_board_parser(ShimBoard *board) {
    return &board->parser;
}

uint8_t shim_crc8(const uint8_t *data, uint16_t count) {
    uint8_t crc = CRC8_INIT;
    for (uint16_t k = 0; k < count; k++) {
        crc = crc8_next(crc, data[k]);
    }
    return (uint8_t)(crc ^ CRC8_FINAL_XOR);
}

uint16_t shim_crc16(const uint8_t *data, uint16_t count) {
    uint16_t crc = CRC16_INIT;
    for (uint16_t k = 0; k < count; k++) {
        crc = crc16_next(crc, data[k]);
    }
    return crc;
}
