// Precise screwing, see screwing.h.
#include "controllers/screwing.h"

#include "core/divide.h"
#include "core/flash.h"
#include "core/inline.h"
#include "core/slew.h"

typedef enum { STAGE_NONE, STAGE_PITCH, STAGE_PHASE, STAGE_STEP, STAGE_SHARE, STAGE_TURN, STAGE_JUDGE } Stage;

#define LUG 5760  // from lug to lug: 180 degrees of 1/32
#define SHARE_SCALE 16777216u
#define PITCH_SCALE 1474560u  // over pulses * turn_q8
#define EDGES_MOST 2u         // a tick: more have no ripple to tell
#define RIPPLE_MAX 4095       // rpm Q1
#define ASSUMED_START (60 * 32)
#define ASSUMED_LEAST 32
#define ASSUMED_MOST (150 * 32)
#define ACQUIRE 18u        // half turns in which the oscillator follows fast
#define TURNED_BIAS 32     // 4 degrees
#define TURNED_MOST 223    // 28 degrees a half turn
#define SETTLE_HALVES 10u  // after a change of power
#define LEARN_HALVES 20u   // of them the last are learned from
#define HARD_HALVES 30u    // before more power
#define WINDOW_Q3                                                                                                                                    \
    80  // 10 degrees: turn is measured over that at least, and a turn of the oscillator: what the Hall pitches beat with the blows evens out
#define WINDOW_MOST 14u
#define FINE_Q4 512
#define WINDOW_FINE_Q3 112
#define SMALL_Q4 768
#define STEEP_SMALL_Q8 390
#define STEEP_HALVES 4u
#define STEEP_FINE_Q8 435
#define STEEP_FINE_Q3 80
#define HOLD_FINE 2u
#define ONSET_FINE_Q8 300
#define SURE_FINE_Q3 96
#define ONSET_Q8 282      // 1.10
#define CALM_Q8 271       // 1.06
#define EASIER_Q8 223     // 0.87
#define STEEP_Q8 333      // 1.30 + 0.018 a degree: steeper is the edge of a knot
#define SLOW_Q8 276       // 1.08 + 0.007 a degree: flatter is not a seat
#define SURE_Q3 112       // 14 degrees and 0.4 of the learned turn: behind the onset until a seat is believed
#define SURE_MOST_Q3 160  // 20 degrees
#define SHARE_SLEW 400    // a tick: a step would brake
#define RECORD_Q3 120     // 15 degrees: how high the edge of a knot is; 3/8 above it is a seat all the same
#define EDGE_Q3 200       // 25 degrees: a knot's edge is over
#define GIVE_UP_Q3 480    // 60 degrees
#define QUARTER 64u

// 127 sin(2 pi n / 256), n = 0..64
static const uint8_t sine_quarter[QUARTER + 1u] FLASH_TABLE = {0,   3,   6,   9,   12,  16,  19,  22,  25,  28,  31,  34,  37,  40,  43,  46,  49,
                                                               51,  54,  57,  60,  63,  65,  68,  71,  73,  76,  78,  81,  83,  85,  88,  90,  92,
                                                               94,  96,  98,  100, 102, 104, 106, 107, 109, 111, 112, 113, 115, 116, 117, 118, 120,
                                                               121, 122, 122, 123, 124, 125, 125, 126, 126, 126, 127, 127, 127, 127};

static int8_t sine(uint8_t angle) {
    const uint8_t in_quarter = angle & (QUARTER - 1u);
    const uint8_t place = (angle & QUARTER) != 0u ? (uint8_t)(QUARTER - in_quarter) : in_quarter;
    const int8_t value = (int8_t)FLASH_U8(&sine_quarter[place]);
    return angle >= 128u ? (int8_t)-value : value;
}

