// Declarations shared by the files of the AVR layer.
#ifndef VGROOVE_HAL_AVR_AVR_H
#define VGROOVE_HAL_AVR_AVR_H

#include <stdint.h>

#include "app/app.h"

// Bits of GPIOR0 by which vgroove-board measures the cycles of a tick and of its controller.
#define AVR_MARK_TICK 1u
#define AVR_MARK_CONTROL 2u

// Frame of an interrupt handler in assembly (ISR_NAKED) that uses r24 and Z. Interrupts do not
// nest, so GPIOR1 and GPIOR2 keep Z; SREG and r24 go on the stack. AVR_ISR_KEEP are its operands.
#define AVR_ISR_BEGIN                                                                              \
    "out %[keep_low], r30\n\t"                                                                     \
    "out %[keep_high], r31\n\t"                                                                    \
    "push r24\n\t"                                                                                 \
    "in r24, __SREG__\n\t"                                                                         \
    "push r24\n\t"
#define AVR_ISR_END                                                                                \
    "pop r24\n\t"                                                                                  \
    "out __SREG__, r24\n\t"                                                                        \
    "pop r24\n\t"                                                                                  \
    "in r31, %[keep_high]\n\t"                                                                     \
    "in r30, %[keep_low]\n\t"                                                                      \
    "reti\n\t"
#define AVR_ISR_KEEP [keep_low] "I"(_SFR_IO_ADDR(GPIOR1)), [keep_high] "I"(_SFR_IO_ADDR(GPIOR2))

extern App avr_app;
extern volatile uint8_t avr_ticks_waiting;
extern uint8_t avr_reset_cause;

void avr_start_pins(void);

// Searches the lowest byte that the stack has used, a few bytes after each tick.
void avr_look_at_stack(void);

// Starts ADC and timers with interrupts off, before the main loop.
void avr_start_timers(void);

#endif
