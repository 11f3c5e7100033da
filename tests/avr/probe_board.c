// Test program of the bench tool: one-letter commands over the UART exercise timers, capture, ADC,
// EEPROM, watchdog and bridge.
//
// Commands, each argument a byte: t COUNT ticks, c ON captures, a COUNT results, k ON clear the
// trigger flag of the ADC, n number of conversions, e ADDRESS VALUE write the EEPROM, g ADDRESS
// read it, b HIGH_BELOW LOW_ABOVE REVERSE drive the bridge, o open it, s pins, r reset cause, w
// wait for the watchdog, m a tick and a controller step between the marks of TWBR. Events go out
// as a letter and two bytes, high byte first: T tick stamp, C capture stamp, A result (channel in
// the top bits), E EEPROM busy time in 8 cycles, G EEPROM byte, R reset cause, S pins, N number of
// conversions.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <stdint.h>

#define RING 64u

#ifdef __AVR_ATmega2560__
#define STAMP TCNT5
#define CAPTURED ICR5
#define CAPTURE_CONTROL TCCR5B
#define CAPTURE_MASK TIMSK5
#define CAPTURE_VECTOR TIMER5_CAPT_vect
#define RECEIVE_VECTOR USART0_RX_vect
#define EMPTY_VECTOR USART0_UDRE_vect
#define ENABLE _BV(PB4)
#define LEG_B PORTE
#define B_HIGH _BV(PE4)
#define B_LOW _BV(PE5)
#else
#define STAMP TCNT1
#define CAPTURED ICR1
#define CAPTURE_CONTROL TCCR1B
#define CAPTURE_MASK TIMSK1
#define CAPTURE_VECTOR TIMER1_CAPT_vect
#define RECEIVE_VECTOR USART_RX_vect
#define EMPTY_VECTOR USART_UDRE_vect
#define ENABLE _BV(PB1)
#define LEG_B PORTD
#define B_HIGH _BV(PD7)
#define B_LOW _BV(PD4)
#endif

static volatile uint8_t out[RING], out_head, out_tail;
static volatile uint8_t in[RING], in_head;
static uint8_t in_tail;
static volatile uint8_t want_ticks, want_captures, want_samples, clear_trigger = 1u;
static volatile uint16_t conversions;
static uint8_t reset_cause __attribute__((section(".noinit")));

static void put(uint8_t byte) {
    out[out_head] = byte;
    out_head = (uint8_t)((out_head + 1u) % RING);
    UCSR0B |= _BV(UDRIE0);
}

static void event(uint8_t letter, uint16_t value) {
    const uint8_t before = SREG;
    cli();
    put(letter);
    put((uint8_t)(value >> 8));
    put((uint8_t)value);
    SREG = before;
}

ISR(EMPTY_VECTOR) {
    if (out_head == out_tail) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
        return;
    }
    UDR0 = out[out_tail];
    out_tail = (uint8_t)((out_tail + 1u) % RING);
}

ISR(RECEIVE_VECTOR) {
    in[in_head] = UDR0;
    in_head = (uint8_t)((in_head + 1u) % RING);
}

ISR(TIMER2_COMPA_vect) {
    const uint16_t now = STAMP;
    if (want_ticks != 0u) {
        event('T', now);
        --want_ticks;
    }
}

ISR(CAPTURE_VECTOR) {
    const uint16_t stamp = CAPTURED;
    CAPTURE_CONTROL ^= _BV(ICES1);
    if (want_captures != 0u) {
        event('C', stamp);
    }
}

ISR(ADC_vect) {
    const uint16_t counts = ADC;
    const uint8_t channel = ADMUX & 3u;
    ADMUX = (uint8_t)(_BV(REFS0) | ((channel + 1u) & 3u));
    ++conversions;
    if (clear_trigger != 0u) {
        TIFR0 = _BV(TOV0);
    }
    if (want_samples != 0u) {
        event('A', (uint16_t)(counts | (uint16_t)channel << 14));
        --want_samples;
    }
}

static uint8_t take(void) {
    while (in_tail == in_head) {
    }
    const uint8_t byte = in[in_tail];
    in_tail = (uint8_t)((in_tail + 1u) % RING);
    return byte;
}

static void start_timers(void) {
    GTCCR = _BV(TSM) | _BV(PSRASY) | _BV(PSRSYNC);
    TCCR0A = _BV(WGM00);
    TCCR0B = _BV(CS00);
    TCCR2A = _BV(WGM21);
    TCCR2B = _BV(CS22);
    OCR2A = 249u;
    TIMSK2 = _BV(OCIE2A);
    CAPTURE_CONTROL = _BV(ICNC1) | _BV(CS10);
    CAPTURE_MASK = _BV(ICIE1);
    STAMP = 0u;
    TCNT0 = 0u;
    TCNT2 = 0u;
    GTCCR = 0u;
}

