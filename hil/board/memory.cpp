// SPDX-License-Identifier: GPL-3.0-or-later
// Timing of EEPROM and watchdog: ATmega328P data sheet, "EEPROM Data Memory" (3.4 ms per byte) and
// "Watchdog Timer" (128 kHz).
#include "memory.hpp"

#include <utility>

extern "C" {
#include <simavr/avr_watchdog.h>
}

namespace board {
namespace {

constexpr unsigned EECR = 0x3f;
constexpr unsigned EEDR = 0x40;
constexpr unsigned EEARL = 0x41;
constexpr unsigned EEARH = 0x42;
constexpr std::uint8_t EERE = 0x01;
constexpr std::uint8_t EEPE = 0x02;
constexpr std::uint8_t EEMPE = 0x04;
constexpr std::uint8_t EERIE = 0x08;
constexpr Cycle READ_STALL = 4;
constexpr Cycle WRITE_STALL = 2;
constexpr Cycle ENABLE_WINDOW = 6;      // four cycles after the SBI (2 cycles) that set EEMPE
constexpr Cycle ATOMIC_CYCLES = 54400;  // erase and write: 3.4 ms
constexpr Cycle HALF_CYCLES = 28800;    // erase only, write only: 1.8 ms
constexpr unsigned WDTCSR = 0x60;
constexpr unsigned MCUSR = 0x54;
constexpr std::uint8_t WDIF = 0x80;
constexpr std::uint8_t WDIE = 0x40;
constexpr std::uint8_t WDCE = 0x10;
constexpr std::uint8_t WDE = 0x08;
constexpr std::uint8_t WDRF = 0x08;
constexpr std::uint8_t PRESCALE_BITS = 0x27;
constexpr Cycle CHANGE_WINDOW = 6;           // four cycles after the STS (2 cycles)
constexpr Cycle WATCHDOG_STEP = 2048 * 125;  // 2048 periods of 128 kHz in CPU cycles

}  // namespace

Eeprom::Eeprom(Machine &machine, int vector, std::vector<std::uint8_t> content, std::uint32_t seed)
    : machine_(machine),
      vector_(vector),
      content_(std::move(content)),
      random_(seed) {
    content_.resize(static_cast<std::size_t>(machine.eeprom_size()), 0xff);
    machine.add(*this);
    machine.serve(vector, *this);
    machine.own(EECR, *this);
}

unsigned Eeprom::address() const {
    return (machine_.peek(EEARL) | static_cast<unsigned>(machine_.peek(EEARH)) << 8) %
           static_cast<unsigned>(content_.size());
}

void Eeprom::start_write(unsigned mode) {
    busy_ = true;
    target_ = address();
    const std::uint8_t data = machine_.peek(EEDR);
    value_ = mode == 1   ? 0xff
             : mode == 2 ? static_cast<std::uint8_t>(content_[target_] & data)
                         : data;
    content_[target_] = static_cast<std::uint8_t>(random_());
    done_at_ = machine_.now() + (mode == 0 ? ATOMIC_CYCLES : HALF_CYCLES);
    first_write_ = first_write_ < 0 ? machine_.now() : first_write_;
    ++writes_;
    machine_.stall(WRITE_STALL);
}

void Eeprom::write(unsigned short, std::uint8_t value) {
    const Cycle now = machine_.now();
    advance(now);
    if ((value & EEPE) != 0 && !busy_ && now <= enabled_until_) {
        start_write(value >> 4 & 3u);
    } else if ((value & EEMPE) != 0) {
        enabled_until_ = now + ENABLE_WINDOW;
    }
    if ((value & EERE) != 0 && !busy_) {
        machine_.reg(EEDR) = content_[address()];
        machine_.stall(READ_STALL);
    }
    machine_.reg(EECR) = static_cast<std::uint8_t>(value & 0x38);
    update();
    machine_.refresh();
}

std::uint8_t Eeprom::read(unsigned short) {
    advance(machine_.now());
    const bool enabled = machine_.now() <= enabled_until_;
    return static_cast<std::uint8_t>((machine_.reg(EECR) & 0x38) | (busy_ ? EEPE : 0) |
                                     (enabled ? EEMPE : 0));
}

void Eeprom::advance(Cycle now) {
    if (done_at_ <= now) {
        end_write();
    }
    update();
}

void Eeprom::end_write() {
    if (busy_) {
        content_[target_] = value_;
        busy_ = false;
    }
}

void Eeprom::update() {
    machine_.line(vector_, !busy_ && (machine_.peek(EECR) & EERIE) != 0);
    due = busy_ ? done_at_ : NEVER;
}

// A reset does not stop a write that has begun, and it has ended before the first instruction: the
// start-up time of a board (65 ms, docs/hardware.md) is longer.
void Eeprom::reset() {
    end_write();
    enabled_until_ = -1;
    update();
}

Watchdog::Watchdog(Machine &machine, int vector) : machine_(machine), vector_(vector) {
    machine.add(*this);
    machine.serve(vector, *this);
    machine.own(WDTCSR, *this);
    port_.owner = this;
    port_.io.kind = "vgroove watchdog";
    port_.io.ioctl = ioctl_hook;
    machine.attach(port_.io);
}

int Watchdog::ioctl_hook(avr_io_t *io, std::uint32_t request, void *) {
    if (request != AVR_IOCTL_WATCHDOG_RESET) {
        return -1;
    }
    reinterpret_cast<Port *>(io)->owner->kick();
    return 0;
}

Cycle Watchdog::timeout() const {
    const unsigned control = machine_.peek(WDTCSR);
    return WATCHDOG_STEP << ((control & 7u) | (control & 0x20u) >> 2);
}

void Watchdog::restart() {
    due = (machine_.peek(WDTCSR) & (WDE | WDIE)) != 0 ? machine_.now() + timeout() : NEVER;
}

void Watchdog::kick() {
    restart();
    machine_.refresh();
}

// WDE and the prescaler can be changed only within four cycles of a write of WDCE and WDE together,
// WDIE and WDIF always.
void Watchdog::write(unsigned short, std::uint8_t value) {
    const std::uint8_t before = machine_.peek(WDTCSR);
    const bool open = machine_.now() <= change_until_;
    const bool opening = (value & WDCE) != 0 && (value & WDE) != 0;
    std::uint8_t kept = static_cast<std::uint8_t>(before & (WDE | PRESCALE_BITS));
    if (open && !opening) {
        kept = static_cast<std::uint8_t>(value & (WDE | PRESCALE_BITS));
        change_until_ = -1;
    } else if (opening) {
        kept |= WDE;
        change_until_ = machine_.now() + CHANGE_WINDOW;
    }
    if ((machine_.peek(MCUSR) & WDRF) != 0) {
        kept |= WDE;
    }
    const std::uint8_t flag = static_cast<std::uint8_t>(before & WDIF & ~value);
    machine_.reg(WDTCSR) = static_cast<std::uint8_t>(kept | flag | (value & WDIE));
    if (machine_.peek(WDTCSR) != before || due == NEVER) {
        restart();
    }
    machine_.line(vector_, flag != 0 && (value & WDIE) != 0);
    machine_.refresh();
}

std::uint8_t Watchdog::read(unsigned short) {
    return machine_.reg(WDTCSR);
}

void Watchdog::advance(Cycle now) {
    if (due > now) {
        return;
    }
    std::uint8_t &control = machine_.reg(WDTCSR);
    if ((control & WDIE) == 0) {
        machine_.reset(WDRF);
        return;
    }
    control |= WDIF;
    machine_.line(vector_, true);
    due = now + timeout();
}

void Watchdog::acknowledge(int) {
    std::uint8_t &control = machine_.reg(WDTCSR);
    control = static_cast<std::uint8_t>(control & ~((control & WDE) != 0 ? WDIF | WDIE : WDIF));
    machine_.line(vector_, false);
}

// After a watchdog reset the watchdog remains enabled, with its shortest timeout.
void Watchdog::reset() {
    change_until_ = -1;
    machine_.reg(WDTCSR) = (machine_.peek(MCUSR) & WDRF) != 0 ? WDE : 0;
    restart();
}

}  // namespace board
