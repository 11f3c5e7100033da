// SPDX-License-Identifier: GPL-3.0-or-later
// Simulated microcontroller: simavr's instruction core with devices, interrupts and a clock of the
// bench.
#ifndef VGROOVE_BOARD_MACHINE_HPP
#define VGROOVE_BOARD_MACHINE_HPP

#include <array>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

extern "C" {
#include <simavr/sim_avr.h>
#include <simavr/sim_io.h>
}

namespace board {

using Cycle = std::int64_t;
constexpr Cycle NEVER = std::numeric_limits<Cycle>::max();
constexpr int VECTORS_MAX = 64;
using Context = std::array<std::uint8_t, 39>;  // r0 to r31; flags C to T of SREG, without I

// Error that ends the run; the message is for the user.
struct BoardError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// A peripheral: owns registers, raises interrupts, and returns the cycle of its next event.
class Device {
public:
    Device() = default;
    Device(const Device &) = delete;
    Device &operator=(const Device &) = delete;
    virtual ~Device() = default;
    virtual void write(std::uint16_t address, std::uint8_t value) = 0;
    virtual std::uint8_t read(std::uint16_t address) = 0;
    virtual void advance(Cycle now) = 0;
    virtual void acknowledge(int vector) = 0;  // its interrupt has been entered
    virtual void reset() = 0;
    Cycle due = NEVER;  // next event
};

// Observer of interrupt entries and exits.
class InterruptWatch {
public:
    virtual ~InterruptWatch() = default;
    // `waited`: cycles since the request; `pc`: byte address of the interrupted program.
    virtual void entered(int vector, Cycle at, Cycle waited, unsigned pc) = 0;
    virtual void left(Cycle at) = 0;
};

class Machine {
public:
    Machine(const std::string &mcu, const std::string &elf, std::uint32_t seed);
    ~Machine() = default;  // no avr_terminate(): simavr would access deleted devices
    Machine(const Machine &) = delete;
    Machine &operator=(const Machine &) = delete;

    Cycle now() const { return static_cast<Cycle>(avr_->cycle); }
    std::uint8_t &reg(unsigned address) { return avr_->data[address]; }
    std::uint8_t peek(unsigned address) const { return avr_->data[address]; }
    unsigned ram_end() const { return avr_->ramend; }
    unsigned ram_used_end() const { return used_end_; }
    unsigned stack_pointer() const {
        return avr_->data[R_SPL] | static_cast<unsigned>(avr_->data[R_SPH]) << 8;
    }
    Context context() const;
    std::size_t flash_words() const { return (avr_->flashend + 1u) / 2u; }
    unsigned io_end() const { return avr_->ioend; }
    int eeprom_size() const { return static_cast<int>(avr_->e2end) + 1; }
    const std::vector<std::uint8_t> &elf_eeprom() const { return elf_eeprom_; }
    Cycle entry_cycles() const { return avr_->address_size + 2; }
    int resets() const { return resets_; }

    void add(Device &device) { devices_.push_back(&device); }
    void attach(avr_io_t &io);
    // The device receives reads and writes of the register.
    void own(unsigned address, Device &device);
    // The device is told when the interrupt is entered.
    void serve(int vector, Device &device) { servers_[static_cast<std::size_t>(vector)] = &device; }
    void watch(InterruptWatch &watch) { watch_ = &watch; }
    // Interrupt request of a vector: pending while `level` is true.
    void line(int vector, bool level);
    void stall(Cycle cycles) { avr_->cycle += static_cast<avr_cycle_count_t>(cycles); }
    // Recomputes the next event of the devices, after a change of `due`.
    void refresh();
    bool current_is_sbi(std::uint8_t &mask) const;
    // From this call on, cycles by word address.
    void count_addresses(std::vector<Cycle> &cycles) { counted_ = &cycles; }
    void run_until(Cycle end);
    void reset(std::uint8_t cause);
    // The main program enters an endless loop, with interrupts enabled, at the end of the flash.
    void hang();

private:
    static void write_hook(avr_t *avr, avr_io_addr_t address, std::uint8_t value, void *device);
    static std::uint8_t read_hook(avr_t *avr, avr_io_addr_t address, void *device);
    static void reti_hook(avr_irq_t *irq, std::uint32_t value, void *machine);
    void load(const std::string &mcu, const std::string &elf);
    void fill_ram(std::uint32_t seed);
    void advance_devices();
    bool interrupt_ready() const;
    void enter_interrupt();
    void step(Cycle budget);
    void check_state() const;

    avr_t *avr_ = nullptr;
    std::vector<Device *> devices_;
    std::array<Device *, VECTORS_MAX> servers_{};
    InterruptWatch *watch_ = nullptr;
    std::vector<Cycle> *counted_ = nullptr;    // cycles by word address
    std::uint64_t pending_ = 0;                // requested vectors, one bit each
    std::array<Cycle, VECTORS_MAX> raised_{};  // cycle of each request
    Cycle due_ = NEVER;                        // next event of all devices
    unsigned used_end_ = 0;                    // end of the variables in SRAM
    std::vector<std::uint8_t> elf_eeprom_;
    int resets_ = 0;
};

}  // namespace board

#endif
