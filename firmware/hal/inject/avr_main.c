// Main program of the build whose sensors and gates are exchanged over the serial line
// (hal/inject/inject.h): timer tick, UART at 1 MBd, watchdog. The gates stay off.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "build_hash.h"
#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"
#include "hal/inject/inject.h"

#define DIVIDER_1000000 1u  // double speed: 16 MHz / 8 / (1 + 1), exact

_Static_assert(INJECT_BAUD == F_CPU / 8u / (DIVIDER_1000000 + 1u), "rate of the line");

AvrMemory avr_memory;
volatile uint8_t avr_ticks_waiting;
static uint16_t tick_begin;  // BOARD_TCNT

ISR(TIMER2_COMPA_vect) {
    avr_ticks_waiting++;
}

// Frame of an interrupt handler in assembly that uses r24 and Z. Interrupts do not nest, so GPIOR1
// and GPIOR2 keep Z; SREG and r24 go on the stack.
#define INJECT_ISR_BEGIN                                                                           \
    "out %[keep_low], r30\n\t"                                                                     \
    "out %[keep_high], r31\n\t"                                                                    \
    "push r24\n\t"                                                                                 \
    "in r24, __SREG__\n\t"                                                                         \
    "push r24\n\t"
#define INJECT_ISR_END                                                                             \
    "pop r24\n\t"                                                                                  \
    "out __SREG__, r24\n\t"                                                                        \
    "pop r24\n\t"                                                                                  \
    "in r31, %[keep_high]\n\t"                                                                     \
    "in r30, %[keep_low]\n\t"                                                                      \
    "reti\n\t"
#define INJECT_ISR_KEEP [keep_low] "I"(_SFR_IO_ADDR(GPIOR1)), [keep_high] "I"(_SFR_IO_ADDR(GPIOR2))

// Pushes the byte to inject.received, in assembly: 57 of these within a tick.
ISR(BOARD_RX_vect, ISR_NAKED) {
    __asm__ volatile(
        INJECT_ISR_BEGIN "lds r31, %[status]\n\t"  // error flags, read before the data
                         "lds r24, %[data]\n\t"
                         "andi r31, %[damaged]\n\t"
                         "brne 3f\n\t"
                         "lds r31, %[tail]\n\t"
                         "lds r30, %[head]\n\t"
                         "dec r31\n\t"
                         "andi r31, %[size] - 1\n\t"
                         "cp r31, r30\n\t"
                         "breq 3f\n\t"
                         "mov r31, r30\n\t"
                         "inc r31\n\t"
                         "andi r31, %[size] - 1\n\t"
                         "sts %[head], r31\n\t"
                         "ldi r31, 0\n\t"
                         "subi r30, lo8(-(%[items]))\n\t"
                         "sbci r31, hi8(-(%[items]))\n\t"
                         "st Z, r24\n\t"
                         "2: " INJECT_ISR_END "3: lds r24, %[errors]\n\t"  // saturates at 255
                         "inc r24\n\t"
                         "breq 2b\n\t"
                         "sts %[errors], r24\n\t"
                         "rjmp 2b\n\t"
        :
        : INJECT_ISR_KEEP, [status] "n"(_SFR_MEM_ADDR(UCSR0A)), [data] "n"(_SFR_MEM_ADDR(UDR0)),
          [damaged] "M"((1u << FE0) | (1u << DOR0)), [tail] "i"(&inject.received.tail),
          [head] "i"(&inject.received.head), [size] "M"(RING_BYTES),
          [items] "i"(&inject.received.items), [errors] "i"(&inject.errors));
}

// Pops a byte from inject.send, in assembly as above.
ISR(BOARD_UDRE_vect, ISR_NAKED) {
    __asm__ volatile(
        INJECT_ISR_BEGIN "lds r30, %[tail]\n\t"
                         "lds r24, %[head]\n\t"
                         "cp r24, r30\n\t"
                         "breq 2f\n\t"
                         "mov r24, r30\n\t"
                         "inc r24\n\t"
                         "sts %[tail], r24\n\t"
                         "andi r30, %[size] - 1\n\t"
                         "ldi r31, 0\n\t"
                         "subi r30, lo8(-(%[items]))\n\t"
                         "sbci r31, hi8(-(%[items]))\n\t"
                         "ld r24, Z\n\t"
                         "sts %[data], r24\n\t"
                         "1: " INJECT_ISR_END
                         "2: lds r24, %[control]\n\t"  // queue empty: off until hal_uart_wake
                         "andi r24, %[silent]\n\t"
                         "sts %[control], r24\n\t"
                         "rjmp 1b\n\t"
        :
        : INJECT_ISR_KEEP, [tail] "i"(&inject.send_tail), [head] "i"(&inject.send_head),
          [size] "M"(INJECT_SEND_BYTES), [items] "i"(&inject.send), [data] "n"(_SFR_MEM_ADDR(UDR0)),
          [control] "n"(_SFR_MEM_ADDR(UCSR0B)), [silent] "n"((uint8_t) ~(1u << UDRIE0)));
}

void hal_uart_wake(void) {
    const uint8_t lock = hal_lock();  // interrupts change the other bits
    UCSR0B = (uint8_t)(UCSR0B | (1u << UDRIE0));
    hal_unlock(lock);
}

// The line has its own rate; the parameter `baud_select` sets the telemetry's byte budget alone.
void hal_uart_start(uint8_t baud) {
    (void)baud;
    UCSR0A = 1u << U2X0;
    UBRR0 = DIVIDER_1000000;
    UCSR0C = (1u << UCSZ01) | (1u << UCSZ00);
    UCSR0B = (1u << RXCIE0) | (1u << RXEN0) | (1u << TXEN0);
}

uint16_t hal_tick_cycles(uint16_t tick_stamp) {
    (void)tick_stamp;  // of the firmware's time, which stands still while inputs are missing
    const uint8_t lock = hal_lock();
    const uint16_t now = BOARD_TCNT;
    hal_unlock(lock);
    return (uint16_t)(now - tick_begin);
}

static void start_timers(void) {
    BOARD_TCCRA = 0;
    BOARD_TCCRB = 1u << BOARD_CS_CLK1;
    OCR2A = BOARD_TICK_TOP;
    TCCR2A = 1u << WGM21;
    TCCR2B = 1u << CS22;
    TIMSK2 = 1u << OCIE2A;
}

static bool take_tick(void) {
    const uint8_t lock = hal_lock();
    const bool due = avr_ticks_waiting > 0u;
    avr_ticks_waiting = (uint8_t)(avr_ticks_waiting - (due ? 1u : 0u));
    hal_unlock(lock);
    return due;
}

// Sleeps until an interrupt, unless one has left work.
static void wait_for_work(void) {
    cli();
    const bool tick_due = avr_ticks_waiting > 0u && inject_has_room();
    if (!tick_due && inject.received.head == inject.received.tail) {
        sei();
        sleep_cpu();
    }
    sei();
}

int main(void) {
    avr_start_pins();
    inject_init(&avr_app, VGROOVE_BUILD_HASH);
    SMCR = 1u << SE;  // idle mode: the timers run
    start_timers();
    wdt_enable(WDTO_15MS);
    for (;;) {
        wait_for_work();
        inject_decode();
        if (inject_has_room() && take_tick()) {
            const uint8_t count = TCNT2;
            tick_begin = BOARD_TCNT;
            AVR_MARKS = AVR_MARK_TICK;
            inject_timer_tick(&avr_app, VGROOVE_BUILD_HASH, count);
            AVR_MARKS = 0;
            avr_look_at_stack();
            wdt_reset();
        }
    }
}