// Phase of (x, y), 2^16 a turn; within 0.0038 rad: atan r = r (pi / 4 + 0.273 (1 - r)).
static uint16_t phase_of(int16_t x, int16_t y) {
    const uint16_t along = (uint16_t)(x < 0 ? -x : x), across = (uint16_t)(y < 0 ? -y : y);
    const bool swap = across > along;
    const uint16_t less = swap ? along : across, more = swap ? across : along;
    const uint16_t ratio_q16 = more == 0u ? 0u : divide_by_u16((uint32_t)less << 16, more);
    const uint16_t slope = (uint16_t)(8192u + (uint16_t)(((uint32_t)2847u * (uint16_t)~ratio_q16) >> 16));
    uint16_t angle = (uint16_t)(((uint32_t)slope * ratio_q16) >> 16);
    angle = swap ? (uint16_t)(16384u - angle) : angle;
    angle = x < 0 ? (uint16_t)(32768u - angle) : angle;
    return y < 0 ? (uint16_t)(0u - angle) : angle;
}

static uint16_t step_of(const Screwing *self) {
    return divide_by_u16((uint32_t)self->pitch << 16, (uint16_t)(LUG + self->assumed));
}

// The sums keep what is left of the last drive: the first half turns are not used.
static void listen(Screwing *self) {
    self->known = 0;
    self->assumed = ASSUMED_START;
    self->per_step = 0;  // edges count from when it is known
    self->mean_rpm_q1 = self->last_rpm_q1;
    self->stage = STAGE_PITCH;
}

static void relearn(Screwing *self) {
    self->count = 0;
    self->filled = 0;
    self->learned_q4 = 0;
    self->rise_q8 = 0;
    self->raw_q8 = 0;
}

void screwing_start(Screwing *self, const ScrewingSetpoints *set) {
    (void)set;  // taken when blows begin
    (void)set;
    *self = (Screwing){.state = SCREWING_RUN_IN};
    relearn(self);
}

// A pitch, or the part of it before or behind the end of a half turn; its middle is at a phase.
__attribute__((always_inline)) static inline void gather(Screwing *self, int16_t ripple, uint16_t phase) {
    const uint8_t angle = (uint8_t)(phase >> 8);
    self->cos_sum = (int16_t)(self->cos_sum + (int16_t)(((int32_t)ripple * sine((uint8_t)(angle + QUARTER))) >> 8));
    self->sin_sum = (int16_t)(self->sin_sum + (int16_t)(((int32_t)ripple * sine(angle)) >> 8));
    self->rest_sum = (int16_t)(self->rest_sum + ripple / 2);
}

// A half turn of the oscillator has ended: its sums and those of the half before are to be looked at, a stage a tick.
static void close_half(Screwing *self) {
    self->x = (int16_t)(self->cos_sum + self->cos_before);
    self->y = (int16_t)(self->sin_sum + self->sin_before);
    self->rest = (int16_t)(self->rest_sum + self->rest_before);
    self->cos_before = self->cos_sum;
    self->sin_before = self->sin_sum;
    self->rest_before = self->rest_sum;
    self->cos_sum = 0;
    self->sin_sum = 0;
    self->rest_sum = 0;
    self->stage = STAGE_PHASE;
}

static void take_edge(Screwing *self) {
    int16_t ripple = (int16_t)(self->mean_rpm_q1 - self->last_rpm_q1);
    ripple = ripple > RIPPLE_MAX ? RIPPLE_MAX : ripple;
    ripple = ripple < -RIPPLE_MAX ? -RIPPLE_MAX : ripple;
    const uint16_t left = (uint16_t)(0x8000u - (self->phase & 0x7FFFu));
    uint16_t begin = self->phase, length = self->step;
    if (left <= length) {
        const uint16_t share_q8 = (uint16_t)(((uint32_t)left * self->per_step) >> 16);
        const int16_t before = (int16_t)(((int32_t)ripple * (int16_t)share_q8) >> 8);
        gather(self, before, (uint16_t)(begin + left / 2u));
        close_half(self);
        ripple = (int16_t)(ripple - before);
        begin = (uint16_t)(begin + left);
        length = (uint16_t)(length - left);
    }
    gather(self, ripple, (uint16_t)(begin + length / 2u));
    self->phase = (uint16_t)(begin + length);
}

