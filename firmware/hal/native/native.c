// Fake hardware, see native.h.
#include "hal/native/native.h"

#include <string.h>

#include "hal/hal.h"

Native native;

void native_reset(void) {
    memset(&native, 0, sizeof native);
    memset(native.eeprom, UINT8_MAX, sizeof native.eeprom);
}

void hal_bridge_cut(void) {
    native.opened++;
    native.armed = false;
    native.enabled = false;
}

void hal_bridge_open(void) {
    hal_bridge_cut();
    native.high_below = 0;
    native.low_above = HAL_COMPARE_MAX;
}

void hal_bridge_arm(bool leg_b_high) {
    native.armed = true;
    native.leg_b_high = leg_b_high;
}

void hal_bridge_set(uint8_t high_below, uint8_t low_above) {
    native.high_below = high_below;
    native.low_above = low_above;
    native.enabled = native.armed;
}

void hal_apply_at(bool later) {
    native.apply_later = later;
}

uint8_t hal_switches(void) {
    return native.switches;
}

void hal_uart_start(uint8_t baud) {
    native.baud = baud;
}

void hal_uart_receive(bool on) {
    native.receive_off = !on;
}

void hal_uart_wake(void) {
    native.woken++;
}

bool hal_eeprom_ready(void) {
    return !native.eeprom_busy;
}

uint8_t hal_eeprom_read(uint16_t address) {
    return native.eeprom[address % NATIVE_EEPROM_BYTES];
}

void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    native.eeprom[address % NATIVE_EEPROM_BYTES] = value;
    native.eeprom_writes++;
}

uint16_t hal_tick_cycles(uint16_t tick_stamp) {
    (void)tick_stamp;
    return native.tick_cycles;
}

uint16_t hal_stack_free(void) {
    return native.stack_free;
}

uint8_t hal_reset_cause(void) {
    return native.reset_cause;
}

void hal_mark_control(bool runs) {
    (void)runs;
}

uint8_t hal_target(void) {
    return 0;
}

uint8_t hal_lock(void) {
    native.locks++;
    return 0;
}

void hal_unlock(uint8_t before) {
    (void)before;
    native.locks--;
}
