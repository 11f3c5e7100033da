// Drill driver, see drill.h. Numbers without another source: docs/spec/model.md, section 7, and the
// reference tool of its section 4.
#include "controllers/drill.h"

#include "core/clear.h"
#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"
#include "core/slew.h"

// Rates of the duty per ms.
#define DUTY_UP_Q15 109          // 0 to 1 in 0.3 s
#define DUTY_LOADED_Q15 400      // under load with the clutch set
#define DUTY_DOWN_Q15 197        // 6 per second
#define LOADED_A_Q17 Q(2.5, 17)  // load current above which the shaft counts as loaded

// Pulse mode.
#define PULSE_ON_A_Q9 Q(15.0, 9)
#define PULSE_COAST_MS 24u  // the bridge is open for one tick more, in which it is armed
#define PULSE_PERIOD_MS 100u
#define BIN_MS 10u
#define BIN_SHIFT 4u
#define PULSE_OFF_SUM Q(8.0 * 100.0 / 16.0, 9)  // 100 ms at 8 A, in the unit of the bins
#define PULSE_A 44u   // limit of a pulse's voltage above the back-EMF, as a current
#define RESUME_A 30u  // in its first RESUME_MS, while the back-EMF may be falling
#define RESUME_MS 3u
#define PULSE_SLEW_Q15 500  // per tick: the current lags a step by L / R = 0.5 ms

#define INDUCTANCE_MV_Q0 100     // per A and tick: L / 1 ms
#define INERTIA_A_Q9_PER_MV 69   // J / k^2 / 1 ms = 0.1347 A/mV
#define FRICTION_A_Q4 Q(1.1, 4)  // Tc / k
#define SETTLING_TICKS 2u        // after an open bridge, until the current has built up
#define SINCE_EMF_MAX 80u        // ticks; times FALL_MV_PER_MS it fits in 16 bits

// Kickback. A jam in either gear takes at once the load current that stalls the motor, 55 A (16 V,
// a pack of 0.1 ohm) to 108 A; the largest ordinary loads, 12 N m in low gear and 3.5 N m in high
// gear, take 36 A. The threshold of 45 A is a fall of the back-EMF by 334 mV/ms.
#define FALL_MV_PER_MS 334
#define FALL_BY_INERTIA_MV 150  // per tick, 20 A of inertia: a smaller fall is an overload
#define FALLEN_MV 300           // a larger sum of the falls beyond ordinary loads is a jam
#define FALLEN_CLUTCH_MV 900    // the same with the clutch set, which acts first where it can
#define FALLEN_TICK_MV 160      // most that a tick adds to the sum: one tick alone is no jam
#define FALLEN_MAX_MV 10000     // limits of the sum and of a fall: both together fit in 16 bits
#define FALL_MAX_MV 20000
#define MV_PER_A 7  // k^2 / J / 1 ms

// Electronic clutch.
#define CLUTCH_A_Q4_MAX Q(40.0, 4)  // below the fold-back limit
#define CLUTCH_A_Q9_MAX Q(40.0, 9)
#define FILTER_SHIFT 8u       // a move of bytes
#define FILTER_GAIN 8         // per 2^FILTER_SHIFT and tick: 32 ms, with twice the gain 16 ms
#define SLOW_A_Q4 Q(18.0, 4)  // a setting below this load current is filtered over 32 ms
#define NOISE_A_Q4 Q(1.6, 4)  // added to the setting, which the noise reaches early by so much
#define NOISE_SLOW_A_Q4 Q(1.0, 4)
#define LEAD_TICKS 2  // from the middle of a measured tick to the opening of the bridge

// Greatest speed with the clutch set, as a back-EMF: a joint whose torque rises to the setting
// within 30 degrees takes up its kinetic energy without passing the setting.
#define LIMIT_MV 750
#define LIMIT_MV_PER_DNM 32
#define LIMIT_MV_PER_A 27
#define RISING_MAX_A_Q9 2000  // greatest rise of the load per tick: 16 times it fits in 16 bits

