// Blow detection, see blow.h.
#include "controllers/blow.h"

#include "core/clear.h"
#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"

#define ANGLE_MAX 28000              // about ten lugs; leaves room for a sum with another angle
#define ANGLE_NEVER INT16_MAX        // value of ahead_angle: no blow is counted without a valley
#define ANGLE_AHEAD (INT16_MAX - 1)  // value of ahead_angle: one has been counted without a valley

// Angle (rpm ms / 64) of 1/256 turn: 60,000 ms/min / 2^6 / 2^8 = 3.66.
#define ANGLE_PER_TURN_Q7 469u

// Least hysteresis: below the smallest blows, above the noise of Hall edges and ADC counts.
#define FLOOR_RPM 27

// Ripple assumed at the start, a hysteresis of 500 rpm: the first climb of the hammer exceeds it,
// the run-up does not.
#define RIPPLE_START_RPM 2000

#define SINCE_MAX_MS 252u  // limit of the times since blow and valley: fits in Q4, multiple of 4
#define PAUSE_MS 160u      // without a valley: the impacts have ended

// Mask of a time in ms: the learned ripple is halved every 4 ms while the motor has turned by more
// than 1.5 lugs since the last blow, since it is too large to detect the valleys.
#define FORGET_MASK_MS 3u

// Ripple below 1/16 of the speed: the hammer swings once per lug, a second valley belongs to the
// same blow.
#define EVEN_SHIFT 4u

// Successive angles that differ by less than this share are equal.
#define EQUAL_SHIFT 3u

// A lug takes 2^4 ms at least, all together two less: the plant's blows are 17.2 ms apart or more,
// two periods last 34.5 ms, of which the Hall pitches at the two valleys may take 4.5 ms.
#define BLOW_EARLY_MS 2u
#define BLOW_LEAST_SHIFT 4u

// A joint that turns by 0.4 lugs or more between two blows leaves the hammer 23 to 29 ms.
#define SOFT_MOST_MS 28u

#define RIPPLE_SHIFT 2u    // running mean of the ripple over 4 valleys
#define MEAN_SHIFT 3u      // running mean of angle and period over 8 blows
#define BASE_SHARE_Q8 16u  // base_rpm: mean over 16 ms, so that a run-up hides no valley

// The first contact leaves no valley of its own: the first valley is that of the swing after it.
#define LUGS_FIRST 2u
#define MEANS_LATEST_MS 6u   // after a blow its means are computed
#define SPEED_MAX_RPM 16383  // range of the Hall speed: differences fit in 16 bits

// Repeats of the reference tool, from drawn joints. Besides the speed, the mean current from blow
// to blow decides: a contact takes energy. Speeds are relative to again_rpm.
#define THIRD_RPM 700                    // below half of again_rpm plus this there is a third
#define THIRD_A_Q9 6656                  // landing, if the current is at least 13 A
#define FREE_RPM 468u                    // up to 748 rpm below it the hammer lands beyond the lug
#define FREE_SPAN_RPM (748u - FREE_RPM)  // if the current is below 14 A
#define FREE_A_Q9 7168
#define NEAR_RPM 432  // just above it: from 16 A on, 3.9 mA more per rpm
#define NEAR_A_Q9 8192
#define GRAZE_RPM 1880   // up to here a joint that slips by 1.2 to 4.7 % of a lug lets the hammer
#define GRAZE_A_Q9 8704  // touch the lug again: from 17 A on, 1 mA more per rpm, with a ripple
#define GRAZE_RIPPLE_RPM 850  // plus an eighth of the speed of less than this

// Values of `seen`, a count that saturates.
#define SEEN_NONE 0u
#define SEEN_PERIOD 2u  // the period is known for the first time
#define SEEN_MAX 3u

// Computation of the next tick. After the start: two parts of the setpoints, a tick each. After a
// valley: the blow. After a blow: the means.
typedef enum { WORK_NONE, WORK_STARTED, WORK_FACTORS, WORK_ANGLES, WORK_VALLEY, WORK_MEANS } Work;

static uint8_t one_more(uint8_t ms) {
    return ms < SINCE_MAX_MS ? (uint8_t)(ms + 1u) : ms;
}

// Sets the ripple and what depends on it.
INLINE_NEVER static void set_ripple(Blow *self, int16_t ripple_rpm) {
    self->ripple_rpm = ripple_rpm;
    self->even = ripple_rpm < self->speed_rpm >> EVEN_SHIFT;
    const int16_t share = (int16_t)(ripple_rpm >> (self->even ? 1 : 2));
    self->hysteresis_rpm = share > FLOOR_RPM ? share : FLOOR_RPM;
}

