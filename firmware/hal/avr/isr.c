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

// The interrupts below are called often: the registers that the compiler saves cost 11 to 23 cycles
// more. prepare_conversion() and prepare_if_due() in assembly:
#define PREPARE                                                                                    \
    "lds r30, %[channel]\n\t"                                                                      \
    "ori r30, %[reference]\n\t"                                                                    \
    "sts %[admux], r30\n\t"                                                                        \
    "sbi %[tifr], %[tov]\n\t"
#define PREPARE_IF_DUE                                                                             \
    "lds r30, %[adcsra]\n\t"                                                                       \
    "sbrs r30, %[adif]\n\t"                                                                        \
    "rjmp .+12\n\t" PREPARE
#define PREPARED                                                                                   \
    [channel] "i"(&avr_app.adc.next_channel), [reference] "M"(1u << REFS0),                        \
        [admux] "n"(_SFR_MEM_ADDR(ADMUX)), [tifr] "I"(_SFR_IO_ADDR(TIFR0)), [tov] "I"(TOV0)
#define PREPARED_IF_DUE PREPARED, [adcsra] "n"(_SFR_MEM_ADDR(ADCSRA)), [adif] "I"(ADIF)

// Frames of handlers that change flags: SREG in r24, or on the stack when r24 and r25 hold a value.
#define TICK_BEGIN AVR_ISR_BEGIN "in r24, __SREG__\n\t" PREPARE_IF_DUE
#define TICK_END "out __SREG__, r24\n\t" AVR_ISR_END
#define PAIR_BEGIN                                                                                 \
    AVR_ISR_BEGIN                                                                                  \
    "in r24, __SREG__\n\t"                                                                         \
    "push r24\n\t"                                                                                 \
    "push r25\n\t"
#define PAIR_END                                                                                   \
    "pop r25\n\t"                                                                                  \
    "pop r24\n\t" TICK_END
#define EDGE_BEGIN PAIR_BEGIN PREPARE_IF_DUE
#define SAMPLE_BEGIN PAIR_BEGIN PREPARE

// app_on_tick() in assembly.
ISR(TIMER2_COMPA_vect, ISR_NAKED) {
    __asm__ volatile(
        TICK_BEGIN "lds r30, %[ticks]\n\t"
                   "inc r30\n\t"
                   "sts %[ticks], r30\n\t"
                   "lds r30, %[head]\n\t"
                   "sts %[limit], r30\n\t" TICK_END
        :
        : AVR_ISR_KEEP, PREPARED_IF_DUE, [ticks] "i"(&avr_ticks_waiting),
          [head] "i"(&avr_app.uart.receive.head), [limit] "i"(&avr_app.uart.receive_limit));
}

// At the tick or 256 cycles after it, see hal_apply_at().
ISR(TIMER2_COMPB_vect) {
    prepare_if_due();
    app_on_apply(&avr_app);
}

#define ANY_EDGE ((1u << BOARD_ICNC) | (1u << BOARD_CS_CLK1))

// app_on_edge() in assembly. Both edges count: the next one to capture is opposite to the present
// level, which also recovers from an edge that was too short. Changing it may set the flag (data
// sheet, "Input Capture Unit").
ISR(BOARD_CAPT_vect, ISR_NAKED) {
    __asm__ volatile(
        EDGE_BEGIN "lds r24, %[stamp]\n\t"
                   "lds r25, %[stamp] + 1\n\t"
                   "lds r30, %[pin]\n\t"
                   "ldi r31, %[rising]\n\t"
                   "sbrc r30, %[hall]\n\t"
                   "ldi r31, %[falling]\n\t"
                   "sts %[capture], r31\n\t"
                   "ldi r31, %[flag]\n\t"
                   "sts %[flags], r31\n\t"
                   "lds r30, %[head]\n\t"
                   "lds r31, %[tail]\n\t"
                   "subi r31, -%[size]\n\t"
                   "cp r31, r30\n\t"
                   "breq 2f\n\t"
                   "mov r31, r30\n\t"
                   "inc r31\n\t"
                   "sts %[head], r31\n\t"
                   "andi r30, %[size] - 1\n\t"
                   "ldi r31, 0\n\t"
                   "subi r30, lo8(-(%[items]))\n\t"
                   "sbci r31, hi8(-(%[items]))\n\t"
                   "st Z, r24\n\t"
                   "std Z + %[size], r25\n\t"
                   "1: " PAIR_END "2: ldi r24, 1\n\t"
                   "sts %[overflowed], r24\n\t"
                   "rjmp 1b\n\t"
        :
        : AVR_ISR_KEEP, PREPARED_IF_DUE, [stamp] "n"(_SFR_MEM_ADDR(BOARD_ICR)),
          [pin] "n"(_SFR_MEM_ADDR(BOARD_HALL_PIN)), [hall] "I"(BOARD_HALL_BIT),
          [rising] "M"(ANY_EDGE | (1u << BOARD_ICES)), [falling] "M"(ANY_EDGE),
          [capture] "n"(_SFR_MEM_ADDR(BOARD_TCCRB)), [flag] "M"(1u << BOARD_ICF),
          [flags] "n"(_SFR_MEM_ADDR(BOARD_TIFR)), [head] "i"(&avr_app.hall.stamps.head),
          [tail] "i"(&avr_app.hall.stamps.tail), [size] "I"(RING_WORDS),
          [items] "i"(&avr_app.hall.stamps.low), [overflowed] "i"(&avr_app.hall.overflowed));
}

