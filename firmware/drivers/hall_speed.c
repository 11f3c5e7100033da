// Speed from edges, see hall_speed.h.
#include "drivers/hall_speed.h"

#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"
#include "hal/hal.h"

// rpm Q1 = 2 * 60 s/min * f_cpu * pitch / period. The pitch in turns is 4 * share Q15 / 2^15 /
// pulses, or 1 / pulses if all are equal.
#define FACTOR_OF_TURN ((uint32_t)2 * 60u * HAL_CPU_HZ)  // 1.92e9 < 2^32
#define SHARE_BITS 13u  // 2^13 is the share of an equal pitch, HALL_SPEED_PITCH_EQUAL_Q15
#define SPEED_MAX_Q1 INT16_MAX
#define CYCLES_PER_MS (HAL_CPU_HZ / 1000u)
#define PERIOD_EDGES 2u  // edges since standstill from which on there is a period

// An edge after less than a quarter of the last period is a second edge of the same magnet.
#define DOUBLE_RATIO 4u

// Missed edges are detected in periods up to this multiple of least_cycles: below 2,979 rpm the
// drive can halve its speed within a pitch, which looks like a missed edge.
#define MISSED_RATIO 11u

// The edge of a pitch, a second edge of the same magnet, an edge after a missed one.
typedef enum { EDGE_VALID, EDGE_DOUBLE, EDGE_MISSED } EdgeKind;

// factor_equal * share / 2^13 in two parts, since the product has 45 bits.
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

// The count of edges may be wrong: the index is searched again, since a wrong one is worse than
// none.
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
    doubt_index(self);  // no search with half of the new pitches
    self->share_q15[pitch % HALL_SPEED_PITCHES] = share_q15;
    self->uneven = hall_spacing_uneven(self->share_q15);
    self->factor[pitch % HALL_SPEED_PITCHES] = factor_of_share(self->factor_equal, share_q15);
}

// Whether the pitch that ends at the next edge is known, learned or measured; else it counts as
// equal to the others.
static bool pitch_known(const HallSpeed *self) {
    return self->index_known || self->spacing.part_rpm_q1 != 0u;
}

// Of that pitch.
static uint32_t factor_ahead(const HallSpeed *self) {
    if (self->index_known) {
        return self->factor[self->index % HALL_SPEED_PITCHES];
    }
    return pitch_known(self) ? hall_spacing_factor(&self->spacing) : self->factor_equal;
}

// In reverse the pitches come in the opposite order.
static uint8_t pitch_after(const HallSpeed *self, uint8_t index) {
    return (uint8_t)((self->reverse ? index - 1u : index + 1u) % HALL_SPEED_PITCHES);
}

// Speed in rpm Q1, rounded to nearest, at most UINT16_MAX.
static uint16_t speed_of(uint32_t factor, uint32_t period) {
    return divide_u16(factor + period / 2u, period);
}

// Whether the period is twice the last one, and the last two agree within an eighth.
static bool is_missed(const HallSpeed *self, uint32_t period) {
    const uint32_t last = self->period_cycles;
    if (self->before_cycles == 0u || last > self->fast_cycles) {
        return false;
    }
    const uint32_t change =
        last > self->before_cycles ? last - self->before_cycles : self->before_cycles - last;
    const uint32_t quarter = fixed_quarter_u32(last);
    const uint32_t missing =
        2u * last - period;  // time by which the second of two periods falls short
    return change <= quarter >> 1 && missing + quarter - 1u < 2u * quarter - 1u;
}

// Most edges are within half of the last period, which skips the other tests.
static EdgeKind kind_of(const HallSpeed *self, uint32_t period) {
    if (self->edges == 0u) {
        return EDGE_VALID;
    }
    if (period < self->least_cycles) {
        return EDGE_DOUBLE;
    }
    if (self->edges < PERIOD_EDGES) {
        return EDGE_VALID;
    }
    const uint32_t half = self->period_cycles >> 1;
    if (period < half) {
        return period < half / (DOUBLE_RATIO / 2u) ? EDGE_DOUBLE : EDGE_VALID;
    }
    return period - half > self->period_cycles && is_missed(self, period) ? EDGE_MISSED
                                                                          : EDGE_VALID;
}

void hall_speed_learn(HallSpeed *self, bool learning) {
    self->learned = false;
    self->spacing.learning = learning;
    restart_spacing(self);
}

// Feeds the search for the index until it is known.
static void note_period(HallSpeed *self, uint32_t period) {
    if (!self->spacing.learning) {
        if (self->learned || self->index_known) {
            return;
        }
        if (self->spacing.step == HALL_SPACING_HELD) {  // most edges
            hall_spacing_pass(&self->spacing);
            return;
        }
    }
    self->learned = hall_spacing_period(&self->spacing, period);
    self->spacing.learning = self->spacing.learning && !self->learned;
}

