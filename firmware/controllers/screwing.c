// Precise screwing, see screwing.h.
#include "controllers/screwing.h"

#include "core/divide.h"
#include "core/inline.h"
#include "core/slew.h"

typedef enum { STAGE_NONE, STAGE_PHASE, STAGE_JUDGE } Stage;

#define DEG 364u               // a degree of a blow's turn
#define WAVE_SCALE 100663296u  // 2^15 times what six pitches of the spindle are of 90 degrees, times pulses * turn_q8
#define EDGES_MOST 2u          // a tick: more have no ripple to tell
#define SETTLE_WAVES 28u       // half a blow each
#define UNSETTLED_WAVES 8u     // of them the first are not learned from
#define POWER_WAVES 14u        // left when the power is chosen
#define KNOT_WAVES 8u          // until the edge of a knot has passed the window
#define KNOT_TURN (12u * DEG)
#define TURN_LEAST (DEG / 5u)  // of a blow
#define MEMORY_Q8 11u          // a turn is taken as it is from 16 degrees a blow on, else averaged over as many
#define MEMORY_LEAST_Q8 26u    // 1/10
#define SETTLE_MEMORY_Q8 32u   // 1/8
#define ONSET_Q8 287           // 1.12
#define STEEP_Q8 402           // 1.57, and 0.008 for each degree that it turned since the onset by more than the learned turn
#define JUMP_Q8 56             // 0.22 in half a blow: steeper is the edge of a knot
#define SURE (8u * DEG)        // and 3/4 of the learned turn: behind the onset until a seat is believed
#define GIVE_UP (60u * DEG)    // too flat for a seat
#define SHARE_MORE 6144        // of power where a blow turns little
#define LEAST_MOST 30000u      // 17/8 of it fit
#define SLEW 110               // a tick: a step would brake

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

void screwing_start(Screwing *self, const ScrewingSetpoints *set) {
    (void)set;  // taken when it impacts
    *self = (Screwing){.state = SCREWING_RUN_IN};
}

static void settle(Screwing *self) {
    self->state = SCREWING_SETTLE;
    self->left = SETTLE_WAVES;
    self->rise_q8 = 0;
}

// A wave has ended. Its sums of sums, less those of two waves ago, weigh 18 pitches as a trapezium: a level, a slope and the ripple once a lug cancel.
static void close_wave(Screwing *self) {
    for (uint8_t n = 0; n < SCREWING_AXES; n++) {
        self->found[n] = (int16_t)(self->twice[n] - self->before[n]);
        self->before[n] = self->last[n];
        self->last[n] = self->twice[n];
        self->twice[n] = 0;
    }
    self->place = 0;
    self->stage = STAGE_PHASE;
}

// A pitch; in the second half of a wave it counts the other way. All is modulo 2^16, what is found fits.
static void take_edge(Screwing *self, uint16_t rpm) {
    const bool second = self->place >= SCREWING_AXES;
    uint16_t *sum = &self->sum[second ? self->place - SCREWING_AXES : self->place];
    *sum = (uint16_t)(second ? *sum - rpm : *sum + rpm);
    for (uint8_t n = 0; n < SCREWING_AXES; n++) {
        self->twice[n] = (uint16_t)(self->twice[n] + self->sum[n]);
    }
    self->place++;
    if (self->place == 2u * SCREWING_AXES) {
        close_wave(self);
    }
}

// What the screw turned in this wave and the one before, a blow's worth: by what its phase lags, and six pitches are more than 90 degrees.
static void take_phase(Screwing *self) {
    BY_POINTER(self);
    const int16_t *found = self->found;
    const int16_t x = (int16_t)((2 * (int32_t)found[0] + found[1] - found[2]) >> 2);
    const int16_t y = (int16_t)((((int32_t)found[1] + found[2]) * 111) >> 8);  // sqrt(3) / 4
    const uint16_t phase = phase_of(x, y);
    const int16_t half = (int16_t)(self->excess + (uint16_t)(phase - self->phase));
    self->phase = phase;
    const int16_t turn = (int16_t)(((int32_t)half + self->half) >> 1);
    self->half = half;
    self->turn = turn > (int16_t)TURN_LEAST ? turn : (int16_t)TURN_LEAST;
}

static int16_t part_q8(int16_t value, uint16_t share_q8) {
    return (int16_t)(((int32_t)value * (int16_t)share_q8) >> 8);
}

static uint16_t memory_q8(const Screwing *self) {
    if (self->state == SCREWING_SETTLE) {
        return self->left > SETTLE_WAVES - UNSETTLED_WAVES ? 256u : SETTLE_MEMORY_Q8;
    }
    const uint16_t share_q8 = (uint16_t)(((uint32_t)(uint16_t)self->learned * MEMORY_Q8) >> 8);
    return share_q8 < MEMORY_LEAST_Q8 ? MEMORY_LEAST_Q8 : share_q8 > 256u ? 256u : share_q8;
}

static bool is_small(const Screwing *self, const ScrewingSetpoints *set) {
    const uint8_t shift = self->share_q15 == set->share_q15 ? 4u : 5u;
    return self->share_q15 < INT16_MAX && (uint16_t)self->now < ((uint32_t)(uint16_t)set->small_deg_q4 * DEG) >> shift;
}