_Static_assert(offsetof(RingWords, high) == offsetof(RingWords, low) + RING_WORDS &&
                   offsetof(AdcSequence, high) == offsetof(AdcSequence, low) + ADC_SEQUENCE_RING &&
                   offsetof(AdcSequence, after) == offsetof(AdcSequence, high) + ADC_SEQUENCE_RING,
               "bytes of an item by one address");

// app_on_sample() in assembly, with hal_bridge_cut() at a current beyond the trip: after the sample
// is stored, always behind the end of the PWM period, 54 cycles after the result.
ISR(ADC_vect, ISR_NAKED) {
    __asm__ volatile(SAMPLE_BEGIN "lds r24, %[counts]\n\t"
                                  "lds r25, %[counts] + 1\n\t"
                                  "lds r30, %[head]\n\t"
                                  "andi r30, %[every] - 1\n\t"
                                  "cpi r30, %[other]\n\t"
                                  "breq 1f\n\t"
                                  "lds r30, %[low]\n\t"
                                  "lds r31, %[low] + 1\n\t"
                                  "cp r24, r30\n\t"
                                  "cpc r25, r31\n\t"
                                  "brlo 2f\n\t"
                                  "lds r30, %[high]\n\t"
                                  "lds r31, %[high] + 1\n\t"
                                  "cp r30, r24\n\t"
                                  "cpc r31, r25\n\t"
                                  "brlo 2f\n\t"
                                  "1: lds r30, %[head]\n\t"
                                  "mov r31, r30\n\t"
                                  "inc r31\n\t"
                                  "sts %[head], r31\n\t"
                                  "andi r30, %[size] - 1\n\t"
                                  "ldi r31, 0\n\t"
                                  "subi r30, lo8(-(%[items]))\n\t"
                                  "sbci r31, hi8(-(%[items]))\n\t"
                                  "st Z, r24\n\t"
                                  "std Z + %[size], r25\n\t"
                                  "ldd r24, Z + 2 * %[size]\n\t"
                                  "sts %[channel], r24\n\t"
                                  "sbrc r25, 7\n\t"  // the mark
                                  "rjmp 3f\n\t"
                                  "4: " PAIR_END "2: ori r25, %[mark]\n\t"
                                  "rjmp 1b\n\t"
                                  "3: cbi %[enable], %[enable_bit]\n\t"
                                  "ldi r30, %[disconnected]\n\t"
                                  "out %[outputs], r30\n\t"
                                  "cbi %[leg_b], %[leg_b_high]\n\t"
                                  "cbi %[leg_b], %[leg_b_low]\n\t"
                                  "ldi r30, 1\n\t"
                                  "sts %[tripped], r30\n\t"
                                  "rjmp 4b\n\t"
                     :
                     : AVR_ISR_KEEP, PREPARED, [counts] "n"(_SFR_MEM_ADDR(ADC)),
                       [head] "i"(&avr_app.adc.head), [every] "M"(ADC_SEQUENCE_OTHER_EVERY),
                       [other] "M"(ADC_SEQUENCE_OTHER_AT), [low] "i"(&avr_app.adc.trip_low),
                       [high] "i"(&avr_app.adc.trip_high), [size] "I"(ADC_SEQUENCE_RING),
                       [items] "i"(&avr_app.adc.low), [enable] "I"(_SFR_IO_ADDR(BOARD_ENABLE_PORT)),
                       [enable_bit] "I"(BOARD_ENABLE_BIT), [disconnected] "M"(AVR_DISCONNECTED),
                       [outputs] "I"(_SFR_IO_ADDR(TCCR0A)), [leg_b] "I"(_SFR_IO_ADDR(BOARD_B_PORT)),
                       [leg_b_high] "I"(BOARD_B_HIGH_BIT), [leg_b_low] "I"(BOARD_B_LOW_BIT),
                       [tripped] "i"(&avr_app.bridge.tripped), [mark] "M"(ADC_SEQUENCE_MARK >> 8));
}

// The serial interrupts address the queues by their indices, see AvrMemory.
_Static_assert(offsetof(AvrMemory, app.uart.receive.items) % AVR_PAGE == 0 &&
                   offsetof(App, uart.send.items) + RING_FRAMES_BYTES ==
                       offsetof(App, uart.receive.items),
               "an index is the low byte of an address");

// app_on_received() in assembly: a command takes six of these within a tick.
#define RX_PREPARES                                                                                \
    "5: in r31, __SREG__\n\t" PREPARE "out __SREG__, r31\n\t"                                      \
    "rjmp 1b\n\t"
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
                      "rjmp 6b\n\t" RX_PREPARES
        :
        : AVR_ISR_KEEP, [control] "n"(_SFR_MEM_ADDR(UCSR0B)),
          [silent] "n"((uint8_t) ~(1u << RXCIE0)), [refuses] "i"(&avr_app.uart.refuses),
          PREPARED_IF_DUE, [status] "n"(_SFR_MEM_ADDR(UCSR0A)), [data] "n"(_SFR_MEM_ADDR(UDR0)),
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
