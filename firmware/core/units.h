// Units table: the only choice of each fixed-point format.
//
// | quantity    | C suffix | type    | Q  | unit | range             | LSB            |
// | current     | _a_q9    | int16_t | 9  | A    | +-64              | 1.95 mA        |
// | speed       | _rpm_q1  | int16_t | 1  | rpm  | +-16,383.5        | 0.5 rpm        |
// | duty        | _q15     | int16_t | 15 | 1    | -1 .. 1 - 2^-15   | 30.5e-6        |
// | supply      | _mv      | uint16_t| 0  | mV   | 0 .. 65,535       | 1 mV           |
// | temperature | _c_q4    | int16_t | 4  | C    | -50 .. 449        | 0.0625 C       |
// | ADC mean    | _q4      | int16_t | 4  | count| 0 .. 1,023        | 1/16 count     |
#ifndef VGROOVE_CORE_UNITS_H
#define VGROOVE_CORE_UNITS_H

#define UNITS_CURRENT_Q 9u
#define UNITS_DUTY_Q 15u
#define UNITS_COUNT_Q 4u

#endif
