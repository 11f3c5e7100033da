// Main loop: sleeps until the tick, runs it, and resets the watchdog when no tick is pending.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "build_hash.h"
#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

#define PAINT 0xC5u    // fills the unused stack
#define PAINT_STEP 2u  // bytes examined per tick

// Bits of GPIOR0 that the bench observes.
#define MARK_TICK 1u
#define MARK_CONTROL 2u

extern uint8_t _end;  // of static data: lower limit of the stack

App avr_app;
volatile uint8_t avr_ticks_waiting;

void avr_paint_stack(void) __attribute__((naked, used, section(".init3")));

void avr_paint_stack(void) {
    __asm__ volatile("ldi r30, lo8(_end)\n\t"
                     "ldi r31, hi8(_end)\n\t"
                     "ldi r24, %[paint]\n\t"
                     "ldi r25, hi8(%[top])\n\t"
                     "1: st Z+, r24\n\t"
                     "cpi r30, lo8(%[top])\n\t"
                     "cpc r31, r25\n\t"
                     "brne 1b\n\t"
                     :
                     : [paint] "M"(PAINT), [top] "i"(RAMEND + 1));
}

static uint16_t stack_free_bytes;

// Searches the lowest byte that the stack has used, a few bytes after each tick.
static void look_at_stack(void) {
    static uint8_t *at = &_end;
    for (uint8_t k = 0; k < PAINT_STEP; k++, at++) {
        if (*at != PAINT) {
            stack_free_bytes = (uint16_t)(at - &_end);
            at = &_end;
            break;
        }
    }
}

uint16_t hal_stack_free(void) {
    return stack_free_bytes;
}

uint8_t hal_lock(void) {
    const uint8_t before = SREG;
    cli();
    return before;
}

void hal_unlock(uint8_t before) {
    SREG = before;
}

uint16_t hal_tick_cycles(uint16_t tick_stamp) {
    const uint8_t lock = hal_lock();
    const uint16_t now = BOARD_TCNT;
    hal_unlock(lock);
    return (uint16_t)(now - tick_stamp);
}

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

uint8_t hal_reset_cause(void) {
    return avr_reset_cause;
}

void hal_mark_control(bool runs) {
    if (runs) {
        GPIOR0 |= MARK_CONTROL;
    } else {
        GPIOR0 &= (uint8_t)~MARK_CONTROL;
    }
}

uint8_t hal_target(void) {
    return BOARD_TARGET;
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
        GPIOR0 = MARK_TICK;
        app_tick(&avr_app, late);
        GPIOR0 = 0;
        look_at_stack();
        if (avr_ticks_waiting == 0u) {
            wdt_reset();
        }
    }
}
