// SPDX-License-Identifier: GPL-3.0-or-later
// Timing of the converter: ATmega328P data sheet, "Prescaling and Conversion Timing" (sample 1.5, 2
// or 13.5 clocks after the start).
#include "converter.hpp"

namespace board {
namespace {

constexpr Cycle SYNCHRONISATION = 3;  // CPU cycles from a trigger to the start of its conversion
constexpr unsigned ADCL = 0x78;
constexpr unsigned ADCH = 0x79;
constexpr unsigned ADCSRB = 0x7b;
constexpr unsigned ADMUX = 0x7c;
constexpr std::uint8_t ADEN = 0x80;
constexpr std::uint8_t ADSC = 0x40;
constexpr std::uint8_t ADATE = 0x20;
constexpr std::uint8_t ADIF = 0x10;
constexpr std::uint8_t ADIE = 0x08;
constexpr std::uint8_t ADLAR = 0x20;
constexpr unsigned SOURCE_FREE = 0;
constexpr unsigned SOURCE_TIMER0_OVERFLOW = 4;

}  // namespace

Converter::Converter(Machine &machine, Timer &trigger, const AnalogueSource &source, int vector)
    : machine_(machine),
      trigger_(trigger),
      source_(source),
      vector_(vector) {
    machine.add(*this);
    machine.serve(vector, *this);
    for (const unsigned address : {ADCL, ADCH, CONTROL, ADCSRB, ADMUX}) {
        machine.own(address, *this);
    }
    trigger.watch_overflow([this](Cycle at) { triggered(at); });
}

void Converter::triggered(Cycle at) {
    const bool armed =
        bit(ADEN) && bit(ADATE) && (machine_.peek(ADCSRB) & 7u) == SOURCE_TIMER0_OVERFLOW;
    if (!armed || busy_) {
        return;
    }
    if (last_trigger_ >= 0 && report_.conversions > 1) {
        const Cycle gap = at - last_trigger_;
        report_.shortest = gap < report_.shortest ? gap : report_.shortest;
        report_.longest = gap > report_.longest ? gap : report_.longest;
    }
    last_trigger_ = at;
    fresh_ ? start(at + SYNCHRONISATION, 27, 50) : start(at + SYNCHRONISATION, 4, 27);
    machine_.refresh();
}

void Converter::start(Cycle at, Cycle half_clocks_to_sample, Cycle half_clocks_to_end) {
    const unsigned select = machine_.peek(CONTROL) & 7u;
    const Cycle half_clock = select < 2 ? 1 : Cycle{1} << (select - 1);
    busy_ = true;
    fresh_ = false;
    started_ = at;
    mux_ = machine_.peek(ADMUX) & 0x1fu;
    sample_at_ = at + half_clocks_to_sample * half_clock;
    end_at_ = at + half_clocks_to_end * half_clock;
    machine_.reg(CONTROL) |= ADSC;
    update();
}

void Converter::write_control(std::uint8_t value) {
    const std::uint8_t before = machine_.peek(CONTROL);
    const std::uint8_t flag =
        static_cast<std::uint8_t>(before & ADIF & ~value);  // cleared by writing one
    machine_.reg(CONTROL) =
        static_cast<std::uint8_t>((value & ~(ADIF | ADSC)) | flag | (busy_ ? ADSC : 0));
    if ((value & ADEN) == 0) {
        busy_ = false;
        fresh_ = true;
        sample_at_ = end_at_ = NEVER;
        machine_.reg(CONTROL) = static_cast<std::uint8_t>(machine_.reg(CONTROL) & ~ADSC);
    } else if ((value & ADSC) != 0 && !busy_) {
        fresh_ ? start(machine_.now(), 27, 50) : start(machine_.now(), 3, 26);
    }
}

void Converter::write(unsigned short address, std::uint8_t value) {
    trigger_.advance(machine_.now());  // an earlier overflow must not trigger
    advance(machine_.now());
    if (address == CONTROL) {
        write_control(value);
    } else if (address == ADMUX || address == ADCSRB) {
        const Cycle clock = Cycle{1} << (machine_.peek(CONTROL) & 7u);
        if (address == ADMUX && busy_ && bit(ADATE) && value != machine_.peek(ADMUX) &&
            machine_.now() - started_ < clock) {
            ++report_.channel_races;
        }
        machine_.reg(address) = value;
    }
    trigger_.arm_overflow(bit(ADEN) && bit(ADATE) &&
                          (machine_.peek(ADCSRB) & 7u) == SOURCE_TIMER0_OVERFLOW);
    update();
    machine_.refresh();
}

std::uint8_t Converter::read(unsigned short address) {
    if (address == ADCL) {
        locked_ = true;
    } else if (address == ADCH) {
        locked_ = false;
    } else {
        advance(machine_.now());
    }
    return machine_.reg(address);
}

void Converter::finish() {
    ++report_.conversions;
    const unsigned result = (machine_.peek(ADMUX) & ADLAR) != 0 ? sample_ << 6 : sample_;
    if (locked_) {
        ++report_.lost;
    } else {
        machine_.reg(ADCL) = static_cast<std::uint8_t>(result);
        machine_.reg(ADCH) = static_cast<std::uint8_t>(result >> 8);
    }
    busy_ = false;
    const Cycle ended = end_at_;
    sample_at_ = end_at_ = NEVER;
    machine_.reg(CONTROL) = static_cast<std::uint8_t>((machine_.reg(CONTROL) | ADIF) & ~ADSC);
    if (bit(ADATE) && (machine_.peek(ADCSRB) & 7u) == SOURCE_FREE) {
        start(ended, 3, 26);
    }
}

void Converter::advance(Cycle now) {
    if (sample_at_ <= now) {
        sample_ = source_.counts(mux_, sample_at_);
        sample_at_ = NEVER;
    }
    if (end_at_ <= now) {
        finish();
    }
    update();
}

void Converter::update() {
    machine_.line(vector_, bit(ADIF) && bit(ADIE));
    due = sample_at_ < end_at_ ? sample_at_ : end_at_;
}

void Converter::acknowledge(int) {
    machine_.reg(CONTROL) = static_cast<std::uint8_t>(machine_.reg(CONTROL) & ~ADIF);
    update();
    machine_.refresh();
}

void Converter::reset() {
    busy_ = locked_ = false;
    fresh_ = true;
    last_trigger_ = started_ = -1;
    sample_at_ = end_at_ = NEVER;
    due = NEVER;
}

}  // namespace board
