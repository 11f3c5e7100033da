// Torque control, see torque.h.
#include "controllers/torque.h"

#include "core/clear.h"
#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"

// docs/spec/model.md, section 4: k = 10.9 mN m/A is 0.5707 mV per 0.5 rpm, R = 0.19 ohm is 0.3711
// mV per 2^-9 A.
#define EMF_MV_Q16 37403
#define DROP_MV_Q8 95u
#define EXCESS_MAX_MV 4000  // limit of the excess voltage; more is a sensor fault

// Initial feed-forward, below that of any supply and winding: the first blows must not be too hard,
// since what they turn cannot be undone.
#define TAKEN_FIRST_MV (-250)

#define RUN_MV_PER_MS 30  // rate of the level in RUN
#define MV_PER_MS 8       // and in the other states
#define RUN_MS 100u       // in RUN the feed-forward adapts from then on
#define REST_MS                                                                                    \
    8u  // the supply is measured without load; several ticks, since the blow detection uses the
        // first
#define BLOWS_FIRST 2u
#define BLOWS_A_Q8 (9 * 256)  // above the current of a nut that runs freely, below that of blows
#define BLOWS_MS 600u         // from then on a current above BLOWS_A_Q8 counts as undetected blows
#define EVALUATE_MS 1200u
#define SLOW_EVALUATE_MS 600u  // below: later soft joints have the current of hard ones
#define SETTLE_MS 2800u
#define SLOW_SETTLE_MS 4400u
#define SLOW_BELOW_MV 7000
#define RAISED_EVALUATE_MS 150u
#define CHANGED_EVALUATE_MS 300u  // on levels at which lugs are hit once instead of twice

// When the current of a low target is exceeded so soon after the first evaluation, the joint is
// hard: the torque is LOW_LATE_NM above that of the filtered current.
#define LOW_LATE_MS 40u
#define LOW_LATE_NM 4
// Until then the filters lag behind the current of a joint whose torque rises fast: the current
// that stops a low target is lower by 2^-8 A for each 2^LOW_LEAD_SHIFT ms that are left.
#define LOW_LEAD_MS 850u
#define LOW_LEAD_SHIFT 4u
#define LOW_EVALUATE_MS 450u  // the slowest filter settles after the motor's start
#define RAISED_MS 8000u
#define SHORT_DECISIONS 150u  // in a row without the duty of the level, one in two ticks: 0.3 s
// A duty that is lower than the requested one by more than this does not hold the level: 0.29 V at
// 18.5 V, 2.8 N m.
#define SHORT_Q15 512
#define TWICE_ABOVE_MV 8000    // lugs are hit three times below this level, twice above,
#define CHANGED_ABOVE_MV 9200  // once above this
#define LEAD_ABOVE_MV 11000    // the torque grows fast: the lag of the filters is compensated
#define LOW_BEGIN_A_Q8 64      // for a low target the filters start this far below its current
#define A_Q8_PER_NM 12u        // on raised levels: 11 to 16, 6 where lugs begin to be hit once
#define MV_PER_NM 105u         // slope of the levels in the map
#define MISSED_SHARE 16u       // a deviation above 1/16 of the target is a miss
#define STALL_A_Q8 (4 * 256)   // above that of a hard joint: the motor stands

void torque_start(Torque *self, const TorqueSetpoints *set) {
    const bool known =
        set->target_nm >= TORQUE_MAP_FIRST_NM && set->target_nm <= TORQUE_MAP_LAST_NM;
    CLEAR(self);
    self->taken_mv_q16 = (int32_t)TAKEN_FIRST_MV * 65536;
    self->excess_mv_q16 = (int32_t)TAKEN_FIRST_MV * 65536;
    self->goal_mv = torque_map_run_mv();
    if (!known) {
        self->state = TORQUE_OVER;
        self->reason = CONTROLLER_REASON_UNREACHABLE;
        return;
    }
    self->row = (uint8_t)(set->target_nm - TORQUE_MAP_FIRST_NM);
    self->settled_a_q8 = torque_map_settled_a_q8(self->row);
    self->raised_mv = torque_map_raised_mv(self->row);
    self->stop_a_q8 = torque_map_stop_a_q8(self->row);
}

static int16_t high_word(int32_t value) {
    return (int16_t)(value >> 16);
}

// First-order low-pass filter with a time constant of 256 / gain calls.
INLINE_ALWAYS int32_t low_pass(int32_t value_q16, int16_t in, uint8_t gain_q8) {
    return fixed_add_product_q8(value_q16, (int16_t)(in - high_word(value_q16)), gain_q8);
}

