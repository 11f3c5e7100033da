// Gates: leg A on the compare outputs of Timer0, leg B and the driver's enable on port pins.
#include <avr/io.h>

#include "hal/avr/avr.h"
#include "hal/avr/board.h"
#include "hal/hal.h"

#define CONNECTED (AVR_DISCONNECTED | (1u << COM0A1) | (1u << COM0B1) | (1u << COM0B0))

// In the same order as the ADC interrupt.
void hal_bridge_cut(void) {
    BOARD_ENABLE_PORT = (uint8_t)(BOARD_ENABLE_PORT & ~(1u << BOARD_ENABLE_BIT));
    TCCR0A = AVR_DISCONNECTED;
    BOARD_B_PORT = (uint8_t)(BOARD_B_PORT & ~(1u << BOARD_B_HIGH_BIT));
    BOARD_B_PORT = (uint8_t)(BOARD_B_PORT & ~(1u << BOARD_B_LOW_BIT));
}

void hal_bridge_open(void) {
    hal_bridge_cut();
    OCR0A = 0;
    OCR0B = HAL_COMPARE_MAX;
}

void hal_bridge_arm(bool leg_b_high) {
    TCCR0A = CONNECTED;
    if (leg_b_high) {
        BOARD_B_PORT = (uint8_t)(BOARD_B_PORT | (1u << BOARD_B_HIGH_BIT));
    } else {
        BOARD_B_PORT = (uint8_t)(BOARD_B_PORT | (1u << BOARD_B_LOW_BIT));
    }
}

// The order of the two writes keeps the dead time even if a TOP occurs between them.
void hal_bridge_set(uint8_t high_below, uint8_t low_above) {
    if (high_below >= OCR0A) {
        OCR0B = low_above;
        OCR0A = high_below;
    } else {
        OCR0A = high_below;
        OCR0B = low_above;
    }
    BOARD_ENABLE_PORT = (uint8_t)(BOARD_ENABLE_PORT | (1u << BOARD_ENABLE_BIT));
}

// Compare B of Timer2: at the tick (its TOP), or four counts of 64 cycles after it.
void hal_apply_at(bool later) {
    OCR2B = later ? BOARD_TICK_LATER : BOARD_TICK_TOP;
}
