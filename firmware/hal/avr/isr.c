// Interrupts: read the hardware, hand over to the application, leave. Timer2 comes first by its
// vector number on both chips.
#include <avr/interrupt.h>
#include <avr/io.h>

#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

_Static_assert(HAL_ADC_CURRENT == BOARD_ADC_CURRENT && HAL_ADC_BUS == BOARD_ADC_BUS &&
                   HAL_ADC_TRIGGER == BOARD_ADC_TRIGGER &&
                   HAL_ADC_TEMPERATURE == BOARD_ADC_TEMPERATURE,
               "ADC inputs are wired in the order of HAL_ADC_*");

// The channel of the next conversion and its trigger flag (data sheet, "Changing Channel"). Doing
// it twice does no harm: the channel is the same until the ADC interrupt moves on, and a flag
// cleared during a conversion is set again by the next BOTTOM.
static inline void prepare_conversion(void) {
    ADMUX = (uint8_t)((1u << REFS0) | app_next_channel(&avr_app));
    TIFR0 |= 1u << TOV0;  // one SBI, which writes this bit alone
}

// Both must be done within 309 cycles of a result, or the next trigger is missed. The ADC interrupt
// comes late by its vector number, so whichever interrupt begins first after a result does it, but
// for UDRE: docs/firmware.md, "Interrupts", has the sum.
static inline void prepare_if_due(void) {
    if ((ADCSRA & (1u << ADIF)) != 0u) {
        prepare_conversion();
    }
}

ISR(TIMER2_COMPA_vect) {
    prepare_if_due();
    avr_ticks_waiting++;
    app_on_tick(&avr_app);
}

// With the tick or 256 cycles after it, see hal_apply_at.
ISR(TIMER2_COMPB_vect) {
    prepare_if_due();
    app_on_apply(&avr_app);
}

// Both edges count: the next one is the opposite of the level now, which also finds back after an
// edge that came too fast.
ISR(BOARD_CAPT_vect) {
    prepare_if_due();
    const uint16_t stamp = BOARD_ICR;
    uint8_t control = (1u << BOARD_ICNC) | (1u << BOARD_ICES) | (1u << BOARD_CS_CLK1);
    if ((BOARD_HALL_PIN & (1u << BOARD_HALL_BIT)) != 0u) {
        control = (1u << BOARD_ICNC) | (1u << BOARD_CS_CLK1);
    }
    BOARD_TCCRB = control;
    BOARD_TIFR =
        1u << BOARD_ICF;  // changing the edge may have set it (data sheet, "Input Capture Unit")
    app_on_edge(&avr_app, stamp);
}

ISR(ADC_vect) {
    prepare_conversion();
    app_on_sample(&avr_app, ADC);
}

