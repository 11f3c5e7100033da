// SPDX-License-Identifier: GPL-3.0-or-later
// Execution statistics: cycles of each interrupt and tick, the interrupts' share of time, unused
// stack.
#ifndef VGROOVE_BOARD_PROFILE_HPP
#define VGROOVE_BOARD_PROFILE_HPP

#include "board_map.hpp"

namespace board {

struct VectorCost {
    long count = 0;
    Cycle worst = 0;  // entry, body and RETI, without nested interrupts
    Cycle total = 0;
    long changed = 0;        // times that a register or flag differed after it
    Cycle longest_wait = 0;  // from the flag to the entry
    unsigned waited_at = 0;  // address of the instruction after the longest wait
};

struct TickCost {
    long count = 0;
    Cycle worst = 0;  // from the compare match of Timer2 to the end of the tick, with interrupts
    Cycle total = 0;
    Cycle worst_at = 0;
    long late = 0;  // ticks that lasted beyond the next compare match
};

struct ControlCost {
    long count = 0;
    Cycle worst = 0;  // of the controller's step, without nested interrupts
    Cycle total = 0;
    Cycle worst_at = 0;
};

// TWBR holds the marks of the program, which does not use the TWI: bit 0 is 1 during a tick, bit 1
// during the controller's step.
class Profile final : public Device, public InterruptWatch {
public:
    Profile(Machine &machine, const Timer &tick);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle) override {}
    void acknowledge(int) override {}
    void reset() override;
    void entered(int vector, Cycle at, Cycle waited, unsigned pc) override;
    void left(Cycle at) override;

    void count_addresses();  // slower: observes each instruction

    // Lines of byte address, cycles of the run, cycles of the longest tick.
    std::string address_table() const;
    void snapshot_stack();
    unsigned stack_free() const;
    const VectorCost &vector(int number) const {
        return vectors_[static_cast<std::size_t>(number)];
    }
    const TickCost &tick() const { return ticks_; }
    const ControlCost &control() const { return controls_; }
    Cycle measured_since() const { return since_; }
    Cycle interrupt_cycles() const { return interrupt_total_; }
    double worst_window_share() const;

private:
    struct Frame {  // a running interrupt
        int vector;
        Cycle entered;
        Cycle nested;  // cycles of the interrupts within it
        Context context;
    };
    void begin_tick();
    void end_tick();
    void end_control();
    void add_interrupt_cycles(Cycle cycles, Cycle at);

    Machine &machine_;
    const Timer &tick_;
    std::array<VectorCost, VECTORS_MAX> vectors_{};
    TickCost ticks_;
    ControlCost controls_;
    Cycle control_began_ = 0;
    std::vector<Frame> frames_;
    Cycle since_ = 0;            // entry of the first interrupt
    Cycle tick_match_ = 0;       // compare match of the present tick
    Cycle interrupt_total_ = 0;  // cycles of all interrupts so far
    Cycle window_start_ = 0;
    Cycle window_cycles_ = 0;
    Cycle worst_window_ = 0;
    unsigned lowest_stack_ = 0xffff;
    std::vector<std::uint8_t> snapshot_;  // SRAM between variables and stack after the start
    // Cycles by word address: so far, at the beginning of the tick, of the longest tick.
    std::vector<Cycle> counted_, at_tick_, worst_tick_;
};

}  // namespace board

#endif
