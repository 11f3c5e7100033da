// An EEPROM image with the default parameters except given ones, for the start of a run.
#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <utility>

extern "C" {
#include "app/param_store.h"
#include "core/crc.h"
}
#include "hal/sim/sim.h"

using Eeprom = std::array<std::uint8_t, SIM_EEPROM_BYTES>;

inline Eeprom eeprom_with(std::initializer_list<std::pair<int, int>> changed) {
#define EEPROM_DEFAULT(name, unit, initial, least, greatest, version) initial,
    int values[] = {PARAM_LIST(EEPROM_DEFAULT)};
#undef EEPROM_DEFAULT
    for (const auto &[index, value] : changed)
        values[index] = value;
    Eeprom eeprom;
    eeprom.fill(0xFF);
    std::uint16_t crc = CRC16_INIT;
    std::size_t at = PARAM_SLOT_ADDRESS;
    const auto put = [&](int byte) {
        eeprom[at++] = static_cast<std::uint8_t>(byte);
        crc = crc16_next(crc, static_cast<std::uint8_t>(byte));
    };
    for (const int byte : {static_cast<int>(PARAM_VERSION), static_cast<int>(PARAM_COUNT), 1, 0})
        put(byte);
    for (const int value : values) {
        put(value & 0xFF);
        put(value >> 8 & 0xFF);
    }
    const int sum = crc;
    put(sum & 0xFF);
    put(sum >> 8);
    return eeprom;
}
