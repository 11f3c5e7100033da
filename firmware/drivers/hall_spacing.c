// Unequal pitches, see hall_spacing.h.
#include "drivers/hall_spacing.h"

#include "core/divide.h"

#define UNIT_SHIFT 8u              // cycles of a period in 1/256: a round of up to 1 s stays below 2^16
#define WHOLE_BITS 17u             // so that a part times 2^15 fits 32 bits
#define LEARN_SHIFT 4u             // while learning: periods of up to 65 ms
#define STEADY_SHIFT 5u            // two rounds agree within 1/32: an even speed
#define CLEAR_RATIO 2u             // the best phase fits twice as well as the next
#define UNEVEN_LEAST_Q15 164       // 0.5 %: pitches closer than this to a quarter need no index

void hall_spacing_forget(HallSpacing *self) {
    self->last_round = 0;  // no round is steady after it: sums begin anew with the next
    self->at = 0;
    self->rounds = 0;
    self->phase = HALL_SPACING_UNKNOWN;
    self->learning = false;
}

void hall_spacing_learn(HallSpacing *self) {
    hall_spacing_forget(self);
    self->learning = true;
}

static bool steady(const HallSpacing *self) {
    const uint32_t longer = self->this_round > self->last_round ? self->this_round : self->last_round;
    const uint32_t shorter = self->this_round > self->last_round ? self->last_round : self->this_round;
    return longer - shorter <= longer >> STEADY_SHIFT;
}

static void learn_round(HallSpacing *self) {
    const bool even = steady(self);
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        self->sum[k] = even ? self->sum[k] + self->round[k] : 0u;
    }
    self->rounds = (uint8_t)(even ? self->rounds + 1u : 0u);
}

bool hall_spacing_period(HallSpacing *self, uint32_t cycles) {
    const uint32_t unit = self->learning ? cycles >> LEARN_SHIFT : cycles >> UNIT_SHIFT;  // no variable shift: a loop on the AVR
    self->round[self->at] = unit > UINT16_MAX ? UINT16_MAX : (uint16_t)unit;
    self->this_round = self->at == 0u ? cycles : self->this_round + cycles;
    self->at = (uint8_t)((self->at + 1u) % HALL_SPACING_PITCHES);
    if (self->at != 0u) {
        return false;
    }
    if (self->learning) {
        learn_round(self);
    }
    self->last_round = self->this_round;
    return self->learning && self->rounds >= HALL_SPACING_ROUNDS;
}

int16_t hall_spacing_share(const HallSpacing *self, uint8_t pitch) {
    uint32_t whole = self->sum[0] + self->sum[1] + self->sum[2] + self->sum[3];
    uint32_t part = self->sum[pitch % HALL_SPACING_PITCHES];
    while (whole >> WHOLE_BITS != 0u) {
        whole >>= 1;
        part >>= 1;
    }
    return (int16_t)divide_u16((part << 15) + whole / 2u, whole);
}

// How far the round is from the learned one turned by `phase` pitches.
static uint32_t misfit(const HallSpacing *self, const uint16_t wanted[HALL_SPACING_PITCHES], uint8_t phase, bool reverse) {
    uint32_t sum = 0;
    uint8_t pitch = phase;
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        const uint16_t want = wanted[pitch % HALL_SPACING_PITCHES];
        const uint16_t got = self->round[k];
        sum += want > got ? (uint16_t)(want - got) : (uint16_t)(got - want);
        pitch = (uint8_t)(reverse ? pitch - 1u : pitch + 1u);
    }
    return sum;
}

bool hall_spacing_uneven(const int16_t share_q15[HALL_SPACING_PITCHES]) {
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        const int16_t apart = (int16_t)(share_q15[k] - 8192);
        if (apart > UNEVEN_LEAST_Q15 || apart < -UNEVEN_LEAST_Q15) {
            return true;
        }
    }
    return false;
}

uint8_t hall_spacing_find(HallSpacing *self, const int16_t share_q15[HALL_SPACING_PITCHES], bool reverse) {
    uint32_t best = UINT32_MAX;
    uint32_t next = UINT32_MAX;
    uint8_t found = HALL_SPACING_UNKNOWN;
    const uint8_t before = self->phase;
    self->phase = HALL_SPACING_UNKNOWN;
    if (!hall_spacing_uneven(share_q15) || !steady(self) || self->this_round >> UNIT_SHIFT > UINT16_MAX) {
        return HALL_SPACING_UNKNOWN;
    }
    uint16_t wanted[HALL_SPACING_PITCHES];
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        wanted[k] = (uint16_t)(((uint32_t)(uint16_t)(self->this_round >> UNIT_SHIFT) * (uint16_t)(2 * share_q15[k])) >> 16);
    }
    for (uint8_t phase = 0; phase < HALL_SPACING_PITCHES; phase++) {
        const uint32_t fit = misfit(self, wanted, phase, reverse);
        next = fit < best ? best : (fit < next ? fit : next);
        found = fit < best ? phase : found;
        best = fit < best ? fit : best;
    }
    self->phase = best * CLEAR_RATIO < next ? found : HALL_SPACING_UNKNOWN;
    return self->phase == before ? self->phase : HALL_SPACING_UNKNOWN;
}
