// The controllers on the board: one of them acts, chosen by the mode.
//
// To plug one in (its functions: controllers/controller.h; its mode must be in the value table of
// `mode` in telemetry/vgroove.dbc):
//   1. here: include its header and add its line to CONTROL_LIST, which alone says which modes
//   exist; limits of PARAM_MODE_*: param_table.h;
//   2. control.c: SETPOINTS_MODE names the parameter that each of its setpoints comes from (all of
//   them are words);
//   3. app/param_table.h: its parameters, behind its mark; then run telemetry/generate.py;
//   4. CMakeLists.txt of the firmware: its source.
//
// What the frame does, so that no controller has to:
//   - calls it in DRIVE only: trigger pressed, no fault, direction settled. Release, faults and the
//   direction switch go over its head;
//   - gives it a trigger that is ramped (slew_per_ms) and, when the shaft still turns, begins at
//   the duty of that speed: a controller that returns
//     in->travel_q15 is the plain mode;
//   - limits what it returns to 0..32767 and to the current of the fold-back, and tells it what
//   came of it two ticks later (in->duty_q15, in->coasted);
//   - CONTROLLER_STOP: state `stopped` with the bridge open until the trigger's contact opens; the
//   reason stays in telemetry until the next drive;
//   - ticks of CONTROLLER_COAST belong to the drive: ramps, fold-back and the time of a stall go on
//   over them;
//   - a controller of one direction (CONTROL_FORWARD: what ends a drive at a torque or a depth)
//   leaves reverse to the plain mode.
// start and step of a drive's first tick come in the same tick: together within the cycles of a
// step.
#ifndef VGROOVE_APP_CONTROL_H
#define VGROOVE_APP_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "app/profile.h"
#include "controllers/blow.h"
#include "controllers/controller.h"
#include "controllers/drill.h"
#include "controllers/screwing.h"
#include "controllers/sync.h"
#include "controllers/torque.h"
#include "controllers/vibration.h"
#include "telemetry/telemetry_signals.h"

enum {
    CONTROL_BOTH,     // acts in both directions
    CONTROL_FORWARD,  // acts when the tool tightens
};

// X(MODE, name, Type, directions): TELEMETRY_MODE_<MODE>, name_step(), Type and Type##Setpoints
// clang-format off
#define CONTROL_LIST(X) \
    X(SYNC, sync, Sync, CONTROL_BOTH) \
    X(SCREWING, screwing, Screwing, CONTROL_FORWARD) \
    /* vibration */ \
    X(VIBRATION, vibration, Vibration, CONTROL_BOTH) \
    /* torque */ \
    X(TORQUE, torque, Torque, CONTROL_FORWARD) \
    X(DRILL, drill, Drill, CONTROL_BOTH) \
    /* end of the list */
// clang-format on

#define CONTROL_SETPOINTS_MOST 10u  // of a controller

#define CONTROL_STATE(MODE, name, Type, directions) Type name;
#define CONTROL_SETPOINTS(MODE, name, Type, directions) Type##Setpoints name;

typedef struct {
    Blow blow;
    BlowSetpoints blow_set;
    union {
        uint8_t none;
        CONTROL_LIST(CONTROL_STATE)
    } state;
    union {
        int16_t words[CONTROL_SETPOINTS_MOST];
        CONTROL_LIST(CONTROL_SETPOINTS)
    } set;
    Profile profile;      // of mode duty
    ControllerInputs in;  // of this tick
    uint8_t mode;         // TELEMETRY_MODE_* of this drive
    bool stopped;         // the controller has ended it
} Control;

// Whether the firmware has this mode.
bool control_has(uint8_t mode);

// Takes the setpoints of a mode out of the parameters: in each tick between drives, which are
// light, so that a drive begins with the latest.
void control_prepare(Control *self, uint8_t mode, const int16_t *value);

// A drive of the mode that was prepared begins.
void control_start(Control *self, uint8_t mode, bool reverse);

// Duty 0..32767, CONTROLLER_STOP or CONTROLLER_COAST.
int16_t control_step(Control *self, const ControllerInputs *in);

// Whether the last step computed so much that the tick has no room for a slow frame.
bool control_was_heavy(const Control *self);

// For telemetry, of the drive that goes on or was the last; all but control_tick.
void control_report(const Control *self, TelemetryControl *out);

#endif
