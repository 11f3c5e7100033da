// Motor speed from Hall edges: one pitch over the last period, falling with the time since the last
// edge, 0 after the time-out.
//
// The four pitches that repeat (magnets and switching points are never evenly spaced) are shares of
// their sum, learned by hall_spacing.h. Which of the four an edge closes is known only while
// `index_known`; until then all pitches count as equal.
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
    uint32_t edge_cycles;    // of the last edge that counted
    uint32_t period_cycles;  // between the last two, of one pitch
    uint32_t before_cycles;  // the one before, 0: none
    uint32_t timeout_cycles;
    uint32_t factor[HALL_SPEED_PITCHES];  // rpm Q1 times period of each pitch
    uint32_t factor_equal;
    uint32_t edge_factor;   // of the pitch that the last edge closed, where its index was known
    uint32_t least_cycles;  // a shorter period is beyond twice the range
    uint32_t fast_cycles;   // period above which a missed edge cannot be told from braking
    uint16_t magnitude_rpm_q1;
    uint8_t edges;      // since standstill: 0, 1, 2 = enough for a period
    uint8_t index;      // pitch that begins at the last edge
    uint8_t new_edges;  // in this tick
    uint8_t missed;
    uint8_t doubled;
    bool index_known;
    bool edge_known;  // edge_factor counts, otherwise all pitches are equal
    bool uneven;      // the pitches differ: worth finding the index
    bool learned;     // hall_spacing has a result
    int16_t share_q15[HALL_SPEED_PITCHES];
    HallSpacing spacing;
    bool reverse;      // sign, set at standstill
    RingWords stamps;  // Timer1 at the edge; last: what lies within 64 bytes is cheap to reach
} HallSpeed;

// What a tick has seen.
typedef struct {
    int16_t rpm_q1;
    bool saturated;
    bool missed;
    bool doubled;
    bool overflowed;
} HallSpeedResult;

// A freshly zeroed HallSpeed is one at rest. pulses: edges a turn; the pitches are to be set after
// it.
void hall_speed_configure(HallSpeed *self, uint8_t pulses, uint16_t timeout_ms);
void hall_speed_set_pitch(HallSpeed *self, uint8_t pitch, int16_t share_q15);
HallSpeedResult hall_speed_tick(HallSpeed *self);

// No edge within the time-out.
bool hall_speed_at_rest(const HallSpeed *self);

// Speed of the last period, without sign; 0 when the last edge was the only one since standstill.
uint16_t hall_speed_last_rpm_q1(const HallSpeed *self);

// One Hall gives no sign: it is that of the drive, and is taken over at standstill only. False
// while the shaft turns.
bool hall_speed_set_reverse(HallSpeed *self, bool reverse);

// From now on the pitches are learned, or no longer; `learned` says when their shares are there. It
// needs 256 edges at an even speed.
void hall_speed_learn(HallSpeed *self, bool learning);

// The index of uneven pitches is wanted: a step of its search, for a tick that has the time.
bool hall_speed_search_due(const HallSpeed *self);
void hall_speed_search(HallSpeed *self);

// Interrupt.
void hall_speed_on_edge(HallSpeed *self, uint16_t stamp);

#endif