// Factor of J / k^2 e i' in A^2 Q8, for the product of e in mV and i' in A Q9 per tick after a
// shift by 12 bits; 1.5 times the value of the motor, since the slope lags.
#define SWING_NUMERATOR 416

static int16_t not_below_0(int32_t value) {
    if (value < 0) {
        return 0;
    }
    return (int16_t)(value > INT16_MAX ? INT16_MAX : value);
}

static void stop(Drill *self, ControllerReason reason) {
    self->state = DRILL_STOPPED;
    self->reason = (uint8_t)reason;
}

// i = T / (N k) + Tc / k, 1 / k = 2 pi / 60 rpm per V: T in 0.1 N m, N Q8 and A Q4 give 42.9.
static void set_clutch(Drill *self, const DrillSetpoints *set) {
    const uint32_t torque = (uint32_t)(uint16_t)set->clutch_dnm * 43u;
    const uint16_t wanted_a_q4 = divide_by_u16(torque * set->rpm_per_v, set->ratio_q8);
    if (wanted_a_q4 > CLUTCH_A_Q4_MAX) {
        stop(self, CONTROLLER_REASON_UNREACHABLE);
        return;
    }
    const int16_t load_a_q4 = (int16_t)((int16_t)wanted_a_q4 + FRICTION_A_Q4);
    self->slow = load_a_q4 < SLOW_A_Q4;
    const int16_t set_a_q4 = (int16_t)(load_a_q4 + (self->slow ? NOISE_SLOW_A_Q4 : NOISE_A_Q4));
    self->set_a2_q8 = (int32_t)set_a_q4 * set_a_q4;
    self->limit_mv = (int16_t)(LIMIT_MV + LIMIT_MV_PER_DNM * set->clutch_dnm +
                               ((LIMIT_MV_PER_A * set_a_q4) >> 4));
}

void drill_start(Drill *self, const DrillSetpoints *set) {
    (void)set;  // read in the first step
    CLEAR(self);
    self->state = DRILL_RUN;
    self->settling = SETTLING_TICKS;
}

void drill_reverse(DrillSetpoints *set) {
    set->clutch_dnm = 0;
    set->pulse = false;
}

// e = d Vs - R i - L i'
static int16_t emf_of(const DrillSetpoints *set, const ControllerInputs *in, int16_t last_a_q9) {
    const uint16_t applied_mv =
        (uint16_t)(((uint32_t)(uint16_t)(2u * (uint16_t)in->duty_q15) * in->supply_mv) >> 16);
    int32_t drop_mv = ((int32_t)in->current_a_q9 * (int16_t)set->motor_mohm) >> 8;
    FIXED_HIDE(drop_mv);
    const int16_t rise_a_q8 = (int16_t)(in->current_a_q9 / 2 - last_a_q9 / 2);
    const int16_t rise_mv = fixed_byte_part(rise_a_q8, INDUCTANCE_MV_Q0);
    return not_below_0((int32_t)applied_mv - (drop_mv >> 1) - rise_mv);
}

// Sums the falls of the back-EMF e over successive ticks, each less the fall that an ordinary load
// causes: FALL_MV_PER_MS - MV_PER_A i, since the motor current i carries a part of the load. The
// sum restarts at 0 in a tick in which e falls by FALL_BY_INERTIA_MV or less, or the drive brakes.
static void judge_fall(Drill *self, int16_t emf_mv, int16_t current_a_q9) {
    const int16_t fall_mv = (int16_t)(self->emf_mv - emf_mv);
    if (current_a_q9 <= 0 || fall_mv <= FALL_BY_INERTIA_MV) {
        self->fallen_mv = 0;
        return;
    }
    const int16_t seen_mv = fall_mv > FALL_MAX_MV ? FALL_MAX_MV : fall_mv;
    int16_t beyond_mv =
        (int16_t)(seen_mv - FALL_MV_PER_MS + ((fixed_byte_part(current_a_q9, 4) * MV_PER_A) >> 3));
    if (self->since_emf > 1u) {
        beyond_mv = (int16_t)(beyond_mv - (int16_t)(self->since_emf - 1u) * FALL_MV_PER_MS);
    } else if (beyond_mv > FALLEN_TICK_MV) {
        beyond_mv = FALLEN_TICK_MV;
    }
    const int16_t fallen_mv =
        (int16_t)((self->fallen_mv > FALLEN_MAX_MV ? FALLEN_MAX_MV : self->fallen_mv) + beyond_mv);
    self->fallen_mv = (int16_t)(fallen_mv < 0 ? 0 : fallen_mv);
}

