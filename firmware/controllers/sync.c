// Synchronisation, see sync.h.
#include "controllers/sync.h"

#include "core/divide.h"
#include "core/fixed.h"
#include "core/slew.h"

#define TRAVEL_LEAST_Q15 9830  // 0.3: below it the trigger itself is the duty, for starting a screw
#define LEVEL_MIN_MV 13400
#define LEVEL_MAX_MV 16600
#define SLEW_Q15 328      // 0.01 a tick
#define RENEW_TICKS 8u    // between two computations of the duty
#define SUPPLY_SHIFT 5u   // 32 ms
#define CURRENT_SHIFT 6u  // 64 ms
#define STEP_UP_MV 100    // a blow
#define STEP_FAST_MV 250
#define STEP_DOWN_MV 60
#define CURRENT_DEAD_A_Q9 1536  // 3 A
#define CURRENT_A_Q9_PER_MV 16  // 32 mV a blow for each A beyond: with 3 A/V and three blows of lag far from swinging
#define SEEK_FACTOR 2           // dips of so many times the limit: out of step

void sync_start(Sync *self, const SyncSetpoints *set) {
    (void)set;
    *self = (Sync){.state = SYNC_PLAIN};
}

static void follow(Sync *self, const ControllerInputs *in) {
    const uint16_t now = (uint16_t)(in->supply_mv > INT16_MAX ? UINT16_MAX - 1u : 2u * in->supply_mv);
    if (self->supply_mv_q1 == 0u) {
        self->supply_mv_q1 = now;
    } else if (now >= self->supply_mv_q1) {
        self->supply_mv_q1 = (uint16_t)(self->supply_mv_q1 + ((uint16_t)(now - self->supply_mv_q1) >> SUPPLY_SHIFT));
    } else {
        self->supply_mv_q1 = (uint16_t)(self->supply_mv_q1 - ((uint16_t)(self->supply_mv_q1 - now) >> SUPPLY_SHIFT));
    }
    self->current_q9_q8 += (((int32_t)in->current_a_q9 << 8) - self->current_q9_q8) >> CURRENT_SHIFT;
}

// Whether the dips are deeper than a share of the speed.
static bool deeper(const Blow *blow, int16_t share_q15) {
    return ((int32_t)blow->ripple_rpm_q1 << 15) > (int32_t)blow->speed_mean_rpm_q1 * share_q15;
}

static int16_t trim_by_depth(const SyncSetpoints *set, const Blow *blow) {
    if (deeper(blow, (int16_t)(SEEK_FACTOR * set->depth_max_q15))) {
        return STEP_FAST_MV;
    }
    if (deeper(blow, set->depth_max_q15)) {
        return STEP_UP_MV;
    }
    return deeper(blow, set->depth_min_q15) ? 0 : -STEP_DOWN_MV;
}

static int16_t trim_by_current(const Sync *self, const SyncSetpoints *set, const Blow *blow) {
    if (deeper(blow, (int16_t)(SEEK_FACTOR * set->depth_max_q15))) {
        return STEP_FAST_MV;
    }
    const int32_t off_a_q9 = set->current_a_q9 - (self->current_q9_q8 >> 8);
    const int32_t dead_a_q9 = fixed_clamp_i32(off_a_q9, -CURRENT_DEAD_A_Q9, CURRENT_DEAD_A_Q9);
    return (int16_t)((off_a_q9 - dead_a_q9) / CURRENT_A_Q9_PER_MV);
}

static int16_t base_mv(const SyncSetpoints *set, int16_t travel_q15) {
    return (int16_t)(set->low_mv + (((int32_t)(set->high_mv - set->low_mv) * travel_q15) >> 15));
}

static void trim(Sync *self, const SyncSetpoints *set, const Blow *blow, int16_t base) {
    const int16_t step = set->method == SYNC_METHOD_SPEED ? trim_by_depth(set, blow) : trim_by_current(self, set, blow);
    const bool full = self->goal_q15 == INT16_MAX && step > 0;  // nothing more to be had from this battery
    if (!full) {
        self->trim_mv = (int16_t)fixed_clamp_i32(self->trim_mv + step, LEVEL_MIN_MV - base, LEVEL_MAX_MV - base);
    }
    self->state = step == STEP_FAST_MV ? SYNC_SEEK : SYNC_HOLD;
}

static void renew(Sync *self) {
    const uint16_t duty_q15 = divide_u16((uint32_t)(uint16_t)self->level_mv << 16, self->supply_mv_q1);
    self->goal_q15 = (int16_t)(duty_q15 > INT16_MAX ? INT16_MAX : (int16_t)duty_q15);
    self->ticks = 0;
}

int16_t sync_step(Sync *self, const SyncSetpoints *set, const ControllerInputs *in, const Blow *blow) {
    follow(self, in);
    if (!blow->impacting || in->travel_q15 < TRAVEL_LEAST_Q15) {
        self->state = SYNC_PLAIN;
        self->goal_q15 = in->travel_q15;
        self->ticks = RENEW_TICKS;
    } else {
        const int16_t base = base_mv(set, in->travel_q15);
        if (blow->lugs > 0u) {
            trim(self, set, blow, base);
        }
        self->level_mv = (int16_t)fixed_clamp_i32(base + self->trim_mv, LEVEL_MIN_MV, LEVEL_MAX_MV);
        if (self->state == SYNC_PLAIN) {
            self->state = SYNC_HOLD;
            self->current_q9_q8 = (int32_t)set->current_a_q9 << 8;  // that of the run-up says nothing
        }
        self->ticks++;
        if (self->ticks >= RENEW_TICKS) {
            renew(self);
        }
    }
    const bool plain_rise = self->state == SYNC_PLAIN && self->duty_q15 <= in->travel_q15;
    self->duty_q15 = plain_rise ? in->travel_q15 : slew_towards(self->duty_q15, self->goal_q15, SLEW_Q15);
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