// What the ripple's phase has moved by against the oscillator is what the screw turned beside the assumed.
static void take_phase(Screwing *self) {
    const uint16_t found = phase_of(self->x, (int16_t)-self->y);
    const int16_t lead = (int16_t)(found - self->found);
    self->found = found;
    self->mean_rpm_q1 = (int16_t)(self->mean_rpm_q1 - (int16_t)(((int32_t)self->rest * (int16_t)self->step) >> 16));
    self->known = (uint8_t)(self->known + (self->known < UINT8_MAX ? 1u : 0u));
    if (self->known < 3u) {
        self->stage = STAGE_NONE;
        return;
    }
    self->head = (int16_t)(self->head + self->assumed / 2 - (int16_t)(((int32_t)LUG * lead) >> 16));
    const int16_t more = (int16_t)(((int32_t)(LUG + self->assumed) * lead) >> 16);
    const int16_t assumed = (int16_t)(self->assumed - (self->known < ACQUIRE ? more / 2 : more / 8));
    self->assumed = assumed < ASSUMED_LEAST ? ASSUMED_LEAST : assumed;
    self->assumed = self->assumed > ASSUMED_MOST ? ASSUMED_MOST : self->assumed;
}

static void push_turned(Screwing *self) {
    const int16_t head_q3 = (int16_t)(self->head >> 2);
    const int16_t turned = (int16_t)(head_q3 - self->head_q3);
    self->head_q3 = head_q3;
    for (uint8_t n = SCREWING_RING - 1u; n > 0u; n--) {
        self->turned[n] = self->turned[n - 1u];
    }
    self->turned[0] = (uint8_t)(turned < -TURNED_BIAS ? 0 : turned > TURNED_MOST ? TURNED_MOST + TURNED_BIAS : turned + TURNED_BIAS);
    self->filled = (uint8_t)(self->filled + (self->filled < SCREWING_RING ? 1u : 0u));
}

// The turn of a blow is no more than what the Hall pitches beat with it.
static bool is_fine(const Screwing *self) {
    return self->learned_q4 != 0 && self->learned_q4 < FINE_Q4;
}

// Turn a half turn over the window, in 1/8 degree Q4, at least a quarter of a degree a blow.
static int16_t turn_q4(const Screwing *self) {
    const int16_t window_q3 = is_fine(self) ? WINDOW_FINE_Q3 : WINDOW_Q3;
    int16_t sum = 0;
    uint8_t n = 0;
    while (n < self->filled && (n < 2u || (sum < window_q3 && n < WINDOW_MOST))) {
        sum = (int16_t)(sum + self->turned[n] - TURNED_BIAS);
        n++;
    }
    const int16_t turn = (int16_t)divide_by_u16((uint32_t)(uint16_t)(sum > 0 ? sum : 0) << 4, n);
    return turn > 16 ? turn : 16;
}

static void learn(Screwing *self, int16_t turn, uint8_t share_q4) {
    self->learned_q4 = (int16_t)(self->learned_q4 + (((int32_t)(turn - self->learned_q4) * share_q4 + 8) >> 4));
}

static void measure_rise(Screwing *self, int16_t turn) {
    const uint16_t raw = divide_by_u16((uint32_t)(uint16_t)self->learned_q4 << 8, (uint16_t)turn);
    const int16_t raw_q8 = (int16_t)(raw < 2048u ? raw : 2048u);
    self->rise_q8 = (int16_t)((raw_q8 + (self->raw_q8 == 0 ? raw_q8 : self->raw_q8)) / 2);
    self->raw_q8 = raw_q8;
}

static void begin_track(Screwing *self) {
    self->state = SCREWING_TRACK;
    self->onset_q3 = self->head_q3;
    self->behind = 0;
    self->edge_q8 = 0;
}

// 1/8 degree Q4 a half turn of the oscillator against 1 degree Q4 a blow.
static uint8_t power_for(const Screwing *self, const ScrewingSetpoints *set) {
    const int16_t turn_deg_q4 = self->learned_q4 / 4;
    if (turn_deg_q4 >= set->hard_turn_deg_q4) {
        return SCREWING_POWER_SOFT;
    }
    return turn_deg_q4 >= set->hard_turn_deg_q4 / 2 ? SCREWING_POWER_HARD : SCREWING_POWER_FULL;
}

