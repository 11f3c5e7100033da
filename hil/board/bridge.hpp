// SPDX-License-Identifier: GPL-3.0-or-later
// Port pins and the H-bridge on them: gate signals from compare registers, COM bits and ports, with
// the check of the dead time.
#ifndef VGROOVE_BOARD_BRIDGE_HPP
#define VGROOVE_BOARD_BRIDGE_HPP

#include "board_map.hpp"

namespace board {

class Bridge;

// Ports as plain digital pins: outputs, pull-ups, and levels from outside.
class Ports final : public Device {
public:
    Ports(Machine &machine, const BoardMap &map);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle) override {}
    void acknowledge(int) override {}
    void reset() override;
    void drive_switches(unsigned switches);
    void pull(const Pin &pin, bool low);  // pulls an input low: open collector
    void connect(Bridge &bridge) { bridge_ = &bridge; }

private:
    unsigned base_of(unsigned address) const;

    Machine &machine_;
    const BoardMap &map_;
    Bridge *bridge_ = nullptr;
    std::array<std::uint8_t, 0x140> pulled_low_{};  // by PINx address: bits pulled low
};

struct BridgeOutput {
    bool coast = true;
    int compare = 0;
    int dead_counts = 0;
};

class Bridge {
public:
    Bridge(Machine &machine, const BoardMap &map, const Timer &pwm, Cycle least_dead);
    void changed();  // a gate register has just been written

    // Checks the period, then latches the compare registers, as the TOP does.
    void end_period(Cycle start, Cycle end);
    BridgeOutput output() const;
    Cycle shortest_dead() const { return shortest_dead_; }

private:
    // Gate signal: constant, or the compare output of Timer0: WAVE is high around BOTTOM.
    enum class Drive : std::uint8_t { OFF, ON, WAVE, INVERTED };
    using Drives = std::array<Drive, GATES>;
    struct Change {
        Cycle at;
        Drives drives;
    };
    // From TOP to TOP: compare values are constant, drives change when the program writes.
    struct Period {
        Cycle start = 0;
        Cycle end = 0;
        std::array<int, 2> latched{};  // applied OCR0A, OCR0B
        Drives drives{};               // at the start
        std::vector<Change> changes;
        bool repeats(const Period &other) const {
            return changes.empty() && other.changes.empty() && latched == other.latched &&
                   drives == other.drives;
        }
    };
    struct Leg {
        bool high = false;
        bool low = false;
        Cycle high_off = -1000;  // of the last turn-off; long ago at the start
        Cycle low_off = -1000;
    };

    Drive drive_of(int gate) const;
    Drives drives_now() const;
    static bool level(const Period &period, const Drives &drives, int gate, Cycle at);
    void check(const Period &period);
    void check_instant(const Period &period, Cycle at);
    void set_leg(int leg, bool high, bool low, Cycle at);
    void turned_on(int leg, const char *which, Cycle at, Cycle other_off);

    Machine &machine_;
    const BoardMap &map_;
    const Timer &pwm_;
    Cycle least_dead_;
    Period current_;
    Period last_;
    bool skipped_ = false;  // the last period was equal to the previous one and not checked
    std::array<Leg, 2> legs_{};
    Cycle shortest_dead_ = NEVER;
};

}  // namespace board

#endif
