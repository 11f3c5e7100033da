// SPDX-License-Identifier: GPL-3.0-or-later
// Check of the bridge: the run ends when both transistors of a leg conduct, or when they switch
// within the dead time.
#include "bridge.hpp"

#include <algorithm>

namespace board {
namespace {

constexpr unsigned TCCR0A = 0x44;
constexpr unsigned OCR0A = 0x47;
constexpr unsigned OCR0B = 0x48;

}  // namespace

Ports::Ports(Machine &machine, const BoardMap &map) : machine_(machine), map_(map) {
    machine.add(*this);
    for (const unsigned port : map.ports) {
        for (unsigned i = 0; i < 3; ++i) {
            machine.own(port + i, *this);
        }
    }
}

unsigned Ports::base_of(unsigned address) const {
    for (const unsigned port : map_.ports) {
        if (address >= port && address < port + 3) {
            return port;
        }
    }
    return address;
}

void Ports::write(unsigned short address, std::uint8_t value) {
    const unsigned port = base_of(address);
    if (address == port) {
        machine_.reg(port + 2) = static_cast<std::uint8_t>(machine_.reg(port + 2) ^
                                                           value);  // writing PINx toggles PORTx
    } else {
        machine_.reg(address) = value;
    }
    if (bridge_ != nullptr) {
        bridge_->changed();
    }
}

// An input without a driver reads its pull-up, or low without one.
std::uint8_t Ports::read(unsigned short address) {
    const unsigned port = base_of(address);
    if (address != port) {
        return machine_.reg(address);
    }
    const std::uint8_t outputs = machine_.reg(port + 1);
    const std::uint8_t levels = machine_.reg(port + 2);
    return static_cast<std::uint8_t>((levels & outputs) | (levels & ~outputs & ~pulled_low_[port]));
}

void Ports::reset() {
    if (bridge_ != nullptr) {
        bridge_->changed();
    }
}

void Ports::pull(const Pin &pin, bool low) {
    std::uint8_t &mask = pulled_low_[pin.port];
    const unsigned bit = 1u << pin.bit;
    mask = static_cast<std::uint8_t>(low ? mask | bit : mask & ~bit);
}

void Ports::drive_switches(unsigned switches) {
    for (const auto &[pin, mask] : map_.switches) {
        pull(pin, (switches & mask) != 0);
    }
}

Bridge::Bridge(Machine &machine, const BoardMap &map, const Timer &pwm, Cycle least_dead)
    : machine_(machine),
      map_(map),
      pwm_(pwm),
      least_dead_(least_dead) {}

// A gate whose pin is an input is off by its pull-down; all gates are off until the driver is
// enabled.
Bridge::Drive Bridge::drive_of(int gate) const {
    const Pin &pin = map_.gates[static_cast<std::size_t>(gate)];
    const auto high = [this](unsigned address, int bit) {
        return (machine_.peek(address) >> bit & 1) != 0;
    };
    const bool enabled =
        high(map_.enable.port + 1, map_.enable.bit) && high(map_.enable.port + 2, map_.enable.bit);
    const bool output = enabled && high(pin.port + 1, pin.bit);
    const unsigned com =
        gate > LEG_A_LOW
            ? 0u
            : static_cast<unsigned>(machine_.peek(TCCR0A)) >> (gate == LEG_A_HIGH ? 6 : 4) & 3u;
    if (!output) {
        return Drive::OFF;
    }
    if (com == 0) {
        return high(pin.port + 2, pin.bit) ? Drive::ON : Drive::OFF;
    }
    if (com == 1 || !pwm_.phase_correct()) {
        throw BoardError("a gate is connected to Timer0 in another mode than phase-correct PWM");
    }
    return com == 2 ? Drive::WAVE : Drive::INVERTED;
}

Bridge::Drives Bridge::drives_now() const {
    Drives drives{};
    for (int gate = 0; gate < GATES; ++gate) {
        drives[static_cast<std::size_t>(gate)] = drive_of(gate);
    }
    return drives;
}

void Bridge::changed() {
    const Drives drives = drives_now();
    const Drives &before =
        current_.changes.empty() ? current_.drives : current_.changes.back().drives;
    if (drives != before) {
        current_.changes.push_back({machine_.now(), drives});
    }
}

bool Bridge::level(const Period &period, const Drives &drives, int gate, Cycle at) {
    const auto index = static_cast<std::size_t>(gate);
    const Drive drive = drives[index];
    if (drive == Drive::OFF || drive == Drive::ON) {
        return drive == Drive::ON;
    }
    const Cycle bottom = period.start + TIMER_TOP;
    const bool around_bottom =
        at >= bottom - period.latched[index] && at < bottom + period.latched[index];
    return around_bottom == (drive == Drive::WAVE);
}

void Bridge::turned_on(int leg, const char *which, Cycle at, Cycle other_off) {
    const Cycle dead = at - other_off;
    shortest_dead_ = std::min(shortest_dead_, dead);
    if (dead < least_dead_) {
        throw BoardError("shoot-through: " + std::string(which) + " side of leg " +
                         (leg == 0 ? "A" : "B") + " turns on " + std::to_string(dead) +
                         " cycles after the other side turned off, at cycle " + std::to_string(at));
    }
}

void Bridge::set_leg(int leg, bool high, bool low, Cycle at) {
    Leg &state = legs_[static_cast<std::size_t>(leg)];
    if (high && low) {
        throw BoardError("shoot-through: both sides of leg " + std::string(leg == 0 ? "A" : "B") +
                         " are on at cycle " + std::to_string(at));
    }
    state.high_off = state.high && !high ? at : state.high_off;
    state.low_off = state.low && !low ? at : state.low_off;
    if (high && !state.high) {
        turned_on(leg, "the high", at, state.low_off);
    }
    if (low && !state.low) {
        turned_on(leg, "the low", at, state.high_off);
    }
    state.high = high;
    state.low = low;
}

void Bridge::check_instant(const Period &period, Cycle at) {
    const Drives *drives = &period.drives;
    for (const Change &change : period.changes) {
        drives = change.at <= at ? &change.drives : drives;
    }
    for (int leg = 0; leg < 2; ++leg) {
        set_leg(leg, level(period, *drives, 2 * leg, at), level(period, *drives, 2 * leg + 1, at),
                at);
    }
}

void Bridge::check(const Period &period) {
    const Cycle bottom = period.start + TIMER_TOP;
    std::vector<Cycle> instants{period.start};
    for (const int width : period.latched) {
        instants.push_back(bottom - width);
        instants.push_back(bottom + width);
    }
    for (const Change &change : period.changes) {
        instants.push_back(change.at);
    }
    std::sort(instants.begin(), instants.end());
    for (const Cycle at : instants) {
        if (at >= period.start && at < period.end) {
            check_instant(period, at);
        }
    }
}

// A period equal to the previous one is not checked again; when the repetition ends, its last
// period is checked for its switching times.
void Bridge::end_period(Cycle start, Cycle end) {
    current_.start = start;
    current_.end = end;
    const bool repeated = current_.repeats(last_);
    if (!repeated) {
        if (skipped_) {
            check(last_);
        }
        check(current_);
    }
    skipped_ = repeated;
    last_ = current_;
    if (!current_.changes.empty()) {
        current_.drives = current_.changes.back().drives;
    }
    current_.changes.clear();
    current_.latched = {machine_.peek(OCR0A), machine_.peek(OCR0B)};
}

// The counts between the two compare values of leg A, in which neither side is on, and their
// middle.
BridgeOutput Bridge::output() const {
    BridgeOutput output;
    const auto on = [this](int gate) {
        return current_.drives[static_cast<std::size_t>(gate)] == Drive::ON;
    };
    const bool switching =
        current_.drives[LEG_A_HIGH] == Drive::WAVE && current_.drives[LEG_A_LOW] == Drive::INVERTED;
    if (!switching || on(LEG_B_HIGH) == on(LEG_B_LOW) || !pwm_.running()) {
        return output;
    }
    output.coast = false;
    const auto [high_below, low_above] = current_.latched;
    output.dead_counts = low_above - high_below;
    output.compare = high_below + output.dead_counts / 2 - (on(LEG_B_HIGH) ? TIMER_TOP : 0);
    return output;
}

}  // namespace board
