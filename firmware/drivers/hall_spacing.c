// Pitches of the Hall sensor, see hall_spacing.h.
#include "drivers/hall_spacing.h"

#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"

#define UNIT_SHIFT 8u    // periods in 256 cycles
#define LEARN_SHIFT 4u   // while learning and in `part` in 16 cycles: up to 65 ms
#define STEADY_SHIFT 5u  // constant speed: two successive rounds of four pitches agree within 1/32
#define ROUND_MAX (1u << 14)  // in UNIT_SHIFT, 0.26 s: misfits fit in 16 bits
#define CLEAR_RATIO 2u        // the best phase must fit twice as well as the next
#define UNEVEN_MIN_Q15 164    // 0.5 %: pitches closer than this to a quarter count as equal
#define EVEN_SHIFT 6u         // the same for the periods of one round: 1/64 of a period, 0.4 %
#define ROUNDS_EQUAL 4u       // each pitch takes the same time in four rounds and the one before

// Steps of a search: whether the round is steady, then one pitch of it per step, its speed, then
// expected periods, then one phase (index of the first pitch) per step, then idle until the next
// round. HELD: the pitches are measured and there are no learned ones to identify.
enum {
    SEARCH_NONE,
    SEARCH_ROUND,
    SEARCH_PITCHES,
    SEARCH_SPEED = SEARCH_PITCHES + HALL_SPACING_PITCHES,
    SEARCH_WANTED,
    SEARCH_PHASES,
    SEARCH_OVER = SEARCH_PHASES + HALL_SPACING_PITCHES,
    SEARCH_HELD = HALL_SPACING_HELD
};

void hall_spacing_forget(HallSpacing *self) {
    self->last_round = 0;  // the next round is not steady: the sums restart
    self->at = 0;
    self->rounds = 0;
    self->phase = HALL_SPACING_UNKNOWN;
    self->learning = false;
    self->step = SEARCH_NONE;
    self->part_rpm_q1 = 0;
}

void hall_spacing_learn(HallSpacing *self) {
    hall_spacing_forget(self);
    self->learning = true;
}

INLINE_NEVER static bool steady(const HallSpacing *self) {
    const uint32_t apart = self->this_round > self->last_round
                               ? self->this_round - self->last_round
                               : self->last_round - self->this_round;
    return apart <= self->this_round >> STEADY_SHIFT;
}

// A round at another speed than the one before restarts the sums.
static void learn_round(HallSpacing *self) {
    if (steady(self)) {
        self->rounds++;
        return;
    }
    self->rounds = 0;
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        self->sum[k] = 0;
    }
}

// An edge during a search.
static void pass(HallSpacing *self) {
    hall_spacing_pass(self);
    if (self->at == 0u && self->step == SEARCH_OVER) {
        self->step = SEARCH_NONE;
    }
}

static uint16_t at_most_u16(uint32_t value) {
    return value > UINT16_MAX ? UINT16_MAX : (uint16_t)value;
}

static void add_to_round(HallSpacing *self, uint32_t cycles) {
    self->this_round = self->at == 0u ? cycles : self->this_round + cycles;
    hall_spacing_pass(self);
}

INLINE_NEVER static bool learn_period(HallSpacing *self, uint32_t cycles) {
    self->sum[self->at] += at_most_u16(cycles >> LEARN_SHIFT);  // a variable shift is a loop
    add_to_round(self, cycles);
    if (self->at != 0u) {
        return false;
    }
    learn_round(self);
    self->last_round = self->this_round;
    if (self->rounds < HALL_SPACING_ROUNDS) {
        return false;
    }
    self->part_rpm_q1 = 0;  // edges are not counted from here on
    return true;
}

INLINE_NEVER bool hall_spacing_period(HallSpacing *self, uint32_t cycles) {
    BY_POINTER(self);
    if (self->step == SEARCH_NONE) {
        self->sum[self->at] = cycles;
        add_to_round(self, cycles);
        self->step = self->at == 0u ? SEARCH_ROUND : SEARCH_NONE;
        return false;
    }
    if (self->step == SEARCH_HELD && self->learning) {
        return learn_period(self, cycles);
    }
    pass(self);
    return false;
}

// Q15. `sum` has at most 22 bits and is shifted by 10; the other 5 are taken from the whole, which
// has at least 13 bits left at the fastest edges.
int16_t hall_spacing_share(const HallSpacing *self, uint8_t pitch) {
    const uint32_t whole = (self->sum[0] + self->sum[1] + self->sum[2] + self->sum[3]) >> 5;
    return (int16_t)divide_u16((self->sum[pitch] << 10) + whole / 2u, whole);
}

bool hall_spacing_uneven(const int16_t share_q15[HALL_SPACING_PITCHES]) {
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        const int16_t apart = (int16_t)(share_q15[k] - 8192);
        if (apart > UNEVEN_MIN_Q15 || apart < -UNEVEN_MIN_Q15) {
            return true;
        }
    }
    return false;
}

bool hall_spacing_search_due(const HallSpacing *self) {
    return self->step != SEARCH_NONE && self->step < SEARCH_OVER;
}

// A round in which edges have already occurred is skipped.
static void end_search(HallSpacing *self) {
    self->step = self->at == 0u ? SEARCH_NONE : SEARCH_OVER;
}

bool hall_spacing_measures(const HallSpacing *self) {
    return self->step < SEARCH_WANTED;
}

