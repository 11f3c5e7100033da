// Motor speed from Hall edges: one pitch over the last period, bounded by the time since the last
// edge, 0 after the timeout.
//
// Magnets and switching points are never evenly spaced. The four pitches that repeat are shares of
// their sum, learned by hall_spacing.h. Which of them ends at an edge is known while `index_known`;
// otherwise all pitches count as equal.
#ifndef VGROOVE_DRIVERS_HALL_SPEED_H
#define VGROOVE_DRIVERS_HALL_SPEED_H

#include <stdbool.h>
#include <stdint.h>

#include "core/ring.h"
#include "drivers/hall_spacing.h"

#define HALL_SPEED_PITCHES HALL_SPACING_PITCHES
#define HALL_SPEED_PITCH_EQUAL_Q15 8192

typedef struct {
    volatile bool overflowed;
    uint32_t now_cycles;     // of the tick; its low half is Timer1 at the tick
    uint32_t edge_cycles;    // of the last valid edge
    uint32_t period_cycles;  // between the last two edges, of one pitch
    uint32_t before_cycles;  // the previous period, 0: none
    uint32_t timeout_cycles;
    uint32_t factor[HALL_SPEED_PITCHES];  // rpm Q1 times period of each pitch
    uint32_t factor_equal;
    uint32_t edge_factor;   // of the pitch that ended at the last edge, if its index was known
    uint32_t least_cycles;  // a shorter period is more than twice the range of the speed: no edge
    uint32_t fast_cycles;   // in a longer period a missed edge looks like braking
    uint16_t magnitude_rpm_q1;
    uint8_t edges;      // since standstill, up to 2: there is a period
    uint8_t index;      // pitch that begins at the last edge
    uint8_t new_edges;  // in this tick
    uint8_t missed;
    uint8_t doubled;
    bool index_known;
    bool edge_known;  // edge_factor is valid, otherwise all pitches are equal
    bool uneven;      // the pitches differ enough for an index to matter
    bool learned;     // hall_spacing has learned the pitches
    int16_t share_q15[HALL_SPEED_PITCHES];
    HallSpacing spacing;
    bool reverse;      // sign, set at standstill
    RingWords stamps;  // Timer1 at the edge; last, since the first 64 bytes are accessed faster
} HallSpeed;

// Speed of a tick and its events.
typedef struct {
    int16_t rpm_q1;
    bool saturated;
    bool missed;
    bool doubled;
    bool overflowed;
} HallSpeedResult;

// A zeroed HallSpeed is at rest. pulses: edges per turn. Set the pitches after it.
void hall_speed_configure(HallSpeed *self, uint8_t pulses, uint16_t timeout_ms);
void hall_speed_set_pitch(HallSpeed *self, uint8_t pitch, int16_t share_q15);
HallSpeedResult hall_speed_tick(HallSpeed *self);

// Whether no edge has occurred within the timeout.
bool hall_speed_at_rest(const HallSpeed *self);

// Speed of the last period without sign; 0 if there was only one edge since standstill.
uint16_t hall_speed_last_rpm_q1(const HallSpeed *self);

// Sign of the speed: one Hall sensor does not measure it, so it is the direction of the drive,
// changed only at standstill. False while the shaft turns.
bool hall_speed_set_reverse(HallSpeed *self, bool reverse);

// Starts or ends learning the pitches; `learned` is set when they are available, after 256 edges at
// constant speed.
void hall_speed_learn(HallSpeed *self, bool learning);

// Whether a step of the search for the index is due; the search runs one step.
bool hall_speed_search_due(const HallSpeed *self);
void hall_speed_search(HallSpeed *self);

// Interrupt.
void hall_speed_on_edge(HallSpeed *self, uint16_t stamp);

#endif