// SETTLE and KNOT: the present turn is the learned one.
static void learn(Screwing *self, const ScrewingSetpoints *set) {
    self->learned = self->now;
    self->rise_q8 = 256;
    self->turned = (uint16_t)(self->turned + (uint16_t)self->turn / 2u);
    if (self->left == POWER_WAVES && is_small(self, set)) {
        self->share_q15 = self->share_q15 > INT16_MAX - SHARE_MORE ? INT16_MAX : (int16_t)(self->share_q15 + SHARE_MORE);
        settle(self);
    } else if (self->left > 1u) {
        self->left--;
    } else if (self->turned >= KNOT_TURN) {
        self->left = 0;
        self->state = SCREWING_TRACK;
    }
}

// As wood changes with the depth, over 180 degrees.
static void follow(Screwing *self) {
    self->learned = (int16_t)(self->learned + (((int32_t)(self->turn - self->learned) * self->turn) >> 17));
    self->turned = 0;
    self->state = SCREWING_TRACK;
}

static void suspect(Screwing *self, const ScrewingSetpoints *set, int16_t jump_q8) {
    self->turned = (uint16_t)(self->turned + (uint16_t)self->turn / 2u);
    self->state = SCREWING_SUSPECT;
    const int16_t steep_q8 = (int16_t)(STEEP_Q8 + ((3 * ((int32_t)self->turned - self->learned)) >> 9));
    const bool steep = self->rise_q8 > steep_q8 || jump_q8 > JUMP_Q8;
    if (steep || self->turned > GIVE_UP) {
        self->state = SCREWING_KNOT;
        self->left = KNOT_WAVES;
        self->turned = 0;
    } else if (self->turned >= SURE + (uint16_t)self->learned / 2u + (uint16_t)self->learned / 4u && self->rise_q8 >= set->rise_q8) {
        self->state = SCREWING_SEATED;
    }
}

static void judge(Screwing *self, const ScrewingSetpoints *set) {
    BY_POINTER(self);
    self->now = (int16_t)(self->now + part_q8((int16_t)(self->turn - self->now), memory_q8(self)));
    if (self->left > 0u) {
        learn(self, set);
        return;
    }
    const uint16_t rise_q8 = divide_by_u16((uint32_t)(uint16_t)self->learned << 8, (uint16_t)self->now);
    const int16_t last_q8 = self->rise_q8;
    self->rise_q8 = (int16_t)(rise_q8 < 2048u ? rise_q8 : 2048u);
    if (self->rise_q8 < ONSET_Q8) {
        follow(self);
    } else {
        suspect(self, set, (int16_t)(self->rise_q8 - last_q8));
    }
}

// None beside edges, which leave ticks enough at the speeds driven here: first what the setpoints come to, then what follows on the end of a wave.
static void step_stage(Screwing *self, const ScrewingSetpoints *set, uint16_t supply_mv) {
    if (self->least_q15 == 0) {
        self->excess = (uint16_t)(2u * divide_u16(WAVE_SCALE, (uint32_t)set->pulses * set->turn_q8));
        const uint16_t least_q15 = divide_by_u16((uint32_t)(uint16_t)set->least_mv << 15, supply_mv);
        self->least_q15 = (int16_t)(least_q15 < LEAST_MOST ? least_q15 : LEAST_MOST);
    } else if (self->stage == STAGE_PHASE) {
        self->stage = STAGE_JUDGE;
        take_phase(self);
    } else if (self->stage == STAGE_JUDGE) {
        self->stage = STAGE_NONE;
        judge(self, set);
    }
}

// Of the trigger's duty a share and half of the least on top, between the least and what still shows the ripple.
static uint16_t wish_q15(const Screwing *self, int16_t travel_q15) {
    const uint16_t least = (uint16_t)self->least_q15, share = (uint16_t)(2u * (uint16_t)self->share_q15);
    const uint16_t wish = (uint16_t)((uint16_t)(((uint32_t)(uint16_t)travel_q15 * share) >> 16) + least / 2u);
    const uint16_t most = (uint16_t)(2u * least + least / 8u);
    return wish < least ? least : wish > most ? most : wish;
}

static int16_t output(Screwing *self, int16_t travel_q15) {
    if (self->state == SCREWING_RUN_IN || self->least_q15 == 0) {
        self->duty_q15 = travel_q15;
    } else {
        const uint16_t most = wish_q15(self, travel_q15);
        const int16_t wish = (int16_t)(most < INT16_MAX ? most : INT16_MAX);
        self->duty_q15 = slew_towards(self->duty_q15, wish, SLEW);
        if (self->state == SCREWING_SETTLE && self->duty_q15 != wish) {
            self->left = SETTLE_WAVES;  // not there yet
        }
    }
    return self->duty_q15 < travel_q15 ? self->duty_q15 : travel_q15;
}

int16_t screwing_step(Screwing *self, const ScrewingSetpoints *set, const ControllerInputs *in, const Blow *blow) {
    BY_POINTER(self);
    if (self->state == SCREWING_SEATED) {
        return CONTROLLER_STOP;
    }
    if (!blow->impacting) {
        self->state = SCREWING_RUN_IN;
    } else if (self->state == SCREWING_RUN_IN) {
        if (blow->count >= 2u) {
            self->share_q15 = set->share_q15;
            settle(self);
        }
    } else if (!blow->busy && in->edges == 0u) {
        step_stage(self, set, in->supply_mv);
    }
    for (uint8_t n = 0; n < in->edges && n < EDGES_MOST; n++) {
        take_edge(self, (uint16_t)in->speed_rpm_q1 / 2u);
    }
    return self->state == SCREWING_SEATED ? CONTROLLER_STOP : output(self, in->travel_q15 > 0 ? in->travel_q15 : 0);
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
