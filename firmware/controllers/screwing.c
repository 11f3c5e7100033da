// Precise screwing, see screwing.h.
#include "controllers/screwing.h"

#include "core/clear.h"
#include "core/divide.h"
#include "core/inline.h"
#include "core/slew.h"

// Computation of a finished wave, one per tick.
typedef enum { STAGE_NONE, STAGE_PHASE, STAGE_JUDGE, STAGE_WEIGH } Stage;

// Rotations are in 1/364 degree: 2^16 is 180 degrees, from lug to lug of two. A wave, six Hall
// pitches, lasts half a blow.
#define DEG 364u
#define WAVE_SCALE 100663296u  // 2^15 * 6 pitches / 90 degrees of the spindle * pulses * turn_q8
#define EDGES_MAX 2u           // per tick: at a higher speed there is no ripple

// Blows at the trigger's duty. A screw turns far before it is seated, and the impact rate is a mean
// over time: a slow end after a fast beginning takes less time than a constant power with the same
// mean rate.
#define RUN_IN_BLOWS 12u

// SETTLE: the rotation per blow is learned at the reduced power.
#define SETTLE_WAVES 28u
#define UNSETTLED_WAVES 8u    // the first of them are not averaged
#define POWER_WAVES 14u       // waves left when the power is chosen
#define SETTLE_MEMORY_Q8 32u  // weight of a new rotation: 1/8

// Averaging in TRACK: the weight of a new rotation is 1 from 11 degrees per blow on, proportional
// to the learned rotation below, and to its square below SMALL_TURN.
#define TURN_MIN (DEG / 5u)  // least rotation per blow
#define SMALL_TURN 1024u     // 2.8 degrees per blow
#define MEMORY_Q8 16u
#define MEMORY_MIN_Q8 4u                   // 1/64
#define PAIR_TURN (27 * (int16_t)DEG / 2)  // below 13.5 degrees per blow, two blows are averaged

// Seat detection: the shape of the rise after its onset, see area_max().
#define ONSET_Q8 287     // 1.12
#define SURE (5u * DEG)  // plus 3/4 of the learned rotation: least angle of a slow rise
#define WIDE_TURN (16 * (int16_t)DEG)  // above it even a knot's edge over two blows would be slow
#define SLOW_TURN (11 * (int16_t)DEG)  // up to it a rise is slow below SLOW_Q8 per blow, above it
#define SLOW_Q8 55                     // (0.21) below SLOW_Q8 / SLOW_TURN: 0.0195 per degree
#define SLOW_AREA_Q8 141               // 0.55: greatest area of a slow rise
#define EDGE (9u * DEG)                // plus 1/5 of the learned rotation, see area_max()
#define LATE_AREA_Q8 77                // 0.3: below this area the rise has only just begun
#define GIVE_UP (60u * DEG)            // no seat within this angle: the rise is learned as wood

// Power and duty.
#define SHARE_MORE 48u    // share_q15 per missing 1/364 degree, times 8: 0.067 per degree
#define LEAST_MAX 30000u  // 17/8 of it fits in 16 bits
#define SLEW 110          // of the duty per tick: a step would brake the motor

// Phase of (x, y), 2^16 per turn, within 0.0038 rad: atan r = r (pi / 4 + 0.273 (1 - r)) for
// 0 <= r <= 1 (Rajan et al., IEEE Signal Processing Magazine 23(3), 2006).
static uint16_t phase_of(int16_t x, int16_t y) {
    const uint16_t along = (uint16_t)(x < 0 ? -x : x), across = (uint16_t)(y < 0 ? -y : y);
    const bool swap = across > along;
    const uint16_t less = swap ? along : across, more = swap ? across : along;
    const uint16_t ratio_q16 = more == 0u ? 0u : divide_by_u16((uint32_t)less << 16, more);
    const uint16_t slope =
        (uint16_t)(8192u + (uint16_t)(((uint32_t)2847u * (uint16_t)~ratio_q16) >> 16));
    uint16_t angle = (uint16_t)(((uint32_t)slope * ratio_q16) >> 16);
    angle = swap ? (uint16_t)(16384u - angle) : angle;
    angle = x < 0 ? (uint16_t)(32768u - angle) : angle;
    return y < 0 ? (uint16_t)(0u - angle) : angle;
}

void screwing_start(Screwing *self, const ScrewingSetpoints *set) {
    (void)set;  // read when the impacts begin
    CLEAR(self);
    self->state = SCREWING_RUN_IN;
}

static void settle(Screwing *self) {
    self->state = SCREWING_SETTLE;
    self->left = SETTLE_WAVES;
    self->rise_q8 = 0;
}

// At the end of a wave: `found`, the double sums of this wave less those of the wave before the
// last, weights the speeds of 18 pitches with a trapezium. A constant speed, a linear trend and the
// ripple once per lug contribute 0 to it.
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

// Adds a pitch, in the second half of a wave with the opposite sign. Sums wrap modulo 2^16; their
// differences fit.
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

