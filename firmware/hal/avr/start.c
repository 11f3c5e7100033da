// Start of pins, ADC and timers after a reset.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>

#include "drivers/adc_sequence.h"
#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

#define ADC_PRESCALE_128 ((1u << ADPS2) | (1u << ADPS1) | (1u << ADPS0))
#define ADC_TRIGGER_TIMER0_OVERFLOW (1u << ADTS2)

#define RESET_CAUSES ((1u << PORF) | (1u << EXTRF) | (1u << BORF) | (1u << WDRF))

// In .noinit: the reset cause is stored before .bss is cleared.
uint8_t avr_reset_cause __attribute__((section(".noinit")));

void avr_boot_loader(void) __attribute__((naked, used, section(".init0")));
void avr_first(void) __attribute__((naked, used, section(".init3")));

// Optiboot clears MCUSR and hands its value over in r2 (optiboot.c, appStart()), which the start-up
// code keeps until .init2.
void avr_boot_loader(void) {
    __asm__ volatile("sts avr_reset_cause, r2");
}

// After a watchdog reset the watchdog remains enabled with its shortest timeout (avr-libc manual,
// <avr/wdt.h>).
void avr_first(void) {
    const uint8_t cause = MCUSR & RESET_CAUSES;
    if (cause != 0u) {
        avr_reset_cause = cause;  // no boot loader, or one that leaves MCUSR alone
    } else if (avr_reset_cause > RESET_CAUSES) {
        avr_reset_cause = 0;  // r2 holds no MCUSR
    }
    MCUSR = 0;
    wdt_disable();
}

static void start_adc(void) {
    DIDR0 = 0x0Fu;
    ADMUX = (uint8_t)((1u << REFS0) | adc_sequence_channel(0));
    // The first conversion takes 25 instead of 13.5 ADC clocks: done here, so that all scheduled
    // ones take equally long.
    ADCSRA = (1u << ADEN) | (1u << ADSC) | ADC_PRESCALE_128;
    while ((ADCSRA & (1u << ADSC)) != 0u) {
    }
    ADCSRB = ADC_TRIGGER_TIMER0_OVERFLOW;
    TIFR0 = 1u << TOV0;
    ADCSRA = (1u << ADEN) | (1u << ADATE) | (1u << ADIF) | (1u << ADIE) | ADC_PRESCALE_128;
}

void avr_start_pins(void) {
    // After a reset all PORT bits are 0 and the compare outputs disconnected: the gates stay off
    // when the pins become outputs.
    TCCR0A = 1u << WGM00;
    OCR0B = HAL_COMPARE_MAX;
    BOARD_ENABLE_DDR |= 1u << BOARD_ENABLE_BIT;
    BOARD_A_HIGH_DDR |= 1u << BOARD_A_HIGH_BIT;
    BOARD_A_LOW_DDR |= 1u << BOARD_A_LOW_BIT;
    BOARD_B_DDR |= (1u << BOARD_B_HIGH_BIT) | (1u << BOARD_B_LOW_BIT);
    BOARD_HALL_PORT |= 1u << BOARD_HALL_BIT;
    BOARD_CONTACT_PORT |= 1u << BOARD_CONTACT_BIT;
    BOARD_REVERSE_PORT |= 1u << BOARD_REVERSE_BIT;
    BOARD_MODE_PORT |= (1u << BOARD_MODE_0_BIT) | (1u << BOARD_MODE_1_BIT);
}

// Timer2 starts when its prescaler is released, the other two 2 and 4 cycles later (one sts each),
// with initial counts as if all had started at 0 together.
static void release_timers(uint8_t hall_control) {
    BOARD_TCNT = 2;
    TCNT0 = 4;
    __asm__ volatile("sts %[gtccr], __zero_reg__\n\t"
                     "sts %[tccr_hall], %[hall]\n\t"
                     "sts %[tccr0b], %[pwm]\n\t"
                     :
                     : [gtccr] "n"(_SFR_MEM_ADDR(GTCCR)),
                       [tccr_hall] "n"(_SFR_MEM_ADDR(BOARD_TCCRB)), [hall] "r"(hall_control),
                       [tccr0b] "n"(_SFR_MEM_ADDR(TCCR0B)), [pwm] "r"((uint8_t)(1u << CS00)));
}

void avr_start_timers(void) {
    const bool hall_high = (BOARD_HALL_PIN & (1u << BOARD_HALL_BIT)) != 0u;
    start_adc();
    GTCCR = (1u << TSM) | (1u << PSRASY) | (1u << PSRSYNC);
    OCR2A = BOARD_TICK_TOP;
    OCR2B = BOARD_TICK_TOP;
    TCCR2A = 1u << WGM21;
    TCCR2B = 1u << CS22;
    TCNT2 = 0;
    TIMSK2 = (1u << OCIE2A) | (1u << OCIE2B);
    BOARD_TCCRA = 0;
    BOARD_TIMSK = 1u << BOARD_ICIE;
    release_timers((uint8_t)((1u << BOARD_ICNC) | (hall_high ? 0u : 1u << BOARD_ICES) |
                             (1u << BOARD_CS_CLK1)));
}