static int32_t filtered(int32_t sum_a_q17) {
    return sum_a_q17 >> FILTER_SHIFT;
}

static int32_t gained(const Drill *self, int32_t off_a_q9) {
    const int32_t slow = off_a_q9 * FILTER_GAIN;
    return self->slow ? slow : 2 * slow;
}

// Filters the load current i - J / k^2 e' over 16 ms, or over 32 ms with a low setting of the
// clutch, at which the noise is relatively larger and the shaft slower.
static void track_load(Drill *self, int16_t emf_mv, int16_t current_a_q9) {
    const int32_t inertia_a_q9 = (int32_t)(int16_t)(self->emf_mv - emf_mv) * INERTIA_A_Q9_PER_MV;
    self->level_a_q17 += gained(self, current_a_q9 + inertia_a_q9 - filtered(self->level_a_q17));
    self->smooth_a_q17 += gained(self, filtered(self->level_a_q17) - filtered(self->smooth_a_q17));
}

static void observe(Drill *self, const DrillSetpoints *set, const ControllerInputs *in) {
    const int16_t last_a_q9 = self->last_a_q9;
    self->last_a_q9 = in->current_a_q9;
    if (self->since_emf < SINCE_EMF_MAX) {
        self->since_emf++;
    }
    self->settling =
        in->coasted ? SETTLING_TICKS : (uint8_t)(self->settling - (self->settling > 0u ? 1u : 0u));
    if (self->settling > 0u) {
        return;
    }
    const int16_t emf_mv = emf_of(set, in, last_a_q9);
    if (self->emf_known) {
        judge_fall(self, emf_mv, in->current_a_q9);
        if (set->clutch_dnm > 0 && self->since_emf == 1u) {
            track_load(self, emf_mv, in->current_a_q9);
        }
    }
    self->emf_mv = emf_mv;
    self->since_emf = 0;
    self->emf_known = true;
}

// Whether the load reaches the setting if the bridge opens: the kinetic energy carries a load that
// rises with the angle on to sqrt(i^2 + J / k^2 e i').
static bool clutch_reached(Drill *self) {
    const int32_t level_a_q9 = filtered(self->level_a_q17);
    const int32_t apart_a_q9 = level_a_q9 - filtered(self->smooth_a_q17);
    const int16_t short_a_q9 = (int16_t)fixed_clamp_i32(apart_a_q9, INT16_MIN, INT16_MAX);
    const int16_t slope_a_q9 =
        fixed_byte_part(short_a_q9, self->slow ? 8u : 16u);  // rise per tick: 1/32 or 1/16
    const int32_t now_a_q9 = level_a_q9 + apart_a_q9 + (int16_t)(LEAD_TICKS * slope_a_q9);
    const int16_t now_a_q4 = (int16_t)(now_a_q9 < 0            ? 0
                                       : now_a_q9 > UINT16_MAX ? 2047
                                                               : (uint16_t)now_a_q9 >> 5);
    const int16_t most_a_q9 = slope_a_q9 > RISING_MAX_A_Q9 ? RISING_MAX_A_Q9 : slope_a_q9;
    const int16_t rising_a_q13 =
        (int16_t)(slope_a_q9 < 0 ? 0 : most_a_q9 * 16);  // left by 4, right by 16 below: 12
    const int16_t swing = (int16_t)(((int32_t)self->emf_mv * rising_a_q13) >> 16);
    self->now_a_q4 = now_a_q4;
    return (int32_t)now_a_q4 * now_a_q4 + (int32_t)swing * SWING_NUMERATOR >= self->set_a2_q8;
}

static int16_t duty_of(uint32_t volt_mv, uint16_t supply_mv) {
    return volt_mv >= supply_mv ? INT16_MAX : (int16_t)divide_by_u16(volt_mv << 15, supply_mv);
}

