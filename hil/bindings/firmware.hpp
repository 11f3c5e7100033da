// The native firmware in the bindings: one simulation a process, owned by the newest instance and
// run by one thread at a time.
#ifndef VGROOVE_HIL_FIRMWARE_HPP
#define VGROOVE_HIL_FIRMWARE_HPP

#include <cstdint>
#include <string>

#include "hal/sim/sim.h"

struct Firmware {
    std::uint32_t number;
    SimOutputs outputs;  // in force in the next period
    bool keeps_tape = false;
    std::string tape, given;  // inputs and outputs of the periods of run_lockstep, if kept
};

// Throws std::runtime_error when a newer instance has taken the simulation over, or another thread
// is running it.
void need_owner(const Firmware &self);

// Holds the simulation for a run without the interpreter's lock.
class FirmwareHold {
public:
    explicit FirmwareHold(const Firmware &self);
    ~FirmwareHold();
    FirmwareHold(const FirmwareHold &) = delete;
    FirmwareHold &operator=(const FirmwareHold &) = delete;
};

#endif
