// Synchronisation, see sync.h.
#include "controllers/sync.h"

#include "core/fixed.h"
#include "core/inline.h"
#include "core/slew.h"

#define TRAVEL_LEAST_Q15 9830  // 0.3: below it the trigger itself is the duty, for starting a screw
#define LEVEL_MIN_MV 13400
#define LEVEL_MAX_MV 16600
#define TRIM_MAX_MV 12000
#define SLEW_Q15 328      // 0.01 a tick
#define SUPPLY_SHIFT 3u   // every third tick: 24 ms
#define CURRENT_SHIFT 4u  // 48 ms
#define STEP_UP_MV 100    // a blow
#define STEP_FAST_MV 250
#define STEP_DOWN_MV 60
#define CURRENT_DEAD_A_Q9 1536  // 3 A
#define CURRENT_STEP_SHIFT                                                                         \
    4u  // 32 mV a blow for each A beyond: with 3 A/V and three blows of lag far from swinging
#define SEEK_SHIFT 1u  // dips of twice the limit: out of step

typedef enum { TURN_FOLLOW, TURN_TRIM, TURN_LEVEL, TURN_APPROACH } Turn;

void sync_start(Sync *self, const SyncSetpoints *set) {
    (void)set;
    *self = (Sync){.state = SYNC_PLAIN};
}

static void follow(Sync *self, const ControllerInputs *in) {
    const uint16_t now =
        (uint16_t)(in->supply_mv > INT16_MAX ? UINT16_MAX - 1u : 2u * in->supply_mv);
    if (self->supply_mv_q1 == 0u) {
        self->supply_mv_q1 = now;
    } else if (now >= self->supply_mv_q1) {
        self->supply_mv_q1 =
            (uint16_t)(self->supply_mv_q1 + ((uint16_t)(now - self->supply_mv_q1) >> SUPPLY_SHIFT));
    } else {
        self->supply_mv_q1 =
            (uint16_t)(self->supply_mv_q1 - ((uint16_t)(self->supply_mv_q1 - now) >> SUPPLY_SHIFT));
    }
    const int16_t half =
        (int16_t)((in->current_a_q9 >> 1) - (self->current_a_q9 >> 1));  // of two int16_t
    self->current_a_q9 = (int16_t)(self->current_a_q9 + (half >> (CURRENT_SHIFT - 1u)));
}

// value * share / 2^15, less its last bit: the high word of a product is a move, a shift by 15 is
// not.
static int16_t part_of(int16_t value, int16_t share_q15) {
    return (int16_t)(2 * (int16_t)(((int32_t)value * share_q15) >> 16));
}

static int16_t trim_by_depth(int16_t ripple_rpm, int16_t deep_rpm, int16_t shallow_rpm) {
    if (ripple_rpm > deep_rpm) {
        return STEP_UP_MV;
    }
    return ripple_rpm > shallow_rpm ? 0 : -STEP_DOWN_MV;
}

static int16_t trim_by_current(const Sync *self, const SyncSetpoints *set) {
    const int32_t off_a_q9 = (int32_t)set->current_a_q9 - self->current_a_q9;
    const int32_t dead_a_q9 = fixed_clamp_i32(off_a_q9, -CURRENT_DEAD_A_Q9, CURRENT_DEAD_A_Q9);
    return (int16_t)((int16_t)fixed_clamp_i32(off_a_q9 - dead_a_q9, INT16_MIN, INT16_MAX) >>
                     CURRENT_STEP_SHIFT);
}

static int16_t base_mv(const SyncSetpoints *set, int16_t travel_q15) {
    return (int16_t)(set->low_mv + part_of((int16_t)(set->high_mv - set->low_mv), travel_q15));
}

// What the last blow says.
static void trim(Sync *self, const SyncSetpoints *set, const Blow *blow) {
    const int16_t deep = part_of(blow->base_rpm, set->depth_max_q15);
    const bool lost = blow->ripple_rpm >> SEEK_SHIFT > deep;
    const int16_t by_dips =
        trim_by_depth(blow->ripple_rpm, deep, part_of(blow->base_rpm, set->depth_min_q15));
    const int16_t even =
        (uint8_t)set->method == CONTROLLER_METHOD_SPEED ? by_dips : trim_by_current(self, set);
    const int16_t step = lost ? STEP_FAST_MV : even;
    if (step < 0 ||
        self->goal_q15 < INT16_MAX) {  // else there is nothing more to be had from this battery
        self->trim_mv =
            (int16_t)fixed_clamp_i32((int32_t)self->trim_mv + step, -TRIM_MAX_MV, TRIM_MAX_MV);
    }
    self->state = lost ? SYNC_SEEK : SYNC_HOLD;
}

