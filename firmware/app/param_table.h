// The only list of parameters. Append only: an older EEPROM slot holds the parameters whose version
// is not newer than its own, in this order.
//
// PARAM_LIST(X): X(NAME, unit, default, least, greatest, version)
//   The parameters of a controller begin with its mode's name and stand behind its mark.
//   NAME ends in _Qn where the stored integer is the quantity times 2^n; the unit is that of the
//   quantity. version: the first one that has it.
#ifndef VGROOVE_APP_PARAM_TABLE_H
#define VGROOVE_APP_PARAM_TABLE_H

#define PARAM_VERSION 3u

// clang-format off
#define PARAM_LIST(X)                                                                                    \
    X(HALL_PULSES,              "1/turn",    4,     1,    64,    1) /* edges the capture sees in a turn of the motor */ \
    X(HALL_PITCH_0_Q15,         "1",         8192,  2048, 16384, 1) /* share of the first of four successive pitches in their sum */ \
    X(HALL_PITCH_1_Q15,         "1",         8192,  2048, 16384, 1) /* second pitch */                   \
    X(HALL_PITCH_2_Q15,         "1",         8192,  2048, 16384, 1) /* third pitch */                    \
    X(HALL_PITCH_3_Q15,         "1",         8192,  2048, 16384, 1) /* fourth pitch */                   \
    X(CURRENT_GAIN_A_Q15,       "A/count",   4096,  1024, 16384, 1) /* current of one ADC count */       \
    X(CURRENT_OFFSET_COUNT_Q4,  "count",     8192,  0,    16368, 1) /* ADC counts at no current */       \
    X(TRIP_A_Q9,                "A",         25600, 2560, 28160, 1) /* over-current trip: 55 A at most */ \
    X(FOLDBACK_A_Q9,            "A",         23040, 1024, 28160, 1) /* the duty is reduced above this current */ \
    X(BUS_GAIN_MV_Q8,           "mV/count",  6400,  2560, 12800, 1) /* bus voltage of one ADC count behind the divider */ \
    X(UNDER_VOLTAGE_MV,         "mV",        12000, 6000, 20000, 1) /* bus voltage below which the drive stops */ \
    X(OVER_TEMPERATURE_C,       "degC",      90,    40,   125,   1) /* bridge temperature above which the drive stops */ \
    X(STALL_MS,                 "ms",        500,   50,   5000,  1) /* time at standstill under drive until the stall fault */ \
    X(SLEW_PER_MS_Q15,          "1/ms",      197,   1,    32767, 1) /* rate of the duty, 6 per second */  \
    X(RELEASE_MODE,             "1",         0,     0,    1,     1) /* trigger release: 0 coasts, 1 ramps down within the foldback */ \
    X(TRIGGER_LOW_COUNT,        "count",     100,   0,    500,   1) /* end of the lower dead band of the trigger */ \
    X(TRIGGER_HIGH_COUNT,       "count",     920,   523,  1023,  1) /* start of the upper dead band of the trigger */ \
    X(MODE,                     "1",         0,     0,    5,     1) /* mode at start: 0 duty, 1 sync, 2 screwing, 3 vibration, 4 torque, 5 drill */ \
    X(BAUD_SELECT,              "1",         0,     0,    1,     1) /* 0: 250,000 Bd, 1: 115,200 Bd; from the next start on */ \
    X(FAST_DIVIDER,             "1",         1,     1,    63,    1) /* ticks between two FAST frames, at least what the rate carries; from the next start on */ \
    X(HALL_TIMEOUT_MS,          "ms",        300,   300,  2000,  2) /* time without an edge after which the speed is 0 */ \
    X(DEAD_TIME_COUNT,          "62.5 ns",   2,     2,    60,    2) /* dead time of the bridge in timer counts */ \
    X(MODE_SWITCH_1,            "1",         1,     0,    5,     3) /* mode at position 1 of the mode switch; at position 0: SET_MODE, or `mode` */ \
    X(MODE_SWITCH_2,            "1",         2,     0,    5,     3) /* mode at position 2 */ \
    X(MODE_SWITCH_3,            "1",         4,     0,    5,     3) /* mode at position 3 */ \
    X(BLOW_TURN_Q8,             "1",         717,   128,   1600,  3) /* blows: turns of the motor from lug to lug of a held anvil, gear ratio / lugs */ \
    X(BLOW_SOURCE,              "1",         0,     0,     1,     3) /* blows found in: 0 the Hall speed, 1 the speed by current and duty */ \
    X(MOTOR_MOHM,               "mohm",      190,   10,    2000,  3) /* resistance of the winding */ \
    X(MOTOR_RPM_PER_V,          "rpm/V",     876,   50,    950,   3) /* speed constant */ \
    /* sync */                                                                                           \
    X(SYNC_METHOD,              "1",         1,     1,     2,     3) /* synchronisation by: 1 motor speed, 2 motor current; finds the blows in it, too */ \
    X(SYNC_LOW_MV,              "mV",        14200, 6000,  25000, 3) /* mean voltage of the motor while impacting, with the trigger nearly released */ \
    X(SYNC_HIGH_MV,             "mV",        15500, 6000,  25000, 3) /* the same at full trigger */ \
    X(SYNC_DEPTH_MIN_Q15,       "1",         393,   0,     16383, 3) /* dips of the speed shallower than this share of it lower the voltage */ \
    X(SYNC_DEPTH_MAX_Q15,       "1",         1966,  0,     16383, 3) /* deeper ones raise it */ \
    X(SYNC_CURRENT_A_Q9,        "A",         12800, 1024,  28160, 3) /* method 2: mean current while impacting */ \
    /* screwing */                                                                                       \
    X(SCREWING_SHARE_Q15,       "1",         7373, 0,  32767, 3) /* share of the trigger's duty once it impacts */ \
    X(SCREWING_LEAST_MV,        "mV",        5800,  3000,  12000, 3) /* at the motor: less is not taken */ \
    X(SCREWING_SMALL_DEG_Q4,    "deg",       200,   0,     1440,  3) /* turn a blow below which there is more power */ \
    X(SCREWING_RISE_Q8,         "1",         340,   290,   512,   3) /* seat: torque over the learned one, at least */ \
    /* vibration */                                                                                      \
    X(VIBRATION_METHOD,          "1",       2,     1,     2,     3) /* low vibration: 1 by the Hall speed, 2 by current and duty */ \
    X(VIBRATION_APPROACH_Q15,    "1",       9175,  3277,  32767, 3) /* duty until the hammer meets the anvil */ \
    X(VIBRATION_CLIMB_Q15,       "1",       7766,  1638,  32767, 3) /* duty with which the hammer begins to climb over the first lug */ \
    X(VIBRATION_CLIMB_PER_MS_Q15,"1/ms",    105,   0,     3277,  3) /* what is added to it each ms */ \
    X(VIBRATION_CLIMB_TURN_Q8,   "turn",    172,   26,    768,   3) /* turns of the motor from the dip of its speed to the first release of the hammer */ \
    X(VIBRATION_SURGE_A_Q9,      "A",       21504, 5120,  22528, 3) /* current from there until the duty is that of the trigger */ \
    X(VIBRATION_HARD_SHARE_Q15,  "1",       21234, 0,     32767, 3) /* share of the back-EMF in the voltage of the motor: less is a hard joint */ \
    X(VIBRATION_HARD_MV,         "mV",      14400, 8000,  30000, 3) /* voltage of the motor on a hard joint */ \
    /* torque */                                                                                         \
    X(TORQUE_TARGET_NM,         "N m",       80,    40,   120,   3) /* torque to which the joint is tightened */ \
    /* drill */                                                                                          \
    X(DRILL_CLUTCH_DNM,         "0.1 Nm",    0,     0,    300,   3) /* drill: torque of the electronic clutch at the chuck, 0 none */ \
    X(DRILL_RATIO_Q8,           "1",         8064,  256,  32767, 3) /* drill: gear ratio, 31.5 in low gear */ \
    X(DRILL_PULSE,              "1",         0,     0,    1,     3) /* drill: pulse mode above 15 A */ \
    X(DRILL_KICKBACK,           "1",         1,     0,    1,     3) /* drill: anti-kickback */ \
    /* end of the list */
// clang-format on

#endif
