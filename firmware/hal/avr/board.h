// The only list of pins and timers of both boards; firmware/hal/avr/pins.py generates docs/pins.md
// from its comments.
//
// pins:    #define BOARD_... value  // port pin, Arduino pin | alternate function | connection
// timers:  #define BOARD_... value  // timer | outputs or inputs | use
#ifndef VGROOVE_HAL_AVR_BOARD_H
#define VGROOVE_HAL_AVR_BOARD_H

#include <avr/io.h>

#if defined(__AVR_ATmega328P__)
// board: ATmega328P (Arduino Uno)
#define BOARD_TARGET 1u
// pins
#define BOARD_HALL_DDR DDRB
#define BOARD_HALL_PORT PORTB
#define BOARD_HALL_PIN PINB
#define BOARD_HALL_BIT PB0  // PB0, D8 | ICP1 | Hall sensor, open collector, pull-up; both edges
#define BOARD_ENABLE_DDR DDRB
#define BOARD_ENABLE_PORT PORTB
#define BOARD_ENABLE_BIT PB1  // PB1, D9 | - | gate driver enable, high = on, 10 kOhm pull-down
#define BOARD_A_HIGH_DDR DDRD
#define BOARD_A_HIGH_PORT PORTD
#define BOARD_A_HIGH_BIT PD6  // PD6, D6 | OC0A | leg A, high-side gate, 10 kOhm pull-down
#define BOARD_A_LOW_DDR DDRD
#define BOARD_A_LOW_PORT PORTD
#define BOARD_A_LOW_BIT PD5  // PD5, D5 | OC0B | leg A, low-side gate, inverted, 10 kOhm pull-down
#define BOARD_B_DDR DDRD
#define BOARD_B_PORT PORTD
#define BOARD_B_HIGH_BIT PD7  // PD7, D7 | - | leg B, high-side gate, 10 kOhm pull-down
#define BOARD_B_LOW_BIT PD4   // PD4, D4 | - | leg B, low-side gate, 10 kOhm pull-down
#define BOARD_CONTACT_PORT PORTD
#define BOARD_CONTACT_PIN PIND
#define BOARD_CONTACT_BIT PD2  // PD2, D2 | - | trigger contact, closes to ground, pull-up
#define BOARD_REVERSE_PORT PORTD
#define BOARD_REVERSE_PIN PIND
#define BOARD_REVERSE_BIT PD3  // PD3, D3 | - | direction switch, reverse closes to ground, pull-up
#define BOARD_MODE_PORT PORTC
#define BOARD_MODE_PIN PINC
#define BOARD_MODE_0_BIT PC4  // PC4, A4 | - | mode switch, bit 0, closes to ground, pull-up
#define BOARD_MODE_1_BIT PC5  // PC5, A5 | - | mode switch, bit 1, closes to ground, pull-up
#define BOARD_RX_BIT PD0      // PD0, D0 | RXD | from the RS232 level shifter
#define BOARD_TX_BIT PD1      // PD1, D1 | TXD | to the RS232 level shifter
#define BOARD_ADC_CURRENT 0u  // PC0, A0 | ADC0 | current sensor, 2.5 V at 0 A, 0.125 A per count
#define BOARD_ADC_BUS 1u      // PC1, A1 | ADC1 | bus voltage, divider 5.12 : 1, 25 mV per count
#define BOARD_ADC_TRIGGER 2u  // PC2, A2 | ADC2 | trigger potentiometer
#define BOARD_ADC_TEMPERATURE 3u  // PC3, A3 | ADC3 | TMP36 at the bridge
// timers
#define BOARD_PWM_TIMER 0   // Timer0 | OC0A, OC0B | phase-correct PWM 31,372.5 Hz; ADC at BOTTOM
#define BOARD_HALL_TIMER 1  // Timer1 | ICP1 | free running, clk/1; captures the Hall edges
#define BOARD_TICK_TIMER 2  // Timer2 | - | CTC, tick every 16,000 cycles; compare B 256 later
// registers of the Hall timer
#define BOARD_TCCRA TCCR1A
#define BOARD_TCCRB TCCR1B
#define BOARD_TCNT TCNT1
#define BOARD_ICR ICR1
#define BOARD_TIMSK TIMSK1
#define BOARD_TIFR TIFR1
#define BOARD_CAPT_vect TIMER1_CAPT_vect
#define BOARD_RX_vect USART_RX_vect
#define BOARD_UDRE_vect USART_UDRE_vect
// end