// Rotation of the screw in this wave and the one before, together a blow, from the phase lag.
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
    self->before_last = self->last_turn;
    self->last_turn = self->turn;
    self->turn = turn > (int16_t)TURN_MIN ? turn : (int16_t)TURN_MIN;
}

static int16_t part_q8(int16_t value, uint16_t share_q8) {
    return (int16_t)(((int32_t)value * (int16_t)share_q8 + 128) >> 8);
}

// Weight of a new rotation in the average, Q8.
static uint16_t weight_q8(const Screwing *self) {
    if (self->state == SCREWING_SETTLE) {
        return self->left > SETTLE_WAVES - UNSETTLED_WAVES ? 256u : SETTLE_MEMORY_Q8;
    }
    const uint16_t learned = (uint16_t)self->learned;
    const uint16_t share_q8 = learned < SMALL_TURN
                                  ? (uint16_t)(((uint32_t)learned * learned) >> 14)
                                  : (uint16_t)(((uint32_t)learned * MEMORY_Q8) >> 8);
    return share_q8 < MEMORY_MIN_Q8 ? MEMORY_MIN_Q8 : share_q8 > 256u ? 256u : share_q8;
}

// Rotation per blow without the error of unequal Hall pitches: where a blow turns little, the
// pitches repeat every second blow, and the mean of two blows cancels their error.
static int16_t steady_turn(const Screwing *self) {
    return self->learned < PAIR_TURN ? (int16_t)(((int32_t)self->turn + self->before_last) >> 1)
                                     : self->turn;
}

// Rotation that a blow lacks to small_deg_q4, or, once the power has been raised, to half of
// small_deg_q4.
static uint16_t lacking(const Screwing *self, const ScrewingSetpoints *set) {
    const uint8_t shift = self->share_q15 == set->share_q15 ? 4u : 5u;
    const uint16_t small = (uint16_t)(((uint32_t)(uint16_t)set->small_deg_q4 * DEG) >> shift);
    return (uint16_t)self->now < small && self->share_q15 < INT16_MAX
               ? (uint16_t)(small - (uint16_t)self->now)
               : 0u;
}

// Starts the integral of the rise.
static void begin(Screwing *self, int16_t base_q8) {
    self->base_q8 = base_q8;
    self->turned = 0;
    self->area = 0;
    self->over_q8 = 0;
}

static void track(Screwing *self) {
    begin(self, ONSET_Q8);
    self->state = SCREWING_TRACK;
}

// SETTLE: the averaged rotation becomes the learned one.
static void learn(Screwing *self, const ScrewingSetpoints *set) {
    self->learned = self->now;
    self->rise_q8 = 256;
    self->left--;
    const uint16_t lack = self->left == POWER_WAVES ? lacking(self, set) : 0u;
    if (lack > 0u) {
        const uint32_t share_q15 =
            (uint32_t)(uint16_t)self->share_q15 + (((uint32_t)lack * SHARE_MORE) >> 3);
        self->share_q15 = (int16_t)(share_q15 < INT16_MAX ? share_q15 : INT16_MAX);
        settle(self);
    } else if (self->left == 0u) {
        track(self);
    }
}

// Adapts the learned rotation to wood that changes with the depth, over 180 degrees.
static void follow(Screwing *self) {
    self->learned = (int16_t)(self->learned +
                              (((int32_t)(self->turn - self->learned) * self->turn + 65536) >> 17));
    track(self);
}

// Whether the rise is slower than any knot's edge, which extends over two blows.
static bool is_slow(const Screwing *self) {
    const int16_t turn = self->learned < SLOW_TURN ? self->learned : SLOW_TURN;
    return self->learned < WIDE_TURN &&
           (int32_t)self->over_q8 * turn <= (int32_t)self->turned * SLOW_Q8;
}

// Greatest area between rise and onset, over the angle turned, that a seat may have, as a share of
// the final rise: a linear rise has half of the angle, a knot's constant level all of it. A knot's
// edge, spread over some blows by the averaging window and the motor's inertia, begins as a linear
// rise too: EDGE subtracts the angle until the two differ. A slow rise is no edge.
static int16_t area_max(const Screwing *self) {
    const int16_t turned = (int16_t)self->turned, learned = self->learned;
    if (is_slow(self) && turned >= (int16_t)SURE + part_q8(learned, 192)) {
        return part_q8(turned, SLOW_AREA_Q8);
    }
    return (int16_t)(part_q8(turned, 205) - (int16_t)EDGE - part_q8(learned, 51));
}

// Adds a wave, half a blow, to the angle since the onset and to the integral (trapezium rule).
static void add_wave(Screwing *self) {
    const int16_t over_q8 = (int16_t)(self->rise_q8 - self->base_q8);
    self->turned = (uint16_t)(self->turned + (uint16_t)self->turn / 2u);
    self->area += ((int32_t)(int16_t)(over_q8 + self->over_q8) * self->turn) >> 2;
    self->over_q8 = over_q8;
}

