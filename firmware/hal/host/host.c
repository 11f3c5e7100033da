// The part of hal.h that has no meaning on a computer: time and stack of a tick, markers of the
// simulated board, and interrupts.
#include "hal/hal.h"

uint16_t hal_tick_cycles(uint16_t tick_stamp) {
    (void)tick_stamp;
    return 0;
}

uint16_t hal_stack_free(void) {
    return 0;
}

void hal_mark_control(bool runs) {
    (void)runs;
}

uint8_t hal_lock(void) {
    return 0;
}

void hal_unlock(uint8_t before) {
    (void)before;
}
