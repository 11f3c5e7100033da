// UART0, 8N1.
#include <avr/io.h>

#include "hal/hal.h"

#define DIVIDER_250000 3u   // 16 MHz / 16 / (3 + 1), exact
#define DIVIDER_115200 16u  // double speed: 16 MHz / 8 / (16 + 1) = 117,647 Bd, +2.1 %

void hal_uart_start(uint8_t baud) {
    if (baud == HAL_BAUD_115200) {
        UCSR0A = 1u << U2X0;
        UBRR0 = DIVIDER_115200;
    } else {
        UCSR0A = 0;
        UBRR0 = DIVIDER_250000;
    }
    UCSR0C = (1u << UCSZ01) | (1u << UCSZ00);
    UCSR0B = (1u << RXCIE0) | (1u << RXEN0) | (1u << TXEN0);
}

void hal_uart_wake(void) {
    const uint8_t lock = hal_lock();  // interrupts change the other bits
    UCSR0B = (uint8_t)(UCSR0B | (1u << UDRIE0));
    hal_unlock(lock);
}

// Switches the reception of bytes. The receiver keeps two bytes while its interrupt is off, and
// loses those that follow; the two are discarded, so that no frame is composed of both sides of the
// loss.
void hal_uart_receive(bool on) {
    if (!on) {
        UCSR0B = (uint8_t)(UCSR0B & ~(1u << RXCIE0));
        return;
    }
    while ((UCSR0A & (1u << RXC0)) != 0u) {
        (void)UDR0;
    }
    UCSR0B = (uint8_t)(UCSR0B | (1u << RXCIE0));
}
