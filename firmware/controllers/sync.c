// Synchronisation, see sync.h.
#include "controllers/sync.h"

#include "core/clear.h"
#include "core/fixed.h"
#include "core/inline.h"
#include "core/slew.h"

#define TRAVEL_MIN_Q15 9830  // 0.3: below it the duty is the trigger's, for starting a screw
#define LEVEL_BELOW_MV 800   // the trim lowers the level to so much below low_mv at most,
#define LEVEL_ABOVE_MV 1100  // and raises it to so much above high_mv
#define OFF_MAX_MV 21844     // of the level and the voltage: 1.5 times it fits in 16 bits
#define SLEW_Q15 328         // 0.01 per tick
#define SUPPLY_SHIFT 3u      // time constant of the supply filter, run every third tick: 24 ms
#define CURRENT_SHIFT 4u     // of the current filter: 48 ms

// Trim per blow.
#define STEP_UP_MV 100
#define STEP_FAST_MV 250
#define STEP_DOWN_MV 60
#define CURRENT_DEAD_A_Q9 1536  // method 2: dead band of 3 A around the setpoint
#define CURRENT_STEP_SHIFT 4u   // 32 mV per A beyond it: stable with 3 A/V of the tool, lag 3 blows
#define SEEK_SHIFT 1u           // valleys of twice the limit: out of step

// In step the periods deviate from their mean by 4 % at most, out of step by 6 to 30 %, or lugs
// pass without a valley. Within the band the hammer falls out of step in a range of 0.3 to 0.5 V
// that depends on the load; the level moves across it.
#define IRREGULAR_SHIFT 4u   // a period off its mean by more than a sixteenth, method 2: an eighth
#define IRREGULAR_BLOWS 10u  // more irregular than regular blows: out of step
#define CROSS_MV 900
#define SETTLE_BLOWS 16u  // after it, until the mean deviation is that of the new level

// Computations that alternate from tick to tick.
typedef enum { TURN_FOLLOW, TURN_LEVEL, TURN_APPROACH } Turn;

void sync_start(Sync *self, const SyncSetpoints *set) {
    (void)set;
    CLEAR(self);
    self->state = SYNC_PLAIN;
}

// Low-pass filters of supply and current.
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
    const int16_t half = (int16_t)((in->current_a_q9 >> 1) -
                                   (self->current_a_q9 >> 1));  // difference of two int16_t
    self->current_a_q9 = (int16_t)(self->current_a_q9 + (half >> (CURRENT_SHIFT - 1u)));
}

// value * share / 2^15 with bit 0 cleared: the high word of a product costs nothing, a shift by 15
// is a loop.
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

static int16_t least_mv(const SyncSetpoints *set) {
    return (int16_t)(set->low_mv - LEVEL_BELOW_MV);
}

static int16_t most_mv(const SyncSetpoints *set) {
    return (int16_t)(set->high_mv + LEVEL_ABOVE_MV);
}

// Whether the blows were irregular for so long that the level moves across to another range. Counts
// the last blow.
static bool crosses(Sync *self, const SyncSetpoints *set, const Blow *blow) {
    const uint16_t by_speed_q7 = blow->mean_period_q7 >> IRREGULAR_SHIFT;
    const uint16_t most_q7 =
        (uint8_t)set->method == CONTROLLER_METHOD_SPEED ? by_speed_q7 : 2u * by_speed_q7;
    const uint16_t off_q7 = (uint16_t)((blow->period_q4 << 3) - blow->mean_period_q7);
    const bool off = (uint16_t)(off_q7 + most_q7) > 2u * most_q7;
    const bool irregular = self->lug_missed || off;
    self->lug_missed = false;
    if (self->settle_blows > 0u) {
        self->settle_blows--;
    } else if (irregular) {
        self->irregular_blows++;
    } else if (self->irregular_blows > 0u) {
        self->irregular_blows--;
    }
    if (self->irregular_blows < IRREGULAR_BLOWS) {
        return false;
    }
    self->irregular_blows = 0;
    self->settle_blows = SETTLE_BLOWS;
    return true;
}

