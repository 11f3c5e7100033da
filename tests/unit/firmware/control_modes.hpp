// The modes of this firmware, for tests of all controllers.
#ifndef VGROOVE_TESTS_CONTROL_MODES_HPP
#define VGROOVE_TESTS_CONTROL_MODES_HPP

#include <cstdint>
#include <vector>

extern "C" {
#include "app/control.h"
#include "telemetry/telemetry_signals.h"
}

inline std::vector<uint8_t> modes() {
    std::vector<uint8_t> found;
    for (uint8_t mode = 0; mode <= TELEMETRY_MODE_MAX; ++mode) {
        if (control_has(mode))
            found.push_back(mode);
    }
    return found;
}

#endif
