// Declarations shared by the files of the AVR layer.
#ifndef VGROOVE_HAL_AVR_AVR_H
#define VGROOVE_HAL_AVR_AVR_H

#include <avr/io.h>
#include <stddef.h>
#include <stdint.h>

#include "app/app.h"

// Register by whose bits vgroove-board measures the cycles of a tick and of its controller: the bit
// rate of the TWI, which is not used.
#define AVR_MARKS TWBR
#define AVR_MARK_TICK 1u
#define AVR_MARK_CONTROL 2u

// TCCR0A with phase-correct PWM, TOP 255; the pins follow PORT, which is 0.
#define AVR_DISCONNECTED (1u << WGM00)

// Frame of an interrupt handler in assembly (ISR_NAKED) that uses r24 and Z and changes no flag of
// SREG. Interrupts do not nest, so three I/O registers keep them. AVR_ISR_KEEP are its operands.
#define AVR_ISR_BEGIN                                                                              \
    "out %[keep_data], r24\n\t"                                                                    \
    "out %[keep_low], r30\n\t"                                                                     \
    "out %[keep_high], r31\n\t"
#define AVR_ISR_END                                                                                \
    "in r31, %[keep_high]\n\t"                                                                     \
    "in r30, %[keep_low]\n\t"                                                                      \
    "in r24, %[keep_data]\n\t"                                                                     \
    "reti\n\t"
#define AVR_ISR_KEEP                                                                               \
    [keep_data] "I"(_SFR_IO_ADDR(GPIOR0)), [keep_low] "I"(_SFR_IO_ADDR(GPIOR1)),                   \
        [keep_high] "I"(_SFR_IO_ADDR(GPIOR2))

// Bytes before the application that put the queues of the UART where an index is the low byte of an
// address: the items of `send` end with a page of 256 bytes, those of `receive` begin the next.
#define AVR_PAGE 256u
#define AVR_BEFORE (AVR_PAGE - offsetof(App, uart.receive.items) % AVR_PAGE)

typedef struct {
    uint8_t before[AVR_BEFORE];
    App app;
} AvrMemory;

extern AvrMemory avr_memory;
#define avr_app (avr_memory.app)
extern volatile uint8_t avr_ticks_waiting;
extern uint8_t avr_reset_cause;

void avr_start_pins(void);

// Searches the lowest byte that the stack has used, a few bytes after each tick.
void avr_look_at_stack(void);

// Starts ADC and timers with interrupts off, before the main loop.
void avr_start_timers(void);

#endif