// Speed control with the clutch set: the back-EMF limit plus 3/4 of the load's drop in the winding.
static int16_t governed(const Drill *self, const DrillSetpoints *set, const ControllerInputs *in) {
    const int16_t load_a_q9 = not_below_0(filtered(self->level_a_q17));
    const int16_t load_a_q4 =
        (int16_t)(load_a_q9 > CLUTCH_A_Q9_MAX ? CLUTCH_A_Q4_MAX : fixed_byte_part(load_a_q9, 8));
    const int32_t drop_mv =
        ((int32_t)(int16_t)(load_a_q4 << 2) * (int16_t)(3u * set->motor_mohm)) >> 8;
    const uint16_t now_mv =
        (uint16_t)(((uint32_t)(uint16_t)(2u * (uint16_t)self->duty_q15) * in->supply_mv) >> 16);
    const int32_t missing_mv = (int32_t)self->limit_mv + drop_mv - now_mv;
    return (int16_t)fixed_clamp_i32(self->duty_q15 + missing_mv + (missing_mv >> 1), 0,
                                    in->travel_q15);  // gain 1.5 per mV: less than 2^15 / 20,500 mV
}

// Whether the mean current of the last 0.1 s is below 8 A, evaluated every 10 ms.
static bool load_dropped(Drill *self, int16_t current_a_q9) {
    self->pulse_ms = (uint16_t)(self->pulse_ms + (self->pulse_ms < PULSE_PERIOD_MS ? 1u : 0u));
    self->bin_sum = (int16_t)(self->bin_sum + (current_a_q9 >> BIN_SHIFT));
    if (++self->bin_ms < BIN_MS) {
        return false;
    }
    self->bins[self->bin] = self->bin_sum;
    self->bin = (uint8_t)(self->bin + 1u < DRILL_BINS ? self->bin + 1u : 0u);
    self->bin_sum = 0;
    self->bin_ms = 0;
    int32_t sum = 0;
    for (uint8_t n = 0; n < DRILL_BINS; n++) {
        sum += self->bins[n];
    }
    return self->pulse_ms >= PULSE_PERIOD_MS && sum < PULSE_OFF_SUM;
}

static DrillState next_state(const Drill *self, const DrillSetpoints *set,
                             const ControllerInputs *in, bool pulse_over) {
    if (pulse_over) {
        return DRILL_RUN;
    }
    switch ((DrillState)self->state) {
    case DRILL_RUN:
        return set->pulse && in->current_a_q9 > PULSE_ON_A_Q9 && self->fallen_mv == 0 ? DRILL_COAST
                                                                                      : DRILL_RUN;
    case DRILL_COAST:
        return self->phase_ms >= PULSE_COAST_MS ? DRILL_PULSE : DRILL_COAST;
    case DRILL_PULSE:
        return self->phase_ms >= PULSE_PERIOD_MS ? DRILL_COAST : DRILL_PULSE;
    case DRILL_STOPPED:
        return DRILL_STOPPED;
    }
    return DRILL_STOPPED;
}

static void change_pulse(Drill *self, const DrillSetpoints *set, const ControllerInputs *in) {
    const bool pulse_over = self->state != DRILL_RUN && load_dropped(self, in->current_a_q9);
    self->phase_ms++;
    const DrillState next = next_state(self, set, in, pulse_over);
    if (next == DRILL_COAST && self->state != DRILL_COAST) {
        self->phase_ms = 0;
    }
    if (next == DRILL_COAST && self->state == DRILL_RUN) {
        self->mv_per_rpm_q12 = divide_by_u16((uint32_t)500u << 12, set->rpm_per_v);
        self->pulse_ms = 0;
        self->bin_ms = 0;
        self->bin_sum = 0;
    }
    self->state = (uint8_t)next;
}

static uint32_t induced_mv(const Drill *self, int16_t speed_rpm_q1) {
    return fixed_byte_down((uint32_t)(uint16_t)(speed_rpm_q1 > 0 ? speed_rpm_q1 : 0) *
                           self->mv_per_rpm_q12) >>
           4;
}

