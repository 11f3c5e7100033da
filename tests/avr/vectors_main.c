// Evaluates the golden vectors on the target and sends over the UART (250 kBd) "fail INDEX RESULT"
// for each that fails, finally "pass N of M".
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdio.h>

#include "hal/hal.h"
#include "vectors.h"

// Functions that the drivers need to link; no vector calls them.
uint8_t hal_lock(void) {
    return 0;
}

void hal_unlock(uint8_t before) {
    (void)before;
}

static void send(const char *text) {
    for (; *text != '\0'; text++) {
        while ((UCSR0A & (1u << UDRE0)) == 0u) {
        }
        UDR0 = (uint8_t)*text;
    }
}

int main(void) {
    char line[32];
    uint16_t passed = 0;
    hal_uart_start(HAL_BAUD_250000);
    for (uint16_t k = 0; k < VECTORS_COUNT; k++) {
        const Vector v = vectors_at(k);
        const int32_t got = vectors_evaluate(v.function, v.a, v.b);
        if (got == v.expected) {
            passed++;
        } else {
            (void)snprintf(line, sizeof line, "fail %u %ld\n", (unsigned)k, (long)got);
            send(line);
        }
    }
    (void)snprintf(line, sizeof line, "pass %u of %u\n", (unsigned)passed, (unsigned)VECTORS_COUNT);
    send(line);
    // Wait until the last byte is sent, then sleep forever.
    UCSR0A |= 1u << TXC0;
    while ((UCSR0A & (1u << TXC0)) == 0u) {
    }
    cli();
    sleep_enable();
    for (;;) {
        sleep_cpu();
    }
}
