// SPDX-License-Identifier: GPL-3.0-or-later
// USART0 with its buffers: one byte waits behind the transmit shift register, two received bytes
// wait for the program.
#ifndef VGROOVE_BOARD_SERIAL_HPP
#define VGROOVE_BOARD_SERIAL_HPP

#include <deque>
#include <utility>

#include "machine.hpp"

namespace board {

struct SerialReport {
    long sent = 0;
    long received = 0;
    long overruns = 0;  // received bytes lost with three bytes unread
    long baud = 0;      // as the program set it, 0: never enabled
};

class Serial final : public Device {
public:
    Serial(Machine &machine, int receive, int empty, int complete);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle now) override;
    void acknowledge(int vector) override;
    void reset() override;

    void arrive(Cycle at, std::uint8_t byte);  // a byte whose stop bit ends at that cycle
    bool take(std::uint8_t &byte);             // next byte whose stop bit has ended
    Cycle byte_cycles() const;                 // of a character at the present rate
    const SerialReport &report() const { return report_; }

private:
    bool enabled(std::uint8_t mask) const { return (machine_.peek(0xc1) & mask) != 0; }
    void send(std::uint8_t value);
    void receive(std::uint8_t byte);
    void finish_byte();
    void update();

    Machine &machine_;
    int receive_, empty_, complete_;  // numbers of the vectors
    bool shifting_ = false;           // a byte is being sent
    bool waiting_ = false;            // a second one is in the buffer
    bool complete_flag_ = false;
    bool overrun_ = false;
    std::uint8_t shift_ = 0;
    std::uint8_t buffer_ = 0;
    Cycle done_at_ = NEVER;
    std::deque<std::uint8_t> received_;
    std::deque<std::pair<Cycle, std::uint8_t>> arriving_;
    std::deque<std::uint8_t> sent_;
    SerialReport report_;
};

}  // namespace board

#endif
