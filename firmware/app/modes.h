// State machine of the tool.
//
//   from       to         condition
//   CALIBRATE  IDLE       calibration finished or cancelled
//   IDLE       CALIBRATE  calibration requested, at rest
//   IDLE       DRIVE      pressed, armed; at rest or the direction switch unchanged
//   DRIVE      RELEASE    released, or the direction switch changed
//   DRIVE      STOPPED    the controller has ended the drive
//   RELEASE    DRIVE      pressed, armed, the direction switch unchanged
//   RELEASE    IDLE       at rest
//   STOPPED    IDLE       contact open
//   any        FAULT      a fault is latched
//   FAULT      IDLE       contact open, no fault condition present
//
// The bridge is driven in DRIVE, open otherwise; in RELEASE with the parameter release_mode 1 the
// duty falls to 0 first, within 300 ms. armed: the contact was open at least once since the start,
// the last fault, the last stop, and since the drive has the direction of its switch, which it
// takes in IDLE at standstill only: a press during the run-down in the other direction does not
// count.
#ifndef VGROOVE_APP_MODES_H
#define VGROOVE_APP_MODES_H

#include <stdbool.h>
#include <stdint.h>

typedef enum {
    MODES_IDLE,
    MODES_DRIVE,
    MODES_RELEASE,
    MODES_FAULT,
    MODES_CALIBRATE,
    MODES_STOPPED,
} ModesState;

typedef struct {
    bool pressed;  // contact closed and travel beyond the dead band
    bool contact;  // contact closed
    bool reverse_switch;
    bool standstill;
    bool fault;           // one is latched
    bool fault_persists;  // its condition is still present
    bool calibrating;     // requested and not finished
    bool stopped;         // the controller has ended the drive
} ModesInputs;

typedef struct {
    uint8_t state;  // ModesState
    bool reverse;
    bool armed;
} Modes;

typedef enum {
    MODES_COMMAND_COAST,
    MODES_COMMAND_DRIVE,
    MODES_COMMAND_RAMP_DOWN,
} ModesCommand;

void modes_init(Modes *self);
ModesState modes_next(const Modes *self, const ModesInputs *m);
ModesCommand modes_output(const Modes *self, bool release_ramps);
void modes_step(Modes *self, const ModesInputs *m);

#endif
