// Tables of torque_map.h, computed by hil/vgroove/adapt/torque_map.py: edit that, not this.
#include "controllers/torque_map.h"

#define BASE_MV 5000
#define STEP_MV 40
#define RUN_STEP_MV 20
#define LEAST_A_Q8 (12 * 256)
#define NEVER 255u  // no current: the target is too low for a joint to settle at its level

// clang-format off
FLASH_CONST TorqueMap torque_map FLASH_TABLE = {
    .stop_a_q8 =
        {3344, 3355, 3366, 3377, 3389, 3400, 3412, 3424, 3436, 3447, 3458, 3469,
         3480, 3489, 3499, 3507, 3515, 3522, 4330, 4344, 4358, 4373, 4387, 4402,
         4416, 4431, 4445, 4460, 4474, 4489, 4503, 4517, 4531, 4545, 4558, 4571,
         4584, 4596, 4608, 4620, 4631, 4642, 4108, 4120, 4132, 4144, 4156, 4166,
         4177, 4187, 4196, 4204, 4212, 4219, 5853, 5873, 5893, 5912, 5930, 5949,
         5967, 5984, 6001, 6018, 6033, 6048, 6620, 6638, 6655, 6671, 6687, 6703,
         6718, 6732, 6747, 6761, 6774, 6788, 6801, 6814, 6828},
    .level_40mv =
        {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
         0, 0, 0, 0, 0, 0, 10, 10, 12, 16, 20, 23,
         27, 30, 33, 40, 40, 41, 41, 58, 58, 58, 59, 60,
         62, 63, 74, 76, 77, 79, 80, 81, 83, 85, 86, 88,
         89, 91, 93, 95, 100, 99, 115, 116, 119, 123, 129, 131,
         134, 135, 136, 138, 145, 145, 149, 151, 152, 154, 155, 157,
         158, 160, 161, 162, 164, 165, 167, 168, 170},
    .settled_a_q4 =
        {NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, NEVER,
         NEVER, NEVER, NEVER, NEVER, NEVER, NEVER, 17, 17, 17, 18, 20, 21,
         22, 24, 23, 29, 29, 31, 31, 43, 43, 43, 44, 45,
         48, 49, 73, 75, 77, 80, 81, 83, 86, 88, 90, 93,
         94, 97, 99, 102, 104, 104, 51, 53, 57, 63, 72, 73,
         77, 84, 84, 85, 100, 100, 106, 115, 117, 121, 122, 126,
         128, 131, 133, 134, 138, 139, 143, 144, 147},
    .raised_40mv =
        {15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15,
         15, 15, 15, 15, 15, 15, 90, 90, 90, 90, 90, 90,
         90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90,
         90, 90, 90, 90, 90, 90, 125, 125, 125, 125, 125, 125,
         125, 125, 125, 125, 125, 125, 192, 192, 192, 192, 192, 192,
         192, 192, 192, 192, 192, 192, 215, 215, 215, 215, 215, 215,
         215, 215, 215, 215, 215, 215, 215, 215, 215},
    .run_20mv = 25,
};
// clang-format on

int16_t torque_map_run_mv(void) {
    return (int16_t)(BASE_MV + FLASH_U8(&torque_map.run_20mv) * RUN_STEP_MV);
}

int16_t torque_map_level_mv(uint8_t row) {
    return (int16_t)(BASE_MV + FLASH_U8(&torque_map.level_40mv[row]) * STEP_MV);
}

int16_t torque_map_settled_a_q8(uint8_t row) {
    const uint8_t settled = FLASH_U8(&torque_map.settled_a_q4[row]);
    return settled == NEVER ? TORQUE_MAP_NEVER : (int16_t)(LEAST_A_Q8 + settled * 16);
}

int16_t torque_map_raised_mv(uint8_t row) {
    return (int16_t)(BASE_MV + FLASH_U8(&torque_map.raised_40mv[row]) * STEP_MV);
}

int16_t torque_map_stop_a_q8(uint8_t row) {
    return FLASH_I16(&torque_map.stop_a_q8[row]);
}
