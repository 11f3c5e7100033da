// Whether the shaft stands: no edge within the time-out says so only as far as the Hall sensor can be believed.
//
// After its last edge a shaft may turn unseen for as long as it takes to run down from its speed then; after a drive without edges whose current was
// that of a turning shaft, from any speed. It counts as standing once it has coasted for that long, so that the direction never changes while it
// turns. A run-down whose edges come to their natural end is not delayed: their last speed is next to none.
#ifndef VGROOVE_APP_STANDSTILL_H
#define VGROOVE_APP_STANDSTILL_H

#include <stdbool.h>
#include <stdint.h>

// From 16,383 rpm. The reference motor without load needs 2 s (physics.md: 1.8e-5 kg m2 against 0.012 N m and more).
#define STANDSTILL_RUN_DOWN_MS 5000u

typedef struct {
    bool lost;              // driven without edges by the current of a turning shaft
    bool coasts;
    uint16_t ended_rpm_q1;  // in the tick of the time-out: speed at the last edges
} StandstillInputs;

typedef struct {
    uint16_t unseen_ms;  // for which the shaft may still turn, coasting
    bool turned;         // to be set in ticks in which the sensor says that the shaft turns
} Standstill;

// Once a tick while the sensor says that the shaft rests; true when it stands.
bool standstill_step(Standstill *self, const StandstillInputs *in);

#endif
