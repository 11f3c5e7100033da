// SPDX-License-Identifier: GPL-3.0-or-later
// Analogue-to-digital converter: single, free-running and Timer0-triggered conversions with their
// sampling times.
#ifndef VGROOVE_BOARD_CONVERTER_HPP
#define VGROOVE_BOARD_CONVERTER_HPP

#include "timers.hpp"

namespace board {

// Counts of a channel at a cycle.
class AnalogueSource {
public:
    virtual ~AnalogueSource() = default;
    virtual unsigned counts(unsigned mux, Cycle at) const = 0;
};

struct ConverterReport {
    long conversions = 0;
    long lost = 0;           // finished while the last result was read in part
    long channel_races = 0;  // ADMUX written within one ADC clock of a trigger: the converted
                             // channel is undefined on silicon
    Cycle shortest = NEVER;  // between two triggered conversions
    Cycle longest = 0;
};

class Converter final : public Device {
public:
    Converter(Machine &machine, Timer &trigger, const AnalogueSource &source, int vector);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override;
    void advance(Cycle now) override;
    void acknowledge(int vector) override;
    void reset() override;
    const ConverterReport &report() const { return report_; }

private:
    bool bit(std::uint8_t mask) const { return (machine_.peek(CONTROL) & mask) != 0; }
    void triggered(Cycle at);
    // In half ADC clocks to sample and end: 27 and 50 for the first conversion after ADEN, 3 and 26
    // for one started by ADSC, 4 and 27 for a triggered one.
    void start(Cycle at, Cycle half_clocks_to_sample, Cycle half_clocks_to_end);
    void write_control(std::uint8_t value);
    void finish();
    void update();

    static constexpr unsigned CONTROL = 0x7a;
    Machine &machine_;
    Timer &trigger_;
    const AnalogueSource &source_;
    int vector_;
    bool busy_ = false;
    bool fresh_ = true;    // the next conversion is the first after ADEN
    bool locked_ = false;  // ADCL has been read, ADCH not: a result is not stored
    unsigned mux_ = 0;
    Cycle started_ = -1;
    Cycle last_trigger_ = -1;
    Cycle sample_at_ = NEVER;
    Cycle end_at_ = NEVER;
    unsigned sample_ = 0;
    ConverterReport report_;
};

}  // namespace board

#endif