static int16_t emf_mv(const ControllerInputs *in) {
    return high_word((int32_t)in->speed_rpm_q1 * EMF_MV_Q16);
}

// Mean of two ticks, or of three with a larger gain: the blow detection can delay it by a tick, and
// the tick with the blow must not be left out.
static void measure_current(Torque *self) {
    const bool three = self->gathered > 2u;
    const int16_t mean_a_q8 = three ? high_word((int32_t)self->sum_a_q7 * 43691) : self->sum_a_q7;
    const uint8_t gain = three ? 24u : 16u;
    self->quick_a_q24 = low_pass(self->quick_a_q24, mean_a_q8, gain);
    self->current_a_q24 = low_pass(self->current_a_q24, high_word(self->quick_a_q24), gain);
    self->slow_a_q24 =
        low_pass(self->slow_a_q24, high_word(self->current_a_q24), (uint8_t)(gain >> 1));
    self->sum_a_q7 = 0;
    self->gathered = 0;
}

static INLINE_NEVER int16_t share_mv(int16_t duty_q15, uint16_t supply_mv) {
    const uint16_t twice_mv = (uint16_t)(supply_mv < 32000u ? 2u * supply_mv : 64000u);
    return (int16_t)(((uint32_t)(uint16_t)duty_q15 * twice_mv) >> 16);
}

// Voltage of the bridge beyond that of the nominal motor: back-EMF plus the drop of the winding.
static void measure_voltage(Torque *self, const ControllerInputs *in) {
    const int16_t given_mv = share_mv(in->duty_q15, in->supply_mv);
    const int16_t drop_mv = fixed_byte_part(in->current_a_q9, DROP_MV_Q8);
    const int16_t own_mv =
        (int16_t)(((emf_mv(in) >> 1) + (drop_mv >> 1)));  // halves: sums fit in 16 bits
    int16_t excess_mv = (int16_t)((given_mv >> 1) - own_mv);
    excess_mv = (int16_t)(excess_mv > EXCESS_MAX_MV / 2
                              ? EXCESS_MAX_MV / 2
                              : (excess_mv < -EXCESS_MAX_MV / 2 ? -EXCESS_MAX_MV / 2 : excess_mv));
    self->excess_mv_q16 = low_pass(self->excess_mv_q16, (int16_t)(2 * excess_mv), 8);
    if (self->state != TORQUE_RUN || self->ticks > RUN_MS) {
        self->taken_mv_q16 = low_pass(self->taken_mv_q16, high_word(self->excess_mv_q16), 4);
    }
}

// From RUN such a drive goes to its raised level at once: its filters have followed no blows.
static bool filters_preset(const Torque *self) {
    return self->settled_a_q8 == TORQUE_MAP_NEVER;
}

// On raised levels on which each lug is hit twice the current rises from below to its value, if the
// filters have followed blows: it is valid at once.
static bool valid_at_once(const Torque *self) {
    return !filters_preset(self) && self->raised_mv > TWICE_ABOVE_MV &&
           self->raised_mv < CHANGED_ABOVE_MV;
}

// Current that compares with the map's: filtered, with the lag compensated on the highest levels.
static int16_t joint_a_q8(const Torque *self) {
    const int16_t current = high_word(self->current_a_q24);
    const int16_t slow = high_word(self->slow_a_q24);
    if (self->raised_mv < LEAD_ABOVE_MV) {
        return valid_at_once(self) ? current : slow;
    }
    const int16_t gained = (int16_t)(current - slow);
    return (int16_t)(current + gained - (gained >> 2));
}

static int16_t stop_a_q8(const Torque *self) {
    if (!filters_preset(self) || self->ticks >= LOW_LEAD_MS) {
        return self->stop_a_q8;
    }
    return (int16_t)(self->stop_a_q8 - (int16_t)((LOW_LEAD_MS - self->ticks) >> LOW_LEAD_SHIFT));
}

static uint16_t evaluate_ms(const Torque *self) {
    return self->goal_mv < SLOW_BELOW_MV ? SLOW_EVALUATE_MS : EVALUATE_MS;
}

static uint16_t settle_ms(const Torque *self) {
    return self->goal_mv < SLOW_BELOW_MV ? SLOW_SETTLE_MS : SETTLE_MS;
}

// Whether the current on the raised level is valid: the filters have settled after the change of
// level.
static bool current_valid(const Torque *self) {
    if (valid_at_once(self)) {
        return true;
    }
    if (filters_preset(self)) {
        return self->ticks >= LOW_EVALUATE_MS;
    }
    return self->ticks >=
           (self->raised_mv < LEAD_ABOVE_MV ? CHANGED_EVALUATE_MS : RAISED_EVALUATE_MS);
}

