// SPDX-License-Identifier: GPL-3.0-or-later
// Runs a board at the pace of the wall clock, its UART on a pseudo-terminal.
#ifndef VGROOVE_BOARD_REAL_TIME_HPP
#define VGROOVE_BOARD_REAL_TIME_HPP

#include "bench.hpp"

namespace board {

// Prints the name of the pseudo-terminal to the descriptor `stream`, then runs until SIGTERM,
// SIGINT or a power cut. `pace`: seconds of the board in a second of the wall clock, for tests on
// busy machines. The sensors keep their rest values: no tool is connected.
void serve_pseudo_terminal(Bench &bench, int stream, double pace);

}  // namespace board

#endif
