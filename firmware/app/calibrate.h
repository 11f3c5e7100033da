// Calibrations: current offset at rest (at every start; on command it becomes a parameter), ends of
// the trigger's travel, Hall pitches.
#ifndef VGROOVE_APP_CALIBRATE_H
#define VGROOVE_APP_CALIBRATE_H

#include "app/app.h"

// `what`: TELEMETRY_CALIBRATE_WHAT_*, CANCEL ends a running one. False while the tool is driven.
bool calibrate_begin(App *app, uint8_t what);

// Once a tick.
void calibrate_step(App *app);

// Whether a learned Hall pitch is to be saved; one per call, since each costs a division.
bool calibrate_pitch_due(const App *app);
void calibrate_pitch(App *app);

// Whether the state machine stays in CALIBRATE; Hall pitches are learned in DRIVE instead.
bool calibrate_holds(const App *app);

#endif