static void start_converter(void) {
    ADMUX = _BV(REFS0);
    ADCSRB = _BV(ADTS2);
    ADCSRA = _BV(ADEN) | _BV(ADATE) | _BV(ADIE) | 7u;
}

static void write_eeprom(uint8_t address, uint8_t value) {
    EEAR = address;
    EEDR = value;
    cli();
    EECR |= _BV(EEMPE);
    EECR |= _BV(EEPE);
    sei();
    const uint16_t start = STAMP;
    while ((EECR & _BV(EEPE)) != 0u) {
    }
    event('E', (uint16_t)((uint16_t)(STAMP - start) >> 3));
}

static uint8_t read_eeprom(uint8_t address) {
    EEAR = address;
    EECR |= _BV(EERE);
    return EEDR;
}

static void open_bridge(void) {
    PORTB &= (uint8_t)~ENABLE;
    TCCR0A = _BV(WGM00);
    LEG_B &= (uint8_t) ~(B_HIGH | B_LOW);
}

static void drive_bridge(uint8_t high_below, uint8_t low_above, uint8_t reverse) {
    OCR0A = high_below;
    OCR0B = low_above;
    LEG_B = (uint8_t)((LEG_B & ~(B_HIGH | B_LOW)) | (reverse != 0u ? B_HIGH : B_LOW));
    TCCR0A = _BV(COM0A1) | _BV(COM0B1) | _BV(COM0B0) | _BV(WGM00);
    PORTB |= ENABLE;
}

static void start_pins(void) {
#ifdef __AVR_ATmega2560__
    DDRB = _BV(PB7) | ENABLE;
    DDRG = _BV(PG5);
    DDRE = B_HIGH | B_LOW;
    PORTA = 0x0fu;
    PORTL = _BV(PL1);
#else
    DDRD = _BV(PD4) | _BV(PD5) | _BV(PD6) | _BV(PD7);
    DDRB = ENABLE;
    PORTD = _BV(PD2) | _BV(PD3);
    PORTC = _BV(PC4) | _BV(PC5);
    PORTB = _BV(PB0);
#endif
}

static void start_uart(void) {
    UBRR0 = 3u;
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

// Contact, reverse, mode 0, mode 1 in bits 0..3, Hall line in bit 4.
static uint8_t pins(void) {
#ifdef __AVR_ATmega2560__
    return (uint8_t)((PINA & 0x0fu) | (PINL & 0x02u) << 3);
#else
    return (uint8_t)((PIND & 0x0cu) >> 2 | (PINC & 0x30u) >> 2 | (PINB & 0x01u) << 4);
#endif
}

static void idle_loop(uint8_t turns) {
    for (volatile uint8_t i = 0u; i < turns; ++i) {
    }
}

static void execute(uint8_t command) {
    uint8_t a;
    uint8_t b;
    switch (command) {
    case 't':
        want_ticks = take();
        break;
    case 'c':
        want_captures = take();
        break;
    case 'a':
        want_samples = take();
        break;
    case 'k':
        clear_trigger = take();
        break;
    case 'n':
        event('N', conversions);
        break;
    case 'e':
        a = take();
        b = take();
        write_eeprom(a, b);
        break;
    case 'g':
        event('G', read_eeprom(take()));
        break;
    case 'b':
        a = take();
        b = take();
        drive_bridge(a, b, take());
        break;
    case 'o':
        open_bridge();
        break;
    case 's':
        event('S', pins());
        break;
    case 'r':
        event('R', reset_cause);
        break;
    case 'w':
        wdt_enable(WDTO_15MS);
        while (1) {
        }
    case 'm':  // a tick of about 1,000 cycles between its marks
        set_sleep_mode(SLEEP_MODE_IDLE);
        sleep_mode();
        TWBR |= 1u;
        idle_loop(60u);
        TWBR |= 2u;  // with a controller step of 400 between its marks
        idle_loop(40u);
        TWBR &= (uint8_t)~2u;
        TWBR &= (uint8_t)~1u;
        break;
    default:
        break;
    }
}

int main(void) {
    reset_cause = MCUSR;
    MCUSR = 0u;
    wdt_disable();
    start_pins();
    start_uart();
    start_converter();
    start_timers();
    sei();
    while (1) {
        execute(take());
    }
}