static void track(Screwing *self, const ScrewingSetpoints *set, int16_t turn) {
    begin_track(self);
    learn(self, turn, self->rise_q8 > EASIER_Q8 ? 1u : 5u);
    if (self->count > HARD_HALVES && self->rise_q8 < CALM_Q8 && self->power < power_for(self, set)) {
        self->power++;
        self->state = SCREWING_SETTLE;
        relearn(self);
    }
}

static bool steep(const Screwing *self, int16_t turned) {
    if (is_fine(self)) {
        return turned < STEEP_FINE_Q3 && self->rise_q8 > STEEP_FINE_Q8;
    }
    if (self->learned_q4 < SMALL_Q4) {
        return self->behind <= STEEP_HALVES && self->rise_q8 > STEEP_SMALL_Q8;
    }
    return turned < EDGE_Q3 && self->rise_q8 > STEEP_Q8 + (int16_t)((uint16_t)(turned > 0 ? turned : 0) * 148u >> 8);
}

static bool seated(const Screwing *self, const ScrewingSetpoints *set, int16_t turned) {
    const int16_t sure = (int16_t)((is_fine(self) ? SURE_FINE_Q3 : SURE_Q3) + (int16_t)(((uint16_t)self->learned_q4 * 13u) >> 8));
    return turned >= (sure < SURE_MOST_Q3 ? sure : SURE_MOST_Q3) && self->rise_q8 >= set->rise_q8 &&
           self->rise_q8 >= SLOW_Q8 + (int16_t)(((uint16_t)turned * 57u) >> 8);
}

static void suspect(Screwing *self, const ScrewingSetpoints *set, int16_t turn) {
    const int16_t turned = (int16_t)(self->head_q3 - self->onset_q3);
    if (self->state == SCREWING_TRACK) {
        self->state = SCREWING_SUSPECT;
    }
    self->behind = (uint8_t)(self->behind + (self->behind < UINT8_MAX ? 1u : 0u));
    if (self->state == SCREWING_SUSPECT && steep(self, turned)) {
        self->state = SCREWING_KNOT;
    }
    const bool holds = seated(self, set, turned);
    self->held = holds ? (uint8_t)(self->held + 1u) : 0u;
    const uint8_t hold = is_fine(self) ? HOLD_FINE : 1u;
    if (turned < RECORD_Q3 && self->rise_q8 > self->edge_q8) {
        self->edge_q8 = self->rise_q8;
    }
    const bool goes_on = turned > EDGE_Q3 && self->rise_q8 > self->edge_q8 + self->edge_q8 / 4 + self->edge_q8 / 8;
    if (self->state == SCREWING_KNOT ? goes_on : self->held >= hold) {
        self->state = SCREWING_SEATED;
    } else if (turned > GIVE_UP_Q3) {
        self->learned_q4 = turn;
        self->raw_q8 = 0;
        begin_track(self);
    }
}

static void judge(Screwing *self, const ScrewingSetpoints *set) {
    if (self->count <= LEARN_HALVES) {
        learn(self, self->turn_q4, 5u);
    } else if (self->rise_q8 < (is_fine(self) ? ONSET_FINE_Q8 : ONSET_Q8)) {
        track(self, set, self->turn_q4);
    } else {
        suspect(self, set, self->turn_q4);
    }
}

static uint16_t pitch_of(const ScrewingSetpoints *set) {
    const uint32_t scale = (uint32_t)set->pulses * set->turn_q8;
    return divide_u16(PITCH_SCALE + scale / 2u, scale);
}