static void begin_round(HallSpacing *self) {
    const bool clear = steady(self) && self->this_round >> UNIT_SHIFT <= ROUND_MAX;
    self->last_round = self->this_round;
    self->step = self->part_rpm_q1 != 0u ? SEARCH_WANTED : SEARCH_PITCHES;
    self->mean = at_most_u16(self->this_round >> (LEARN_SHIFT + 2u));
    self->seen_uneven = false;
    if (!clear) {
        self->phase = HALL_SPACING_UNKNOWN;
        self->rounds = 0;
        end_search(self);
    }
}

static bool differ(uint16_t a, uint16_t b, uint16_t most) {
    return (uint16_t)(a - b + most) > 2u * most;
}

// Compares a period with that of the same pitch in the round before and with the mean.
static void keep_pitch(HallSpacing *self, uint8_t pitch) {
    const uint16_t part = at_most_u16(self->sum[pitch] >> LEARN_SHIFT);
    const uint16_t most = (uint16_t)(self->mean >> EVEN_SHIFT);
    if (differ(part, self->part[pitch], most)) {
        self->rounds = 0;
    }
    if (differ(part, self->mean, most)) {
        self->seen_uneven = true;
    }
    self->part[pitch] = part;
    self->step++;
}

// A ripple of the speed is no multiple of a turn: it does not repeat over several rounds.
static void end_round(HallSpacing *self, uint32_t factor_equal, bool uneven) {
    const bool proven = self->rounds >= ROUNDS_EQUAL;
    self->rounds++;
    if (proven && self->seen_uneven) {
        self->part_rpm_q1 = divide_u16(factor_equal, fixed_quarter_u32(self->this_round));
    }
    if (uneven && !self->learning) {
        self->step = SEARCH_WANTED;
    } else if (proven) {
        self->rounds = 0;
        self->step = SEARCH_HELD;
    } else {
        end_search(self);
    }
}

INLINE_NEVER void hall_spacing_measure(HallSpacing *self, uint32_t factor_equal, bool uneven) {
    BY_POINTER(self);
    if (self->step == SEARCH_ROUND) {
        begin_round(self);
    } else if (self->step < SEARCH_SPEED) {
        keep_pitch(self, (uint8_t)(self->step - SEARCH_PITCHES));
    } else {
        end_round(self, factor_equal, uneven);
    }
}

static void begin_search(HallSpacing *self, const int16_t share_q15[HALL_SPACING_PITCHES]) {
    const uint16_t whole = (uint16_t)(self->this_round >> UNIT_SHIFT);
    self->best = UINT16_MAX;
    self->next = UINT16_MAX;
    self->step = SEARCH_PHASES;
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        self->round[k] = (uint16_t)(self->sum[k] >> UNIT_SHIFT);
        self->wanted[k] = (uint16_t)(((uint32_t)whole * (uint16_t)(2 * share_q15[k])) >> 16);
    }
}

// Sum of the absolute differences between the round and the learned one, shifted by `phase`.
static uint16_t misfit(const HallSpacing *self, uint8_t phase, bool reverse) {
    uint16_t sum = 0;
    uint8_t pitch = phase;
    for (uint8_t k = 0; k < HALL_SPACING_PITCHES; k++) {
        const uint16_t want = self->wanted[pitch % HALL_SPACING_PITCHES];
        const uint16_t got = self->round[k];
        sum = (uint16_t)(sum + (want > got ? want - got : got - want));
        pitch = (uint8_t)(reverse ? pitch - 1u : pitch + 1u);
    }
    return sum;
}

static void try_phase(HallSpacing *self, uint8_t phase, bool reverse) {
    const uint16_t fit = misfit(self, phase, reverse);
    if (fit < self->best) {
        self->next = self->best;
        self->best = fit;
        self->found = phase;
    } else if (fit < self->next) {
        self->next = fit;
    }
}

// Index of the present pitch, `at` pitches after the round.
static uint8_t conclude(HallSpacing *self, bool reverse) {
    const uint8_t before = self->phase;
    const uint8_t passed = (uint8_t)(reverse ? HALL_SPACING_PITCHES - self->at : self->at);
    const uint8_t now = (uint8_t)((uint8_t)(self->found + passed) % HALL_SPACING_PITCHES);
    const bool clear = self->best < self->next / CLEAR_RATIO;
    self->phase = clear ? self->found : HALL_SPACING_UNKNOWN;
    return clear && self->phase == before ? now : HALL_SPACING_UNKNOWN;
}

INLINE_NEVER uint8_t hall_spacing_search(HallSpacing *self,
                                         const int16_t share_q15[HALL_SPACING_PITCHES],
                                         bool reverse) {
    BY_POINTER(self);
    if (self->step == SEARCH_WANTED) {
        begin_search(self, share_q15);
        return HALL_SPACING_UNKNOWN;
    }
    try_phase(self, (uint8_t)(self->step - SEARCH_PHASES), reverse);
    self->step++;
    if (self->step < SEARCH_OVER) {
        return HALL_SPACING_UNKNOWN;
    }
    end_search(self);
    return conclude(self, reverse);
}

uint32_t hall_spacing_factor(const HallSpacing *self) {
    return ((uint32_t)self->part_rpm_q1 * self->part[self->at]) << LEARN_SHIFT;
}
