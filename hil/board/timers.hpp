// SPDX-License-Identifier: GPL-3.0-or-later
// Timer/counters 0, 1 (or 4, 5) and 2: exact counts, flags, input capture and the common reset of
// the prescalers.
#ifndef VGROOVE_BOARD_TIMERS_HPP
#define VGROOVE_BOARD_TIMERS_HPP

#include <functional>

#include "machine.hpp"

namespace board {

constexpr int TIMER_TOP = 255;  // phase-correct PWM, mode 1

// Register addresses (data space) and vectors of one timer; 0 where the timer has no such register.
struct TimerMap {
    int number;
    int bits;
    unsigned tccra, tccrb, tcnt, icr, ocra, ocrb, timsk, tifr;
    int overflow, compare_a, compare_b, capture;
    const int *prescales;  // by clock select, 0: stopped, -1: not modelled
};

class Timer final : public Device {
public:
    Timer(Machine &machine, const TimerMap &map);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle now) override;
    void acknowledge(int vector) override;
    void reset() override;

    bool running() const { return running_; }
    bool phase_correct() const { return mode_ == Mode::PHASE; }
    Cycle next_top(Cycle after) const { return occurrence(TIMER_TOP, after); }
    bool captures(bool rising) const {
        return ((machine_.peek(map_.tccrb) & 0x40u) != 0) == rising;
    }
    bool filters() const { return (machine_.peek(map_.tccrb) & 0x80u) != 0; }
    void capture(Cycle edge);
    void hold(Cycle now, bool held);
    void reset_prescaler(Cycle now);
    void watch_overflow(std::function<void(Cycle)> hook) { overflow_hook_ = std::move(hook); }
    void watch_control(std::function<void()> hook) { control_hook_ = std::move(hook); }
    void arm_overflow(bool armed);
    Cycle last_compare_a() const { return last_compare_a_; }

private:
    enum class Mode { NORMAL, CTC, PHASE, FAST };
    struct Source {
        std::uint8_t flag;
        Cycle phase;  // counts from the start of the period, negative: never
    };

    Cycle period() const;
    Cycle ticks(Cycle now) const;
    unsigned count(Cycle now) const;
    Cycle occurrence(Cycle phase, Cycle after) const;
    std::array<Source, 3> sources() const;
    unsigned compare(unsigned low) const;
    void stop(Cycle now);
    void resume(Cycle now);
    void configure();
    void set_count(unsigned value);
    void write_pair(unsigned low, unsigned address, std::uint8_t value);
    void write_control(unsigned address, std::uint8_t value);
    void write_compare(unsigned address, std::uint8_t value);
    void write_flags(std::uint8_t value);
    void set_flag(std::uint8_t flag, Cycle at);
    void update();

    Machine &machine_;
    TimerMap map_;
    Mode mode_ = Mode::NORMAL;
    bool running_ = false;
    bool held_ = false;
    bool armed_ = false;
    Cycle prescale_ = 0;
    Cycle prescaler_origin_ = 0;
    Cycle base_ = 0;           // cycle of count 0 while running
    Cycle stopped_count_ = 0;  // count while stopped
    Cycle advanced_to_ = 0;    // flags are set up to this cycle
    Cycle last_compare_a_ = 0;
    std::uint8_t temp_ = 0;
    std::function<void(Cycle)> overflow_hook_;
    std::function<void()> control_hook_;
};

// GTCCR: halts timers while TSM holds their prescaler in reset.
class PrescalerReset final : public Device {
public:
    PrescalerReset(Machine &machine, std::vector<Timer *> synchronous, Timer &asynchronous);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short) override { return machine_.reg(0x43); }
    void advance(Cycle) override {}
    void acknowledge(int) override {}
    void reset() override {}

private:
    Machine &machine_;
    std::vector<Timer *> synchronous_;
    Timer &asynchronous_;
};

}  // namespace board

#endif
