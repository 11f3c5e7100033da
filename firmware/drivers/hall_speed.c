// Speed from edges, see hall_speed.h.
#include "drivers/hall_speed.h"

#include "core/divide.h"
#include "core/inline.h"
#include "hal/hal.h"

// rpm Q1 = 2 * 60 s/min * f_cpu * pitch / period, pitch in turns = 4 * share Q15 / 2^15 / pulses, 1
// / pulses when it is an equal one.
#define FACTOR_OF_TURN ((uint32_t)2 * 60u * HAL_CPU_HZ)  // 1.92e9 < 2^32
#define SHARE_BITS 13u  // of an equal pitch, HALL_SPEED_PITCH_EQUAL_Q15
#define SPEED_MAX_Q1 INT16_MAX
#define CYCLES_PER_MS (HAL_CPU_HZ / 1000u)
#define DOUBLE_RATIO                                                                               \
    4u  // an edge after less than a quarter of the last period is a second edge of the same magnet
#define MISSED_RATIO                                                                               \
    11u  // times the least: below 2,979 rpm the drive can really halve its speed within a pitch

// The factor of a pitch is to that of an equal one as their shares: in two parts, since the product
// has 45 bits.
static uint32_t factor_of_share(uint32_t factor_equal, int16_t share_q15) {
    const uint32_t share = (uint16_t)share_q15;
    return (factor_equal >> SHARE_BITS) * share +
           (((factor_equal & (HALL_SPEED_PITCH_EQUAL_Q15 - 1u)) * share) >> SHARE_BITS);
}

static void restart_spacing(HallSpeed *self) {
    if (self->spacing.learning) {
        hall_spacing_learn(&self->spacing);
    } else {
        hall_spacing_forget(&self->spacing);
    }
}

// A wrong index is worse than none: where the count of the edges may have slipped it is found anew.
static void doubt_index(HallSpeed *self) {
    self->index_known = false;
    restart_spacing(self);
}

void hall_speed_configure(HallSpeed *self, uint8_t pulses, uint16_t timeout_ms) {
    self->timeout_cycles = (uint32_t)timeout_ms * CYCLES_PER_MS;
    doubt_index(self);
    self->factor_equal = divide_u32(FACTOR_OF_TURN, pulses);
    self->least_cycles = self->factor_equal >> 16;
    self->fast_cycles = self->least_cycles * MISSED_RATIO;
}

void hall_speed_set_pitch(HallSpeed *self, uint8_t pitch, int16_t share_q15) {
    doubt_index(self);  // no search sees one half of the old pitches and one of the new
    self->share_q15[pitch % HALL_SPEED_PITCHES] = share_q15;
    self->uneven = hall_spacing_uneven(self->share_q15);
    self->factor[pitch % HALL_SPEED_PITCHES] = factor_of_share(self->factor_equal, share_q15);
}

static uint32_t factor_at(const HallSpeed *self, uint8_t index) {
    return self->index_known ? self->factor[index % HALL_SPEED_PITCHES] : self->factor_equal;
}

// In reverse the pitches come in the opposite order.
static uint8_t pitch_after(const HallSpeed *self, uint8_t index) {
    return (uint8_t)((self->reverse ? index - 1u : index + 1u) % HALL_SPEED_PITCHES);
}

// Nearest rpm Q1, at most UINT16_MAX.
static uint16_t speed_of(uint32_t factor, uint32_t period) {
    return divide_u16(factor + period / 2u, period);
}

// Within half of the last period: neither a second edge of the same magnet nor the one after a
// missed one. Most are, and are spared the rest.
static bool is_even(const HallSpeed *self, uint32_t period) {
    const uint32_t half = self->period_cycles >> 1;
    return self->edges >= 2u && period >= self->least_cycles && period >= half &&
           period - half <= self->period_cycles;
}

static bool is_double(const HallSpeed *self, uint32_t period) {
    return period < self->least_cycles ||
           (self->edges >= 2u && period < self->period_cycles / DOUBLE_RATIO);
}

static bool is_missed(const HallSpeed *self, uint32_t period) {
    const uint32_t last = self->period_cycles;
    if (self->edges < 2u || self->before_cycles == 0u || last > self->fast_cycles) {
        return false;
    }
    const uint32_t change =
        last > self->before_cycles ? last - self->before_cycles : self->before_cycles - last;
    const uint32_t quarter = last >> 2;
    const uint32_t missing = 2u * last - period;  // of the second of two
    return change <= quarter >> 1 &&
           missing + quarter - 1u < 2u * quarter - 1u;  // the last two agree within an eighth
}

void hall_speed_learn(HallSpeed *self, bool learning) {
    self->learned = false;
    self->spacing.learning = learning;
    restart_spacing(self);
}

// Feeds the pitch finder; once the index is known there is nothing left to find.
static void note_period(HallSpeed *self, uint32_t period) {
    if (!self->spacing.learning && (self->learned || self->index_known || !self->uneven)) {
        return;
    }
    self->learned = hall_spacing_period(&self->spacing, period);
    self->spacing.learning = self->spacing.learning && !self->learned;
}

// The division of an edge by a long period leaves no time for it; fast edges, which may come in
// every tick, do.
bool hall_speed_search_due(const HallSpeed *self) {
    return hall_spacing_search_due(&self->spacing) &&
           (self->new_edges == 0u || self->period_cycles <= UINT16_MAX);
}

CLONE_NEVER void hall_speed_search(HallSpeed *self) {
    const uint8_t found = hall_spacing_search(&self->spacing, self->share_q15, self->reverse);
    if (found != HALL_SPACING_UNKNOWN) {
        self->index = found;
        self->index_known = true;
    }
}