void blow_start(Blow *self, const BlowSetpoints *set) {
    (void)set;
    CLEAR(self);
    self->since_hit_ms = PAUSE_MS;
    self->rising = true;
    self->ahead_angle = ANGLE_NEVER;
    set_ripple(self, RIPPLE_START_RPM);
    self->work = WORK_STARTED;
}

// Sets the learned angle; 0.69 of it is the least from blow to blow.
INLINE_NEVER static void set_angle(Blow *self, int16_t mean) {
    self->mean_angle = mean;
    self->blow_angle = (int16_t)((mean >> 1) + (mean >> 3) + (mean >> 4));
}

static void take_angles(Blow *self, const BlowSetpoints *set) {
    self->lug_angle = (int16_t)(((uint32_t)set->turn_q8 * ANGLE_PER_TURN_Q7) >> 7);
    set_angle(self, (int16_t)(self->lug_angle + (self->lug_angle >> 3)));  // 1/8: joint
    self->again_rpm =
        (int16_t)(2 * self->lug_angle + (self->lug_angle >> 4));  // over 31 ms, rpm ms / 64
}

static void take_factors(Blow *self, const BlowSetpoints *set) {
    self->rpm_per_mv_q15 =
        (uint16_t)(((uint32_t)set->motor_rpm_per_v * 16777u) >> 8);  // 2 * 2^15 / 1000
    const uint32_t per_a =
        ((uint32_t)set->motor_mohm * self->rpm_per_mv_q15) >> 9;  // rpm per A, Q7
    self->rpm_per_a_q7 = (uint16_t)(per_a > UINT16_MAX ? UINT16_MAX : per_a);
}

// (duty Vs - R i) rpm/V, with the measured bus voltage Vs, which falls with the current. Factors
// are scaled so that each result is the high word of a product: a shift by 16 is a move of
// registers.
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
                                : ANGLE_NEVER;  // corrected at the next blow
        self->seen = 0;
        set_ripple(self, 0);
    }
}

// Angle beyond a lug from which one more lug is counted: 0.56 of the mean angle, 0.5 of it while
// the hammer swings once per lug.
static int16_t more_angle(const Blow *self) {
    return (int16_t)((self->mean_angle >> 1) + (self->even ? 0 : self->mean_angle >> 4));
}

// One and a half lugs: the largest angle that is learned, and the least of a first valley that
// belongs to the second lug.
static int16_t most_angle(const Blow *self) {
    return (int16_t)(self->lug_angle + (self->lug_angle >> 1));
}

