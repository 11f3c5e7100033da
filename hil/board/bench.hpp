// SPDX-License-Identifier: GPL-3.0-or-later
// Bench: one board with its devices, advanced by one PWM period per lock-step message.
#ifndef VGROOVE_BOARD_BENCH_HPP
#define VGROOVE_BOARD_BENCH_HPP

#include <sim_io.h>

#include <string>

#include "converter.hpp"
#include "hall_line.hpp"
#include "memory.hpp"
#include "profile.hpp"
#include "serial.hpp"

namespace board {

struct Options {
    std::string elf;
    std::string mcu = "atmega328p";
    std::string eeprom;
    std::string stats;
    std::string profile;           // cycles by address, for tests/avr/hot_spots.py
    std::uint8_t reset_cause = 1;  // MCUSR: power-on
    int boot_r2 = -1;    // from 0 on: a boot loader has cleared MCUSR and left this value in r2
    Cycle cut = NEVER;   // power fails at this cycle: the run ends, a byte being written is random
    Cycle hang = NEVER;  // the main program enters an endless loop at this cycle
    Cycle brown_out = NEVER;  // brown-out reset at this cycle
    Cycle least_dead = 2;
    std::uint32_t seed = 1;
    bool stretches = false;  // several periods in a message, see main.cpp
    bool pty = false;        // at the pace of the wall clock, see real_time.hpp
    double pace = 1.0;
};

// Traps registers of peripherals that the bench does not model: writing a value other than zero
// ends the run.
class Unmodelled final : public Device {
public:
    explicit Unmodelled(Machine &machine);
    void write(unsigned short address, std::uint8_t value) override;
    std::uint8_t read(unsigned short address) override { return machine_.reg(address); }
    void advance(Cycle) override {}
    void acknowledge(int) override {}
    void reset() override {}

private:
    Machine &machine_;
};

class Bench final : public AnalogueSource {
public:
    explicit Bench(const Options &options);
    // One PWM period; false: the power was cut within it.
    bool period(const SimInputs &inputs, SimOutputs &outputs);
    // A byte for the UART: its stop bit ends one character after that of the byte before it, at
    // the earliest one character after the end of the last period.
    void receive(std::uint8_t byte);
    void save_eeprom() const;
    std::string statistics() const;
    std::string address_table() const { return profile_.address_table(); }
    unsigned counts(unsigned mux, Cycle at) const override;

private:
    Cycle period_end() const;
    void boot();
    void feed(const SimInputs &inputs);
    void run_to(Cycle end);

    Options options_;
    const BoardMap &map_;
    Machine machine_;
    Timer pwm_, hall_, tick_;
    PrescalerReset prescaler_reset_;
    Converter converter_;
    Serial serial_;
    Eeprom eeprom_;
    Watchdog watchdog_;
    Ports ports_;
    HallLine line_;
    Bridge bridge_;
    Profile profile_;
    Unmodelled unmodelled_;
    SimInputs now_{};
    SimInputs before_{};
    Cycle start_ = -1;
    Cycle received_at_ = 0;  // of the last byte of receive()
    Cycle end_ = 0;
    long periods_ = 0;
    long odd_periods_ = 0;  // not 510 cycles long: a reset has restarted Timer0
};

}  // namespace board

#endif
