// Blow detection, see blow.h.
#include "controllers/blow.h"

#include <string.h>

#include "core/divide.h"
#include "core/fixed.h"

#define ANGLE_SHIFT 4u            // speed per tick, Q1, is summed in sixteenths
#define ANGLE_PER_TURN_Q4 469u    // of 1/256 turn: 60,000 ms/min Q1, less 4 bits of ANGLE_SHIFT and 8 of turn_q8, is 29.3
#define TURN_PER_ANGLE_Q16 2237u  // 2^16 over 29.3
#define FLOOR_RPM_Q1 60           // hysteresis at least, 30 rpm: below what the smallest blows leave, above what edges and counts do
#define PAUSE_MS 160u             // no hit for that long: impacts have ended
#define FORGET_MASK_MS 7u         // no valley for more than two lugs: the learned ripple, too large by now, is halved every 8 ms
#define EVEN_SHIFT 4u             // ripple below 1/16 of the speed: the hammer swings once a lug, and a second valley is a notch
#define MEMORY_SHIFT 2u           // of the ripple: 4 hits
#define SUPPLY_SHIFT 5u           // of the supply: 32 ms
#define BASE_SHIFT 4u             // of the speed that the signal is counted from: 16 ms; a run-up hides no valley
#define OFF_MAX_Q4 4095u          // from the mean period
#define SINCE_MAX_MS 4000u        // longer is as long: fits in Q4
#define SIGNAL_MAX_RPM_Q1 16383   // differences of two fit
// Shares of the angle from lug to lug.
#define SHARE_DEAD_Q8 72u     // 0.28 after a hit nothing counts
#define SHARE_EVEN_Q8 184u    // 0.72 while the hammer swings evenly
#define SHARE_REPEAT_Q8 159u  // 0.62 after a blow the next lug cannot have been reached
#define SHARE_TWO_Q8 166u     // 0.65 beyond one lug there must have been another
#define SHARE_LATE_Q8 38u     // 0.15 beyond a lug a blow was late: the next one may come as much earlier

typedef enum { WORK_NONE, WORK_NEXT, WORK_ANGLES, WORK_GAINS, WORK_MEASURE, WORK_LEARN } Work;

static uint16_t share_of(uint16_t value, uint8_t share_q8) {
    return (uint16_t)(((uint32_t)value * share_q8) >> 8);
}

static uint16_t one_more(uint16_t count) {
    return count < UINT16_MAX ? (uint16_t)(count + 1u) : count;
}

void blow_start(Blow *self, const BlowSetpoints *set) {
    (void)set;
    (void)memset(self, 0, sizeof *self);
    self->since_ms = UINT16_MAX;
    self->since_hit_ms = PAUSE_MS - 1u;
    self->rising = true;
    self->work = WORK_NEXT;
}

static void set_angles(Blow *self, const BlowSetpoints *set) {
    const uint16_t lug = (uint16_t)(((uint32_t)set->turn_q8 * ANGLE_PER_TURN_Q4) >> 4);
    self->dead_angle = share_of(lug, SHARE_DEAD_Q8);
    self->even_angle = share_of(lug, SHARE_EVEN_Q8);
    self->repeat_angle = share_of(lug, SHARE_REPEAT_Q8);
    self->late_from_angle = (uint16_t)(lug + share_of(lug, SHARE_LATE_Q8));
    const uint32_t two = (uint32_t)lug + share_of(lug, SHARE_TWO_Q8);
    self->two_angle = (uint16_t)(two > UINT16_MAX ? UINT16_MAX : two);
    self->forget_angle = (uint16_t)(lug > UINT16_MAX / 3u ? UINT16_MAX : 2u * lug + (lug >> 2));
}

static void set_gains(Blow *self, const BlowSetpoints *set) {
    self->rpm_per_mv_q15 = (uint16_t)(((uint32_t)set->motor_rpm_per_v * 16777u) >> 8);  // 2 (Q1) * 2^15 / 1000
    const uint32_t per_a = ((uint32_t)set->motor_mohm * self->rpm_per_mv_q15) >> 8;     // Q1 rpm of an ampere, by 2^(16 - 9)
    self->rpm_per_a_q7 = (uint16_t)(per_a > UINT16_MAX ? UINT16_MAX : per_a);
}