// Kickback while the bridge is open, by the Hall sensor: the speed lost in the coast exceeds what
// an ordinary load takes.
static bool jammed_coasting(const Drill *self, const ControllerInputs *in) {
    return self->state == DRILL_COAST && self->phase_ms == PULSE_COAST_MS - 1u &&
           self->emf_mv - (int32_t)induced_mv(self, in->speed_rpm_q1) >
               (int32_t)PULSE_COAST_MS * FALL_MV_PER_MS;
}

// Full duty, limited to the voltage that drives PULSE_A through the winding beyond the back-EMF,
// since the shaft may have stopped.
static int16_t pulse_duty(const Drill *self, const DrillSetpoints *set,
                          const ControllerInputs *in) {
    const bool resuming = self->phase_ms <= PULSE_COAST_MS + RESUME_MS;
    const uint32_t beyond_mv = (uint32_t)set->motor_mohm * (resuming ? RESUME_A : PULSE_A);
    const int16_t wanted_q15 =
        duty_of(induced_mv(self, in->speed_rpm_q1) + beyond_mv, in->supply_mv);
    return self->phase_ms == PULSE_COAST_MS
               ? wanted_q15
               : slew_towards(self->duty_q15, wanted_q15, PULSE_SLEW_Q15);
}

static int16_t output(Drill *self, const DrillSetpoints *set, const ControllerInputs *in) {
    switch ((DrillState)self->state) {
    case DRILL_RUN: {
        const int16_t wanted_q15 = set->clutch_dnm > 0 ? governed(self, set, in) : in->travel_q15;
        const bool loaded = set->clutch_dnm > 0 && self->level_a_q17 > LOADED_A_Q17;
        const int16_t up_q15 = loaded ? DUTY_LOADED_Q15 : DUTY_UP_Q15;
        self->duty_q15 = slew_towards(self->duty_q15, wanted_q15,
                                      self->duty_q15 > wanted_q15 ? DUTY_DOWN_Q15 : up_q15);
        return self->duty_q15;
    }
    case DRILL_COAST:
        return CONTROLLER_COAST;
    case DRILL_PULSE:
        self->duty_q15 = pulse_duty(self, set, in);
        return in->travel_q15 > 0 ? self->duty_q15 : CONTROLLER_COAST;
    case DRILL_STOPPED:
        return CONTROLLER_STOP;
    }
    return CONTROLLER_STOP;
}

// First step of the drive: computes the clutch's limits; there is no back-EMF to observe yet.
static int16_t begin(Drill *self, const DrillSetpoints *set, int16_t travel_q15) {
    self->begun = true;
    self->duty_q15 = travel_q15;  // 0, or the duty that matches a turning shaft
    if (set->clutch_dnm > 0) {
        set_clutch(self, set);
    }
    return self->state == DRILL_STOPPED ? CONTROLLER_STOP : travel_q15;
}

int16_t drill_step(Drill *self, const DrillSetpoints *set, const ControllerInputs *in,
                   const Blow *blow) {
    BY_POINTER(self);
    (void)blow;
    if (self->state == DRILL_STOPPED) {
        return CONTROLLER_STOP;
    }
    if (!self->begun) {
        return begin(self, set, in->travel_q15);
    }
    observe(self, set, in);
    if (set->kickback && (self->fallen_mv > (set->clutch_dnm > 0 ? FALLEN_CLUTCH_MV : FALLEN_MV) ||
                          jammed_coasting(self, in))) {
        stop(self, CONTROLLER_REASON_KICKBACK);
    } else if (set->clutch_dnm > 0) {
        if (clutch_reached(self)) {
            stop(self, CONTROLLER_REASON_CLUTCH);
        }
    } else {
        change_pulse(self, set, in);
    }
    return output(self, set, in);
}

uint8_t drill_state(const Drill *self) {
    return self->state;
}

uint8_t drill_stop_reason(const Drill *self) {
    return self->reason;
}

int16_t drill_estimate(const Drill *self) {
    return self->now_a_q4;
}
