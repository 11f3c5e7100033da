// Calibrations: current offset at rest (at every start, and on command into the parameters), ends
// of the trigger, Hall pitches.
#ifndef VGROOVE_APP_CALIBRATE_H
#define VGROOVE_APP_CALIBRATE_H

#include "app/app.h"

// TELEMETRY_CALIBRATE_WHAT_*; false when the tool is driven. CANCEL ends what is going on.
bool calibrate_begin(App *app, uint8_t what);

// Once a tick.
void calibrate_step(App *app);

// A learned Hall pitch waits to be taken over; one at a time, since each costs a division.
bool calibrate_pitch_due(const App *app);
void calibrate_pitch(App *app);

// Whether the state machine has to hold CALIBRATE: the Hall pitches are learned while the user
// drives.
bool calibrate_holds(const App *app);

#endif