static bool arrived(const Torque *self) {
    return self->level_mv == self->goal_mv;
}

static bool in_reach(const Torque *self, uint16_t supply_mv) {
    const int16_t level = torque_map_level_mv(self->row);
    const uint16_t most = (uint16_t)(level > self->raised_mv ? level : self->raised_mv);
    return supply_mv >= most + (most >> 3);
}

static TorqueState next_state(const Torque *self, const ControllerInputs *in, const Blow *blow) {
    if (self->short_decisions >= SHORT_DECISIONS) {
        return TORQUE_OVER;
    }
    switch (self->state) {
    case TORQUE_RUN:
        if (self->ticks < REST_MS && !in_reach(self, in->supply_mv)) {
            return TORQUE_OVER;
        }
        if (blow->count < BLOWS_FIRST &&
            (self->ticks < BLOWS_MS || high_word(self->current_a_q24) < BLOWS_A_Q8)) {
            return TORQUE_RUN;
        }
        return filters_preset(self) ? TORQUE_RAISED : TORQUE_LEVEL;
    case TORQUE_LEVEL:
        if (self->ticks < evaluate_ms(self)) {
            return TORQUE_LEVEL;
        }
        return high_word(self->slow_a_q24) >= self->settled_a_q8 ? TORQUE_SETTLE : TORQUE_RAISED;
    case TORQUE_SETTLE:
        return self->ticks < settle_ms(self) ? TORQUE_SETTLE : TORQUE_OVER;
    case TORQUE_RAISED:
        return self->ticks < RAISED_MS &&
                       (!current_valid(self) || joint_a_q8(self) < stop_a_q8(self))
                   ? TORQUE_RAISED
                   : TORQUE_OVER;
    case TORQUE_OVER:
        break;
    }
    return self->state;
}

// Deviation from the target in N m, from the deviation of the current or of the level.
static int16_t deviation_nm(int16_t difference, uint8_t per_nm) {
    const int16_t rows =
        (int16_t)divide_by_u16((uint16_t)(difference < 0 ? -difference : difference), per_nm);
    return (int16_t)(difference < 0 ? -rows : rows);
}

// A hammer that does not pass the lugs draws the current of the standing motor: the torque is not
// known, and far below the target.
static bool stalled(const Torque *self) {
    return self->state != TORQUE_RAISED &&
           high_word(self->slow_a_q24) > self->settled_a_q8 + STALL_A_Q8;
}

// The drive is over: sets the reason and the estimated torque.
static void conclude(Torque *self, int16_t target_nm, const ControllerInputs *in) {
    int16_t off_nm = 0;
    self->reason = self->state == TORQUE_RAISED && self->ticks >= RAISED_MS
                       ? CONTROLLER_REASON_TIMEOUT
                       : CONTROLLER_REASON_REACHED;
    if (self->state == TORQUE_RUN) {
        self->reason = CONTROLLER_REASON_UNREACHABLE;
        return;
    }
    if (stalled(self)) {
        off_nm = (int16_t)-target_nm;
    } else if (self->short_decisions >= SHORT_DECISIONS) {
        const int16_t held_mv =
            (int16_t)(share_mv(in->duty_q15, in->supply_mv) - high_word(self->taken_mv_q16));
        off_nm = deviation_nm((int16_t)(held_mv - torque_map_level_mv(self->row)), MV_PER_NM);
    } else if (self->state == TORQUE_RAISED) {
        off_nm = deviation_nm((int16_t)(joint_a_q8(self) - stop_a_q8(self)), A_Q8_PER_NM);
        if (self->raised_mv < TWICE_ABOVE_MV && self->ticks < LOW_EVALUATE_MS + LOW_LATE_MS) {
            off_nm = (int16_t)(off_nm + LOW_LATE_NM);
        }
    }
    self->estimate_nm = (int16_t)(target_nm + off_nm > 0 ? target_nm + off_nm : 0);
    if (self->short_decisions >= SHORT_DECISIONS ||
        (off_nm < 0 ? -off_nm : off_nm) > (int16_t)((uint16_t)target_nm / MISSED_SHARE)) {
        self->reason = CONTROLLER_REASON_MISSED;
    }
}