#elif defined(__AVR_ATmega2560__)
// board: ATmega2560 (Arduino Mega 2560)
#define BOARD_TARGET 2u
// pins
#define BOARD_HALL_DDR DDRL
#define BOARD_HALL_PORT PORTL
#define BOARD_HALL_PIN PINL
#define BOARD_HALL_BIT PL1  // PL1, D48 | ICP5 | Hall sensor, open collector, pull-up; both edges
#define BOARD_ENABLE_DDR DDRB
#define BOARD_ENABLE_PORT PORTB
#define BOARD_ENABLE_BIT PB4  // PB4, D10 | - | gate driver enable, high = on, 10 kOhm pull-down
#define BOARD_A_HIGH_DDR DDRB
#define BOARD_A_HIGH_PORT PORTB
#define BOARD_A_HIGH_BIT PB7  // PB7, D13 | OC0A | leg A, high-side gate, 10 kOhm pull-down
#define BOARD_A_LOW_DDR DDRG
#define BOARD_A_LOW_PORT PORTG
#define BOARD_A_LOW_BIT PG5  // PG5, D4 | OC0B | leg A, low-side gate, inverted, 10 kOhm pull-down
#define BOARD_B_DDR DDRE
#define BOARD_B_PORT PORTE
#define BOARD_B_HIGH_BIT PE4  // PE4, D2 | - | leg B, high-side gate, 10 kOhm pull-down
#define BOARD_B_LOW_BIT PE5   // PE5, D3 | - | leg B, low-side gate, 10 kOhm pull-down
#define BOARD_CONTACT_PORT PORTA
#define BOARD_CONTACT_PIN PINA
#define BOARD_CONTACT_BIT PA0  // PA0, D22 | - | trigger contact, closes to ground, pull-up
#define BOARD_REVERSE_PORT PORTA
#define BOARD_REVERSE_PIN PINA
#define BOARD_REVERSE_BIT PA1  // PA1, D23 | - | direction switch, reverse closes to ground, pull-up
#define BOARD_MODE_PORT PORTA
#define BOARD_MODE_PIN PINA
#define BOARD_MODE_0_BIT PA2  // PA2, D24 | - | mode switch, bit 0, closes to ground, pull-up
#define BOARD_MODE_1_BIT PA3  // PA3, D25 | - | mode switch, bit 1, closes to ground, pull-up
#define BOARD_RX_BIT PE0      // PE0, D0 | RXD0 | from the RS232 level shifter
#define BOARD_TX_BIT PE1      // PE1, D1 | TXD0 | to the RS232 level shifter
#define BOARD_ADC_CURRENT 0u  // PF0, A0 | ADC0 | current sensor, 2.5 V at 0 A, 0.125 A per count
#define BOARD_ADC_BUS 1u      // PF1, A1 | ADC1 | bus voltage, divider 5.12 : 1, 25 mV per count
#define BOARD_ADC_TRIGGER 2u  // PF2, A2 | ADC2 | trigger potentiometer
#define BOARD_ADC_TEMPERATURE 3u  // PF3, A3 | ADC3 | TMP36 at the bridge
// timers
#define BOARD_PWM_TIMER 0   // Timer0 | OC0A, OC0B | phase-correct PWM 31,372.5 Hz; ADC at BOTTOM
#define BOARD_HALL_TIMER 5  // Timer5 | ICP5 | free running, clk/1; captures the Hall edges
#define BOARD_TICK_TIMER 2  // Timer2 | - | CTC, tick every 16,000 cycles; compare B 256 later
// registers of the Hall timer
#define BOARD_TCCRA TCCR5A
#define BOARD_TCCRB TCCR5B
#define BOARD_TCNT TCNT5
#define BOARD_ICR ICR5
#define BOARD_TIMSK TIMSK5
#define BOARD_TIFR TIFR5
#define BOARD_CAPT_vect TIMER5_CAPT_vect
#define BOARD_RX_vect USART0_RX_vect
#define BOARD_UDRE_vect USART0_UDRE_vect
// end
#else
#error "no pin list for this MCU"
#endif

#define BOARD_TICK_TOP 249u  // 16 MHz / 64 / 250 = 1 kHz
#define BOARD_TICK_LATER 3u  // 256 cycles after the tick

// The bits of the input capture have the same positions in Timer1 and Timer5.
#define BOARD_ICNC ICNC1
#define BOARD_ICES ICES1
#define BOARD_CS_CLK1 CS10
#define BOARD_ICIE ICIE1
#define BOARD_ICF ICF1

#endif
