// Whether the shaft stands: no edge within the time-out says so only as far as the Hall sensor can
// be believed.
//
// After its last edge a shaft may turn unseen for as long as it takes to run down from its speed
// then, or from the most that the drive can have given it since; after a drive without edges whose
// current was that of a turning shaft, from any speed. It counts as standing once it has coasted
// for that long, so that the direction never changes while it turns. A run-down whose edges come to
// their natural end is not delayed: their last speed is next to none. Nor is a shaft that drew the
// current of a standing one for longer than it takes to get going.
#ifndef VGROOVE_APP_STANDSTILL_H
#define VGROOVE_APP_STANDSTILL_H

#include <stdbool.h>
#include <stdint.h>

// From 16,383 rpm. The reference motor without load needs 2 s (physics.md: 1.8e-5 kg m2 against
// 0.012 N m and more).
#define STANDSTILL_RUN_DOWN_MS 5000u

typedef struct {
    bool lost;  // driven without edges by the current of a turning shaft
    bool coasts;
    uint16_t ended_rpm_q1;  // in the tick of the time-out: speed at the last edges; 0 later
} StandstillInputs;

// The drive's greatest acceleration: 55 A (the trip) at 0.0109 N m/A and 1.8e-5 kg m2 (physics.md)
// make 318 rpm/ms.
#define STANDSTILL_RPM_Q1_PER_MS 636u
// Full duty takes the shaft to 18.5 V / 0.0109 V s = 16,200 rpm: a count of the compare value
// to 64.
#define STANDSTILL_RPM_Q1_PER_COUNT 128u
// An unloaded shaft has left the current of a standing one behind by then: 0.42 of the speed at 45
// A takes 26 ms.
#define STANDSTILL_GOING_MS 100u

typedef struct {
    uint8_t driven_ms;       // since the last edge, up to STANDSTILL_GOING_MS
    uint8_t driven_compare;  // greatest since then
    bool stood;              // so says the current, at STANDSTILL_GOING_MS
    uint16_t unseen_ms;      // for which the shaft may still turn, coasting
    bool turned;             // to be set in ticks in which the sensor says that the shaft turns
} Standstill;

// In each tick without an edge that drives, with its compare value; true when `stood` wants to be
// told. An edge makes `driven_ms` 0.
bool standstill_driven(Standstill *self, int16_t compare);

// Once a tick while the sensor says that the shaft rests; true when it stands.
bool standstill_step(Standstill *self, const StandstillInputs *in);

#endif
