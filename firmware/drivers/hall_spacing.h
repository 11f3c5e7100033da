// The four pitches of the Hall sensor: learned at an even speed, and found again in the running
// shaft after each start.
//
// Learning sums the periods of 64 rounds of four; their shares of the whole are the pitches.
// Searching compares a round of four periods with the learned shares in all four phases; only a
// clear best, twice in a row, counts: a wrong phase is worse than none. It comes in steps, since a
// tick has no time for the whole; the round stands still meanwhile, and the edges that pass are
// counted.
#ifndef VGROOVE_DRIVERS_HALL_SPACING_H
#define VGROOVE_DRIVERS_HALL_SPACING_H

#include <stdbool.h>
#include <stdint.h>

#define HALL_SPACING_PITCHES 4u
#define HALL_SPACING_ROUNDS 64u
#define HALL_SPACING_UNKNOWN 0xFFu

typedef struct {
    uint32_t sum[HALL_SPACING_PITCHES];    // of the periods while learning
    uint16_t round[HALL_SPACING_PITCHES];  // periods of the round that runs, in `unit` cycles
    uint32_t last_round;                   // cycles of the round before
    uint32_t this_round;
    uint8_t at;  // pitch that the next period closes
    uint8_t rounds;
    uint8_t phase;  // found once
    bool learning;
    uint8_t step;   // of the search, 0: none
    uint8_t found;  // best phase so far
    uint16_t best;  // its misfit, and that of the second best
    uint16_t next;
    uint16_t wanted[HALL_SPACING_PITCHES];  // the round as the learned shares would have it, from
                                            // the first pitch on
} HallSpacing;

void hall_spacing_learn(HallSpacing *self);
void hall_spacing_forget(HallSpacing *self);

// True when learning is complete: then hall_spacing_share gives the result.
bool hall_spacing_period(HallSpacing *self, uint32_t cycles);
int16_t hall_spacing_share(const HallSpacing *self, uint8_t pitch);

// Whether the pitches differ enough to need an index.
bool hall_spacing_uneven(const int16_t share_q15[HALL_SPACING_PITCHES]);

// A round is complete and waits to be searched.
bool hall_spacing_search_due(const HallSpacing *self);

// A step of the search. The last one gives the index of the learned pitch that the next period
// closes, or HALL_SPACING_UNKNOWN when that is not clear; the others HALL_SPACING_UNKNOWN.
uint8_t hall_spacing_search(HallSpacing *self, const int16_t share_q15[HALL_SPACING_PITCHES],
                            bool reverse);

#endif
