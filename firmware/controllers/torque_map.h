// Hammering level and motor current that belong to a target torque, a row per N m. `vgroove adapt`
// replaces the table in the image by that of another tool.
#ifndef VGROOVE_CONTROLLERS_TORQUE_MAP_H
#define VGROOVE_CONTROLLERS_TORQUE_MAP_H

#include <stdint.h>

#include "core/flash.h"

#define TORQUE_MAP_FIRST_NM 40
#define TORQUE_MAP_LAST_NM 120
#define TORQUE_MAP_ROWS 81u
#define TORQUE_MAP_NEVER INT16_MAX

// The map as it lies in flash; no padding on any machine.
typedef struct {
    int16_t stop_a_q8[TORQUE_MAP_ROWS];
    uint8_t level_40mv[TORQUE_MAP_ROWS];    // level - 5 V
    uint8_t settled_a_q4[TORQUE_MAP_ROWS];  // current - 12 A; 255: never
    uint8_t raised_40mv[TORQUE_MAP_ROWS];   // level - 5 V
    uint8_t run_20mv;                       // level - 5 V
} TorqueMap;

extern FLASH_CONST TorqueMap torque_map;

// Level of the run-up, the least one on which the hammer climbs over the lugs, with a margin.
int16_t torque_map_run_mv(void);

// Level on which blows stop turning a joint at the row's torque.
int16_t torque_map_level_mv(uint8_t row);

// Motor current on that level from which on the joint is hard: it stops turning there. NEVER: the
// row has a raised level only.
int16_t torque_map_settled_a_q8(uint8_t row);

// Higher level for soft joints, and the motor current on it at the row's torque.
int16_t torque_map_raised_mv(uint8_t row);
int16_t torque_map_stop_a_q8(uint8_t row);

#endif
