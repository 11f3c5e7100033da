// SPDX-License-Identifier: GPL-3.0-or-later
// Line of the Hall sensor to the capture pin: it toggles at exact cycles; with the noise canceller
// the capture unit receives a level 4 cycles later.
#ifndef VGROOVE_BOARD_HALL_LINE_HPP
#define VGROOVE_BOARD_HALL_LINE_HPP

#include <deque>

#include "bridge.hpp"

namespace board {

struct HallReport {
    long edges = 0;
    long captured = 0;
    long not_selected = 0;  // edges missed because the program had not changed the edge select
};

class HallLine final : public Device {
public:
    HallLine(Machine &machine, Timer &timer, Ports &ports, const Pin &pin);
    void edge(Cycle at);
    void write(unsigned short, std::uint8_t) override {}
    std::uint8_t read(unsigned short) override { return 0; }
    void advance(Cycle now) override;
    void acknowledge(int) override {}
    void reset() override {}
    const HallReport &report() const { return report_; }

private:
    void apply_level(Cycle at, bool high);
    void update();

    struct Level {
        Cycle at;
        bool high;
    };
    Machine &machine_;
    Timer &timer_;
    Ports &ports_;
    Pin pin_;
    bool high_ = true;           // open collector with pull-up
    bool filtered_high_ = true;  // level after the noise canceller
    std::deque<Cycle> edges_;
    std::deque<Level> filtering_;
    HallReport report_;
};

}  // namespace board

#endif
