// Low vibration, see vibration.h.
#include "controllers/vibration.h"

#include "core/divide.h"
#include "core/fixed.h"
#include "core/slew.h"

#define APPROACH_MS 90u  // without a dip: the hammer need not climb here
#define SETTLE_MS 12u    // the current has followed the first rise of the duty, and the Hall sensor has seen two edges or none
#define CLIMB_MS 100u    // longer than any climb at the duty that it has risen to by then
#define SURGE_MS 100u
#define DIP_SHIFT 4u                   // a sixteenth below the highest speed
#define APPROACH_STEP_Q15 Q(0.08, 15)  // a ms
#define SURGE_STEP_Q15 Q(0.12, 15)     // a ms
#define RUN_STEP_Q15 Q(0.006, 15)      // a ms: the trigger's own ramp
#define LIMIT_STEP_Q15 Q(0.002, 15)    // a ms: a blow or two until a hard joint is told, 0.1 s to its voltage
#define TURN_PER_Q8 469u               // rpm Q1 ms in a 1/256 turn: 60,000 * 2 / 256

// What a tick says.
typedef struct {
    uint16_t motor_mv;  // applied
    int16_t speed_rpm_q1;
    int16_t free_rpm_q1;  // speed whose back-EMF is the whole voltage
} Seen;

static int16_t rpm_of(const VibrationSetpoints *set, int32_t emf_mv) {
    const uint16_t per_mv_q15 = (uint16_t)(((uint32_t)set->motor_rpm_per_v * 16777u) >> 8);  // 2 * 2^15 / 1000
    const uint32_t rpm_q1 = ((uint32_t)(uint16_t)fixed_clamp_i32(emf_mv, 0, INT16_MAX) * per_mv_q15) >> 15;
    return (int16_t)(rpm_q1 > INT16_MAX ? INT16_MAX : (int16_t)rpm_q1);
}

static int16_t drop_mv(const VibrationSetpoints *set, int16_t current_a_q9) {
    return fixed_saturate_i16(((int32_t)current_a_q9 * (int16_t)set->motor_mohm) >> 9, &(bool){false});
}

static Seen look(const VibrationSetpoints *set, const ControllerInputs *in) {
    Seen seen = {.motor_mv = (uint16_t)(((uint32_t)(uint16_t)in->duty_q15 * in->supply_mv) >> 15)};
    seen.free_rpm_q1 = rpm_of(set, seen.motor_mv);
    seen.speed_rpm_q1 = set->method == VIBRATION_BY_SPEED ? in->speed_rpm_q1 : rpm_of(set, (int32_t)seen.motor_mv - drop_mv(set, in->current_a_q9));
    return seen;
}

void vibration_start(Vibration *self, const VibrationSetpoints *set) {
    *self = (Vibration){.limit_q15 = INT16_MAX, .climb_turn = (uint32_t)set->climb_turn_q8 * TURN_PER_Q8};
}

static uint8_t next_phase(const Vibration *self, const ControllerInputs *in, const Seen *seen) {
    switch ((VibrationPhase)self->phase) {
    case VIBRATION_APPROACH:
        if (seen->speed_rpm_q1 < self->top_rpm_q1 - (self->top_rpm_q1 >> DIP_SHIFT)) {
            return VIBRATION_CLIMB;
        }
        return self->phase_ms >= APPROACH_MS ? VIBRATION_RUN : VIBRATION_APPROACH;
    case VIBRATION_CLIMB:
        return self->turned >= self->climb_turn || self->phase_ms >= CLIMB_MS ? VIBRATION_SURGE : VIBRATION_CLIMB;
    case VIBRATION_SURGE:
        return self->duty_q15 >= in->trigger_q15 || self->phase_ms >= SURGE_MS ? VIBRATION_RUN : VIBRATION_SURGE;
    case VIBRATION_RUN:
        break;
    }
    return VIBRATION_RUN;
}

