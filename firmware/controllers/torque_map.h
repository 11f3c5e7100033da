// What level and current belong to a torque: rows of 1 N m, made from the plant by
// hil/vgroove/study/torque_map.py.
#ifndef VGROOVE_CONTROLLERS_TORQUE_MAP_H
#define VGROOVE_CONTROLLERS_TORQUE_MAP_H

#include <stdint.h>

#define TORQUE_MAP_FIRST_NM 40
#define TORQUE_MAP_LAST_NM 120
#define TORQUE_MAP_ROWS 81u
#define TORQUE_MAP_NEVER INT16_MAX

// On this level blows stop turning a joint at the row's torque.
int16_t torque_map_level_mv(uint8_t row);

// A joint that takes this current there, or more, is so hard that it settles; NEVER: the row has
// the raised level only.
int16_t torque_map_settled_a_q8(uint8_t row);

// Level for soft joints, and the current on it at the row's torque.
int16_t torque_map_raised_mv(uint8_t row);
int16_t torque_map_stop_a_q8(uint8_t row);

#endif
