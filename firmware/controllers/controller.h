// What every controller gets and gives: `int16_t NAME_step(Name *self, const ControllerInputs *in)` returns the wished duty, 0..32767.
//
// All quantities count in the direction of the drive: positive speed and current drive the tool, negative current brakes it.
#ifndef VGROOVE_CONTROLLERS_CONTROLLER_H
#define VGROOVE_CONTROLLERS_CONTROLLER_H

#include <stdint.h>

typedef struct {
    int16_t travel_q15;  // trigger, 0 released
    int16_t speed_rpm_q1;
    int16_t current_a_q9;
    uint16_t supply_mv;
} ControllerInputs;

#endif