// Integrates angle and current; a lug passed without a valley is counted before the next valley.
static void collect(Blow *self, int16_t current_a_q9) {
    if (self->since_ms < SINCE_MAX_MS) {  // else the sum would exceed its range
        self->charge_q1 = (int16_t)(self->charge_q1 + (current_a_q9 >> 8));
    }
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

// Difference between the angle of a blow and the mean angle, of which an eighth is added to the
// mean. A larger angle is used only if it follows from the joint's rotation: equal to the last one,
// and within the time of one swing. Out of step, a valley stands for one lug and for two in turn.
static int16_t learnable_angle(Blow *self, int16_t angle) {
    const int16_t off = (int16_t)(angle - self->mean_angle);
    const uint16_t allowed = (uint16_t)self->mean_angle >> EQUAL_SHIFT;
    const uint16_t change = (uint16_t)(self->angle - self->last_angle);
    const bool equal = (uint16_t)(change + allowed) <= (uint16_t)(allowed << 1);
    self->last_angle = self->angle;
    return off > 0 && (!equal || self->since_ms > SOFT_MOST_MS) ? 0 : off;
}

static void learn_angle(Blow *self) {
    const int16_t mean = (int16_t)(self->mean_angle + (self->off_angle >> MEAN_SHIFT));
    const int16_t most = most_angle(self);
    set_angle(self, mean < self->lug_angle ? self->lug_angle : mean > most ? most : mean);
}

static void learn_period(Blow *self) {
    if (self->seen == SEEN_PERIOD) {
        self->mean_period_q7 = (uint16_t)(self->period_q4 << MEAN_SHIFT);
        self->deviation_q8 = 0;
    }
    const uint16_t mean_q4 = (uint16_t)(self->mean_period_q7 + 4u) >> MEAN_SHIFT;
    const int16_t off_q4 = (int16_t)(self->period_q4 - mean_q4);
    self->mean_period_q7 = (uint16_t)(self->mean_period_q7 + (uint16_t)off_q4);  // mean_q4 in Q7
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

// The fraction of the tick at which the signal crossed the hysteresis resolves the period further.
static void close_blow(Blow *self) {
    const uint8_t fraction_q4 = self->fraction_q4;
    self->count =
        (uint16_t)(self->count + self->lugs - (self->ahead_angle == ANGLE_AHEAD ? 1u : 0u));
    self->ahead_angle = (int16_t)(self->mean_angle + more_angle(self) - self->late_angle);
    self->seen = (uint8_t)(self->seen + (self->seen < SEEN_MAX ? 1u : 0u));
    if (self->lugs <= 2u && self->seen > SEEN_PERIOD - 1u) {
        const uint16_t since_q4 =
            (uint16_t)((uint16_t)(self->since_ms << 4) + self->last_fraction_q4 - fraction_q4);
        self->period_q4 = self->lugs == 2u ? since_q4 >> 1 : since_q4;
        self->off_angle = learnable_angle(self, self->lugs == 2u ? self->angle >> 1 : self->angle);
        self->work = WORK_MEANS;
    }
    self->last_fraction_q4 = fraction_q4;
    self->angle = 0;
    self->charge_q1 = 0;
    self->since_ms = 0;
}

static void learn_ripple(Blow *self) {
    const int16_t ripple =
        (int16_t)(self->high_rpm - self->extreme_rpm);  // the fall; excludes a run-up
    const int16_t known = self->ripple_rpm;
    self->high_rpm = self->signal_rpm;
    if (self->seen == SEEN_NONE) {
        set_ripple(self, 0);  // the speeds before it are those of the run-up
    } else {
        set_ripple(self,
                   known == 0 ? ripple : (int16_t)(known + ((ripple - known) >> RIPPLE_SHIFT)));
    }
}

// Lugs that the angle stands for. Three eighths of the remainder are carried to the next blow: out
// of step, the angles alternate between 0.7 and 1.3 lugs.
static uint8_t lugs_of(Blow *self) {
    if (self->seen == SEEN_NONE) {
        self->late_angle = 0;
        const uint16_t past = (uint16_t)(self->angle - most_angle(self));
        return past < (uint16_t)self->lug_angle ? LUGS_FIRST + 1u : LUGS_FIRST;
    }
    int16_t left = (int16_t)(self->angle + self->late_angle);
    int16_t reach = self->blow_angle;
    uint8_t lugs = 0;
    const uint8_t most = (uint8_t)((uint8_t)(self->since_ms + BLOW_EARLY_MS) >> BLOW_LEAST_SHIFT);
    while (left >= reach && (lugs == 0u || lugs < most)) {
        left = (int16_t)(left - self->mean_angle);
        reach = more_angle(self);
        lugs++;
    }
    if (lugs > 0u) {
        self->late_angle = (int16_t)((left >> 1) - (left >> 3));
    }
    return lugs;
}

// Whether the mean current since the last blow is above this.
static bool draws(const Blow *self, uint16_t least_a_q9) {
    const uint16_t least_q1 = (uint16_t)(((uint32_t)least_a_q9 * self->since_ms) >> 8);
    return self->charge_q1 > (int16_t)least_q1;
}

// Whether the hammer touches the lug again at a speed at which its swing alone ends beyond it.
static bool grazes(const Blow *self) {
    const uint16_t over_rpm = (uint16_t)(self->base_rpm - self->again_rpm);
    if (over_rpm < NEAR_RPM) {
        return draws(self, (uint16_t)(NEAR_A_Q9 + 2u * over_rpm));
    }
    const uint16_t slip = (uint16_t)(self->mean_angle - self->lug_angle);
    const uint16_t lug = (uint16_t)self->lug_angle;
    return over_rpm < GRAZE_RPM && slip >= (lug >> 7) + (lug >> 8) &&
           slip < (lug >> 5) + (lug >> 6) &&
           (uint16_t)self->ripple_rpm + (over_rpm >> 3) < GRAZE_RIPPLE_RPM &&
           draws(self, (uint16_t)(GRAZE_A_Q9 + (over_rpm >> 1)));
}

// The hammer's swing lasts about 31 ms: when the motor needs longer than that from lug to lug at
// the mean speed, the hammer lands on the same lug once more, at 51 ms a third time. Whether that
// leaves a valley of its own depends on the joint. The computed speed is too inaccurate for the
// limits of the current.
static uint8_t repeats_of(const Blow *self, const BlowSetpoints *set) {
    if (self->seen == SEEN_NONE) {
        return 0;
    }
    const bool by_time = (uint8_t)set->source == BLOW_SOURCE_CURRENT;
    if (self->base_rpm >= self->again_rpm) {
        return !by_time && grazes(self) ? 1 : 0;
    }
    if (self->base_rpm < (self->again_rpm >> 1) + THIRD_RPM) {
        return self->seen == SEEN_MAX && (by_time || draws(self, THIRD_A_Q9)) ? 2 : 1;
    }
    const uint16_t below_rpm = (uint16_t)(self->again_rpm - self->base_rpm);
    const bool free = (uint16_t)(below_rpm - FREE_RPM) < FREE_SPAN_RPM;
    return free && !by_time && !draws(self, FREE_A_Q9) ? 0 : 1;
}

// Classifies a valley by the angle since the last blow.
static void judge(Blow *self, const BlowSetpoints *set) {
    self->lugs = lugs_of(self);
    self->impacting = self->seen > SEEN_NONE;
    if (self->lugs > 0u) {
        self->repeats = repeats_of(self, set);
        close_blow(self);
    }
    self->hit_angle = self->angle;
}

// Computes the next of the values that a blow requires, one a tick, so that no tick exceeds its
// cycles. The means need a division: they wait for a tick without a Hall edge, because an edge
// needs one too, for the speed.
INLINE_NEVER static void work(Blow *self, const BlowSetpoints *set, bool edge) {
    const Work due = (Work)self->work;
    if (due == WORK_MEANS && edge && self->since_ms < MEANS_LATEST_MS) {
        return;
    }
    self->work = (uint8_t)(due < WORK_ANGLES ? due + 1u : WORK_NONE);
    if (due == WORK_FACTORS) {
        take_factors(self, set);
    } else if (due == WORK_ANGLES) {
        take_angles(self, set);
    } else if (due == WORK_VALLEY) {
        judge(self, set);
    } else if (due == WORK_MEANS) {
        learn_angle(self);
        learn_period(self);
    }
}

// A valley has ended: prepares its classification unless it follows the last one too soon.
static void valley(Blow *self, int16_t last_rpm) {
    const bool same = self->even ? self->angle < self->blow_angle
                                 : self->angle - self->hit_angle < self->mean_angle >> 2;
    if (self->seen > SEEN_NONE && same) {
        return;
    }
    self->fraction_q4 =
        sixteenths((uint16_t)(self->signal_rpm - self->extreme_rpm - self->hysteresis_rpm),
                   (uint16_t)(self->signal_rpm - last_rpm));
    learn_ripple(self);
    self->since_hit_ms = 0;
    self->busy = true;
    self->work = WORK_VALLEY;
}

// Speed of the source and its deviation from the mean.
static void sense(Blow *self, const BlowSetpoints *set, const ControllerInputs *in) {
    const bool first =
        self->base_rpm == 0;  // base_rpm starts at the speed: the shaft may turn already
    if ((uint8_t)set->source == BLOW_SOURCE_SPEED) {
        self->speed_rpm = in->speed_rpm_q1 < 0 ? 0 : in->speed_rpm_q1 >> 1;
    } else if (!in->coasted) {  // mean of two ticks against sample noise
        const int16_t now = speed_by_current(self, in);
        self->speed_rpm = first ? now : (int16_t)((self->speed_rpm + now) >> 1);
    }
    if (first) {
        self->base_rpm = self->speed_rpm;
    }
    const int16_t off = (int16_t)(self->speed_rpm - self->base_rpm);
    self->base_rpm = (int16_t)(self->base_rpm + fixed_byte_part(off, BASE_SHARE_Q8));
    self->signal_rpm = (int16_t)(self->speed_rpm - self->base_rpm);
}

// Whether a valley of the signal has just ended.
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
    if (self->busy) {
        work(self, set, in->edges > 0u);
    }
    count_time(self);
    const int16_t last_rpm = self->signal_rpm;
    const bool rising = self->rising;
    sense(self, set, in);
    collect(self, in->current_a_q9);
    if (turns_up(self)) {
        valley(self, last_rpm);
    }
    if (self->rising != rising) {
        self->extreme_rpm = self->signal_rpm;
    }
}
