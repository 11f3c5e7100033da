// SPDX-License-Identifier: GPL-3.0-or-later
// Timer/counters: counts are computed from the cycle counter, so that nothing is simulated between
// events.
#include "timers.hpp"

#include <utility>

namespace board {
namespace {

constexpr std::uint8_t TOV = 0x01;
constexpr std::uint8_t OCFA = 0x02;
constexpr std::uint8_t OCFB = 0x04;
constexpr std::uint8_t ICF = 0x20;
constexpr unsigned GTCCR = 0x43;

Cycle floor_div(Cycle a, Cycle b) {
    return a >= 0 ? a / b : -((-a + b - 1) / b);
}

}  // namespace

Timer::Timer(Machine &machine, const TimerMap &map) : machine_(machine), map_(map) {
    machine.add(*this);
    for (const unsigned address :
         {map.tccra, map.tccrb, map.timsk, map.tifr, map.tcnt, map.ocra, map.ocrb}) {
        machine.own(address, *this);
    }
    if (map.bits == 16) {
        for (const unsigned address :
             {map.tcnt + 1, map.ocra + 1, map.ocrb + 1, map.icr, map.icr + 1}) {
            machine.own(address, *this);
        }
        machine.serve(map.capture, *this);
    }
    for (const int vector : {map.overflow, map.compare_a, map.compare_b}) {
        machine.serve(vector, *this);
    }
}

Cycle Timer::period() const {
    switch (mode_) {
    case Mode::NORMAL:
        return Cycle{1} << map_.bits;
    case Mode::CTC:
        return static_cast<Cycle>(compare(map_.ocra)) + 1;
    case Mode::PHASE:
        return 2 * TIMER_TOP;
    case Mode::FAST:
        return TIMER_TOP + 1;
    }
    return 1;
}

unsigned Timer::compare(unsigned low) const {
    const unsigned high = map_.bits == 16 ? machine_.peek(low + 1) : 0u;
    return machine_.peek(low) | high << 8;
}

Cycle Timer::ticks(Cycle now) const {
    const Cycle raw = running_ ? floor_div(now - base_, prescale_) : stopped_count_;
    const Cycle length = period();
    return raw - floor_div(raw, length) * length;
}

unsigned Timer::count(Cycle now) const {
    const Cycle position = ticks(now);
    return static_cast<unsigned>(
        mode_ == Mode::PHASE && position > TIMER_TOP ? 2 * TIMER_TOP - position : position);
}

// First cycle after `after` at which the position is `phase`.
Cycle Timer::occurrence(Cycle phase, Cycle after) const {
    const Cycle length = prescale_ * period();
    const Cycle first = base_ + prescale_ * phase;
    return first + length * (floor_div(after - first, length) + 1);
}

// A compare flag is set at the timer clock after the match; the second match of phase-correct PWM
// is not modelled (configure() rejects its use).
std::array<Timer::Source, 3> Timer::sources() const {
    const Cycle top = period() - 1;
    const Cycle a = static_cast<Cycle>(compare(map_.ocra));
    const Cycle b = static_cast<Cycle>(compare(map_.ocrb));
    const Cycle overflow = mode_ == Mode::CTC ? -1 : 0;
    return {{{TOV, overflow},
             {OCFA, a > top ? -1 : (a + 1) % (top + 1)},
             {OCFB, b > top ? -1 : (b + 1) % (top + 1)}}};
}

void Timer::stop(Cycle now) {
    stopped_count_ = ticks(now);
    running_ = false;
}

// The next count comes at the next edge of the prescaler, which runs independently since its last
// reset.
void Timer::resume(Cycle now) {
    if (prescale_ == 0 || held_) {
        return;
    }
    const Cycle next =
        prescaler_origin_ + prescale_ * (floor_div(now - prescaler_origin_, prescale_) + 1);
    base_ = next - prescale_ * (stopped_count_ + 1);
    running_ = true;
    advanced_to_ = now;
}

void Timer::configure() {
    const unsigned a = machine_.peek(map_.tccra);
    const unsigned b = machine_.peek(map_.tccrb);
    const unsigned wgm = (a & 3u) | (b & (map_.bits == 16 ? 0x18u : 0x08u)) >> 1;
    const bool wide_pwm = map_.bits == 16 && (wgm & 3u) != 0;
    if (wgm > 4 || wide_pwm || (map_.bits == 8 && wgm == 4)) {
        throw BoardError("the bench does not model waveform mode " + std::to_string(wgm) +
                         " of timer " + std::to_string(map_.number));
    }
    const Mode narrow[] = {Mode::NORMAL, Mode::PHASE, Mode::CTC, Mode::FAST};
    mode_ = wgm == 4 ? Mode::CTC : narrow[wgm];
    const int prescale = map_.prescales[b & 7u];
    if (prescale < 0) {
        throw BoardError("the bench does not model an external clock of timer " +
                         std::to_string(map_.number));
    }
    prescale_ = prescale;
}

void Timer::set_count(unsigned value) {
    const Cycle now = machine_.now();
    stopped_count_ = static_cast<Cycle>(value);
    if (running_) {
        running_ = false;
        resume(now);
    }
}

void Timer::write_pair(unsigned low, unsigned address, std::uint8_t value) {
    if (address == low + 1) {
        temp_ = value;
        return;
    }
    if (low == map_.tcnt) {
        set_count(value | static_cast<unsigned>(temp_) << 8);
        return;
    }
    machine_.reg(low + 1) = temp_;
    machine_.reg(low) = value;
}

void Timer::write_flags(std::uint8_t value) {
    std::uint8_t mask = 0;
    if (machine_.current_is_sbi(mask)) {
        value &= mask;
    }
    machine_.reg(map_.tifr) = static_cast<std::uint8_t>(machine_.reg(map_.tifr) & ~value);
}

void Timer::write_control(unsigned address, std::uint8_t value) {
    const Cycle now = machine_.now();
    const Cycle position = static_cast<Cycle>(count(now));
    const Mode mode_before = mode_;
    const Cycle prescale_before = prescale_;
    machine_.reg(address) = value;
    configure();
    if (mode_ != mode_before || prescale_ != prescale_before) {
        running_ = false;
        stopped_count_ = position;
        resume(now);
    }
    if (control_hook_) {
        control_hook_();
    }
}

// In CTC mode a new compare value changes the period at once; the count continues.
void Timer::write_compare(unsigned address, std::uint8_t value) {
    const Cycle now = machine_.now();
    const Cycle position = ticks(now);
    machine_.reg(address) = value;
    if (mode_ == Mode::CTC && running_) {
        base_ += prescale_ * (floor_div(now - base_, prescale_) - position);
    }
}

void Timer::write(unsigned short address, std::uint8_t value) {
    advance(machine_.now());
    if (address == map_.tifr) {
        write_flags(value);
    } else if (address == map_.timsk) {
        machine_.reg(address) = value;
    } else if (address == map_.tccra || address == map_.tccrb) {
        write_control(address, value);
    } else if (map_.bits == 16) {
        write_pair(address & ~1u, address, value);
    } else if (address == map_.tcnt) {
        set_count(value);
    } else {
        write_compare(address, value);
    }
    update();
    machine_.refresh();
}

std::uint8_t Timer::read(unsigned short address) {
    const Cycle now = machine_.now();
    if (address == map_.tifr) {
        advance(now);
        return machine_.reg(address);
    }
    if (map_.bits == 8) {
        return address == map_.tcnt ? static_cast<std::uint8_t>(count(now)) : machine_.reg(address);
    }
    if (address == map_.tcnt) {
        const unsigned value = count(now);
        temp_ = static_cast<std::uint8_t>(value >> 8);
        return static_cast<std::uint8_t>(value);
    }
    if (address == map_.icr) {
        temp_ = machine_.reg(map_.icr + 1);
        return machine_.reg(address);
    }
    return address == map_.tcnt + 1 || address == map_.icr + 1 ? temp_ : machine_.reg(address);
}

void Timer::set_flag(std::uint8_t flag, Cycle at) {
    std::uint8_t &flags = machine_.reg(map_.tifr);
    if (flag == OCFA) {
        last_compare_a_ = at;
    }
    const bool rising = (flags & flag) == 0;
    flags |= flag;
    if (rising && flag == TOV && overflow_hook_) {
        overflow_hook_(at);
    }
}

void Timer::advance(Cycle now) {
    if (running_) {
        for (const Source &source : sources()) {
            const Cycle at = source.phase < 0 ? NEVER : occurrence(source.phase, advanced_to_);
            if (at <= now) {
                set_flag(source.flag, at);
            }
        }
    }
    advanced_to_ = now;
    update();
}

// Updates the interrupt lines and the next event.
void Timer::update() {
    const unsigned flags = machine_.peek(map_.tifr);
    const unsigned mask = machine_.peek(map_.timsk);
    if (mode_ == Mode::PHASE && (mask & (OCFA | OCFB)) != 0) {
        throw BoardError("the bench does not model compare interrupts of phase-correct PWM");
    }
    machine_.line(map_.overflow, (flags & mask & TOV) != 0);
    machine_.line(map_.compare_a, (flags & mask & OCFA) != 0);
    machine_.line(map_.compare_b, (flags & mask & OCFB) != 0);
    if (map_.bits == 16) {
        machine_.line(map_.capture, (flags & mask & ICF) != 0);
    }
    due = NEVER;
    if (!running_) {
        return;
    }
    const unsigned wanted = (mask | (armed_ ? TOV : 0u)) & ~flags;
    for (const Source &source : sources()) {
        if ((wanted & source.flag) != 0 && source.phase >= 0) {
            const Cycle at = occurrence(source.phase, advanced_to_);
            due = at < due ? at : due;
        }
    }
}

void Timer::acknowledge(int vector) {
    const std::uint8_t flag = vector == map_.overflow    ? TOV
                              : vector == map_.compare_a ? OCFA
                              : vector == map_.compare_b ? OCFB
                                                         : ICF;
    advance(machine_.now());
    machine_.reg(map_.tifr) = static_cast<std::uint8_t>(machine_.reg(map_.tifr) & ~flag);
    update();
    machine_.refresh();
}

void Timer::reset() {
    stop(machine_.now());
    stopped_count_ = 0;
    prescale_ = 0;
    mode_ = Mode::NORMAL;
    held_ = false;
    armed_ = false;
    due = NEVER;
}

// `edge` is the cycle at which the capture unit detects the edge; the captured count is that of
// this cycle, independent of the program.
void Timer::capture(Cycle edge) {
    const unsigned stamp = count(edge);
    machine_.reg(map_.icr) = static_cast<std::uint8_t>(stamp);
    machine_.reg(map_.icr + 1) = static_cast<std::uint8_t>(stamp >> 8);
    set_flag(ICF, edge);
    update();
}

void Timer::hold(Cycle now, bool held) {
    if (held == held_) {
        return;
    }
    advance(now);
    held_ = held;
    if (held) {
        stop(now);
    } else {
        prescaler_origin_ = now;
        resume(now);
    }
    update();
}

void Timer::reset_prescaler(Cycle now) {
    hold(now, true);
    hold(now, false);
}

void Timer::arm_overflow(bool armed) {
    advance(machine_.now());
    armed_ = armed;
    update();
    machine_.refresh();
}

PrescalerReset::PrescalerReset(Machine &machine, std::vector<Timer *> synchronous,
                               Timer &asynchronous)
    : machine_(machine),
      synchronous_(std::move(synchronous)),
      asynchronous_(asynchronous) {
    machine.own(GTCCR, *this);
}

void PrescalerReset::write(unsigned short, std::uint8_t value) {
    const Cycle now = machine_.now();
    const bool keep = (value & 0x80u) != 0;
    machine_.reg(GTCCR) = keep ? value : 0;
    for (Timer *timer : synchronous_) {
        if ((value & 1u) != 0) {
            timer->hold(now, true);
        }
        if (!keep || (value & 1u) == 0) {
            timer->hold(now, false);
        }
    }
    if ((value & 2u) != 0) {
        asynchronous_.hold(now, true);
    }
    if (!keep || (value & 2u) == 0) {
        asynchronous_.hold(now, false);
    }
    machine_.refresh();
}

}  // namespace board
