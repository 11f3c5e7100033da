// SPDX-License-Identifier: GPL-3.0-or-later
// Hall edges: pin level, noise canceller (four equal samples, ATmega328P data sheet, "Noise
// Canceler"), edge select.
#include "hall_line.hpp"

namespace board {
namespace {

constexpr Cycle FILTER_CYCLES = 4;

}  // namespace

HallLine::HallLine(Machine &machine, Timer &timer, Ports &ports, const Pin &pin)
    : machine_(machine),
      timer_(timer),
      ports_(ports),
      pin_(pin) {
    machine.add(*this);
}

void HallLine::edge(Cycle at) {
    edges_.push_back(at);
    update();
    machine_.refresh();
}

// The capture unit receives the level `high` at cycle `at`.
void HallLine::apply_level(Cycle at, bool high) {
    if (high == filtered_high_) {
        return;
    }
    filtered_high_ = high;
    if (timer_.captures(high)) {
        ++report_.captured;
        timer_.capture(at);
    } else {
        ++report_.not_selected;
    }
}

void HallLine::advance(Cycle now) {
    while (due <= now) {
        if (!filtering_.empty() && filtering_.front().at == due) {
            const Level level = filtering_.front();
            filtering_.pop_front();
            apply_level(level.at, level.high);
        } else {
            const Cycle at = edges_.front();
            edges_.pop_front();
            ++report_.edges;
            high_ = !high_;
            ports_.pull(pin_, !high_);
            filtering_.clear();  // a pulse shorter than the filter is suppressed
            filtering_.push_back({at + (timer_.filters() ? FILTER_CYCLES : 0), high_});
        }
        update();
    }
}

void HallLine::update() {
    const Cycle edge = edges_.empty() ? NEVER : edges_.front();
    const Cycle level = filtering_.empty() ? NEVER : filtering_.front().at;
    due = edge < level ? edge : level;
}

}  // namespace board