// app_on_received() by hand: a command that comes in takes six of these within a tick. Arms the ADC
// as prepare_if_due does. No interrupt nests, so GPIOR1 and GPIOR2 keep Z; SREG and r24 go on the
// stack.
ISR(BOARD_RX_vect, ISR_NAKED) {
    __asm__ volatile(
        "out %[keep_low], r30\n\t"
        "out %[keep_high], r31\n\t"
        "push r24\n\t"
        "in r24, __SREG__\n\t"
        "push r24\n\t"
        "lds r24, %[adcsra]\n\t"
        "sbrs r24, %[adif]\n\t"
        "rjmp 1f\n\t"
        "lds r24, %[channel]\n\t"
        "ori r24, %[reference]\n\t"
        "sts %[admux], r24\n\t"
        "sbi %[tifr], %[tov]\n\t"
        "1: lds r31, %[status]\n\t"  // before the data: it says what is wrong with it
        "lds r24, %[data]\n\t"
        "andi r31, %[damaged]\n\t"
        "brne 3f\n\t"
        "lds r31, %[tail]\n\t"
        "lds r30, %[head]\n\t"
        "subi r31, -%[size]\n\t"
        "cp r31, r30\n\t"
        "breq 3f\n\t"
        "mov r31, r30\n\t"
        "inc r31\n\t"
        "sts %[head], r31\n\t"
        "andi r30, %[size] - 1\n\t"
        "ldi r31, 0\n\t"
        "subi r30, lo8(-(%[items]))\n\t"
        "sbci r31, hi8(-(%[items]))\n\t"
        "st Z, r24\n\t"
        "2: pop r24\n\t"
        "out __SREG__, r24\n\t"
        "pop r24\n\t"
        "in r31, %[keep_high]\n\t"
        "in r30, %[keep_low]\n\t"
        "reti\n\t"
        "3: lds r24, %[errors]\n\t"  // counted up to 255
        "inc r24\n\t"
        "breq 2b\n\t"
        "sts %[errors], r24\n\t"
        "rjmp 2b\n\t"
        :
        : [keep_low] "I"(_SFR_IO_ADDR(GPIOR1)), [keep_high] "I"(_SFR_IO_ADDR(GPIOR2)),
          [adcsra] "n"(_SFR_MEM_ADDR(ADCSRA)), [adif] "I"(ADIF),
          [channel] "i"(&avr_app.adc.next_channel), [reference] "M"(1u << REFS0),
          [admux] "n"(_SFR_MEM_ADDR(ADMUX)), [tifr] "I"(_SFR_IO_ADDR(TIFR0)), [tov] "I"(TOV0),
          [status] "n"(_SFR_MEM_ADDR(UCSR0A)), [data] "n"(_SFR_MEM_ADDR(UDR0)),
          [damaged] "M"((1u << FE0) | (1u << DOR0)), [tail] "i"(&avr_app.uart.receive.tail),
          [head] "i"(&avr_app.uart.receive.head), [size] "M"(RING_BYTES),
          [items] "i"(&avr_app.uart.receive.items), [errors] "i"(&avr_app.uart.receive_errors));
}

// app_on_ready() by hand, 20,000 times a second: what the compiler saves around any interrupt would
// cost a third more. No interrupt nests, so GPIOR1 and GPIOR2 keep Z; SREG and r24 go on the stack.
ISR(BOARD_UDRE_vect, ISR_NAKED) {
    __asm__ volatile("out %[keep_low], r30\n\t"
                     "out %[keep_high], r31\n\t"
                     "push r24\n\t"
                     "in r24, __SREG__\n\t"
                     "push r24\n\t"
                     "lds r30, %[tail]\n\t"
                     "lds r24, %[head]\n\t"
                     "cp r24, r30\n\t"
                     "breq 2f\n\t"
                     "mov r24, r30\n\t"
                     "inc r24\n\t"
                     "cpi r24, %[end]\n\t"
                     "brne 3f\n\t"
                     "ldi r24, 0\n\t"
                     "3: sts %[tail], r24\n\t"
                     "ldi r31, 0\n\t"
                     "subi r30, lo8(-(%[items]))\n\t"
                     "sbci r31, hi8(-(%[items]))\n\t"
                     "ld r24, Z\n\t"
                     "sts %[data], r24\n\t"
                     "1: pop r24\n\t"
                     "out __SREG__, r24\n\t"
                     "pop r24\n\t"
                     "in r31, %[keep_high]\n\t"
                     "in r30, %[keep_low]\n\t"
                     "reti\n\t"
                     "2: lds r24, %[control]\n\t"  // nothing left: until hal_uart_wake
                     "andi r24, %[silent]\n\t"
                     "sts %[control], r24\n\t"
                     "rjmp 1b\n\t"
                     :
                     : [keep_low] "I"(_SFR_IO_ADDR(GPIOR1)), [keep_high] "I"(_SFR_IO_ADDR(GPIOR2)),
                       [tail] "i"(&avr_app.uart.send.tail), [head] "i"(&avr_app.uart.send.head),
                       [items] "i"(&avr_app.uart.send.items), [end] "M"(RING_FRAMES_BYTES),
                       [data] "n"(_SFR_MEM_ADDR(UDR0)), [control] "n"(_SFR_MEM_ADDR(UCSR0B)),
                       [silent] "n"((uint8_t) ~(1u << UDRIE0)));
}
