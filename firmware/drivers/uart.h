// Queues of the serial line and counters of lost bytes and frames.
#ifndef VGROOVE_DRIVERS_UART_H
#define VGROOVE_DRIVERS_UART_H

#include <stdbool.h>
#include <stdint.h>

#include "core/ring.h"

typedef struct {
    RingFrames send;  // its items and those of `receive` follow one another, see hal/avr/avr.h
    RingBytes receive;
    volatile uint8_t receive_limit;   // head of `receive` at the last tick: later bytes belong to
                                      // the next tick
    volatile uint8_t receive_errors;  // overruns, bad stop bits, full queue; saturates
    volatile bool refuses;            // since the queue was full, until it is empty
    uint8_t room;                     // frames whose slots are in the queue, not in `spare`
    uint8_t send_lost;  // frames dropped by a full queue; 0 within the byte budget; not reported
} Uart;

void uart_init(Uart *self, uint8_t baud);

// Slots for up to two frames: in the queue, or in `spare` when it is full; those frames are lost.
void uart_places(Uart *self, uint8_t *place[2], uint8_t spare[2u * RING_FRAME]);
void uart_send(Uart *self, uint8_t frames);
bool uart_received(const Uart *self);  // bytes are pending
bool uart_receive(Uart *self, uint8_t *byte);

// Interrupts. on_tick: the beginning tick may take the bytes received so far. on_apply: later in
// the tick; receives again after a full queue, from which on no byte has been kept. on_ready: false
// when nothing is left to send.
void uart_on_tick(Uart *self);
void uart_on_apply(Uart *self);
void uart_on_received(Uart *self, uint8_t byte, bool damaged);
bool uart_on_ready(Uart *self, uint8_t *byte);

#endif
