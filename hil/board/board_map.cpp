// SPDX-License-Identifier: GPL-3.0-or-later
// The two boards: register addresses and vectors from the data sheets of ATmega328P (DS40002061)
// and ATmega2560 (DS40002211).
#include "board_map.hpp"

namespace board {
namespace {

constexpr int SYNCHRONOUS[] = {0, 1, 8, 64, 256, 1024, -1, -1};
constexpr int TIMER2[] = {0, 1, 8, 32, 64, 128, 256, 1024};
constexpr unsigned PINB = 0x23;
constexpr unsigned PINC = 0x26;
constexpr unsigned PIND = 0x29;
constexpr unsigned PINA = 0x20;
constexpr unsigned PINE = 0x2c;
constexpr unsigned PING = 0x32;
constexpr unsigned PINL = 0x109;

// Rows in the order of BoardMap and TimerMap.
// clang-format off: tables, a row of the data sheet a line
const BoardMap UNO = {
    "atmega328p",
    {0, 8, 0x44, 0x45, 0x46, 0, 0x47, 0x48, 0x6e, 0x35, 16, 14, 15, 0, SYNCHRONOUS},
    {1, 16, 0x80, 0x81, 0x84, 0x86, 0x88, 0x8a, 0x6f, 0x36, 13, 11, 12, 10, SYNCHRONOUS},
    {2, 8, 0xb0, 0xb1, 0xb2, 0, 0xb3, 0xb4, 0x70, 0x37, 9, 7, 8, 0, TIMER2},
    {PINB, PINC, PIND},
    {{{PIND, 6}, {PIND, 5}, {PIND, 7}, {PIND, 4}}},
    {PINB, 1},
    {PINB, 0},
    {{{{PIND, 2}, 1}, {{PIND, 3}, 2}, {{PINC, 4}, 4}, {{PINC, 5}, 8}}},
    {{0, 1, 2, 3}},
    18,
    19,
    20,
    21,
    22,
    6,
    {{6, "WDT"},
     {7, "TIMER2_COMPA"},
     {8, "TIMER2_COMPB"},
     {9, "TIMER2_OVF"},
     {10, "TIMER1_CAPT"},
     {11, "TIMER1_COMPA"},
     {12, "TIMER1_COMPB"},
     {13, "TIMER1_OVF"},
     {14, "TIMER0_COMPA"},
     {15, "TIMER0_COMPB"},
     {16, "TIMER0_OVF"},
     {18, "USART_RX"},
     {19, "USART_UDRE"},
     {20, "USART_TX"},
     {21, "ADC"},
     {22, "EE_READY"}},
};

const BoardMap MEGA = {
    "atmega2560",
    {0, 8, 0x44, 0x45, 0x46, 0, 0x47, 0x48, 0x6e, 0x35, 23, 21, 22, 0, SYNCHRONOUS},
    {5, 16, 0x120, 0x121, 0x124, 0x126, 0x128, 0x12a, 0x73, 0x3a, 50, 47, 48, 46, SYNCHRONOUS},
    {2, 8, 0xb0, 0xb1, 0xb2, 0, 0xb3, 0xb4, 0x70, 0x37, 15, 13, 14, 0, TIMER2},
    {PINA, PINB, PINC, PIND, PINE, 0x2f, PING, 0x100, 0x103, 0x106, PINL},
    {{{PINB, 7}, {PING, 5}, {PINE, 4}, {PINE, 5}}},
    {PINB, 4},
    {PINL, 1},
    {{{{PINA, 0}, 1}, {{PINA, 1}, 2}, {{PINA, 2}, 4}, {{PINA, 3}, 8}}},
    {{0, 1, 2, 3}},
    25,
    26,
    27,
    29,
    30,
    12,
    {{12, "WDT"},
     {13, "TIMER2_COMPA"},
     {14, "TIMER2_COMPB"},
     {15, "TIMER2_OVF"},
     {46, "TIMER5_CAPT"},
     {47, "TIMER5_COMPA"},
     {48, "TIMER5_COMPB"},
     {50, "TIMER5_OVF"},
     {21, "TIMER0_COMPA"},
     {22, "TIMER0_COMPB"},
     {23, "TIMER0_OVF"},
     {25, "USART0_RX"},
     {26, "USART0_UDRE"},
     {27, "USART0_TX"},
     {29, "ADC"},
     {30, "EE_READY"}},
};
// clang-format on

}  // namespace

const BoardMap &board_map(const std::string &mcu) {
    for (const BoardMap *map : {&UNO, &MEGA}) {
        if (map->mcu == mcu) {
            return *map;
        }
    }
    throw BoardError("the bench supports atmega328p and atmega2560, not " + mcu);
}

}  // namespace board