static void take_edge(HallSpeed *self, uint32_t edge, HallSpeedResult *result) {
    uint32_t period = edge - self->edge_cycles;
    const uint8_t before = self->index;
    const bool even = is_even(self, period);
    if (!even && self->edges > 0u && is_double(self, period)) {
        self->doubled = (uint8_t)(self->doubled + (self->doubled < UINT8_MAX ? 1u : 0u));
        result->doubled = true;
        doubt_index(self);
        return;
    }
    if (!even && is_missed(self, period)) {
        self->missed = (uint8_t)(self->missed + (self->missed < UINT8_MAX ? 1u : 0u));
        result->missed = true;
        self->index = pitch_after(self, self->index);
        period /= 2u;
        doubt_index(self);
    }
    if (self->edges > 0u) {
        self->before_cycles = self->edges >= 2u ? self->period_cycles : 0u;
        self->period_cycles = period;
        self->edge_known = self->index_known;
        if (self->index_known) {
            self->edge_factor = self->factor[before];
        }
    }
    self->edge_cycles = edge;
    self->index = pitch_after(self, self->index);
    if (self->edges > 0u && !result->missed) {
        note_period(self, period);
    }
    self->edges = (uint8_t)(self->edges < 2u ? self->edges + 1u : 2u);
    self->new_edges++;
}

static void take_edges(HallSpeed *self, HallSpeedResult *result) {
    const uint16_t now = (uint16_t)self->now_cycles;
    self->new_edges = 0;
    while (ring_count_words(&self->stamps) > 0u) {
        const uint16_t age = (uint16_t)(now - ring_peek_word(&self->stamps));
        if (age > INT16_MAX) {
            break;  // younger than the tick: the next one's
        }
        ring_drop_word(&self->stamps);
        take_edge(self, self->now_cycles - age, result);
    }
}

// With equal pitches the value falls once the age exceeds the last period; otherwise it may a
// little earlier.
static bool may_fall(const HallSpeed *self, uint32_t age) {
    return age > (self->index_known ? self->period_cycles / 2u : self->period_cycles);
}

// One pitch over the age, downwards: the value never exceeds it.
static uint16_t bound_of(const HallSpeed *self, uint32_t age) {
    return divide_u16(factor_at(self, self->index), age);
}

// Whether one pitch over the age is less than the speed that the tick's edge gives: told without a
// division, so that a tick needs only one. Both times are below 2^16 here: the age of an edge that
// a tick takes is below 2^15, and the period less than twice that when the value may fall. In
// doubt, by less than 0.02 % with four pulses a turn, it is: never more than one pitch over the
// age.
static bool bound_is_less(const HallSpeed *self, uint32_t factor, uint32_t age) {
    const uint32_t bound =
        (uint32_t)(uint16_t)(factor_at(self, self->index) >> 16) * (uint16_t)self->period_cycles;
    return bound <= (uint32_t)(uint16_t)((factor >> 16) + 1u) * (uint16_t)age;
}

// The speed after an edge of this tick.
static uint16_t fresh_speed(const HallSpeed *self, uint32_t age) {
    const uint32_t factor = self->edge_known ? self->edge_factor : self->factor_equal;
    // With equal pitches the bound is less, since the age exceeds the period.
    const bool falls =
        may_fall(self, age) && (!self->index_known || bound_is_less(self, factor, age));
    return falls ? bound_of(self, age) : speed_of(factor, self->period_cycles);
}

static void update(HallSpeed *self) {
    const uint32_t age = self->now_cycles - self->edge_cycles;
    if (self->edges == 0u || age >= self->timeout_cycles) {
        if (self->edges > 0u) {
            self->period_cycles = self->edges >= 2u ? self->period_cycles : 0u;
            doubt_index(self);  // the shaft may rock over an edge while it stands
        }
        self->edges = 0;
        self->magnitude_rpm_q1 = 0;
        return;
    }
    if (self->edges < 2u) {
        return;
    }
    if (self->new_edges > 0u) {
        self->magnitude_rpm_q1 = fresh_speed(self, age);
    } else if (may_fall(self, age)) {
        const uint16_t bound = bound_of(self, age);
        self->magnitude_rpm_q1 = bound < self->magnitude_rpm_q1 ? bound : self->magnitude_rpm_q1;
    }
}

HallSpeedResult hall_speed_tick(HallSpeed *self) {
    HallSpeedResult result = {.overflowed = self->overflowed};
    self->overflowed = false;
    self->now_cycles += HAL_CYCLES_PER_TICK;
    take_edges(self, &result);
    update(self);
    uint16_t magnitude = self->magnitude_rpm_q1;
    if (magnitude > SPEED_MAX_Q1) {
        magnitude = SPEED_MAX_Q1;
        result.saturated = true;
    }
    result.rpm_q1 = (int16_t)(self->reverse ? -(int16_t)magnitude : (int16_t)magnitude);
    return result;
}

bool hall_speed_at_rest(const HallSpeed *self) {
    return self->edges == 0u;
}

INLINE_NEVER uint16_t hall_speed_last_rpm_q1(const HallSpeed *self) {
    return self->period_cycles == 0u ? 0u : speed_of(self->factor_equal, self->period_cycles);
}

bool hall_speed_set_reverse(HallSpeed *self, bool reverse) {
    if (self->edges > 0u && self->reverse != reverse) {
        return false;
    }
    self->index_known = self->index_known && self->reverse == reverse;
    self->reverse = reverse;
    return true;
}

void hall_speed_on_edge(HallSpeed *self, uint16_t stamp) {
    if (!ring_push_word(&self->stamps, stamp)) {
        self->overflowed = true;
    }
}