// Moves the level across the range that is out of step: upwards until the bridge is fully on or the
// band ends, then downwards from the voltage that there is.
static void cross(Sync *self, const SyncSetpoints *set) {
    const int16_t supply_mv = (int16_t)(self->supply_mv_q1 >> 1);
    const int16_t given_mv = self->level_mv < supply_mv ? self->level_mv : supply_mv;
    const bool ends = self->falls ? self->level_mv <= least_mv(set)
                                  : self->level_mv >= most_mv(set) || self->goal_q15 == INT16_MAX;
    self->falls = self->falls != ends;
    self->trim_mv =
        (int16_t)(given_mv - self->level_mv + self->trim_mv + (self->falls ? -CROSS_MV : CROSS_MV));
    self->crossed = true;
}

// Trims the level by the last blow.
static void trim(Sync *self, const SyncSetpoints *set, const Blow *blow) {
    const int16_t deep = part_of(blow->base_rpm, set->depth_max_q15);
    const bool out_of_step = blow->ripple_rpm >> SEEK_SHIFT > deep;
    const int16_t by_depth =
        trim_by_depth(blow->ripple_rpm, deep, part_of(blow->base_rpm, set->depth_min_q15));
    const int16_t by_method =
        (uint8_t)set->method == CONTROLLER_METHOD_SPEED ? by_depth : trim_by_current(self, set);
    if (crosses(self, set, blow)) {
        cross(self, set);
        self->state = SYNC_SEEK;
        return;
    }
    const int16_t step = out_of_step ? STEP_FAST_MV : self->crossed ? 0 : by_method;
    if (step < 0 || self->goal_q15 < INT16_MAX) {         // at full duty the level cannot rise
        self->trim_mv = (int16_t)(self->trim_mv + step);  // set_level limits it
    }
    self->state = out_of_step || self->settle_blows > 0u ? SYNC_SEEK : SYNC_HOLD;
}

// Limits the trim by the limits of the level.
static void set_level(Sync *self, const SyncSetpoints *set, int16_t travel_q15) {
    const int16_t base = base_mv(set, travel_q15);
    const int16_t least = (int16_t)(least_mv(set) - base), most = (int16_t)(most_mv(set) - base);
    const int16_t not_below_mv = self->trim_mv < least ? least : self->trim_mv;
    self->trim_mv =
        not_below_mv < most ? not_below_mv : most;  // the upper limit holds if they cross
    self->level_mv = (int16_t)(base + self->trim_mv);
}

// Duty of the level, by steps that leave a sixth of the error or less: 3/2 approximates 2^15 over
// the supply voltage in mV and saves a division.
static void approach(Sync *self) {
    const int16_t given_mv =
        (int16_t)(uint16_t)(((uint32_t)(uint16_t)self->goal_q15 * self->supply_mv_q1) >> 16);
    const int16_t off_mv = slew_towards(0, (int16_t)(self->level_mv - given_mv), OFF_MAX_MV);
    const int16_t more_q15 = (int16_t)(off_mv + (off_mv >> 1));
    self->goal_q15 =
        more_q15 > INT16_MAX - self->goal_q15 ? INT16_MAX : (int16_t)(self->goal_q15 + more_q15);
    self->goal_q15 = self->goal_q15 < 0 ? 0 : self->goal_q15;
}

static void engage(Sync *self, const SyncSetpoints *set, int16_t travel_q15) {
    self->state = SYNC_HOLD;
    self->turn = TURN_FOLLOW;
    self->blow_pending = false;
    self->irregular_blows = 0;
    self->settle_blows = SETTLE_BLOWS;
    self->current_a_q9 = set->current_a_q9;  // the filtered current is that of the run-up
    self->goal_q15 = self->duty_q15;
    set_level(self, set, travel_q15);
}

// One computation per tick, none while the blow detection computes. The one for a blow comes first:
// the time from the blow to the change of state then does not depend on what else is due.
static void take_turn(Sync *self, const SyncSetpoints *set, const ControllerInputs *in,
                      const Blow *blow) {
    if (self->blow_pending) {
        trim(self, set, blow);
        self->blow_pending = false;
        self->turn = TURN_LEVEL;
        return;
    }
    switch ((Turn)self->turn) {
    case TURN_FOLLOW:
        follow(self, in);
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
    self->blow_pending = self->blow_pending || blow->lugs > 0u;
    self->lug_missed = self->lug_missed || blow->lugs > 1u;
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
    if (blow->impacting && in->travel_q15 >= TRAVEL_MIN_Q15) {
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
