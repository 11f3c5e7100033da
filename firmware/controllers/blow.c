// Blow detection, see blow.h.
#include "controllers/blow.h"

#include <string.h>

#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"

#define ANGLE_MAX 28000              // about ten lugs: sums with another angle fit
#define ANGLE_NEVER INT16_MAX        // beyond ANGLE_MAX: no blow to count ahead from
#define ANGLE_AHEAD (INT16_MAX - 1)  // as well: it is counted already
#define ANGLE_PER_TURN_Q7                                                                          \
    469u  // of 1/256 turn: 60,000 ms/min, less 6 bits of the angle and 8 of turn_q8, is 3.66
#define FLOOR_RPM                                                                                  \
    27  // hysteresis at least: below what the smallest blows leave, above what edges and counts do
#define RIPPLE_START_RPM                                                                           \
    2000  // hysteresis of 500 rpm: the first climb leaves more, what the run-up to it leaves is
          // less
#define SINCE_MAX_MS 252u  // longer is as long: fits in Q4, and is a time to forget
#define PAUSE_MS 160u      // no hit for that long: impacts have ended
#define FORGET_MASK_MS                                                                             \
    3u  // no valley for more than a lug and a half: the learned ripple, too large by now, is halved
        // every 4 ms
#define EVEN_SHIFT                                                                                 \
    4u  // ripple below 1/16 of the speed: the hammer swings once a lug, and a second valley is a
        // notch
#define UNEVEN_SHIFT                                                                               \
    3u  // ripple above 1/8 of the speed: out of step, a valley may stand for two lugs
#define RIPPLE_SHIFT 2u  // memory of the ripple: 4 hits
#define MEAN_SHIFT 3u    // memory of angle and period: 8 blows
#define BASE_SHIFT                                                                                 \
    4u  // of the speed that the signal is counted from: 16 ms; a run-up hides no valley
#define LUGS_FIRST                                                                                 \
    2u  // a first contact leaves no valley of its own: the first one is that of the swing after it
#define LUGS_MAX 8u
#define SPEED_MAX_RPM 16383  // as far as the Hall speed goes: differences fit
#define SEEN_MAX 3u
#define THIRD_RPM 600  // above half of what a second swing needs: a third one
typedef enum { WORK_NONE, WORK_NEXT, WORK_SET, WORK_HIT, WORK_LEARN } Work;

static uint8_t one_more(uint8_t ms) {
    return ms < SINCE_MAX_MS ? (uint8_t)(ms + 1u) : ms;
}

// What follows from the ripple. Even: the hammer swings once a lug, there are no repeats, and a
// second valley is the notch of the blow.
INLINE_NEVER static void set_ripple(Blow *self, int16_t ripple_rpm) {
    self->ripple_rpm = ripple_rpm;
    self->even = ripple_rpm < self->speed_rpm >> EVEN_SHIFT;
    const int16_t share = (int16_t)(ripple_rpm >> (self->even ? 1 : 2));
    self->hysteresis_rpm = share > FLOOR_RPM ? share : FLOOR_RPM;
}

void blow_start(Blow *self, const BlowSetpoints *set) {
    (void)set;
    (void)memset(self, 0, sizeof *self);
    self->since_hit_ms = PAUSE_MS;
    self->rising = true;
    self->ahead_angle = ANGLE_NEVER;
    set_ripple(self, RIPPLE_START_RPM);
    self->work = WORK_NEXT;
}

// Nearer than 0.66 to a blow the next lug cannot have been reached; nor is there another hit while
// the hammer swings evenly.
INLINE_NEVER static void set_angle(Blow *self, int16_t mean) {
    self->mean_angle = mean;
    self->blow_angle = (int16_t)((mean >> 1) + (mean >> 3) + (mean >> 5));
}

static void take_setpoints(Blow *self, const BlowSetpoints *set) {
    self->lug_angle = (int16_t)(((uint32_t)set->turn_q8 * ANGLE_PER_TURN_Q7) >> 7);
    set_angle(self, (int16_t)(self->lug_angle + (self->lug_angle >> 3)));  // the joint's own turn
    self->again_rpm =
        (int16_t)(2 * self->lug_angle + (self->lug_angle >> 4));  // 31 ms: an angle is rpm ms / 64
    self->rpm_per_mv_q15 =
        (uint16_t)(((uint32_t)set->motor_rpm_per_v * 16777u) >> 8);  // 2 * 2^15 / 1000
    const uint32_t per_a =
        ((uint32_t)set->motor_mohm * self->rpm_per_mv_q15) >> 9;  // rpm of an ampere, by 2^(16 - 9)
    self->rpm_per_a_q7 = (uint16_t)(per_a > UINT16_MAX ? UINT16_MAX : per_a);
}

