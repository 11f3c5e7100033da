// The two byte queues of the serial line and what was lost on them.
#ifndef VGROOVE_DRIVERS_UART_H
#define VGROOVE_DRIVERS_UART_H

#include <stdbool.h>
#include <stdint.h>

#include "core/ring.h"

typedef struct {
    RingFrames send;
    RingBytes receive;
    volatile uint8_t receive_limit;   // head of the receive queue at the last tick: bytes that came
                                      // later wait for the next
    volatile uint8_t receive_errors;  // overruns, bad stop bits, full queue; saturates
    uint8_t room;                     // frames that the places given last lie in the queue for
    uint8_t send_lost;  // messages that found the queue full; saturates, 0 as long as the byte
                        // budget holds
} Uart;

void uart_init(Uart *self, uint8_t baud);

// Places for up to two frames, where the queue has room; otherwise in `spare`, and the frame is
// lost.
void uart_places(Uart *self, uint8_t *place[2], uint8_t spare[2u * RING_FRAME]);
void uart_send(Uart *self, uint8_t frames);
bool uart_received(const Uart *self);  // something waits
bool uart_receive(Uart *self, uint8_t *byte);

// Interrupts. on_tick: the tick that begins may take the bytes received so far. on_ready: false
// when nothing is left to send.
void uart_on_tick(Uart *self);
void uart_on_received(Uart *self, uint8_t byte, bool damaged);
bool uart_on_ready(Uart *self, uint8_t *byte);

#endif
