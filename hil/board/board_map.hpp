// SPDX-License-Identifier: GPL-3.0-or-later
// Differences between the two boards: pins, channels, timers and vectors, as in
// firmware/hal/avr/board.h and docs/pins.md.
#ifndef VGROOVE_BOARD_BOARD_MAP_HPP
#define VGROOVE_BOARD_BOARD_MAP_HPP

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "timers.hpp"

namespace board {

struct Pin {
    unsigned port;  // address of PINx; DDRx and PORTx follow
    int bit;
};

enum Gate { LEG_A_HIGH, LEG_A_LOW, LEG_B_HIGH, LEG_B_LOW, GATES };

struct BoardMap {
    std::string mcu;
    TimerMap pwm, hall, tick;
    std::vector<unsigned> ports;   // addresses of all PINx
    std::array<Pin, GATES> gates;  // leg A: OC0A and OC0B
    Pin enable;                    // of the gate driver, high = on
    Pin hall_pin;                  // the capture pin
    std::array<std::pair<Pin, unsigned>, 4>
        switches;                      // pin, bit of SimInputs.switches; closed = pulled low
    std::array<unsigned, 4> channels;  // ADC channel of each SimInputs.adc_counts
    int receive, empty, complete, converter, eeprom, watchdog;  // numbers of the vectors
    std::vector<std::pair<int, const char *>> vector_names;
};

const BoardMap &board_map(const std::string &mcu);

}  // namespace board

#endif