// The duty that lets the current rise to surge_a: what is applied plus what the resistance wants for the rest.
static int16_t surge(const Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in, const Seen *seen) {
    const int32_t rest_a_q9 = (int32_t)set->surge_a_q9 - in->current_a_q9;
    const int32_t wanted_mv = (int32_t)seen->motor_mv + drop_mv(set, (int16_t)fixed_clamp_i32(rest_a_q9, INT16_MIN, INT16_MAX));
    const uint16_t wanted_q15 = divide_u16((uint32_t)fixed_clamp_i32(wanted_mv, 0, UINT16_MAX) << 15, in->supply_mv);
    const uint16_t most_q15 = (uint16_t)(self->duty_q15 + SURGE_STEP_Q15);
    const uint16_t duty_q15 = wanted_q15 < most_q15 ? wanted_q15 : most_q15;
    const int16_t risen_q15 = (int16_t)(duty_q15 > INT16_MAX ? (uint16_t)INT16_MAX : duty_q15);
    return risen_q15 > self->duty_q15 ? risen_q15 : self->duty_q15;
}

// On a hard joint the motor is slow for its voltage.
static int16_t limited(const Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in, const Seen *seen, const Blow *blow) {
    const bool slow = seen->speed_rpm_q1 < (int16_t)(((int32_t)seen->free_rpm_q1 * set->hard_share_q15) >> 15);
    if (slow && blow->impacting && seen->motor_mv > set->hard_mv) {
        const int16_t from_q15 = self->limit_q15 < in->trigger_q15 ? self->limit_q15 : in->trigger_q15;
        return slew_towards(from_q15, 0, LIMIT_STEP_Q15);
    }
    return slew_towards(self->limit_q15, INT16_MAX, LIMIT_STEP_Q15);
}

static int16_t climb(const Vibration *self, const VibrationSetpoints *set) {
    return (int16_t)fixed_clamp_i32(set->climb_q15 + (int32_t)set->climb_per_ms_q15 * self->phase_ms, 0, INT16_MAX);
}

static int16_t output(Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in, const Seen *seen, const Blow *blow) {
    switch ((VibrationPhase)self->phase) {
    case VIBRATION_APPROACH:
        return slew_towards(self->duty_q15, set->approach_q15, APPROACH_STEP_Q15);
    case VIBRATION_CLIMB:
        return climb(self, set);
    case VIBRATION_SURGE:
        return surge(self, set, in, seen);
    case VIBRATION_RUN:
        break;
    }
    self->limit_q15 = limited(self, set, in, seen, blow);
    return slew_towards(self->duty_q15, self->limit_q15, RUN_STEP_Q15);
}

// Never beyond the trigger; a trigger that is let go a little is followed at the trigger's own rate.
static int16_t within_trigger(const Vibration *self, const ControllerInputs *in, int16_t wish_q15) {
    const int16_t down_q15 = slew_towards(self->duty_q15, 0, RUN_STEP_Q15);
    const int16_t most_q15 = in->trigger_q15 > down_q15 ? in->trigger_q15 : down_q15;
    return wish_q15 < most_q15 ? wish_q15 : most_q15;
}

static void begin(Vibration *self, const ControllerInputs *in) {
    self->begun = true;
    if (in->speed_rpm_q1 > 0) {
        self->phase = VIBRATION_RUN;
        self->duty_q15 = in->travel_q15;  // a drive that resumes while the shaft turns
    }
}

static void note(Vibration *self, const Seen *seen) {
    if (self->phase == VIBRATION_APPROACH) {
        self->top_rpm_q1 = self->phase_ms >= SETTLE_MS && seen->speed_rpm_q1 > self->top_rpm_q1 ? seen->speed_rpm_q1 : self->top_rpm_q1;
    } else if (self->phase == VIBRATION_CLIMB && seen->speed_rpm_q1 > 0) {
        self->turned += (uint16_t)seen->speed_rpm_q1;
    }
}

int16_t vibration_step(Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in, const Blow *blow) {
    if (!self->begun) {
        begin(self, in);
    }
    const Seen seen = look(set, in);
    self->phase_ms = (uint8_t)(self->phase_ms + (self->phase_ms < UINT8_MAX ? 1u : 0u));
    note(self, &seen);
    const uint8_t next = next_phase(self, in, &seen);
    if (next != self->phase) {
        self->phase = next;
        self->phase_ms = 0;
    }
    self->duty_q15 = within_trigger(self, in, output(self, set, in, &seen, blow));
    return self->duty_q15;
}

uint8_t vibration_state(const Vibration *self) {
    return self->phase;
}

uint8_t vibration_stop_reason(const Vibration *self) {
    (void)self;
    return CONTROLLER_REASON_NONE;
}

int16_t vibration_estimate(const Vibration *self) {
    return self->limit_q15;
}
