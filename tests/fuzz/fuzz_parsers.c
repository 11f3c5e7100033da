// Fuzz target of the parsers of received bytes: commands (telemetry/command.c) and real-time runs
// (hal/inject). Every byte of the command parser ends in a frame, a counted error, or the rest that
// may become a frame. Built with libFuzzer, or with the driver in fuzz_driver.c.
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "hal/hal.h"
#include "hal/inject/inject.h"
#include "telemetry/command.h"

#define FRAME 19u
#define COUNTED_MAX 200u  // bytes: the counter of errors saturates at 255
#define TICK_BYTES 40u

// The part of hal.h that inject.c leaves to the hardware.
static uint8_t eeprom[1024];
void hal_uart_start(uint8_t baud) {
    (void)baud;
}
void hal_uart_wake(void) {}
uint8_t hal_reset_cause(void) {
    return 1;
}
uint8_t hal_target(void) {
    return 0;
}
bool hal_eeprom_ready(void) {
    return true;
}
uint8_t hal_eeprom_read(uint16_t address) {
    return eeprom[address % sizeof eeprom];
}
void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    eeprom[address % sizeof eeprom] = value;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void commands(const uint8_t *data, size_t size) {
    static const CommandParser fresh;
    CommandParser parser = fresh;
    size_t frames = 0;
    for (size_t k = 0; k < size && k < COUNTED_MAX; k++) {
        Command command = {0};
        command_byte(&parser, data[k]);
        while (!command_reading(&parser)) {
            if (command_step(&parser, &command) && command.result != TELEMETRY_ACK_RESULT_BAD_CRC) {
                frames++;
            }
        }
    }
    const size_t used = size < COUNTED_MAX ? size : COUNTED_MAX;
    if (frames * FRAME + parser.errors + parser.count != used) {
        abort();
    }
}

// Bytes of a host with timer ticks in between; the first byte selects how many.
static void real_time(const uint8_t *data, size_t size) {
    static App app;
    inject_init(&app, 0);
    for (size_t k = 1; k < size; k++) {
        (void)ring_push_byte(&inject.received, data[k]);
        if (k % (1u + data[0] % TICK_BYTES) == 0u) {
            inject_decode();
            inject_timer_tick(&app, 0, data[k]);
            inject.send_tail = inject.send_head;
        }
    }
    if (inject.count >= INJECT_FRAME) {
        abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    commands(data, size);
    if (size > 0u) {
        real_time(data, size);
    }
    return 0;
}
