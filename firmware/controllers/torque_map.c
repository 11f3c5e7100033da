// Rows of 1 N m, see torque_map.h; made by hil/vgroove/study/torque_map.py, not by hand.
#include "controllers/torque_map.h"

#include "core/flash.h"

#define LEAST_MV 5000
#define STEP_MV 40
#define LEAST_A_Q8 (12 * 256)
#define NONE 255u

// clang-format off
static const uint8_t level_40mv[TORQUE_MAP_ROWS] FLASH_TABLE = {
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    13, 17, 20, 23, 27, 30, 33, 40, 40, 41, 50, 47, 52, 58, 59, 60, 62, 63, 74, 76,
    77, 79, 80, 81, 83, 85, 86, 88, 89, 91, 93, 95, 100, 110, 113, 116, 119, 123, 129, 131,
    134, 135, 136, 138, 145, 145, 149, 151, 152, 154, 155, 157, 158, 160, 161, 162, 164, 165, 167, 168,
    170};

// Above 12 A.
static const uint8_t settled_a_q4[TORQUE_MAP_ROWS] FLASH_TABLE = {
    255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255,
    25, 25, 26, 25, 31, 25, 29, 42, 42, 43, 27, 25, 32, 43, 44, 45, 48, 49, 73, 75,
    77, 80, 81, 83, 86, 88, 90, 93, 94, 97, 99, 102, 104, 47, 51, 56, 60, 67, 72, 73,
    77, 84, 85, 87, 100, 100, 101, 114, 117, 120, 122, 126, 128, 131, 133, 134, 138, 139, 142, 144,
    147};

static const uint8_t raised_40mv[TORQUE_MAP_ROWS] FLASH_TABLE = {
    15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 90, 90,
    90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90, 90,
    90, 90, 125, 125, 125, 125, 125, 125, 125, 125, 125, 192, 192, 192, 192, 192, 192, 192, 192, 192,
    192, 192, 192, 192, 192, 192, 215, 215, 215, 215, 215, 215, 215, 215, 215, 215, 215, 215, 215, 215,
    215};

static const int16_t stop_a_q8[TORQUE_MAP_ROWS] FLASH_TABLE = {
    3345, 3355, 3366, 3377, 3388, 3400, 3412, 3423, 3435, 3447, 3458, 3469, 3479, 3489, 3499, 3507, 3515, 3522, 4320, 4334,
    4349, 4365, 4380, 4395, 4410, 4426, 4441, 4456, 4471, 4486, 4501, 4515, 4529, 4543, 4557, 4570, 4584, 4596, 4608, 4620,
    4631, 4642, 4140, 4148, 4155, 4162, 4168, 4174, 4180, 4186, 4193, 5823, 5842, 5861, 5880, 5898, 5917, 5935, 5953, 5971,
    5988, 6004, 6021, 6036, 6051, 6065, 6626, 6643, 6660, 6676, 6691, 6706, 6721, 6735, 6749, 6762, 6776, 6789, 6802, 6815,
    6828};
// clang-format on

int16_t torque_map_level_mv(uint8_t row) {
    return (int16_t)(LEAST_MV + FLASH_U8(&level_40mv[row]) * STEP_MV);
}

int16_t torque_map_settled_a_q8(uint8_t row) {
    const uint8_t settled = FLASH_U8(&settled_a_q4[row]);
    return settled == NONE ? TORQUE_MAP_NEVER : (int16_t)(LEAST_A_Q8 + settled * 16);
}

int16_t torque_map_raised_mv(uint8_t row) {
    return (int16_t)(LEAST_MV + FLASH_U8(&raised_40mv[row]) * STEP_MV);
}

int16_t torque_map_stop_a_q8(uint8_t row) {
    return FLASH_I16(&stop_a_q8[row]);
}
