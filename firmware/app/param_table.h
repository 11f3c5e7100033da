// The only list of parameters. Append only: an older EEPROM slot holds the parameters whose version
// is not newer than its own, in this order.
//
// PARAM_LIST(X): X(NAME, unit, default, least, greatest, version) followed by a comment, its text
//   {signal} in the text stands for the value table of a signal.
//   The parameters of a controller begin with the name of its mode and stand in its section.
//   NAME ends in _Qn where the stored integer is the quantity times 2^n; unit: of the quantity.
//   version: the first list version that has the parameter.
#ifndef VGROOVE_APP_PARAM_TABLE_H
#define VGROOVE_APP_PARAM_TABLE_H

#include "telemetry/telemetry_signals.h"

#define PARAM_VERSION 4u

// clang-format off
#define PARAM_LIST(X)                                                                            \
    X(HALL_PULSES,               "1/turn",   4,     1,    4,     1)                              \
      /* edges of the Hall sensor per turn of the motor */                                       \
    X(HALL_PITCH_0_Q15,          "1",        8192,  2048, 16384, 1)                              \
      /* share of the first of four successive pitches in their sum */                           \
    X(HALL_PITCH_1_Q15,          "1",        8192,  2048, 16384, 1) /* second pitch */           \
    X(HALL_PITCH_2_Q15,          "1",        8192,  2048, 16384, 1) /* third pitch */            \
    X(HALL_PITCH_3_Q15,          "1",        8192,  2048, 16384, 1) /* fourth pitch */           \
    X(CURRENT_GAIN_A_Q15,        "A/count",  4096,  1024, 16384, 1)                              \
      /* current of one ADC count */                                                             \
    X(CURRENT_OFFSET_COUNT_Q4,   "count",    8192,  0,    16368, 1)                              \
      /* ADC counts at zero current */                                                           \
    X(TRIP_A_Q9,                 "A",        25600, 2560, 28160, 1)                              \
      /* over-current trip: 55 A at most */                                                      \
    X(FOLDBACK_A_Q9,             "A",        23040, 1024, 28160, 1)                              \
      /* fold-back: the duty is reduced above this current */                                    \
    X(BUS_GAIN_MV_Q8,            "mV/count", 6400,  2560, 12800, 1)                              \
      /* bus voltage of one ADC count, divider included */                                       \
    X(UNDER_VOLTAGE_MV,          "mV",       12000, 6000, 20000, 1)                              \
      /* bus voltage below which the drive stops */                                              \
    X(OVER_TEMPERATURE_C,        "degC",     90,    40,   125,   1)                              \
      /* bridge temperature above which the drive stops */                                       \
    X(STALL_MS,                  "ms",       500,   50,   5000,  1)                              \
      /* time without an edge under drive until the stall fault */                               \
    X(SLEW_PER_MS_Q15,           "1/ms",     197,   1,    32767, 1)                              \
      /* greatest rate of the duty; a raw value of 197 is 6 per second */                        \
    X(RELEASE_MODE,              "1",        0,     0,    1,     1)                              \
      /* trigger release: 0 coasts, 1 ramps down within the fold-back */                         \
    X(TRIGGER_LOW_COUNT,         "count",    100,   0,    500,   1)                              \
      /* end of the lower dead band of the trigger */                                            \
    X(TRIGGER_HIGH_COUNT,        "count",    920,   523,  1023,  1)                              \
      /* start of the upper dead band of the trigger */                                          \
    X(MODE,                      "1",        0,     0,    TELEMETRY_MODE_LAST,1)                 \
      /* mode at start: {mode} */                                                                \
    X(BAUD_SELECT,               "1",        0,     0,    1,     1)                              \
      /* 0: 250,000 Bd, 1: 115,200 Bd; from the next start on */                                 \
    X(FAST_DIVIDER,              "1",        1,     1,    63,    1)                              \
      /* ticks per FAST frame, at 115,200 Bd at least 2; from the next start on */               \
    X(HALL_TIMEOUT_MS,           "ms",       300,   300,  2000,  2)                              \
      /* time without an edge after which the speed is 0 */                                      \
    X(DEAD_TIME_COUNT,           "62.5 ns",  2,     2,    60,    2)                              \
      /* dead time of the bridge in timer counts */                                              \
    X(MODE_SWITCH_1,             "1",        1,     0,    TELEMETRY_MODE_LAST,3)                 \
      /* mode at position 1 of the mode switch; at position 0: SET_MODE, or `mode` */            \
    X(MODE_SWITCH_2,             "1",        2,     0,    TELEMETRY_MODE_LAST,3)                 \
      /* mode at position 2 */                                                                   \
    X(MODE_SWITCH_3,             "1",        4,     0,    TELEMETRY_MODE_LAST,3)                 \
      /* mode at position 3 */                                                                   \
    X(BLOW_TURN_Q8,              "1",        717,   128,  1600,  3)                              \
      /* turns of the motor from lug to lug of a held anvil: gear ratio / lugs */                \
    X(BLOW_SOURCE,               "1",        0,     0,    1,     3)                              \
      /* blows are detected in: 0 Hall speed, 1 speed computed from current and duty */          \
    X(MOTOR_MOHM,                "mohm",     190,   10,   2000,  3) /* winding resistance */     \
    X(MOTOR_RPM_PER_V,           "rpm/V",    876,   50,   950,   3) /* speed constant */         \
    /* sync */                                                                                   \
    X(SYNC_METHOD,               "1",        1,     1,    2,     3)                              \
      /* signal of the controller and of its blow detection: 1 motor speed, 2 motor current */   \
    X(SYNC_LOW_MV,               "mV",       14200, 6000, 25000, 3)                              \
      /* mean motor voltage while impacting, trigger nearly released */                          \
    X(SYNC_HIGH_MV,              "mV",       15500, 6000, 25000, 3)                              \
      /* mean motor voltage while impacting, full trigger */                                     \
    X(SYNC_DEPTH_MIN_Q15,        "1",        393,   0,    16383, 3)                              \
      /* valleys of the speed below this share of it lower the voltage */                        \
    X(SYNC_DEPTH_MAX_Q15,        "1",        1966,  0,    16383, 3)                              \
      /* valleys of the speed above this share of it raise the voltage */                        \
    X(SYNC_CURRENT_A_Q9,         "A",        12800, 1024, 28160, 3)                              \
      /* method 2: mean current while impacting */                                               \
    /* screwing */                                                                               \
    X(SCREWING_SHARE_Q15,        "1",        9994,  0,    32767, 3)                              \
      /* share of the trigger's duty while impacting */                                          \
    X(SCREWING_LEAST_MV,         "mV",       5650,  3000, 12000, 3)                              \
      /* lower limit of the motor voltage while impacting */                                     \
    X(SCREWING_SMALL_DEG_Q4,     "deg",      200,   0,    1440,  3)                              \
      /* rotation of the screw per blow below which the power is raised */                       \
    X(SCREWING_RISE_Q8,          "1",        340,   290,  512,   3)                              \
      /* seat detection: least ratio of the present torque to the learned one */                 \
    /* vibration */                                                                              \
    X(VIBRATION_METHOD,          "1",        2,     1,    2,     3)                              \
      /* signal of the controller: 1 Hall speed, 2 speed computed from current and duty */       \
    X(VIBRATION_APPROACH_Q15,    "1",        9175,  3277, 32767, 3)                              \
      /* duty until the hammer meets the anvil */                                                \
    X(VIBRATION_CLIMB_Q15,       "1",        7766,  1638, 32767, 3)                              \
      /* duty at which the hammer begins to climb over the first lug */                          \
    X(VIBRATION_CLIMB_PER_MS_Q15,"1/ms",     105,   0,    3277,  3)                              \
      /* rate at which the duty of the climb rises */                                            \
    X(VIBRATION_CLIMB_TURN_Q8,   "turn",     172,   26,   768,   3)                              \
      /* motor turns from the dip of the speed to the first release of the hammer */             \
    X(VIBRATION_SURGE_A_Q9,      "A",        21504, 5120, 22528, 3)                              \
      /* current from the hammer's release until the duty is that of the trigger */              \
    X(VIBRATION_HARD_SHARE_Q15,  "1",        21234, 0,    32767, 3)                              \
      /* hard joint: back-EMF below this share of the motor voltage */                           \
    X(VIBRATION_HARD_MV,         "mV",       14400, 8000, 30000, 3)                              \
      /* motor voltage on a hard joint */                                                        \
    /* torque */                                                                                 \
    X(TORQUE_TARGET_NM,          "N m",      80,    40,   120,   3)                              \
      /* torque to which the joint is tightened */                                               \
    /* drill */                                                                                  \
    X(DRILL_CLUTCH_DNM,          "0.1 Nm",   0,     0,    300,   3)                              \
      /* torque of the electronic clutch at the chuck, 0: no clutch */                           \
    X(DRILL_RATIO_Q8,            "1",        8064,  256,  32767, 3)                              \
      /* gear ratio motor / chuck: 31.5 in low gear, 8.75 in high gear */                        \
    X(DRILL_PULSE,               "1",        0,     0,    1,     3)                              \
      /* 1: pulse mode above 15 A */                                                             \
    X(DRILL_KICKBACK,            "1",        1,     0,    1,     3) /* 1: anti-kickback */       \
    X(RUN_DOWN_PER_MS_Q15,       "1/ms",     197,   110,  32767, 4)                              \
      /* release_mode 1: rate at which the duty falls, 0 within 300 ms */                        \
    /* end of the list */
// clang-format on

#endif
