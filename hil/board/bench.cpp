// SPDX-License-Identifier: GPL-3.0-or-later
// Bench: boots the program, aligns the periods of the messages with Timer0, and reports the
// measured statistics.
#include "bench.hpp"

#include <cstdio>
#include <fstream>
#include <iterator>
#include <sstream>

namespace board {
namespace {

constexpr unsigned MCUSR = 0x54;
constexpr unsigned R2 = 2;
constexpr std::uint8_t BORF = 4;
constexpr Cycle BOOT_LIMIT = 3200000;  // 0.2 s without Timer0: periods of 510 cycles are assumed
constexpr Cycle PERIOD = SIM_CYCLES_PER_PERIOD;
constexpr Cycle RECEIVE_CYCLE = 128;  // within the period, as in firmware/hal/sim
constexpr unsigned MUX_BANDGAP = 0x1e;
constexpr unsigned BANDGAP_COUNTS = 225;  // 1.1 V of 5 V

std::vector<std::uint8_t> eeprom_content(const std::string &file,
                                         const std::vector<std::uint8_t> &from_elf) {
    std::ifstream stream(file, std::ios::binary);
    if (file.empty() || !stream) {
        return from_elf;
    }
    return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

}  // namespace

Unmodelled::Unmodelled(Machine &machine) : machine_(machine) {
    // CLKPR, PCICR, EIMSK, SPCR, TWCR: clock division, pin interrupts, SPI, TWI
    for (const unsigned address : {0x61u, 0x68u, 0x3du, 0x4cu, 0xbcu}) {
        machine.own(address, *this);
    }
}

void Unmodelled::write(unsigned short address, std::uint8_t value) {
    if (value != 0) {
        char text[80];
        std::snprintf(text, sizeof text,
                      "the program uses register 0x%02x, which the bench does not model", address);
        throw BoardError(text);
    }
    machine_.reg(address) = value;
}

Bench::Bench(const Options &options)
    : options_(options),
      map_(board_map(options.mcu)),
      machine_(options.mcu, options.elf, options.seed),
      pwm_(machine_, map_.pwm),
      hall_(machine_, map_.hall),
      tick_(machine_, map_.tick),
      prescaler_reset_(machine_, {&pwm_, &hall_}, tick_),
      converter_(machine_, pwm_, *this, map_.converter),
      serial_(machine_, map_.receive, map_.empty, map_.complete),
      eeprom_(machine_, map_.eeprom, eeprom_content(options.eeprom, machine_.elf_eeprom()),
              options.seed),
      watchdog_(machine_, map_.watchdog),
      ports_(machine_, map_),
      line_(machine_, hall_, ports_, map_.hall_pin),
      bridge_(machine_, map_, pwm_, options.least_dead),
      profile_(machine_, tick_),
      unmodelled_(machine_) {
    ports_.connect(bridge_);
    pwm_.watch_control([this] { bridge_.changed(); });
    machine_.reg(MCUSR) = options.boot_r2 < 0 ? options.reset_cause : 0;
    if (options.boot_r2 >= 0) {
        machine_.reg(R2) = static_cast<std::uint8_t>(options.boot_r2);
    }
    if (!options.profile.empty()) {
        profile_.count_addresses();
    }
}

// Sensor values refer to the ends of periods; a sample takes the value of the nearest end.
unsigned Bench::counts(unsigned mux, Cycle at) const {
    if (mux == MUX_BANDGAP) {
        return BANDGAP_COUNTS;
    }
    const SimInputs &inputs = at - start_ < PERIOD / 2 ? before_ : now_;
    for (std::size_t i = 0; i < map_.channels.size(); ++i) {
        if (map_.channels[i] == mux) {
            return inputs.adc_counts[i] & 0x3ffu;
        }
    }
    return 0;
}

// Next TOP of a running Timer0, otherwise the end of a period of 510 cycles; a TOP right after a
// restart is skipped.
Cycle Bench::period_end() const {
    if (!pwm_.running() || !pwm_.phase_correct()) {
        return end_ + PERIOD;
    }
    const Cycle top = pwm_.next_top(end_);
    return top - end_ < PERIOD / 2 ? top + PERIOD : top;
}

// Runs the program up to the first TOP of Timer0, where the first period begins.
void Bench::boot() {
    ports_.drive_switches(now_.switches);
    before_ = now_;
    while (!pwm_.running() && end_ < BOOT_LIMIT) {
        end_ += PERIOD / 10;
        machine_.run_until(end_);
    }
    const Cycle first = pwm_.running() ? pwm_.next_top(machine_.now()) : end_;
    machine_.run_until(first);
    bridge_.end_period(0, first);
    profile_.snapshot_stack();
    end_ = first;
}

void Bench::feed(const SimInputs &inputs) {
    before_ = now_;
    now_ = inputs;
    ports_.drive_switches(inputs.switches);
    for (unsigned i = 0; i < inputs.edge_count && i < SIM_EDGES_MAX; ++i) {
        line_.edge(start_ + inputs.edge_cycle[i]);
    }
    for (unsigned i = 0; i < inputs.rx_count && i < SIM_BYTES_MAX; ++i) {
        serial_.arrive(start_ + RECEIVE_CYCLE, inputs.rx[i]);
    }
}

void Bench::run_to(Cycle end) {
    if (options_.hang < end) {
        machine_.run_until(options_.hang);
        options_.hang = NEVER;
        machine_.hang();
    }
    if (options_.brown_out < end) {
        machine_.run_until(options_.brown_out);
        options_.brown_out = NEVER;
        machine_.reset(BORF);
    }
    machine_.run_until(end);
}

bool Bench::period(const SimInputs &inputs, SimOutputs &outputs) {
    if (start_ < 0) {
        now_ = inputs;
        boot();
    }
    start_ = end_;
    feed(inputs);
    const Cycle end = period_end();
    if (options_.cut < end) {
        run_to(options_.cut);
        return false;
    }
    run_to(end);
    end_ = end;
    odd_periods_ += end_ - start_ != PERIOD ? 1 : 0;
    ++periods_;
    bridge_.end_period(start_, end_);
    const BridgeOutput gates = bridge_.output();
    outputs = {};
    outputs.coast = gates.coast ? 1 : 0;
    outputs.compare = static_cast<std::int16_t>(gates.compare);
    outputs.dead_counts = static_cast<std::uint8_t>(gates.dead_counts);
    while (outputs.tx_count < SIM_BYTES_MAX && serial_.take(outputs.tx[outputs.tx_count])) {
        ++outputs.tx_count;
    }
    return true;
}

void Bench::receive(std::uint8_t byte) {
    received_at_ = (received_at_ < end_ ? end_ : received_at_) + serial_.byte_cycles();
    serial_.arrive(received_at_, byte);
}

void Bench::save_eeprom() const {
    if (options_.eeprom.empty()) {
        return;
    }
    std::ofstream stream(options_.eeprom, std::ios::binary);
    const auto &content = eeprom_.content();
    stream.write(reinterpret_cast<const char *>(content.data()),
                 static_cast<std::streamsize>(content.size()));
    if (!stream) {
        throw BoardError("cannot write " + options_.eeprom);
    }
}

std::string Bench::statistics() const {
    std::ostringstream json;
    const Cycle now = machine_.now();
    const Cycle measured = profile_.measured_since() == 0 ? 1 : now - profile_.measured_since();
    json << "{\"mcu\": \"" << options_.mcu << "\", \"cycles\": " << now
         << ", \"periods\": " << periods_ << ", \"odd_periods\": " << odd_periods_
         << ", \"boot_cycles\": " << end_ - periods_ * PERIOD
         << ", \"resets\": " << machine_.resets() << ",\n \"isr\": {";
    const char *separator = "";
    for (const auto &[number, name] : map_.vector_names) {
        const VectorCost &cost = profile_.vector(number);
        if (cost.count > 0) {
            json << separator << "\"" << name << "\": {\"count\": " << cost.count
                 << ", \"worst_cycles\": " << cost.worst << ", \"mean_cycles\": "
                 << static_cast<double>(cost.total) / static_cast<double>(cost.count)
                 << ", \"changed\": " << cost.changed
                 << ", \"longest_wait_cycles\": " << cost.longest_wait
                 << ", \"waited_at_address\": " << cost.waited_at << "}";
            separator = ",\n  ";
        }
    }
    const TickCost &tick = profile_.tick();
    const ControlCost &control = profile_.control();
    json << "},\n \"isr_share\": "
         << static_cast<double>(profile_.interrupt_cycles()) / static_cast<double>(measured)
         << ", \"isr_share_worst_100ms\": " << profile_.worst_window_share()
         << ",\n \"tick\": {\"count\": " << tick.count << ", \"worst_cycles\": " << tick.worst
         << ", \"worst_at_cycle\": " << tick.worst_at << ", \"mean_cycles\": "
         << (tick.count > 0 ? static_cast<double>(tick.total) / static_cast<double>(tick.count)
                            : 0.0)
         << ", \"late\": " << tick.late << "},\n \"control\": {\"count\": " << control.count
         << ", \"worst_cycles\": " << control.worst << ", \"worst_at_cycle\": " << control.worst_at
         << ", \"mean_cycles\": "
         << (control.count > 0
                 ? static_cast<double>(control.total) / static_cast<double>(control.count)
                 : 0.0)
         << "},\n \"stack\": {\"free_bytes\": " << profile_.stack_free()
         << ", \"variables_bytes\": " << machine_.ram_used_end() - machine_.io_end() - 1 << "}";
    const ConverterReport &converter = converter_.report();
    json << ",\n \"adc\": {\"conversions\": " << converter.conversions
         << ", \"lost\": " << converter.lost << ", \"channel_races\": " << converter.channel_races
         << ", \"shortest_cadence_cycles\": " << (converter.longest > 0 ? converter.shortest : 0)
         << ", \"longest_cadence_cycles\": " << converter.longest << "}";
    const HallReport &line = line_.report();
    json << ",\n \"hall\": {\"edges\": " << line.edges << ", \"captured\": " << line.captured
         << ", \"deaf\": " << line.not_selected << "}";
    const SerialReport &serial = serial_.report();
    json << ",\n \"uart\": {\"baud\": " << serial.baud << ", \"sent\": " << serial.sent
         << ", \"received\": " << serial.received << ", \"overruns\": " << serial.overruns
         << "},\n \"eeprom\": {\"writes\": " << eeprom_.writes()
         << ", \"first_write_cycle\": " << eeprom_.first_write()
         << "},\n \"bridge\": {\"shortest_dead_cycles\": "
         << (bridge_.shortest_dead() == NEVER ? -1 : bridge_.shortest_dead()) << "}}\n";
    return json.str();
}

}  // namespace board