// Not in a tick with the division for a slow edge; with fast edges, which may come in every tick,
// both fit.
bool hall_speed_search_due(const HallSpeed *self) {
    return hall_spacing_search_due(&self->spacing) &&
           (self->new_edges == 0u || self->period_cycles <= UINT16_MAX);
}

CLONE_NEVER void hall_speed_search(HallSpeed *self) {
    if (hall_spacing_measures(&self->spacing)) {
        hall_spacing_measure(&self->spacing, self->factor_equal, self->uneven);
        return;
    }
    const uint8_t found = hall_spacing_search(&self->spacing, self->share_q15, self->reverse);
    if (found != HALL_SPACING_UNKNOWN) {
        self->index = found;
        self->index_known = true;
    }
}

static void take_edge(HallSpeed *self, uint32_t edge, HallSpeedResult *result) {
    uint32_t period = edge - self->edge_cycles;
    const uint8_t before = self->index;
    const EdgeKind kind = kind_of(self, period);
    if (kind == EDGE_DOUBLE) {
        self->doubled = (uint8_t)(self->doubled + (self->doubled < UINT8_MAX ? 1u : 0u));
        result->doubled = true;
        doubt_index(self);
        return;
    }
    if (kind == EDGE_MISSED) {
        self->missed = (uint8_t)(self->missed + (self->missed < UINT8_MAX ? 1u : 0u));
        result->missed = true;
        self->index = pitch_after(self, self->index);
        period /= 2u;
        doubt_index(self);
    }
    if (self->edges > 0u) {
        self->before_cycles = self->edges >= PERIOD_EDGES ? self->period_cycles : 0u;
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
    self->edges = (uint8_t)(self->edges < PERIOD_EDGES ? self->edges + 1u : PERIOD_EDGES);
    self->new_edges++;
}

static void take_edges(HallSpeed *self, HallSpeedResult *result) {
    const uint16_t now = (uint16_t)self->now_cycles;
    self->new_edges = 0;
    while (ring_count_words(&self->stamps) > 0u) {
        const uint16_t age = (uint16_t)(now - ring_peek_word(&self->stamps));
        if (age > INT16_MAX) {
            break;  // after the tick: belongs to the next one
        }
        ring_drop_word(&self->stamps);
        take_edge(self, self->now_cycles - age, result);
    }
}

// Whether the time since the last edge can bound the speed: with equal pitches once it exceeds the
// last period; with unequal pitches, of which the present one may be shorter, once it exceeds half
// of the last period.
static bool may_fall(const HallSpeed *self, uint32_t age) {
    return age > (pitch_known(self) ? self->period_cycles / 2u : self->period_cycles);
}

// Upper bound of the speed: one pitch over the time since the last edge, rounded down. It holds for
// unequal pitches once they are measured, after five rounds at constant speed.
static uint16_t bound_of(const HallSpeed *self, uint32_t age) {
    return divide_u16(factor_ahead(self), age);
}

// Whether that bound is below the speed of the tick's edge, without a division, so that a tick
// needs only one. Both times are below 2^16: the age of an edge taken by a tick is below 2^15, and
// the period below twice that when may_fall() holds. When the two are within 0.02 % (at four pulses
// per turn) it returns true, so that the speed never exceeds the bound.
static bool bound_is_less(const HallSpeed *self, uint32_t factor, uint32_t age) {
    const uint32_t bound =
        (uint32_t)(uint16_t)(factor_ahead(self) >> 16) * (uint16_t)self->period_cycles;
    return bound <= (uint32_t)(uint16_t)((factor >> 16) + 1u) * (uint16_t)age;
}

// Speed after an edge in this tick.
static uint16_t fresh_speed(const HallSpeed *self, uint32_t age) {
    const uint32_t factor = self->edge_known ? self->edge_factor : self->factor_equal;
    // With equal pitches the bound is always lower: the age exceeds the period.
    const bool falls =
        may_fall(self, age) && (!pitch_known(self) || bound_is_less(self, factor, age));
    return falls ? bound_of(self, age) : speed_of(factor, self->period_cycles);
}

static void update(HallSpeed *self) {
    const uint32_t age = self->now_cycles - self->edge_cycles;
    if (self->edges == 0u || age >= self->timeout_cycles) {
        if (self->edges > 0u) {
            self->period_cycles = self->edges >= PERIOD_EDGES ? self->period_cycles : 0u;
            doubt_index(self);  // a resting shaft may rock across an edge
        }
        self->edges = 0;
        self->magnitude_rpm_q1 = 0;
        return;
    }
    if (self->edges < PERIOD_EDGES) {
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