// The bus dips with the current, as the speed does. Products whose high word is the result: shifts
// by 16 are moves.
static int16_t speed_by_current(const Blow *self, const ControllerInputs *in) {
    const uint16_t applied_mv =
        (uint16_t)(((uint32_t)(uint16_t)(2u * (uint16_t)in->duty_q15) * in->supply_mv) >> 16);
    const uint16_t idle_rpm = (uint16_t)(((uint32_t)applied_mv * self->rpm_per_mv_q15) >> 16);
    const int16_t drop_rpm = (int16_t)(((int32_t)in->current_a_q9 * self->rpm_per_a_q7) >> 16);
    return (int16_t)fixed_clamp_i32((int32_t)idle_rpm - drop_rpm, 0, SPEED_MAX_RPM);
}

static void count_time(Blow *self) {
    self->since_ms = one_more(self->since_ms);
    self->since_hit_ms = one_more(self->since_hit_ms);
    if ((self->since_hit_ms & FORGET_MASK_MS) == 0u && self->ripple_rpm > 0 &&
        self->angle >= self->mean_angle + (self->mean_angle >> 1)) {
        set_ripple(self, (int16_t)(self->ripple_rpm >> 1));
        self->busy = true;
    }
    if (self->since_hit_ms == PAUSE_MS) {
        self->impacting = false;
        self->ahead_angle = self->ahead_angle == ANGLE_AHEAD
                                ? ANGLE_AHEAD
                                : ANGLE_NEVER;  // is made good at the next blow
        self->seen = 0;
        set_ripple(self, 0);
    }
}

// So far beyond a lug there was another: 0.56, and half a lug while nothing lengthens the way that
// the hammer swings.
static int16_t more_angle(const Blow *self) {
    return (int16_t)((self->mean_angle >> 1) + (self->even ? 0 : self->mean_angle >> 4));
}

// A lug that was passed without a valley counts before the next valley tells it.
static void collect(Blow *self) {
    self->angle =
        (int16_t)(self->angle + (int16_t)((uint16_t)(4u * (uint16_t)self->speed_rpm) >> 8));
    self->angle = self->angle > ANGLE_MAX ? ANGLE_MAX : self->angle;
    if (self->signal_rpm > self->high_rpm) {
        self->high_rpm = self->signal_rpm;
    }
    if (self->angle >= self->ahead_angle) {
        self->ahead_angle = ANGLE_AHEAD;
        self->count++;
    }
}

// Not above what it is while out of step, when one valley may stand for two lugs.
static void learn_angle(Blow *self, int16_t angle) {
    const int16_t off = (int16_t)(angle - self->mean_angle);
    if (off > 0 && self->ripple_rpm > self->speed_rpm >> UNEVEN_SHIFT) {
        return;
    }
    const int16_t mean = (int16_t)(self->mean_angle + (off >> MEAN_SHIFT));
    const int16_t most = (int16_t)(self->lug_angle + (self->lug_angle >> 1));
    set_angle(self, mean < self->lug_angle ? self->lug_angle : mean > most ? most : mean);
}

static void learn_period(Blow *self) {
    if (self->seen == 2u) {
        self->mean_period_q7 = (uint16_t)(self->period_q4 << MEAN_SHIFT);
        self->deviation_q8 = 0;
    }
    const uint16_t mean_q4 = (uint16_t)(self->mean_period_q7 + 4u) >> MEAN_SHIFT;
    const int16_t off_q4 = (int16_t)(self->period_q4 - mean_q4);
    self->mean_period_q7 = (uint16_t)(self->mean_period_q7 + (uint16_t)off_q4);  // an eighth of it
    self->deviation_q8 = (uint16_t)(self->deviation_q8 - (self->deviation_q8 >> MEAN_SHIFT) +
                                    2u * (uint16_t)(off_q4 < 0 ? -off_q4 : off_q4));
    const uint16_t spread_q15 = divide_by_u16(((uint32_t)self->deviation_q8 << 8) << 3, mean_q4);
    self->spread_q15 = (int16_t)(spread_q15 > INT16_MAX ? INT16_MAX : (int16_t)spread_q15);
}

// over / step in sixteenths, at most 15: four bits of a division.
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

// Where within its tick the signal crossed the hysteresis makes the period finer than a tick.
static void close_blow(Blow *self) {
    const uint8_t fraction_q4 = sixteenths(self->over_rpm, self->step_rpm);
    self->count =
        (uint16_t)(self->count + self->lugs - (self->ahead_angle == ANGLE_AHEAD ? 1u : 0u));
    self->ahead_angle = (int16_t)(self->mean_angle + more_angle(self) - self->late_angle);
    self->seen = (uint8_t)(self->seen + (self->seen < SEEN_MAX ? 1u : 0u));
    if (self->lugs <= 2u && self->seen > 1u) {
        const uint16_t since_q4 =
            (uint16_t)((uint16_t)(self->since_ms << 4) + self->last_fraction_q4 - fraction_q4);
        self->period_q4 = self->lugs == 2u ? since_q4 >> 1 : since_q4;
        learn_angle(self, self->lugs == 2u ? self->angle >> 1 : self->angle);
        self->work = WORK_LEARN;
    }
    self->last_fraction_q4 = fraction_q4;
    self->angle = 0;
    self->since_ms = 0;
}

