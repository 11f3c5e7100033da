// Serial line, see uart.h.
#include "drivers/uart.h"

#include "hal/hal.h"

void uart_init(Uart *self, uint8_t baud) {
    *self = (Uart){0};
    hal_uart_start(baud);
}

void uart_send(Uart *self, const uint8_t *bytes, uint8_t count) {
    if (count == 0u) {
        return;
    }
    if (ring_push_bytes(&self->send, bytes, count)) {
        hal_uart_wake();
    } else if (self->send_lost < UINT8_MAX) {
        self->send_lost++;
    }
}

bool uart_received(const Uart *self) {
    return self->receive.tail != self->receive_limit;
}

bool uart_receive(Uart *self, uint8_t *byte) {
    const uint8_t tail = self->receive.tail;
    if (tail == self->receive_limit) {
        return false;
    }
    *byte = self->receive.items[tail % RING_BYTES];
    self->receive.tail = (uint8_t)(tail + 1u);
    return true;
}

void uart_on_tick(Uart *self) {
    self->receive_limit = self->receive.head;
}

void uart_on_received(Uart *self, uint8_t byte, bool damaged) {
    const bool kept = !damaged && ring_push_byte(&self->receive, byte);
    if (!kept && self->receive_errors < UINT8_MAX) {
        self->receive_errors = (uint8_t)(self->receive_errors + 1u);
    }
}

bool uart_on_ready(Uart *self, uint8_t *byte) {
    return ring_pop_byte(&self->send, byte);
}
