// Interrupts: read the hardware, hand over to the application, return. Timer2 has the highest
// priority on both chips by its vector number.
#include <avr/interrupt.h>
#include <avr/io.h>

#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

_Static_assert(HAL_ADC_CURRENT == BOARD_ADC_CURRENT && HAL_ADC_BUS == BOARD_ADC_BUS &&
                   HAL_ADC_TRIGGER == BOARD_ADC_TRIGGER &&
                   HAL_ADC_TEMPERATURE == BOARD_ADC_TEMPERATURE,
               "ADC inputs are wired in the order of HAL_ADC_*");

// Sets the channel of the next conversion and clears its trigger flag (data sheet, "Changing
// Channel"). May run twice: the channel stays the same until the ADC interrupt, and a flag cleared
// during a conversion is set again by the next BOTTOM.
static inline void prepare_conversion(void) {
    ADMUX = (uint8_t)((1u << REFS0) | app_next_channel(&avr_app));
    TIFR0 |= 1u << TOV0;  // one SBI, which writes this bit alone
}

// Both must be done within 309 cycles of a result, or the next trigger is missed. The ADC interrupt
// has a low priority, so the first interrupt after a result does it, except UDRE; timing budget:
// docs/firmware.md, "Interrupts".
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

// At the tick or 256 cycles after it, see hal_apply_at().
ISR(TIMER2_COMPB_vect) {
    prepare_if_due();
    app_on_apply(&avr_app);
}

// Both edges count: the next one to capture is opposite to the present level, which also recovers
// from an edge that was too short.
ISR(BOARD_CAPT_vect) {
    prepare_if_due();
    const uint16_t stamp = BOARD_ICR;
    uint8_t control = (1u << BOARD_ICNC) | (1u << BOARD_ICES) | (1u << BOARD_CS_CLK1);
    if ((BOARD_HALL_PIN & (1u << BOARD_HALL_BIT)) != 0u) {
        control = (1u << BOARD_ICNC) | (1u << BOARD_CS_CLK1);
    }
    BOARD_TCCRB = control;
    BOARD_TIFR =
        1u << BOARD_ICF;  // may be set by changing the edge (data sheet, "Input Capture Unit")
    app_on_edge(&avr_app, stamp);
}

ISR(ADC_vect) {
    prepare_conversion();
    app_on_sample(&avr_app, ADC);
}

// The serial interrupts address the queues by their indices, see AvrMemory.
_Static_assert(offsetof(AvrMemory, app.uart.receive.items) % AVR_PAGE == 0 &&
                   offsetof(App, uart.send.items) + RING_FRAMES_BYTES ==
                       offsetof(App, uart.receive.items),
               "an index is the low byte of an address");

// app_on_received() in assembly: a command takes six of these within a tick. Prepares the ADC as
// prepare_if_due() does.
ISR(BOARD_RX_vect, ISR_NAKED) {
    __asm__ volatile(
        AVR_ISR_BEGIN "lds r31, %[adcsra]\n\t"
                      "sbrc r31, %[adif]\n\t"
                      "rjmp 5f\n\t"
                      "1: lds r31, %[status]\n\t"  // error flags, read before the data
                      "lds r24, %[data]\n\t"
                      "sbrc r31, %[frame_error]\n\t"
                      "rjmp 3f\n\t"
                      "sbrc r31, %[overrun]\n\t"
                      "rjmp 3f\n\t"
                      "lds r30, %[head]\n\t"
                      "ldi r31, hi8(%[items])\n\t"
                      "st Z+, r24\n\t"  // the free item, if the queue is full
                      "sbrc r30, %[end]\n\t"
                      "ldi r30, 0\n\t"
                      "lds r31, %[tail]\n\t"
                      "cpse r30, r31\n\t"
                      "rjmp 2f\n\t"
                      "ldi r24, 1\n\t"  // queue full: off until hal_uart_receive
                      "sts %[refuses], r24\n\t"
                      "in r30, __SREG__\n\t"
                      "lds r24, %[control]\n\t"
                      "andi r24, %[silent]\n\t"
                      "sts %[control], r24\n\t"
                      "rjmp 4f\n\t"
                      "2: sts %[head], r30\n\t"
                      "6: " AVR_ISR_END "3: in r30, __SREG__\n\t"
                      "4: lds r24, %[errors]\n\t"  // saturates at 255
                      "inc r24\n\t"
                      "breq 7f\n\t"
                      "sts %[errors], r24\n\t"
                      "7: out __SREG__, r30\n\t"
                      "rjmp 6b\n\t"
                      "5: in r31, __SREG__\n\t"
                      "lds r24, %[channel]\n\t"
                      "ori r24, %[reference]\n\t"
                      "sts %[admux], r24\n\t"
                      "sbi %[tifr], %[tov]\n\t"
                      "out __SREG__, r31\n\t"
                      "rjmp 1b\n\t"
        :
        : AVR_ISR_KEEP, [control] "n"(_SFR_MEM_ADDR(UCSR0B)),
          [silent] "n"((uint8_t) ~(1u << RXCIE0)), [refuses] "i"(&avr_app.uart.refuses),
          [adcsra] "n"(_SFR_MEM_ADDR(ADCSRA)), [adif] "I"(ADIF),
          [channel] "i"(&avr_app.adc.next_channel), [reference] "M"(1u << REFS0),
          [admux] "n"(_SFR_MEM_ADDR(ADMUX)), [tifr] "I"(_SFR_IO_ADDR(TIFR0)), [tov] "I"(TOV0),
          [status] "n"(_SFR_MEM_ADDR(UCSR0A)), [data] "n"(_SFR_MEM_ADDR(UDR0)),
          [frame_error] "I"(FE0), [overrun] "I"(DOR0), [tail] "i"(&avr_app.uart.receive.tail),
          [head] "i"(&avr_app.uart.receive.head), [end] "I"(RING_BYTES_BIT),
          [items] "i"(&avr_app.uart.receive.items), [errors] "i"(&avr_app.uart.receive_errors));
}

// app_on_ready() in assembly, 20,000 times a second: the registers that the compiler saves cost a
// third more. The queue is not empty: the last byte switches the interrupt off until hal_uart_wake.
ISR(BOARD_UDRE_vect, ISR_NAKED) {
    __asm__ volatile(
        AVR_ISR_BEGIN "lds r30, %[tail]\n\t"
                      "ldi r31, hi8(%[items])\n\t"
                      "ld r24, Z+\n\t"
                      "sts %[data], r24\n\t"
                      "sbrs r30, 7\n\t"  // overflow to 0: RING_FRAMES_FIRST is above 127
                      "ldi r30, %[first]\n\t"
                      "sts %[tail], r30\n\t"
                      "lds r31, %[head]\n\t"
                      "cpse r30, r31\n\t"
                      "rjmp 1f\n\t"
                      "in r30, __SREG__\n\t"
                      "lds r24, %[control]\n\t"
                      "andi r24, %[silent]\n\t"
                      "sts %[control], r24\n\t"
                      "out __SREG__, r30\n\t"
                      "1: " AVR_ISR_END
        :
        : AVR_ISR_KEEP, [tail] "i"(&avr_app.uart.send.tail), [head] "i"(&avr_app.uart.send.head),
          [items] "i"(&avr_app.uart.send.items), [first] "M"(RING_FRAMES_FIRST),
          [data] "n"(_SFR_MEM_ADDR(UDR0)), [control] "n"(_SFR_MEM_ADDR(UCSR0B)),
          [silent] "n"((uint8_t) ~(1u << UDRIE0)));
}
