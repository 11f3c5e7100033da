// Standstill: confirms with run-down time and current that a shaft without Hall edges does not
// turn.
//
// The Hall sensor may fail, so a timeout without edges is not sufficient. After its last edge the
// shaft may turn for the run-down time from its last speed, or from the greatest speed that the
// drive can have given it since. After a drive without edges whose current was that of a turning
// shaft, it may turn at any speed. The shaft counts as standing once the bridge has been open for
// that time, so that the direction never changes while the shaft turns. Two cases need no waiting:
// a run-down whose edges end at a low speed, and a shaft that drew the current of a shaft at rest
// for longer than a start takes.
#ifndef VGROOVE_APP_STANDSTILL_H
#define VGROOVE_APP_STANDSTILL_H

#include <stdbool.h>
#include <stdint.h>

// Run-down time from 16,383 rpm, with a margin: the unloaded reference motor needs 2 s, with an
// inertia of 1.8e-5 kg m2 and a friction of at least 0.012 N m (docs/spec/model.md, section 4).
#define STANDSTILL_RUN_DOWN_MS 5000u

typedef struct {
    bool lost;              // driven without edges by the current of a turning shaft
    bool coasts;            // the bridge is open
    uint16_t ended_rpm_q1;  // in the tick of the timeout: speed at the last edges; 0 later
} StandstillInputs;

// Greatest acceleration: 55 A (trip) at 0.0109 N m/A and 1.8e-5 kg m2 (docs/spec/model.md,
// section 4) give 318 rpm/ms.
#define STANDSTILL_RPM_PER_MS 318u
// Full duty gives 18.5 V / 0.0109 V s = 16,200 rpm: 64 rpm per count of the compare value.
#define STANDSTILL_RPM_PER_COUNT 64u
// Time of a drive after which the current shows whether the shaft turns: at 45 A an unloaded shaft
// reaches 0.42 of its full speed within 26 ms and draws less than a shaft at rest from then on.
#define STANDSTILL_STARTED_MS 100u

typedef struct {
    uint8_t driven_ms;       // time driven since the last edge, up to STANDSTILL_STARTED_MS
    uint8_t driven_compare;  // greatest magnitude of the compare value in that time
    bool stood;              // the current at STANDSTILL_STARTED_MS was that of a shaft at rest
    uint16_t unseen_ms;      // remaining time with an open bridge in which the shaft may turn
    bool turned;             // the caller sets it in ticks with speed
} Standstill;

// Call in each driven tick without an edge, with the compare value; true: evaluate the current and
// set `stood`. The caller sets `driven_ms` to 0 at an edge.
bool standstill_driven(Standstill *self, int16_t compare);

// Once a tick in which the Hall speed is 0; true when the shaft stands.
bool standstill_step(Standstill *self, const StandstillInputs *in);

#endif
