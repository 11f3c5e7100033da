// Hammering level and motor current that belong to a target torque, a row per N m.
#ifndef VGROOVE_CONTROLLERS_TORQUE_MAP_H
#define VGROOVE_CONTROLLERS_TORQUE_MAP_H

#include <stdint.h>

#define TORQUE_MAP_FIRST_NM 40
#define TORQUE_MAP_LAST_NM 120
#define TORQUE_MAP_ROWS 81u
#define TORQUE_MAP_NEVER INT16_MAX

// Level on which blows stop turning a joint at the row's torque.
int16_t torque_map_level_mv(uint8_t row);

// Motor current on that level from which on the joint is hard: it stops turning there. NEVER: the
// row has a raised level only.
int16_t torque_map_settled_a_q8(uint8_t row);

// Higher level for soft joints, and the motor current on it at the row's torque.
int16_t torque_map_raised_mv(uint8_t row);
int16_t torque_map_stop_a_q8(uint8_t row);

#endif