static void enter(Torque *self, TorqueState next, int16_t target_nm, const ControllerInputs *in) {
    if (next == TORQUE_OVER) {
        conclude(self, target_nm, in);
    } else if (next == TORQUE_LEVEL) {
        self->goal_mv = torque_map_level_mv(self->row);
    } else if (next == TORQUE_RAISED) {
        self->goal_mv = self->raised_mv;
        if (self->state == TORQUE_RUN) {
            self->slow_a_q24 = (int32_t)(self->stop_a_q8 - LOW_BEGIN_A_Q8) * 65536;
            self->current_a_q24 = self->slow_a_q24;
            self->quick_a_q24 = self->slow_a_q24;
        }
    }
    self->state = next;
    self->ticks = 0;
}

// Moves the level towards its goal. A drive that begins with a turning shaft starts at its duty.
static void move_level(Torque *self, const ControllerInputs *in) {
    if (self->state == TORQUE_RUN && self->ticks == 0u) {
        self->duty_q15 = in->travel_q15;
        self->level_mv = (int16_t)(share_mv(in->travel_q15, in->supply_mv) - TAKEN_FIRST_MV);
    }
    int16_t rate = MV_PER_MS;
    if (self->state == TORQUE_RUN) {
        rate = RUN_MV_PER_MS;
    }
    int16_t change_mv = (int16_t)(self->goal_mv - self->level_mv);
    change_mv = change_mv > rate ? rate : change_mv;
    self->level_mv = (int16_t)(self->level_mv + (change_mv < -MV_PER_MS ? -MV_PER_MS : change_mv));
}

// Time in the state; in LEVEL and RAISED only on the goal level, in RUN up to BLOWS_MS.
static void count_tick(Torque *self) {
    const bool level_moves =
        (self->state == TORQUE_LEVEL || self->state == TORQUE_RAISED) && !arrived(self);
    if (!level_moves && (self->state != TORQUE_RUN || self->ticks < BLOWS_MS)) {
        self->ticks++;
    }
}

// The duty of the last decision has been applied, less what duty limit and fold-back take from it.
static void set_duty(Torque *self, const ControllerInputs *in) {
    const uint16_t supply_mv = in->supply_mv;
    const int16_t requested_mv = (int16_t)(self->level_mv + high_word(self->taken_mv_q16));
    const bool full = requested_mv > 0 && (uint16_t)requested_mv >= supply_mv;
    const bool reduced = (int16_t)(self->duty_q15 - in->duty_q15) > SHORT_Q15;
    self->short_decisions = (uint8_t)(full || reduced ? self->short_decisions + 1u : 0u);
    if (requested_mv <= 0) {
        self->duty_q15 = 0;
    } else {
        self->duty_q15 =
            full ? INT16_MAX
                 : (int16_t)(divide_by_u16((uint32_t)(uint16_t)requested_mv << 16, supply_mv) >> 1);
    }
}

static void decide(Torque *self, const TorqueSetpoints *set, const ControllerInputs *in,
                   const Blow *blow) {
    const TorqueState next = next_state(self, in, blow);
    self->entered = next != self->state;
    if (self->entered) {
        enter(self, next, set->target_nm, in);
    } else {
        set_duty(self, in);
    }
}

// Duty and filters alternate from tick to tick; neither runs when the blow detection computes.
static void act(Torque *self, const TorqueSetpoints *set, const ControllerInputs *in,
                const Blow *blow) {
    self->sum_a_q7 = (int16_t)(self->sum_a_q7 + (in->current_a_q9 >> 2));
    self->gathered++;
    if (self->gathered == 1u) {
        if (!blow->busy) {
            decide(self, set, in, blow);
        }
    } else if (!blow->busy || self->gathered > 2u) {
        measure_current(self);
        if (!in->coasted && !blow->busy) {  // both filters and a blow exceed the cycles of a tick
            measure_voltage(self, in);
        }
    }
}

int16_t torque_step(Torque *self, const TorqueSetpoints *set, const ControllerInputs *in,
                    const Blow *blow) {
    BY_POINTER(self);
    self->entered = false;
    if (self->state != TORQUE_OVER) {
        move_level(self, in);
        act(self, set, in, blow);
    }
    if (self->state == TORQUE_OVER) {
        return CONTROLLER_STOP;
    }
    if (in->travel_q15 <= 0) {
        return CONTROLLER_COAST;
    }
    count_tick(self);
    return self->duty_q15;
}

uint8_t torque_state(const Torque *self) {
    return (uint8_t)self->state;
}

uint8_t torque_stop_reason(const Torque *self) {
    return (uint8_t)self->reason;
}

int16_t torque_estimate(const Torque *self) {
    return (int16_t)(10 * self->estimate_nm);
}