// Slow: its ripple goes with that of the current and would only take a part of it away.
static void follow_supply(Blow *self, uint16_t supply_mv) {
    const uint16_t now = (uint16_t)(supply_mv > INT16_MAX ? UINT16_MAX - 1u : 2u * supply_mv);
    if (self->supply_mv_q1 == 0u) {
        self->supply_mv_q1 = now;
    } else if (now >= self->supply_mv_q1) {
        self->supply_mv_q1 = (uint16_t)(self->supply_mv_q1 + ((now - self->supply_mv_q1) >> SUPPLY_SHIFT));
    } else {
        self->supply_mv_q1 = (uint16_t)(self->supply_mv_q1 - ((self->supply_mv_q1 - now) >> SUPPLY_SHIFT));
    }
}

// Products whose high word is the result: shifts by 16 are moves.
static int16_t speed_by_current(Blow *self, const ControllerInputs *in) {
    follow_supply(self, in->supply_mv);
    const uint16_t applied_mv = (uint16_t)(((uint32_t)(uint16_t)in->duty_q15 * self->supply_mv_q1) >> 16);
    const uint16_t half_rpm_q1 = (uint16_t)(((uint32_t)applied_mv * self->rpm_per_mv_q15) >> 16);
    const int16_t drop_rpm_q1 = (int16_t)(((int32_t)in->current_a_q9 * self->rpm_per_a_q7) >> 16);
    return (int16_t)fixed_clamp_i32((int32_t)half_rpm_q1 + half_rpm_q1 - drop_rpm_q1, 0, INT16_MAX);
}

// What follows from the ripple. Even: the hammer swings once a lug, there are no repeats, and a second valley is the notch of the blow.
static void set_ripple(Blow *self, int16_t ripple_rpm_q1) {
    self->ripple_rpm_q1 = ripple_rpm_q1;
    self->even = ripple_rpm_q1 < self->speed_rpm_q1 >> EVEN_SHIFT;
    const int16_t share = (int16_t)(ripple_rpm_q1 >> (self->even ? 1 : 2));
    self->hysteresis_rpm_q1 = share > FLOOR_RPM_Q1 ? share : FLOOR_RPM_Q1;
}

static void count_time(Blow *self) {
    self->since_ms = one_more(self->since_ms);
    self->since_hit_ms = one_more(self->since_hit_ms);
    if (self->since_hit_ms < PAUSE_MS) {
        if ((self->since_hit_ms & FORGET_MASK_MS) == 0u && self->angle >= self->forget_angle) {
            set_ripple(self, (int16_t)(self->ripple_rpm_q1 >> 1));
        }
        return;
    }
    if (self->since_hit_ms > PAUSE_MS) {
        return;  // it is told already
    }
    self->impacting = false;
    self->blows_seen = 0;
    self->late_angle = 0;
    set_ripple(self, 0);
}

static void collect(Blow *self) {
    const uint16_t more = (uint16_t)(self->angle + ((uint16_t)self->speed_rpm_q1 >> ANGLE_SHIFT));
    self->angle = more < self->angle ? UINT16_MAX : more;
    if (self->signal_rpm_q1 > self->high_rpm_q1) {
        self->high_rpm_q1 = self->signal_rpm_q1;
    }
}

static void learn_period(Blow *self) {
    if (self->blows_seen < 2u) {
        return;
    }
    if (self->blows_seen == 2u) {
        self->mean_period_q4 = self->period_q4;
        self->deviation_q8 = 0;
    }
    const bool shorter = self->period_q4 < self->mean_period_q4;
    const uint16_t apart_q4 = (uint16_t)(shorter ? self->mean_period_q4 - self->period_q4 : self->period_q4 - self->mean_period_q4);
    const int16_t size_q4 = (int16_t)(apart_q4 > OFF_MAX_Q4 ? OFF_MAX_Q4 : apart_q4);
    const int16_t off_q4 = (int16_t)(shorter ? -size_q4 : size_q4);
    self->mean_period_q4 = (uint16_t)(self->mean_period_q4 + (uint16_t)((off_q4 + 4) >> 3));
    self->deviation_q8 = (uint16_t)(self->deviation_q8 - (self->deviation_q8 >> 3) + 2u * (uint16_t)size_q4);  // an eighth
    const uint16_t spread_q15 = divide_u16(((uint32_t)self->deviation_q8 << 8) << 3, self->mean_period_q4);
    self->spread_q15 = (int16_t)(spread_q15 > INT16_MAX ? INT16_MAX : (int16_t)spread_q15);
}

