// Frames of a host, for the telemetry tests in C++.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

extern "C" {
#include "core/crc.h"
}
#include "telemetry/telemetry_signals.h"

using Bytes = std::vector<std::uint8_t>;

// CRC of a frame of 19 bytes as docs/telemetry.md defines it: over id, time and the first seven
// data bytes.
inline std::uint8_t frame_crc(const Bytes &frame) {
    std::uint8_t crc = crc8_over(CRC8_INIT, &frame[6], 4);
    crc = crc8_over(crc, &frame[1], 4);
    return static_cast<std::uint8_t>(crc8_over(crc, &frame[10], 7) ^ CRC8_FINAL_XOR);
}

inline Bytes frame_of(std::uint32_t id, const std::array<std::uint8_t, 7> &data,
                      std::uint32_t ms = 0) {
    Bytes frame{0xAA};
    for (int k = 0; k < 4; ++k)
        frame.push_back(static_cast<std::uint8_t>(ms >> (8 * k)));
    frame.push_back(8);
    for (int k = 0; k < 4; ++k)
        frame.push_back(static_cast<std::uint8_t>(id >> (8 * k)));
    frame.insert(frame.end(), data.begin(), data.end());
    frame.push_back(frame_crc(frame));
    frame.push_back(0xBB);
    return frame;
}