static void set_level(Sync *self, const SyncSetpoints *set, int16_t travel_q15) {
    const int16_t base = base_mv(set, travel_q15);
    self->level_mv =
        (int16_t)fixed_clamp_i32((int32_t)base + self->trim_mv, LEVEL_MIN_MV, LEVEL_MAX_MV);
    self->trim_mv = (int16_t)(self->level_mv - base);  // no more than what it does
}

// The duty that gives the level, by steps that leave a sixth of what is missing or less: 3/2 stands
// for 2^15 over the supply, and no division is needed.
static void approach(Sync *self) {
    const int16_t given_mv =
        (int16_t)(uint16_t)(((uint32_t)(uint16_t)self->goal_q15 * self->supply_mv_q1) >> 16);
    const int16_t off_mv = (int16_t)(self->level_mv - given_mv);
    const int16_t more_q15 = (int16_t)(off_mv + (off_mv >> 1));
    self->goal_q15 =
        more_q15 > INT16_MAX - self->goal_q15 ? INT16_MAX : (int16_t)(self->goal_q15 + more_q15);
    self->goal_q15 = self->goal_q15 < 0 ? 0 : self->goal_q15;
}

static void engage(Sync *self, const SyncSetpoints *set, int16_t travel_q15) {
    self->state = SYNC_HOLD;
    self->turn = TURN_FOLLOW;
    self->heard = false;
    self->current_a_q9 = set->current_a_q9;  // that of the run-up says nothing
    self->goal_q15 = self->duty_q15;
    set_level(self, set, travel_q15);
}

// One piece a tick, none while the blow itself is worked out; what a blow says is looked at when
// all of it is known.
static void take_turn(Sync *self, const SyncSetpoints *set, const ControllerInputs *in,
                      const Blow *blow) {
    switch ((Turn)self->turn) {
    case TURN_FOLLOW:
        follow(self, in);
        self->turn = self->heard ? TURN_TRIM : TURN_LEVEL;
        break;
    case TURN_TRIM:
        trim(self, set, blow);
        self->heard = false;
        self->turn = TURN_LEVEL;
        break;
    case TURN_LEVEL:
        set_level(self, set, in->travel_q15);
        self->turn = TURN_APPROACH;
        break;
    case TURN_APPROACH:
        approach(self);
        self->turn = TURN_FOLLOW;
        break;
    }
}

static void hold(Sync *self, const SyncSetpoints *set, const ControllerInputs *in,
                 const Blow *blow) {
    if (self->state == SYNC_PLAIN) {
        engage(self, set, in->travel_q15);
    } else if (!blow->busy) {
        take_turn(self, set, in, blow);
    }
    self->heard = self->heard || blow->lugs > 0u;
}

static void release(Sync *self, const ControllerInputs *in, const Blow *blow) {
    self->state = SYNC_PLAIN;
    self->goal_q15 = in->travel_q15;
    if (!blow->busy) {
        follow(self, in);
    }
}

int16_t sync_step(Sync *self, const SyncSetpoints *set, const ControllerInputs *in,
                  const Blow *blow) {
    BY_POINTER(self);
    if (blow->impacting && in->travel_q15 >= TRAVEL_LEAST_Q15) {
        hold(self, set, in, blow);
    } else {
        release(self, in, blow);
    }
    const bool plain_rise = self->state == SYNC_PLAIN && self->duty_q15 <= in->travel_q15;
    self->duty_q15 =
        plain_rise ? in->travel_q15 : slew_towards(self->duty_q15, self->goal_q15, SLEW_Q15);
    return self->duty_q15;
}

uint8_t sync_state(const Sync *self) {
    return self->state;
}

uint8_t sync_stop_reason(const Sync *self) {
    (void)self;
    return CONTROLLER_REASON_NONE;
}

int16_t sync_estimate(const Sync *self) {
    return self->state == SYNC_PLAIN ? 0 : self->level_mv;
}
