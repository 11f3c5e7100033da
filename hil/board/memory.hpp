// SPDX-License-Identifier: GPL-3.0-or-later
// EEPROM with its write time and power cuts, and watchdog with its resets.
#ifndef VGROOVE_BOARD_MEMORY_HPP
#define VGROOVE_BOARD_MEMORY_HPP

#include <random>

#include "machine.hpp"

namespace board {

class Eeprom final : public Device {
public:
    Eeprom(Machine &machine, int vector, std::vector<std::uint8_t> content, std::uint32_t seed);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle now) override;
    void acknowledge(int) override {}
    void reset() override;
    const std::vector<std::uint8_t> &content() const { return content_; }
    long writes() const { return writes_; }
    Cycle first_write() const { return first_write_; }

private:
    unsigned address() const;
    void start_write(unsigned mode);
    void end_write();
    void update();

    Machine &machine_;
    int vector_;
    std::vector<std::uint8_t> content_;  // a byte being written is random, as after a power cut
    std::mt19937 random_;
    bool busy_ = false;
    Cycle enabled_until_ = -1;
    Cycle done_at_ = NEVER;
    unsigned target_ = 0;
    std::uint8_t value_ = 0;
    long writes_ = 0;
    Cycle first_write_ = -1;
};

class Watchdog final : public Device {
public:
    Watchdog(Machine &machine, int vector);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle now) override;
    void acknowledge(int vector) override;
    void reset() override;
    void kick();

private:
    static int ioctl_hook(avr_io_t *io, std::uint32_t request, void *);
    Cycle timeout() const;
    void restart();

    struct Port {
        avr_io_t io;
        Watchdog *owner;
    };
    Machine &machine_;
    int vector_;
    Port port_{};
    Cycle change_until_ = -1;
};

}  // namespace board

#endif
