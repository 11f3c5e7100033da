// The four unequal pitches of the Hall sensor: measured in the turning shaft after each start,
// learned at constant speed, and identified.
//
// Where each pitch takes the same time in successive rounds of four, the last round gives the
// pitches up to its noise, enough for a bound of the speed. Learning sums the periods of 64 rounds;
// the share of each in the total is its pitch. The search compares a round of four periods with the
// learned shares in all four phases (least absolute differences). Only a clear best phase found
// twice in a row is used, since a wrong index is worse than none. The search is split into steps,
// one per tick; edges that occur meanwhile are counted.
#ifndef VGROOVE_DRIVERS_HALL_SPACING_H
#define VGROOVE_DRIVERS_HALL_SPACING_H

#include <stdbool.h>
#include <stdint.h>

#define HALL_SPACING_PITCHES 4u
#define HALL_SPACING_ROUNDS 64u  // of four pitches, in a learning run
#define HALL_SPACING_UNKNOWN 0xFFu
#define HALL_SPACING_HELD 0xFEu  // value of `step`: the pitches are measured, edges are counted

typedef struct {
    uint32_t sum[HALL_SPACING_PITCHES];    // periods of the present round; while learning, sums
    uint16_t part[HALL_SPACING_PITCHES];   // periods of the last measured round, in 16 cycles
    uint16_t round[HALL_SPACING_PITCHES];  // periods of the searched round, in 256 cycles
    uint32_t last_round;                   // cycles of the previous round
    uint32_t this_round;
    uint16_t part_rpm_q1;  // mean speed of that round; 0: not repeated yet, or equal pitches
    uint16_t mean;         // period of that round, in 16 cycles
    bool seen_uneven;      // one of its periods differs from the mean
    uint8_t at;            // pitch that ends at the next edge
    uint8_t rounds;        // of equal periods
    uint8_t phase;         // index of the round's first pitch, found in the last search
    bool learning;
    uint8_t step;   // of the search, 0: none
    uint8_t found;  // best phase so far
    uint16_t best;  // its misfit, and that of the second best
    uint16_t next;
    uint16_t wanted[HALL_SPACING_PITCHES];  // periods expected from the learned shares
} HallSpacing;

void hall_spacing_learn(HallSpacing *self);
void hall_spacing_forget(HallSpacing *self);

// An edge whose period is not needed.
static inline void hall_spacing_pass(HallSpacing *self) {
    self->at = (uint8_t)((self->at + 1u) % HALL_SPACING_PITCHES);
}

// A period has ended; true when learning is complete: hall_spacing_share() gives the result.
bool hall_spacing_period(HallSpacing *self, uint32_t cycles);
int16_t hall_spacing_share(const HallSpacing *self, uint8_t pitch);

// Whether the pitches differ enough for an index to matter.
bool hall_spacing_uneven(const int16_t share_q15[HALL_SPACING_PITCHES]);

// Whether a complete round is to be measured or searched, and whether it is measured first.
bool hall_spacing_search_due(const HallSpacing *self);
bool hall_spacing_measures(const HallSpacing *self);

// A step of the measurement of a complete round, which precedes the search. factor_equal: rpm Q1
// times the period of a quarter of four pitches; uneven: there are learned pitches to search.
void hall_spacing_measure(HallSpacing *self, uint32_t factor_equal, bool uneven);

// A step of the search. The last step returns the index of the pitch that ends at the next edge,
// HALL_SPACING_UNKNOWN if it is not clear; all others return HALL_SPACING_UNKNOWN.
uint8_t hall_spacing_search(HallSpacing *self, const int16_t share_q15[HALL_SPACING_PITCHES],
                            bool reverse);

// rpm Q1 times the period of the pitch that ends at the next edge, as measured in this run; 0:
// unknown, or the pitches are equal.
uint32_t hall_spacing_factor(const HallSpacing *self);

#endif
