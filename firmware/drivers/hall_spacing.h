// The four unequal pitches of the Hall sensor: learned at constant speed, and identified in the
// turning shaft after each start.
//
// Learning sums the periods of 64 rounds of four pitches; the share of each in the total is its
// pitch. The search compares a round of four periods with the learned shares in all four phases
// (least absolute differences). Only a clear best phase found twice in a row is used, since a wrong
// index is worse than none. The search is split into steps, one per tick; edges that occur
// meanwhile are counted.
#ifndef VGROOVE_DRIVERS_HALL_SPACING_H
#define VGROOVE_DRIVERS_HALL_SPACING_H

#include <stdbool.h>
#include <stdint.h>

#define HALL_SPACING_PITCHES 4u
#define HALL_SPACING_ROUNDS 64u  // of four pitches, in a learning run
#define HALL_SPACING_UNKNOWN 0xFFu

typedef struct {
    uint32_t sum[HALL_SPACING_PITCHES];    // of the periods while learning
    uint16_t round[HALL_SPACING_PITCHES];  // periods of the present round, in 256 cycles
    uint32_t last_round;                   // cycles of the previous round
    uint32_t this_round;
    uint8_t at;  // pitch that ends at the next edge
    uint8_t rounds;
    uint8_t phase;  // index of the round's first pitch, found in the last search
    bool learning;
    uint8_t step;   // of the search, 0: none
    uint8_t found;  // best phase so far
    uint16_t best;  // its misfit, and that of the second best
    uint16_t next;
    uint16_t wanted[HALL_SPACING_PITCHES];  // periods expected from the learned shares
} HallSpacing;

void hall_spacing_learn(HallSpacing *self);
void hall_spacing_forget(HallSpacing *self);

// A period has ended; true when learning is complete: hall_spacing_share() gives the result.
bool hall_spacing_period(HallSpacing *self, uint32_t cycles);
int16_t hall_spacing_share(const HallSpacing *self, uint8_t pitch);

// Whether the pitches differ enough for an index to matter.
bool hall_spacing_uneven(const int16_t share_q15[HALL_SPACING_PITCHES]);

// Whether a complete round is to be searched.
bool hall_spacing_search_due(const HallSpacing *self);

// A step of the search. The last step returns the index of the pitch that ends at the next edge,
// HALL_SPACING_UNKNOWN if it is not clear; all others return HALL_SPACING_UNKNOWN.
uint8_t hall_spacing_search(HallSpacing *self, const int16_t share_q15[HALL_SPACING_PITCHES],
                            bool reverse);

#endif
