// Interrupts: read the hardware, hand over to the application, leave. Timer2 comes first by its vector number on both chips.
#include <avr/interrupt.h>
#include <avr/io.h>

#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

_Static_assert(HAL_ADC_CURRENT == BOARD_ADC_CURRENT && HAL_ADC_BUS == BOARD_ADC_BUS && HAL_ADC_TRIGGER == BOARD_ADC_TRIGGER &&
                   HAL_ADC_TEMPERATURE == BOARD_ADC_TEMPERATURE,
               "ADC inputs are wired in the order of HAL_ADC_*");

ISR(TIMER2_COMPA_vect) {
    avr_ticks_waiting++;
    app_on_tick(&avr_app);
}

// With the tick or 256 cycles after it, see hal_apply_at.
ISR(TIMER2_COMPB_vect) {
    app_on_apply(&avr_app);
}

// Both edges count: the next one is the opposite of the level now, which also finds back after an edge that came too fast.
ISR(BOARD_CAPT_vect) {
    const uint16_t stamp = BOARD_ICR;
    uint8_t control = (1u << BOARD_ICNC) | (1u << BOARD_ICES) | (1u << BOARD_CS_CLK1);
    if ((BOARD_HALL_PIN & (1u << BOARD_HALL_BIT)) != 0u) {
        control = (1u << BOARD_ICNC) | (1u << BOARD_CS_CLK1);
    }
    BOARD_TCCRB = control;
    BOARD_TIFR = 1u << BOARD_ICF;  // changing the edge may have set it (data sheet, "Input Capture Unit")
    app_on_edge(&avr_app, stamp);
}

// First of all the channel of the next conversion, then its trigger flag (data sheet, "Changing Channel"): both must be done before the next
// trigger, 309 cycles after this result.
ISR(ADC_vect) {
    ADMUX = (uint8_t)((1u << REFS0) | app_next_channel(&avr_app));
    TIFR0 = 1u << TOV0;
    app_on_sample(&avr_app, ADC);
}

ISR(BOARD_RX_vect) {
    const uint8_t status = UCSR0A;
    const uint8_t byte = UDR0;
    app_on_received(&avr_app, byte, (status & ((1u << FE0) | (1u << DOR0))) != 0u);
}

ISR(BOARD_UDRE_vect) {
    uint8_t byte = 0;
    if (app_on_ready(&avr_app, &byte)) {
        UDR0 = byte;
    } else {
        UCSR0B = (uint8_t)(UCSR0B & ~(1u << UDRIE0));
    }
}
