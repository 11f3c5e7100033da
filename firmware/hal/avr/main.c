// Main loop: sleeps until the tick, runs it, and resets the watchdog when no tick is pending.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "build_hash.h"
#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

AvrMemory avr_memory __attribute__((aligned(AVR_PAGE)));
volatile uint8_t avr_ticks_waiting;

// A switch pulls its pin to ground.
uint8_t hal_switches(void) {
    uint8_t switches = 0;
    if ((BOARD_CONTACT_PIN & (1u << BOARD_CONTACT_BIT)) == 0u) {
        switches |= HAL_SWITCH_CONTACT;
    }
    if ((BOARD_REVERSE_PIN & (1u << BOARD_REVERSE_BIT)) == 0u) {
        switches |= HAL_SWITCH_REVERSE;
    }
    if ((BOARD_MODE_PIN & (1u << BOARD_MODE_0_BIT)) == 0u) {
        switches |= 1u << HAL_SWITCH_MODE_SHIFT;
    }
    if ((BOARD_MODE_PIN & (1u << BOARD_MODE_1_BIT)) == 0u) {
        switches |= 2u << HAL_SWITCH_MODE_SHIFT;
    }
    return switches;
}

uint16_t hal_tick_cycles(uint16_t tick_stamp) {
    const uint8_t lock = hal_lock();
    const uint16_t now = BOARD_TCNT;
    hal_unlock(lock);
    return (uint16_t)(now - tick_stamp);
}

// Sleeps until a tick is due; returns how many more are pending.
static uint8_t wait_for_tick(void) {
    cli();
    while (avr_ticks_waiting == 0u) {
        sei();
        sleep_cpu();
        cli();
    }
    const uint8_t late = (uint8_t)(avr_ticks_waiting - 1u);
    avr_ticks_waiting = late;
    sei();
    return late;
}

int main(void) {
    avr_start_pins();
    app_init(&avr_app, VGROOVE_BUILD_HASH);
    SMCR = 1u << SE;  // idle mode: the timers run
    avr_start_timers();
    wdt_enable(WDTO_15MS);
    for (;;) {
        const uint8_t late = wait_for_tick();
        AVR_MARKS = AVR_MARK_TICK;
        app_tick(&avr_app, late);
        AVR_MARKS = 0;
        avr_look_at_stack();
        if (avr_ticks_waiting == 0u) {
            wdt_reset();
        }
    }
}
