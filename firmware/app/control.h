// The controller of the selected mode: takes its setpoints from the parameters, starts and steps
// it.
//
// control_list.h lists the controllers, controllers/controller.h says what each one must provide.
// What app/ does for all controllers, so that no controller has to do it:
//   - It steps a controller in state DRIVE only: trigger pressed, no fault, direction settled.
//     Release, faults and the direction switch end the drive without asking the controller.
//   - Its trigger input is ramped (slew_per_ms); when the shaft is turning at the start of the
//     drive, the ramp begins at the duty of that speed. A controller that returns in->travel_q15
//     behaves as the plain mode.
//   - It limits the returned duty to 0..32767 and reduces it while the current exceeds the
//     fold-back limit. Two ticks later the controller gets the duty that the bridge has applied
//     (in->duty_q15, in->coasted).
//   - CONTROLLER_STOP ends the drive: state `stopped`, bridge open until the trigger's contact
//     opens; telemetry sends the reason until the next drive.
//   - CONTROLLER_COAST opens the bridge for the tick; ramp, fold-back and stall time go on.
//   - A controller of one direction (CONTROL_FORWARD) is replaced by the plain mode in reverse.
//   - It starts the controller after a drive and after a change of mode, direction or parameters,
//     so that the first tick of the next drive has the cycles of a step and no more.
#ifndef VGROOVE_APP_CONTROL_H
#define VGROOVE_APP_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "app/control_list.h"
#include "app/profile.h"
#include "controllers/blow.h"
#include "controllers/controller.h"
#include "telemetry/telemetry_signals.h"

#define CONTROL_SETPOINTS_MAX 10u  // int16_t members of a setpoint struct

#define CONTROL_STATE(MODE, name, Type, ...) Type name;
#define CONTROL_SETPOINTS(MODE, name, Type, ...) Type##Setpoints name;

typedef struct {
    Blow blow;
    BlowSetpoints blow_set;
    union {
        uint8_t none;
        CONTROL_LIST(CONTROL_STATE)
    } state;
    union {
        int16_t words[CONTROL_SETPOINTS_MAX];
        CONTROL_LIST(CONTROL_SETPOINTS)
    } set;
    Profile profile;      // of mode duty
    ControllerInputs in;  // of this tick
    uint8_t mode;         // TELEMETRY_MODE_* of this drive
    bool stopped;         // the controller has ended the drive
    bool stepped;         // since its start
    bool start_due;       // in the next tick
    uint8_t asked;        // mode of the last start
    bool asked_reverse;
} Control;

// Whether this build has the mode: the plain mode, and those of CONTROL_LIST.
bool control_has(uint8_t mode);

// The mode if this build has it, otherwise the plain mode.
uint8_t control_built(uint8_t mode);

// A tick without a drive: copies the setpoints; in the tick after a change, and after a drive, it
// starts the controller. A drive waits while `start_due`.
void control_ready(Control *self, uint8_t mode, bool reverse, const int16_t *value);

// Copies the setpoints of a mode of this build from the parameters; true: one has changed.
bool control_prepare(Control *self, uint8_t mode, const int16_t *value);

// The next step begins a drive of the prepared mode.
void control_start(Control *self, uint8_t mode, bool reverse);

// Returns a duty 0..32767, CONTROLLER_STOP or CONTROLLER_COAST.
int16_t control_step(Control *self, const ControllerInputs *in);

// Whether the last step used so many cycles that the tick has no room for a slow frame.
bool control_was_heavy(const Control *self);

// Whether the controller has made a step since its start: before that there is no drive to report.
bool control_has_stepped(const Control *self);

// Telemetry of the drive: every signal of the frame but control_tick.
void control_report(const Control *self, TelemetryControl *out);

#endif
