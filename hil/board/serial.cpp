// SPDX-License-Identifier: GPL-3.0-or-later
// USART0: asynchronous, 8 data bits, no parity, one stop bit; other formats end the run.
#include "serial.hpp"

namespace board {
namespace {

constexpr unsigned UCSRA = 0xc0;
constexpr unsigned UCSRB = 0xc1;
constexpr unsigned UCSRC = 0xc2;
constexpr unsigned UBRRL = 0xc4;
constexpr unsigned UBRRH = 0xc5;
constexpr unsigned UDR = 0xc6;
constexpr std::uint8_t RXC = 0x80;
constexpr std::uint8_t TXC = 0x40;
constexpr std::uint8_t UDRE = 0x20;
constexpr std::uint8_t DOR = 0x08;
constexpr std::uint8_t U2X = 0x02;
constexpr std::uint8_t RXEN = 0x10;
constexpr std::uint8_t TXEN = 0x08;
constexpr std::uint8_t FRAME_8N1 = 0x06;
constexpr std::size_t RECEIVE_DEPTH = 3;  // two buffers and the shift register
constexpr Cycle FRAME_BITS = 10;
constexpr long CPU_HZ = 16000000;

}  // namespace

Serial::Serial(Machine &machine, int receive, int empty, int complete)
    : machine_(machine),
      receive_(receive),
      empty_(empty),
      complete_(complete) {
    machine.add(*this);
    for (const int vector : {receive, empty, complete}) {
        machine.serve(vector, *this);
    }
    for (const unsigned address : {UCSRA, UCSRB, UCSRC, UBRRL, UBRRH, UDR}) {
        machine.own(address, *this);
    }
    reset();
}

Cycle Serial::byte_cycles() const {
    const Cycle divisor = 1 + (machine_.peek(UBRRL) | (machine_.peek(UBRRH) & 0x0f) << 8);
    return ((machine_.peek(UCSRA) & U2X) != 0 ? 8 : 16) * divisor * FRAME_BITS;
}

void Serial::write(unsigned short address, std::uint8_t value) {
    advance(machine_.now());
    if (address == UCSRA) {
        complete_flag_ = complete_flag_ && (value & TXC) == 0;
        machine_.reg(UCSRA) =
            static_cast<std::uint8_t>((machine_.reg(UCSRA) & ~U2X) | (value & U2X));
    } else if (address == UDR) {
        send(value);
    } else {
        if (address == UCSRC && value != FRAME_8N1) {
            throw BoardError(
                "the bench models the UART with 8 data bits, no parity and one stop bit only");
        }
        machine_.reg(address) = value;
    }
    if (enabled(RXEN | TXEN)) {
        report_.baud = CPU_HZ * FRAME_BITS / byte_cycles();
    }
    update();
    machine_.refresh();
}

void Serial::send(std::uint8_t value) {
    if (!enabled(TXEN) || waiting_) {
        return;  // silicon ignores a write to a full buffer
    }
    if (shifting_) {
        buffer_ = value;
        waiting_ = true;
        return;
    }
    shift_ = value;
    shifting_ = true;
    done_at_ = machine_.now() + byte_cycles();
}

std::uint8_t Serial::read(unsigned short address) {
    advance(machine_.now());
    if (address != UDR) {
        return machine_.reg(address);
    }
    std::uint8_t value = machine_.reg(UDR);
    if (!received_.empty()) {
        value = received_.front();
        received_.pop_front();
        overrun_ = false;
    }
    update();
    machine_.refresh();
    return value;
}

void Serial::receive(std::uint8_t byte) {
    if (!enabled(RXEN)) {
        return;
    }
    if (received_.size() == RECEIVE_DEPTH) {
        overrun_ = true;
        ++report_.overruns;
        return;
    }
    ++report_.received;
    received_.push_back(byte);
}

void Serial::finish_byte() {
    ++report_.sent;
    sent_.push_back(shift_);
    shifting_ = waiting_;
    if (waiting_) {
        shift_ = buffer_;
        waiting_ = false;
        done_at_ += byte_cycles();
        return;
    }
    done_at_ = NEVER;
    complete_flag_ = true;
}

void Serial::advance(Cycle now) {
    while (done_at_ <= now) {
        finish_byte();
    }
    while (!arriving_.empty() && arriving_.front().first <= now) {
        receive(arriving_.front().second);
        arriving_.pop_front();
    }
    update();
}

void Serial::update() {
    std::uint8_t &status = machine_.reg(UCSRA);
    status = static_cast<std::uint8_t>((status & U2X) | (received_.empty() ? 0 : RXC) |
                                       (complete_flag_ ? TXC : 0) | (waiting_ ? 0 : UDRE) |
                                       (overrun_ ? DOR : 0));
    machine_.line(receive_, !received_.empty() && enabled(0x80));
    machine_.line(empty_, !waiting_ && enabled(0x20));
    machine_.line(complete_, complete_flag_ && enabled(0x40));
    const Cycle arrival = arriving_.empty() ? NEVER : arriving_.front().first;
    due = done_at_ < arrival ? done_at_ : arrival;
}

void Serial::acknowledge(int vector) {
    if (vector == complete_) {
        complete_flag_ = false;
        update();
    }
}

void Serial::reset() {
    shifting_ = waiting_ = complete_flag_ = overrun_ = false;
    received_.clear();
    done_at_ = NEVER;
    machine_.reg(UCSRC) = FRAME_8N1;
    update();
}

void Serial::arrive(Cycle at, std::uint8_t byte) {
    arriving_.emplace_back(at, byte);
    update();
    machine_.refresh();
}

bool Serial::take(std::uint8_t &byte) {
    if (sent_.empty()) {
        return false;
    }
    byte = sent_.front();
    sent_.pop_front();
    return true;
}

}  // namespace board
