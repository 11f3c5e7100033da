// SPDX-License-Identifier: GPL-3.0-or-later
// Statistics from every interrupt entry, return and tick mark; nothing is sampled.
#include "profile.hpp"

#include <algorithm>

namespace board {
namespace {

constexpr unsigned MARKS = 0xb8;  // TWBR
constexpr unsigned TICK_MARK = 1;
constexpr unsigned CONTROL_MARK = 2;
constexpr Cycle WINDOW_CYCLES = 1600000;  // 100 ms

}  // namespace

Profile::Profile(Machine &machine, const Timer &tick) : machine_(machine), tick_(tick) {
    machine.own(MARKS, *this);
    machine.add(*this);
    machine.watch(*this);
}

void Profile::write(unsigned short, std::uint8_t value) {
    const unsigned before = machine_.peek(MARKS);
    machine_.reg(MARKS) = value;
    const unsigned set = value & ~before;
    const unsigned cleared = before & ~static_cast<unsigned>(value);
    if ((set & TICK_MARK) != 0) {
        begin_tick();
    } else if ((cleared & TICK_MARK) != 0) {
        end_tick();
    }
    if ((set & CONTROL_MARK) != 0) {
        control_began_ = machine_.now() - interrupt_total_;
    } else if ((cleared & CONTROL_MARK) != 0) {
        end_control();
    }
}

std::uint8_t Profile::read(unsigned short) {
    return machine_.reg(MARKS);
}

void Profile::begin_tick() {
    tick_match_ = tick_.last_compare_a();
    at_tick_ = counted_;
}

void Profile::end_tick() {
    const Cycle lasted = machine_.now() + 1 - tick_match_;
    ++ticks_.count;
    ticks_.total += lasted;
    ticks_.late += tick_.last_compare_a() != tick_match_ ? 1 : 0;
    if (lasted > ticks_.worst) {
        ticks_.worst = lasted;
        ticks_.worst_at = machine_.now();
        worst_tick_ = counted_;
        for (std::size_t i = 0; i < worst_tick_.size(); ++i) {
            worst_tick_[i] -= at_tick_[i];
        }
    }
}

void Profile::end_control() {
    const Cycle lasted = machine_.now() - interrupt_total_ - control_began_;
    ++controls_.count;
    controls_.total += lasted;
    if (lasted > controls_.worst) {
        controls_.worst = lasted;
        controls_.worst_at = machine_.now();
    }
}

void Profile::entered(int vector, Cycle at, Cycle waited, unsigned pc) {
    VectorCost &cost = vectors_[static_cast<std::size_t>(vector)];
    if (waited > cost.longest_wait) {
        cost.longest_wait = waited;
        cost.waited_at = pc;
    }
    lowest_stack_ = std::min(lowest_stack_, machine_.stack_pointer());
    since_ = since_ == 0 ? at : since_;
    frames_.push_back({vector, at, 0, machine_.context()});
}

void Profile::left(Cycle at) {
    if (frames_.empty()) {
        return;
    }
    const Frame frame = frames_.back();
    frames_.pop_back();
    const Cycle whole = at - frame.entered;
    const Cycle own = whole - frame.nested;
    VectorCost &cost = vectors_[static_cast<std::size_t>(frame.vector)];
    ++cost.count;
    cost.worst = std::max(cost.worst, own);
    cost.total += own;
    cost.changed += machine_.context() != frame.context ? 1 : 0;
    if (!frames_.empty()) {
        frames_.back().nested += whole;
    }
    add_interrupt_cycles(own, at);
}

void Profile::add_interrupt_cycles(Cycle cycles, Cycle at) {
    interrupt_total_ += cycles;
    if (at - window_start_ >= WINDOW_CYCLES) {
        worst_window_ = std::max(worst_window_, window_cycles_);
        window_start_ = at;
        window_cycles_ = 0;
    }
    window_cycles_ += cycles;
}

double Profile::worst_window_share() const {
    return static_cast<double>(std::max(worst_window_, window_cycles_)) /
           static_cast<double>(WINDOW_CYCLES);
}

void Profile::reset() {
    frames_.clear();
}

void Profile::count_addresses() {
    counted_.assign(machine_.flash_words(), 0);
    worst_tick_ = at_tick_ = counted_;
    machine_.count_addresses(counted_);
}

std::string Profile::address_table() const {
    std::string table;
    for (std::size_t i = 0; i < counted_.size(); ++i) {
        if (counted_[i] > 0) {
            table += std::to_string(2 * i) + " " + std::to_string(counted_[i]) + " " +
                     std::to_string(worst_tick_[i]) + "\n";
        }
    }
    return table;
}

// Records the bytes between the variables and the stack after the program's start; those that
// change later belong to the stack.
void Profile::snapshot_stack() {
    snapshot_.clear();
    for (unsigned address = machine_.ram_used_end(); address <= machine_.stack_pointer();
         ++address) {
        snapshot_.push_back(machine_.peek(address));
    }
}

// Bytes between the variables and the lowest stack byte used since then, or the lowest entry of an
// interrupt.
unsigned Profile::stack_free() const {
    unsigned lowest = lowest_stack_;
    for (unsigned i = 0; i < snapshot_.size(); ++i) {
        if (machine_.peek(machine_.ram_used_end() + i) != snapshot_[i]) {
            lowest = std::min(lowest, machine_.ram_used_end() + i - 1);
            break;
        }
    }
    return lowest + 1 - std::min(lowest + 1, machine_.ram_used_end());
}

}  // namespace board
