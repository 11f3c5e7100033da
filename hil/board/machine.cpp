// SPDX-License-Identifier: GPL-3.0-or-later
// Simulated microcontroller: runs simavr's core from event to event and enters interrupts with the
// timing of silicon.
#include "machine.hpp"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <random>

extern "C" {
#include <simavr/sim_core.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>
}

namespace board {
namespace {

constexpr unsigned SMCR = 0x53;
constexpr unsigned MCUSR = 0x54;
// ATmega328P data sheet, "Sleep Modes": halted for four cycles in addition to the start-up time.
constexpr Cycle WAKE_CYCLES = 4;

void quiet_logger(avr_t *, const int level, const char *format, va_list arguments) {
    if (level <= LOG_ERROR) {
        std::vfprintf(stderr, format, arguments);
    }
}

unsigned symbol_address(const elf_firmware_t &firmware, const char *name) {
    for (std::uint32_t i = 0; i < firmware.symbolcount; ++i) {
        if (std::strcmp(firmware.symbol[i]->symbol, name) == 0) {
            return firmware.symbol[i]->addr & 0xffffu;
        }
    }
    return 0;
}

// Architecture for which an AVR ELF was linked: the low bits of e_flags, 5 for the ATmega328P, 6
// for the ATmega2560.
int linked_architecture(const std::string &elf) {
    std::ifstream stream(elf, std::ios::binary);
    constexpr std::streamoff E_FLAGS = 36;
    stream.seekg(E_FLAGS);
    return stream.get() & 0x7f;
}

}  // namespace

Machine::Machine(const std::string &mcu, const std::string &elf, std::uint32_t seed) {
    avr_global_logger_set(quiet_logger);
    load(mcu, elf);
    // All peripherals of simavr are removed: registers that no device owns are plain memory.
    for (auto &slot : avr_->io) {
        slot.r.c = nullptr;
        slot.w.c = nullptr;
    }
    fill_ram(seed);
    avr_irq_register_notify(avr_get_interrupt_irq(avr_, AVR_INT_ANY) + AVR_INT_IRQ_RUNNING,
                            reti_hook, this);
    avr_->state = cpu_Running;
}

void Machine::load(const std::string &mcu, const std::string &elf) {
    elf_firmware_t firmware{};
    if (elf_read_firmware(elf.c_str(), &firmware) != 0 || firmware.flash == nullptr) {
        throw BoardError(elf + " is not an AVR ELF file or not readable");
    }
    avr_ = avr_make_mcu_by_name(mcu.c_str());
    if (avr_ == nullptr) {
        throw BoardError("there is no microcontroller named " + mcu + " in simavr");
    }
    avr_init(avr_);
    if (firmware.flashbase + firmware.flashsize > avr_->flashend + 1) {
        throw BoardError(elf + " does not fit into the flash of the " + mcu);
    }
    used_end_ = symbol_address(firmware, "_end");
    if (linked_architecture(elf) != (avr_->address_size == 3 ? 6 : 5) || used_end_ <= avr_->ioend ||
        used_end_ > avr_->ramend) {
        throw BoardError(elf + " was not linked for the " + mcu);
    }
    if (firmware.eeprom != nullptr) {
        elf_eeprom_.assign(firmware.eeprom, firmware.eeprom + firmware.eesize);
    }
    avr_->frequency = 16000000;
    avr_loadcode(avr_, firmware.flash, firmware.flashsize, firmware.flashbase);
    avr_->codeend = firmware.flashbase + firmware.flashsize;
    avr_->pc = avr_->reset_pc;
}

// SRAM is random after power-up: a program that relies on zeros fails here as on silicon.
void Machine::fill_ram(std::uint32_t seed) {
    std::mt19937 random(seed);
    for (unsigned address = avr_->ioend + 1u; address <= avr_->ramend; ++address) {
        avr_->data[address] = static_cast<std::uint8_t>(random());
    }
}

Context Machine::context() const {
    Context out;
    std::copy_n(avr_->data, 32, out.begin());
    std::copy_n(avr_->sreg, out.size() - 32, out.begin() + 32);
    return out;
}

void Machine::own(unsigned address, Device &device) {
    auto &slot = avr_->io[AVR_DATA_TO_IO(address)];
    slot.w.c = write_hook;
    slot.w.param = &device;
    slot.r.c = read_hook;
    slot.r.param = &device;
}

// simavr calls the modules in turn when the program executes WDR, the last attached one first.
void Machine::attach(avr_io_t &io) {
    avr_register_io(avr_, &io);
}

void Machine::write_hook(avr_t *, avr_io_addr_t address, std::uint8_t value, void *device) {
    static_cast<Device *>(device)->write(address, value);
}

std::uint8_t Machine::read_hook(avr_t *, avr_io_addr_t address, void *device) {
    return static_cast<Device *>(device)->read(address);
}

void Machine::reti_hook(avr_irq_t *, std::uint32_t, void *param) {
    auto *machine = static_cast<Machine *>(param);
    if (machine->watch_ != nullptr) {
        machine->watch_->left(machine->now() +
                              machine->entry_cycles());  // RETI takes as many cycles as the entry
    }
}

void Machine::line(int vector, bool level) {
    const std::uint64_t bit = std::uint64_t{1} << vector;
    if (level && (pending_ & bit) == 0) {
        raised_[static_cast<std::size_t>(vector)] = now();
    }
    pending_ = level ? pending_ | bit : pending_ & ~bit;
    if (level) {
        avr_->run_cycle_count = 0;  // leaves the core's inner loop after this instruction
    }
}

void Machine::refresh() {
    due_ = NEVER;
    for (const Device *device : devices_) {
        due_ = device->due < due_ ? device->due : due_;
    }
    avr_->run_cycle_count = 0;
}

// SBI writes one bit of the flag registers below 0x40; simavr reads and writes the whole register.
bool Machine::current_is_sbi(std::uint8_t &mask) const {
    const unsigned opcode = avr_->flash[avr_->pc] | static_cast<unsigned>(avr_->flash[avr_->pc + 1])
                                                        << 8;
    mask = static_cast<std::uint8_t>(1u << (opcode & 7u));
    return (opcode & 0xff00u) == 0x9a00u;
}

void Machine::advance_devices() {
    for (Device *device : devices_) {
        if (device->due <= now()) {
            device->advance(now());
        }
    }
    refresh();
}

bool Machine::interrupt_ready() const {
    return pending_ != 0 && avr_->sreg[S_I] != 0 && avr_->interrupt_state >= 0;
}

void Machine::enter_interrupt() {
    const int vector = __builtin_ctzll(pending_);
    if (avr_->state == cpu_Sleeping) {
        avr_->state = cpu_Running;
        stall(WAKE_CYCLES);
    }
    const Cycle at = now();
    const unsigned from = avr_->pc;
    _avr_push_addr(avr_, avr_->pc);
    avr_->sreg[S_I] = 0;
    avr_->interrupt_state = 0;
    avr_->pc = static_cast<avr_flashaddr_t>(vector) * avr_->vector_size;
    servers_[static_cast<std::size_t>(vector)]->acknowledge(vector);
    stall(entry_cycles());
    if (watch_ != nullptr) {
        watch_->entered(vector, at, at - raised_[static_cast<std::size_t>(vector)], from);
    }
}

void Machine::check_state() const {
    if (avr_->state != cpu_Running && avr_->state != cpu_Sleeping) {
        char text[120];
        std::snprintf(text, sizeof text,
                      "the program crashed at cycle %lld, address 0x%04x, stack pointer 0x%04x",
                      static_cast<long long>(now()), avr_->pc, stack_pointer());
        throw BoardError(text);
    }
}

void Machine::step(Cycle budget) {
    const bool interrupts_just_enabled =
        avr_->interrupt_state < 0;  // one more instruction before any interrupt
    avr_->interrupt_state = 0;
    const bool single = interrupts_just_enabled || counted_ != nullptr;
    avr_->run_cycle_count = single ? 1u : static_cast<avr_cycle_count_t>(budget);
    const auto pc = avr_->pc;
    const Cycle before = now();
    avr_->pc = avr_run_one(avr_);
    if (counted_ != nullptr) {
        (*counted_)[pc / 2] += now() - before;
    }
    if (avr_->state == cpu_Sleeping && (reg(SMCR) & 1u) == 0) {
        avr_->state = cpu_Running;
    }
    check_state();
}

void Machine::run_until(Cycle end) {
    while (now() < end) {
        const Cycle next = due_ < end ? due_ : end;
        if (now() >= due_) {
            advance_devices();
        } else if (interrupt_ready()) {
            enter_interrupt();
        } else if (avr_->state == cpu_Sleeping) {
            avr_->cycle = static_cast<avr_cycle_count_t>(next);
        } else {
            step(next - now());
        }
    }
}

// Sets all registers except SRAM and the general registers to their initial values; `cause` is a
// bit of MCUSR.
void Machine::reset(std::uint8_t cause) {
    const std::uint8_t causes = static_cast<std::uint8_t>(reg(MCUSR) | cause);
    std::memset(avr_->data + 32, 0, avr_->ioend - 31u);
    std::memset(avr_->sreg, 0, sizeof avr_->sreg);
    reg(MCUSR) = causes;
    reg(R_SPL) = static_cast<std::uint8_t>(avr_->ramend);
    reg(R_SPH) = static_cast<std::uint8_t>(avr_->ramend >> 8);
    avr_->pc = avr_->reset_pc;
    avr_->state = cpu_Running;
    avr_->interrupt_state = 0;
    pending_ = 0;
    ++resets_;
    for (Device *device : devices_) {
        device->reset();
    }
    refresh();
}

void Machine::hang() {
    constexpr int LONGEST = 1000;  // of a critical section or an interrupt, in steps of 4 cycles
    for (int k = 0; k < LONGEST && avr_->sreg[S_I] == 0; ++k) {
        run_until(now() + 4);
    }
    avr_->flash[avr_->flashend - 1] = 0xff;  // rjmp .-2
    avr_->flash[avr_->flashend] = 0xcf;
    avr_->pc = avr_->flashend - 1;
    avr_->state = cpu_Running;
}

}  // namespace board
