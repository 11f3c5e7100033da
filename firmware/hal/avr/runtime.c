// Stack, marks for the bench and interrupt lock, common to all builds of the AVR layer.
#include <avr/interrupt.h>
#include <avr/io.h>

#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

#define PAINT 0xC5u    // fills the unused stack
#define PAINT_STEP 2u  // bytes examined per tick

extern uint8_t _end;  // of static data: lower limit of the stack

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
void avr_look_at_stack(void) {
    static uint16_t at;  // from &_end
    for (uint8_t k = 0; k < PAINT_STEP; k++, at++) {
        if (*(&_end + at) != PAINT) {
            stack_free_bytes = at;
            at = 0;
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

uint8_t hal_reset_cause(void) {
    return avr_reset_cause;
}

void hal_mark_control(bool runs) {
    AVR_MARKS = runs ? AVR_MARK_TICK | AVR_MARK_CONTROL : AVR_MARK_TICK;
}

uint8_t hal_target(void) {
    return BOARD_TARGET;
}