// over / step in sixteenths, less than 1: four bits of a division.
static uint8_t sixteenths(uint16_t over, uint16_t step) {
    uint8_t result = 0;
    for (uint8_t bit = 8; bit > 0u; bit >>= 1) {
        over = (uint16_t)(over << 1);
        if (over >= step) {
            over = (uint16_t)(over - step);
            result |= bit;
        }
    }
    return result;
}

// Over the time since the blow before; where within its tick the signal crossed the hysteresis makes the period finer than a tick.
static void measure_blow(Blow *self) {
    const uint8_t fraction_q4 = self->step_rpm_q1 > self->over_rpm_q1 ? sixteenths(self->over_rpm_q1, self->step_rpm_q1) : 15u;
    const uint16_t since_q4 = (uint16_t)((uint16_t)(self->last_ms << 4) + self->last_fraction_q4 - fraction_q4);
    const uint16_t turn_q8 = (uint16_t)(((uint32_t)self->last_angle * TURN_PER_ANGLE_Q16) >> 16);
    self->last_fraction_q4 = fraction_q4;
    self->period_q4 = self->last_lugs == 2u ? (uint16_t)(since_q4 >> 1) : since_q4;
    self->turn_q8 = self->last_lugs == 2u ? (uint16_t)(turn_q8 >> 1) : turn_q8;
    self->speed_mean_rpm_q1 = (int16_t)divide_u16((uint32_t)self->last_angle << ANGLE_SHIFT, self->last_ms);
}

// What takes its time comes one piece a tick: after a start what the setpoints come to, after a blow what it was.
static void work(Blow *self, const BlowSetpoints *set) {
    switch ((Work)self->work) {
    case WORK_NONE:
        return;
    case WORK_NEXT:
        self->work = WORK_ANGLES;
        return;
    case WORK_ANGLES:
        set_angles(self, set);
        self->work = WORK_GAINS;
        return;
    case WORK_GAINS:
        set_gains(self, set);
        break;
    case WORK_MEASURE:
        measure_blow(self);
        self->work = WORK_LEARN;
        return;
    case WORK_LEARN:
        learn_period(self);
        break;
    }
    self->work = WORK_NONE;
}

static void close_blow(Blow *self, uint8_t lugs) {
    self->count = (uint16_t)(self->count + lugs);
    self->blows_seen = (uint8_t)(self->blows_seen + (self->blows_seen < UINT8_MAX ? 1u : 0u));
    const bool late = lugs == 1u && self->blows_seen > 2u && self->angle > self->late_from_angle;
    self->late_angle = late ? (uint16_t)(self->angle - self->late_from_angle) : 0u;
    self->last_angle = self->angle;
    self->last_lugs = lugs;
    self->last_ms = self->since_ms < SINCE_MAX_MS ? self->since_ms : SINCE_MAX_MS;
    self->work = WORK_MEASURE;
    self->angle = 0;
    self->since_ms = 0;
}

static void hit(Blow *self) {
    const int16_t ripple = (int16_t)(self->high_rpm_q1 - self->extreme_rpm_q1);  // the fall: a run-up between two valleys is none
    if (self->blows_seen == 0u) {
        set_ripple(self, 0);  // what was before it is the run-up
    } else if (self->ripple_rpm_q1 == 0) {
        set_ripple(self, ripple);
    } else {
        set_ripple(self, (int16_t)(self->ripple_rpm_q1 + ((ripple - self->ripple_rpm_q1) >> MEMORY_SHIFT)));
    }
    self->high_rpm_q1 = self->signal_rpm_q1;
    self->struck = true;
    self->busy = true;
    self->since_hit_ms = 0;
}

// Lugs that the angle stands for; after a pause the first blow is one.
static uint8_t lugs_of(const Blow *self) {
    if (self->blows_seen == 0u) {
        return 1;
    }
    if (self->angle < self->repeat_angle && self->angle + (uint32_t)self->late_angle < self->repeat_angle) {
        return 0;
    }
    return self->angle >= self->two_angle && self->blows_seen > 2u ? 2 : 1;
}