static void learn_ripple(Blow *self) {
    const int16_t ripple =
        (int16_t)(self->high_rpm -
                  self->extreme_rpm);  // the fall: a run-up between two valleys is none
    const int16_t known = self->ripple_rpm;
    self->high_rpm = self->signal_rpm;
    if (self->seen == 0u) {
        set_ripple(self, 0);  // what was before it is the run-up
    } else {
        set_ripple(self,
                   known == 0 ? ripple : (int16_t)(known + ((ripple - known) >> RIPPLE_SHIFT)));
    }
}

// Lugs that the angle stands for. What is over, or short of it, goes by three eighths to the next
// one: out of step, blows come at 0.7 and 1.3 in turn.
static uint8_t lugs_of(Blow *self) {
    if (self->seen == 0u) {
        self->late_angle = 0;
        return LUGS_FIRST;
    }
    int16_t left = (int16_t)(self->angle + self->late_angle);
    int16_t reach = self->blow_angle;
    uint8_t lugs = 0;
    while (left >= reach && lugs < LUGS_MAX) {
        left = (int16_t)(left - self->mean_angle);
        reach = more_angle(self);
        lugs++;
    }
    if (lugs > 0u) {
        self->late_angle = (int16_t)((left >> 1) - (left >> 3));
    }
    return lugs;
}

// The hammer's swing takes its time: when from lug to lug, at the mean speed, takes longer than 31
// ms it comes down on the same lug once more, and at 50 ms a third time. Whether that leaves a
// valley of its own depends on the joint.
static uint8_t repeats_of(const Blow *self) {
    if (self->base_rpm >= self->again_rpm || self->seen == 0u) {
        return 0;
    }
    return self->seen == SEEN_MAX && self->base_rpm < (self->again_rpm >> 1) + THIRD_RPM ? 2 : 1;
}

static void judge(Blow *self) {
    self->lugs = lugs_of(self);
    self->impacting = self->seen > 0u;
    if (self->lugs > 0u) {
        self->repeats = repeats_of(self);
        close_blow(self);
    }
    self->hit_angle = self->angle;
}

// What takes its time: after a start what the setpoints come to, after a valley what it was, and
// what follows from that.
INLINE_NEVER static void work(Blow *self, const BlowSetpoints *set) {
    const Work now = (Work)self->work;
    self->work = now == WORK_NEXT ? WORK_SET : WORK_NONE;
    if (now == WORK_SET) {
        take_setpoints(self, set);
    } else if (now == WORK_HIT) {
        judge(self);
    } else if (now == WORK_LEARN) {
        learn_period(self);
    }
}

static void valley(Blow *self, int16_t last_rpm) {
    const int16_t dead = (int16_t)(self->even ? self->blow_angle : self->mean_angle >> 2);
    if (self->seen > 0u && self->angle - self->hit_angle < dead) {
        return;
    }
    self->over_rpm = (uint16_t)(self->signal_rpm - self->extreme_rpm - self->hysteresis_rpm);
    self->step_rpm = (uint16_t)(self->signal_rpm - last_rpm);
    learn_ripple(self);
    self->since_hit_ms = 0;
    self->busy = true;
    self->work = WORK_HIT;
}

static void sense(Blow *self, const BlowSetpoints *set, const ControllerInputs *in) {
    const bool first = self->base_rpm == 0;  // a drive that resumes begins with a speed
    if ((uint8_t)set->source == BLOW_SOURCE_SPEED) {
        self->speed_rpm = in->speed_rpm_q1 < 0 ? 0 : in->speed_rpm_q1 >> 1;
    } else if (!in->coasted) {  // smoothed against the noise of its samples
        const int16_t now = speed_by_current(self, in);
        self->speed_rpm = first ? now : (int16_t)((self->speed_rpm + now) >> 1);
    }
    if (first) {
        self->base_rpm = self->speed_rpm;
    }
    self->base_rpm = (int16_t)(self->base_rpm + ((self->speed_rpm - self->base_rpm) >> BASE_SHIFT));
    self->signal_rpm = (int16_t)(self->speed_rpm - self->base_rpm);
}

// A valley of the signal ends.
static bool turns_up(Blow *self) {
    const int16_t x = self->signal_rpm;
    if (self->rising ? x > self->extreme_rpm : x < self->extreme_rpm) {
        self->extreme_rpm = x;
        return false;
    }
    const int16_t back = (int16_t)(self->rising ? self->extreme_rpm - x : x - self->extreme_rpm);
    if (back <= self->hysteresis_rpm) {
        return false;
    }
    self->rising = !self->rising;
    return self->rising;
}

void blow_step(Blow *self, const BlowSetpoints *set, const ControllerInputs *in) {
    BY_POINTER(self);
    self->lugs = 0;
    self->busy = self->work != (uint8_t)WORK_NONE;
    work(self, set);
    count_time(self);
    const int16_t last_rpm = self->signal_rpm;
    const bool rising = self->rising;
    sense(self, set, in);
    collect(self);
    if (turns_up(self)) {
        valley(self, last_rpm);
    }
    if (self->rising != rising) {
        self->extreme_rpm = self->signal_rpm;
    }
}