static bool area_within(const Screwing *self, int16_t angle) {
    return self->area <= (int32_t)self->over_q8 * angle;
}

// Where the area is much below that of a linear rise, the onset was a disturbance and the rise has
// only begun: the integral starts again from there.
static void suspect(Screwing *self, const ScrewingSetpoints *set) {
    const int16_t last_q8 = self->over_q8;
    self->state = SCREWING_SUSPECT;
    add_wave(self);
    if (last_q8 > 0 && area_within(self, part_q8((int16_t)self->turned, LATE_AREA_Q8))) {
        begin(self, (int16_t)(self->base_q8 + last_q8));
        add_wave(self);
    }
    if (self->rise_q8 >= set->rise_q8 && self->over_q8 > 0 && area_within(self, area_max(self))) {
        self->state = SCREWING_SEATED;
    } else if (self->turned > GIVE_UP) {
        self->learned = self->now;
        track(self);
    }
}

static void judge(Screwing *self, const ScrewingSetpoints *set) {
    BY_POINTER(self);
    self->now =
        (int16_t)(self->now + part_q8((int16_t)(steady_turn(self) - self->now), weight_q8(self)));
    if (self->left > 0u) {
        learn(self, set);
        return;
    }
    const uint16_t rise_q8 =
        divide_by_u16((uint32_t)(uint16_t)self->learned << 8, (uint16_t)self->now);
    self->rise_q8 = (int16_t)(rise_q8 < 2048u ? rise_q8 : 2048u);
    if (self->rise_q8 < ONSET_Q8) {
        follow(self);
    } else {
        self->stage = STAGE_WEIGH;
    }
}

// One computation per tick, in ticks without edges: first the constants of the setpoints, then the
// stages of a finished wave.
static void step_stage(Screwing *self, const ScrewingSetpoints *set, uint16_t supply_mv) {
    if (self->least_q15 == 0) {
        self->excess =
            (uint16_t)(2u * divide_u16(WAVE_SCALE, (uint32_t)set->pulses * set->turn_q8));
        const uint16_t least_q15 =
            divide_by_u16((uint32_t)(uint16_t)set->least_mv << 15, supply_mv);
        self->least_q15 = (int16_t)(least_q15 < LEAST_MAX ? least_q15 : LEAST_MAX);
    } else if (self->stage == STAGE_PHASE) {
        self->stage = STAGE_JUDGE;
        take_phase(self);
    } else if (self->stage == STAGE_JUDGE) {
        self->stage = STAGE_NONE;
        judge(self, set);
    } else if (self->stage == STAGE_WEIGH) {
        self->stage = STAGE_NONE;
        suspect(self, set);
    }
}

// Duty while impacting: a share of the trigger's duty plus a quarter of the least duty. Limits: the
// least duty, and 17/8 of it, above which blows are not detected because the speed has no ripple.
static uint16_t requested_q15(const Screwing *self, int16_t travel_q15) {
    const uint16_t least = (uint16_t)self->least_q15,
                   share = (uint16_t)(2u * (uint16_t)self->share_q15);
    const uint16_t requested =
        (uint16_t)((uint16_t)(((uint32_t)(uint16_t)travel_q15 * share) >> 16) + least / 4u);
    const uint16_t most = (uint16_t)(2u * least + least / 8u);
    return requested < least ? least : requested > most ? most : requested;
}

static int16_t output(Screwing *self, int16_t travel_q15) {
    if (self->state == SCREWING_RUN_IN || self->least_q15 == 0) {
        self->duty_q15 = travel_q15;
    } else {
        const uint16_t most = requested_q15(self, travel_q15);
        const int16_t requested = (int16_t)(most < INT16_MAX ? most : INT16_MAX);
        self->duty_q15 = slew_towards(self->duty_q15, requested, SLEW);
        if (self->state == SCREWING_SETTLE && self->duty_q15 != requested) {
            self->left = SETTLE_WAVES;  // the duty has not settled
        }
    }
    return self->duty_q15 < travel_q15 ? self->duty_q15 : travel_q15;
}

int16_t screwing_step(Screwing *self, const ScrewingSetpoints *set, const ControllerInputs *in,
                      const Blow *blow) {
    BY_POINTER(self);
    if (self->state == SCREWING_SEATED) {
        return CONTROLLER_STOP;
    }
    if (!blow->impacting) {
        self->state = SCREWING_RUN_IN;
    } else if (self->state == SCREWING_RUN_IN) {
        if (blow->count >= RUN_IN_BLOWS) {
            self->share_q15 = set->share_q15;
            settle(self);
        }
    } else if (!blow->busy && in->edges == 0u) {
        step_stage(self, set, in->supply_mv);
    }
    for (uint8_t n = 0; n < in->edges && n < EDGES_MAX; n++) {
        take_edge(self, (uint16_t)in->speed_rpm_q1 / 2u);
    }
    return self->state == SCREWING_SEATED ? CONTROLLER_STOP
                                          : output(self, in->travel_q15 > 0 ? in->travel_q15 : 0);
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