static void valley(Blow *self, int16_t last_rpm_q1) {
    const uint16_t dead = self->even ? self->even_angle : self->dead_angle;
    if (self->blows_seen > 0u && (uint16_t)(self->angle - self->hit_angle) < dead) {
        return;
    }
    const int16_t over = (int16_t)(self->signal_rpm_q1 - self->extreme_rpm_q1 - self->hysteresis_rpm_q1);
    const int16_t step = (int16_t)(self->signal_rpm_q1 - last_rpm_q1);
    self->over_rpm_q1 = (uint16_t)over;
    self->step_rpm_q1 = (uint16_t)(step < 0 ? 0 : step);
    hit(self);
    self->lugs = lugs_of(self);
    self->repeat = self->lugs == 0u;
    self->impacting = self->blows_seen > 0u;
    if (self->repeat) {
        self->repeats++;
    } else {
        close_blow(self, self->lugs);
    }
    self->hit_angle = self->angle;
}

// What the speed was lately, so that a run-up hides no valley.
static void follow_speed(Blow *self) {
    const uint16_t now_q2 = (uint16_t)(2u * (uint16_t)self->speed_rpm_q1);
    if (now_q2 >= self->base_rpm_q2) {
        self->base_rpm_q2 = (uint16_t)(self->base_rpm_q2 + ((uint16_t)(now_q2 - self->base_rpm_q2) >> BASE_SHIFT));
    } else {
        self->base_rpm_q2 = (uint16_t)(self->base_rpm_q2 - ((uint16_t)(self->base_rpm_q2 - now_q2) >> BASE_SHIFT));
    }
}

static void sense(Blow *self, const BlowSetpoints *set, const ControllerInputs *in) {
    const bool first = self->base_rpm_q2 == 0u;  // a drive that resumes begins with a speed
    if ((uint8_t)set->source == BLOW_SOURCE_SPEED) {
        self->speed_rpm_q1 = in->speed_rpm_q1 < 0 ? 0 : in->speed_rpm_q1;
    } else if (!in->coasted) {  // smoothed against the noise of its samples
        const int16_t now = speed_by_current(self, in);
        self->speed_rpm_q1 = first ? now : (int16_t)((uint16_t)((uint16_t)self->speed_rpm_q1 + (uint16_t)now) >> 1);
    }
    if (first) {
        self->base_rpm_q2 = (uint16_t)(2u * (uint16_t)self->speed_rpm_q1);
    }
    follow_speed(self);
    const int16_t left = (int16_t)(self->speed_rpm_q1 - (int16_t)(self->base_rpm_q2 >> 1));
    self->signal_rpm_q1 = left > SIGNAL_MAX_RPM_Q1 ? SIGNAL_MAX_RPM_Q1 : left;
    self->signal_rpm_q1 = left < -SIGNAL_MAX_RPM_Q1 ? -SIGNAL_MAX_RPM_Q1 : self->signal_rpm_q1;
}

// A valley of the signal ends.
static bool turns_up(Blow *self) {
    const int16_t x = self->signal_rpm_q1;
    if (self->rising ? x > self->extreme_rpm_q1 : x < self->extreme_rpm_q1) {
        self->extreme_rpm_q1 = x;
        return false;
    }
    const int16_t back = (int16_t)(self->rising ? self->extreme_rpm_q1 - x : x - self->extreme_rpm_q1);
    if (back <= self->hysteresis_rpm_q1) {
        return false;
    }
    self->rising = !self->rising;
    return self->rising;
}

void blow_step(Blow *self, const BlowSetpoints *set, const ControllerInputs *in) {
    self->struck = false;
    self->repeat = false;
    self->lugs = 0;
    self->busy = self->work != (uint8_t)WORK_NONE;
    work(self, set);
    count_time(self);
    const int16_t last = self->signal_rpm_q1;
    const bool rising = self->rising;
    sense(self, set, in);
    collect(self);
    if (turns_up(self)) {
        valley(self, last);
    }
    if (self->rising != rising) {
        self->extreme_rpm_q1 = self->signal_rpm_q1;
    }
}
