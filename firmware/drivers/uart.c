// Serial line, see uart.h.
#include "drivers/uart.h"

#include "hal/hal.h"

void uart_init(Uart *self, uint8_t baud) {
    *self = (Uart){0};
    ring_clear_frames(&self->send);
    hal_uart_start(baud);
}

void uart_places(Uart *self, uint8_t *place[2], uint8_t spare[2u * RING_FRAME]) {
    const uint8_t room = ring_frames_free(&self->send);
    place[0] = room > 0u ? ring_frame_at(&self->send, 0) : spare;
    place[1] = room > 1u ? ring_frame_at(&self->send, 1) : &spare[RING_FRAME];
    self->room = room;
}

void uart_send(Uart *self, uint8_t frames) {
    uint8_t sent = frames;
    if (frames == 0u) {
        return;
    }
    if (frames > self->room) {
        sent = self->room;
        self->send_lost = (uint8_t)(self->send_lost + (self->send_lost < UINT8_MAX ? 1u : 0u));
    }
    ring_push_frames(&self->send, sent);
    hal_uart_wake();
}

bool uart_received(const Uart *self) {
    return self->receive.tail != self->receive_limit;
}

bool uart_receive(Uart *self, uint8_t *byte) {
    const uint8_t tail = self->receive.tail;
    if (tail == self->receive_limit) {
        return false;
    }
    *byte = self->receive.items[tail];
    self->receive.tail = (uint8_t)(tail + 1u) % RING_BYTES;
    return true;
}

void uart_on_tick(Uart *self) {
    self->receive_limit = self->receive.head;
}

void uart_on_apply(Uart *self) {
    if (self->refuses && self->receive.tail == self->receive.head) {
        self->refuses = false;
        hal_uart_receive(true);
    }
}

void uart_on_received(Uart *self, uint8_t byte, bool damaged) {
    if (!damaged && ring_push_byte(&self->receive, byte)) {
        return;
    }
    if (!damaged) {
        self->refuses = true;
        hal_uart_receive(false);
    }
    if (self->receive_errors < UINT8_MAX) {
        self->receive_errors = (uint8_t)(self->receive_errors + 1u);
    }
}

bool uart_on_ready(Uart *self, uint8_t *byte) {
    return ring_pop_frame_byte(&self->send, byte);
}
