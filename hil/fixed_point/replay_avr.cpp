// Replays records on the AVR, one at a time: sends '>' when it is ready for the next one, takes it
// from the UART (kinds as in replay.cpp), and sends the result in 1/256 of the format's step. The
// steps run between marks whose cycles vgroove-board counts.
#include <avr/io.h>

#include "replay_core.hpp"

namespace {

constexpr uint8_t MARK_CONTROL = 2;  // bit of TWBR that vgroove-board observes

void put(uint8_t byte) {
    while ((UCSR0A & (1u << UDRE0)) == 0) {
    }
    UDR0 = byte;
}

uint8_t get() {
    while ((UCSR0A & (1u << RXC0)) == 0) {
    }
    return UDR0;
}

template <class T> T taken() {
    T out;
    auto *bytes = reinterpret_cast<uint8_t *>(&out);
    for (uint16_t k = 0; k < sizeof out; ++k) {
        bytes[k] = get();
    }
    return out;
}

void put_scaled(replay::Result value) {
    auto scaled = static_cast<int32_t>(value * replay::Result(256));
    for (uint8_t k = 0; k < sizeof scaled; ++k) {
        put(static_cast<uint8_t>(scaled >> (8 * k)));
    }
}

template <class Stepped> void marked(Stepped &stepped) {
    TWBR = MARK_CONTROL;
    stepped.step();
    TWBR = 0;
}

replay::Controller controller;
replay::Filters filters;

void take_step() {
    controller.take(taken<replay::Step>());
    marked(controller);
    const replay::Output out = controller.output();
    put_scaled(out.requested_q15);
    put(out.state);
    put(out.stop_reason);
}

void take_filter() {
    filters.take(taken<replay::Filter>());
    marked(filters);
    put_scaled(filters.output().current_a_q9);
    put_scaled(filters.output().speed_rpm_q1);
}

}  // namespace

int main() {
    UCSR0A = 1u << U2X0;  // 16 MHz / 8: 2 MBd
    UBRR0 = 0;
    UCSR0C = (1u << UCSZ01) | (1u << UCSZ00);
    UCSR0B = (1u << RXEN0) | (1u << TXEN0);
    for (;;) {
        put('>');
        switch (get()) {
        case 'S':
            controller.start(taken<replay::Start>());
            break;
        case 'T':
            take_step();
            break;
        case 'F':
            take_filter();
            break;
        }
    }
}