// What follows on the end of a half turn: one division a tick.
static void step_stage(Screwing *self, const ScrewingSetpoints *set) {
    switch ((Stage)self->stage) {
    case STAGE_NONE:
        return;
    case STAGE_PITCH:
        self->pitch = pitch_of(set);
        self->stage = STAGE_STEP;
        return;
    case STAGE_PHASE:
        self->stage++;
        take_phase(self);
        return;
    case STAGE_STEP:
        self->step = step_of(self);
        break;
    case STAGE_SHARE:
        self->per_step = divide_by_u16(SHARE_SCALE, self->step);
        if (self->known == 0u) {
            self->stage = STAGE_NONE;
            return;
        }
        push_turned(self);
        break;
    case STAGE_TURN:
        self->count = (uint8_t)(self->count + (self->count < UINT8_MAX ? 1u : 0u));
        self->turn_q4 = turn_q4(self);
        break;
    case STAGE_JUDGE:
        self->stage = STAGE_NONE;
        if (self->count <= SETTLE_HALVES) {
            self->filled = 1;
            return;
        }
        self->learned_q4 = self->learned_q4 == 0 ? self->turn_q4 : self->learned_q4;
        measure_rise(self, self->turn_q4);
        judge(self, set);
        return;
    }
    self->stage++;
}

static int16_t share_of(int16_t duty_q15, int16_t share_q15) {
    return (int16_t)(((uint32_t)(uint16_t)duty_q15 * (uint16_t)(2u * (uint16_t)share_q15)) >> 16);
}

static int16_t power_q15(const Screwing *self, const ScrewingSetpoints *set) {
    switch ((ScrewingPower)self->power) {
    case SCREWING_POWER_SOFT:
        return set->share_q15;
    case SCREWING_POWER_HARD:
        return set->share_hard_q15;
    case SCREWING_POWER_FULL:
        break;
    }
    return INT16_MAX;
}

static int16_t output(Screwing *self, const ScrewingSetpoints *set, int16_t travel_q15) {
    switch ((ScrewingState)self->state) {
    case SCREWING_RUN_IN:
        self->share_q15 = INT16_MAX;
        return travel_q15;
    case SCREWING_SETTLE:
    case SCREWING_TRACK:
    case SCREWING_SUSPECT:
    case SCREWING_KNOT:
        if (self->share_q15 != power_q15(self, set)) {
            self->share_q15 = slew_towards(self->share_q15, power_q15(self, set), SHARE_SLEW);
        }
        return share_of(travel_q15, self->share_q15);
    case SCREWING_SEATED:
        break;
    }
    return CONTROLLER_STOP;
}

// Two of the tick's heavy works do not meet: a half turn that ends, and what follows on the one before.
static bool ends_half(const Screwing *self, uint8_t edges) {
    return edges > 1u || (edges == 1u && (uint16_t)(0x8000u - (self->phase & 0x7FFFu)) <= self->step);
}

static bool impacts(const Screwing *self, const Blow *blow) {
    return blow->impacting && (self->state != SCREWING_RUN_IN || blow->count >= 2u);
}

int16_t screwing_step(Screwing *self, const ScrewingSetpoints *set, const ControllerInputs *in, const Blow *blow) {

    const int16_t speed_rpm_q1 = in->speed_rpm_q1 > 0 ? in->speed_rpm_q1 : 0;
    self->last_rpm_q1 = speed_rpm_q1;
    if (self->state == SCREWING_SEATED) {
        return CONTROLLER_STOP;
    }
    if (!impacts(self, blow)) {
        self->state = SCREWING_RUN_IN;
        self->power = SCREWING_POWER_SOFT;
    } else if (self->state == SCREWING_RUN_IN) {
        self->state = SCREWING_SETTLE;
        listen(self);
        relearn(self);
    } else if (!blow->busy && !ends_half(self, in->edges)) {
        step_stage(self, set);
    }
    if (self->state != SCREWING_RUN_IN && self->per_step > 0u) {
        for (uint8_t n = 0; n < in->edges && n < EDGES_MOST; n++) {
            take_edge(self);
        }
    }
    return output(self, set, in->travel_q15 > 0 ? in->travel_q15 : 0);
}

uint8_t screwing_state(const Screwing *self) {
    return self->state;
}

uint8_t screwing_stop_reason(const Screwing *self) {
    return self->state == SCREWING_SEATED ? CONTROLLER_REASON_SEATED : CONTROLLER_REASON_NONE;
}

int16_t screwing_estimate(const Screwing *self) {
    return self->rise_q8;
}
