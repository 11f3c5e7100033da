// Low vibration, see vibration.h.
#include "controllers/vibration.h"

#include "core/clear.h"
#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"
#include "core/slew.h"

#define APPROACH_MS 90u  // without a dip: the hammer need not climb

// Time in APPROACH from which on the greatest back-EMF is recorded: by then the current has
// followed the first rise of the duty, and the Hall sensor has given two edges, hence a speed, or
// none.
#define SETTLE_MS 12u
#define CLIMB_MS 100u  // longer than any climb at the duty reached by then
#define SURGE_MS 100u

// Rates of the duty per ms.
#define APPROACH_STEP_Q15 Q(0.08, 15)
#define SURGE_STEP_Q15 Q(0.12, 15)
#define RUN_STEP_Q15 Q(0.006, 15)    // as the trigger's ramp
#define LIMIT_STEP_Q15 Q(0.002, 15)  // 1 or 2 blows to detect a hard joint, 0.1 s to its voltage

#define TURNED_SHIFT 4u  // an angle in mV ms / 16 fits in 16 bits
#define TURN_Q8 469u     // 1/256 turn in 2^-1 rpm ms: 60,000 * 2 / 256
#define MOHM_MAX 511u    // limit of the setpoint in the computation

// At a bus voltage below 16.9 V the third climb on a hard joint would end on top of a lug.
#define LOW_SURGE_A_Q9 Q(30.5, 9)
#define LOW_256MV 66u  // 16.9 V in steps of 256 mV

// Trigger times bus voltage from which on a soft start reduces the vibration. Below it the start
// only decides by chance whether a hard joint falls in step.
#define START_MV 15400u

// Computations of the first ticks, one per tick, in their order.
typedef enum {
    PREPARE_NONE,
    PREPARE_RESUMED,
    PREPARE_EMF,
    PREPARE_SURGE,
    PREPARE_RISE,
    PREPARE_CLIMB,
} Prepare;

// Motor voltages of a tick: applied, and its share that is back-EMF.
typedef struct {
    uint16_t applied_mv;
    uint16_t emf_mv;
} MotorVoltages;

static uint16_t high_word(uint32_t product) {
    return (uint16_t)(product >> 16);
}

static uint16_t emf_by_current(const Vibration *self, uint16_t applied_mv, int16_t current_a_q9) {
    const int16_t drop_mv = (int16_t)(((int32_t)current_a_q9 * self->mohm_q7) >> 16);
    if (drop_mv < 0) {
        return (uint16_t)(applied_mv - (uint16_t)drop_mv);
    }
    return applied_mv > (uint16_t)drop_mv ? (uint16_t)(applied_mv - (uint16_t)drop_mv) : 0u;
}

static uint16_t emf_by_speed(const Vibration *self, int16_t speed_rpm_q1) {
    return speed_rpm_q1 > 0 ? (uint16_t)(fixed_byte_down((uint32_t)(uint16_t)speed_rpm_q1 *
                                                         self->mv_per_rpm_q12) >>
                                         4)
                            : 0u;
}

static MotorVoltages measure(const Vibration *self, const VibrationSetpoints *set,
                             const ControllerInputs *in) {
    const uint16_t supply_mv = in->supply_mv < INT16_MAX ? in->supply_mv : INT16_MAX;
    MotorVoltages motor = {.applied_mv =
                               high_word((uint32_t)(2u * (uint16_t)in->duty_q15) * supply_mv)};
    motor.emf_mv = (uint8_t)set->method == CONTROLLER_METHOD_SPEED
                       ? emf_by_speed(self, in->speed_rpm_q1)
                       : emf_by_current(self, motor.applied_mv, in->current_a_q9);
    return motor;
}

void vibration_start(Vibration *self, const VibrationSetpoints *set) {
    CLEAR(self);
    self->limit_q15 = INT16_MAX;
    self->least_q15 = UINT16_MAX;
    self->mohm_q7 = (uint16_t)((set->motor_mohm < MOHM_MAX ? set->motor_mohm : MOHM_MAX) << 7);
}

// Whether the trigger is too weak for a soft start, or not known to be strong enough yet.
static bool is_weak(const Vibration *self, const ControllerInputs *in) {
    return (uint16_t)in->trigger_q15 < self->least_q15;
}

static uint8_t next_phase(const Vibration *self, const VibrationSetpoints *set,
                          const ControllerInputs *in, const MotorVoltages *motor) {
    switch ((VibrationPhase)self->phase) {
    case VIBRATION_APPROACH:
        if (is_weak(self, in)) {
            return in->travel_q15 < set->approach_q15 ? VIBRATION_APPROACH : VIBRATION_RUN;
        }
        if (motor->emf_mv < self->top_mv - fixed_sixteenth(self->top_mv)) {
            return VIBRATION_CLIMB;
        }
        return self->phase_ms >= APPROACH_MS ? VIBRATION_RUN : VIBRATION_APPROACH;
    case VIBRATION_CLIMB:
        return self->turned >= self->climb_turn || self->phase_ms >= CLIMB_MS ? VIBRATION_SURGE
                                                                              : VIBRATION_CLIMB;
    case VIBRATION_SURGE:
        return self->duty_q15 >= in->trigger_q15 || self->phase_ms >= SURGE_MS ? VIBRATION_RUN
                                                                               : VIBRATION_SURGE;
    case VIBRATION_RUN:
        break;
    }
    return VIBRATION_RUN;
}

// Duty at which the current rises to surge_a: the applied duty plus that of the missing current's
// drop in the winding.
static int16_t surge(const Vibration *self, const ControllerInputs *in) {
    const uint16_t most_q15 = (uint16_t)(self->duty_q15 + SURGE_STEP_Q15);
    if (in->current_a_q9 >= self->surge_a_q9) {
        return self->duty_q15;
    }
    const uint16_t rest_a_q9 = (uint16_t)self->surge_a_q9 - (uint16_t)in->current_a_q9;
    const uint16_t wanted_q15 =
        (uint16_t)((uint16_t)in->duty_q15 + high_word((uint32_t)rest_a_q9 * self->rise_q16));
    const uint16_t duty_q15 = wanted_q15 < most_q15 ? wanted_q15 : most_q15;
    return duty_q15 > INT16_MAX ? INT16_MAX : (int16_t)duty_q15;
}

// Duty limit: falls while the joint is hard, that is while the motor is slow for its voltage.
static int16_t limited(const Vibration *self, const VibrationSetpoints *set,
                       const ControllerInputs *in, const MotorVoltages *motor, const Blow *blow) {
    if (blow->impacting && motor->applied_mv > set->hard_mv &&
        motor->emf_mv <
            high_word((uint32_t)motor->applied_mv * (uint16_t)(2 * set->hard_share_q15))) {
        const int16_t from_q15 =
            self->limit_q15 < in->trigger_q15 ? self->limit_q15 : in->trigger_q15;
        return slew_towards(from_q15, 0, LIMIT_STEP_Q15);
    }
    return slew_towards(self->limit_q15, INT16_MAX, LIMIT_STEP_Q15);
}

// Duty of the climb, which rises with its time.
static int16_t climb(const Vibration *self, const VibrationSetpoints *set) {
    const uint32_t duty_q15 =
        (uint16_t)set->climb_q15 + (uint32_t)(uint16_t)set->climb_per_ms_q15 * self->phase_ms;
    return (int16_t)(duty_q15 < INT16_MAX ? (uint16_t)duty_q15 : INT16_MAX);
}

static int16_t output(Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in,
                      const MotorVoltages *motor, const Blow *blow) {
    switch ((VibrationPhase)self->phase) {
    case VIBRATION_APPROACH:
        return is_weak(self, in)
                   ? in->travel_q15
                   : slew_towards(self->duty_q15, set->approach_q15, APPROACH_STEP_Q15);
    case VIBRATION_CLIMB:
        return climb(self, set);
    case VIBRATION_SURGE:
        return surge(self, in);
    case VIBRATION_RUN:
        break;
    }
    self->limit_q15 = limited(self, set, in, motor, blow);
    return slew_towards(self->duty_q15, self->limit_q15, RUN_STEP_Q15);
}

// Limits the duty to the trigger's; a trigger that is released partly is followed at the rate of
// its ramp.
static int16_t within_trigger(const Vibration *self, const ControllerInputs *in,
                              int16_t requested_q15) {
    const int16_t down_q15 = (int16_t)(self->duty_q15 - RUN_STEP_Q15);
    const int16_t most_q15 = in->trigger_q15 > down_q15 ? in->trigger_q15 : down_q15;
    return requested_q15 < most_q15 ? requested_q15 : most_q15;
}

// Angle of climb_turn_q8 in mV ms / 16.
static uint16_t climb_turn(const Vibration *self, const VibrationSetpoints *set) {
    const uint16_t per_q8_mv_ms =
        (uint16_t)(fixed_byte_down((uint32_t)TURN_Q8 * self->mv_per_rpm_q12) >> 4);
    const uint32_t turn = ((uint32_t)set->climb_turn_q8 * per_q8_mv_ms) >> TURNED_SHIFT;
    return (uint16_t)(turn > UINT16_MAX ? UINT16_MAX : turn);
}

// The divisions run in the first ticks, one per tick, in ticks without a computation of the blow
// detection. Back-EMF per 0.5 rpm: 500 mV / (rpm/V). Duty Q15 per current Q9 through the winding:
// 2^15 * 2^16 * 1000 / (1000 * 2^9) = 2^22 mohm / mV.
static void prepare(Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in) {
    self->prepared++;
    switch ((Prepare)self->prepared) {
    case PREPARE_NONE:
        break;
    case PREPARE_RESUMED:
        if (in->speed_rpm_q1 > 0) {
            self->phase = VIBRATION_RUN;
            self->duty_q15 = in->travel_q15;
        }
        break;
    case PREPARE_EMF:
        self->mv_per_rpm_q12 = divide_by_u16((uint32_t)500u << 12, set->motor_rpm_per_v);
        break;
    case PREPARE_SURGE:
        self->surge_a_q9 =
            (uint8_t)(in->supply_mv >> 8) < LOW_256MV && set->surge_a_q9 > LOW_SURGE_A_Q9
                ? LOW_SURGE_A_Q9
                : set->surge_a_q9;
        self->least_q15 = divide_by_u16((uint32_t)START_MV << 15, in->supply_mv);
        break;
    case PREPARE_RISE:
        self->rise_q16 = divide_by_u16((uint32_t)(self->mohm_q7 >> 1) << 16, in->supply_mv);
        break;
    case PREPARE_CLIMB:
        self->climb_turn = climb_turn(self, set);
        break;
    }
}

// Greatest back-EMF of the approach, angle of the climb; the approach begins with the trigger that
// is strong enough.
static void note(Vibration *self, const ControllerInputs *in, const MotorVoltages *motor) {
    if (self->phase == VIBRATION_APPROACH && is_weak(self, in)) {
        self->phase_ms = 0;
    } else if (self->phase == VIBRATION_APPROACH) {
        self->top_mv = self->phase_ms >= SETTLE_MS && motor->emf_mv > self->top_mv ? motor->emf_mv
                                                                                   : self->top_mv;
    } else if (self->phase == VIBRATION_CLIMB) {
        const uint16_t turned = (uint16_t)(self->turned + fixed_sixteenth(motor->emf_mv));
        self->turned = turned < self->turned ? UINT16_MAX : turned;
    }
}

int16_t vibration_step(Vibration *self, const VibrationSetpoints *set, const ControllerInputs *in,
                       const Blow *blow) {
    BY_POINTER(self);
    const bool resumes = self->prepared == (uint8_t)PREPARE_NONE;
    if (self->prepared < PREPARE_CLIMB && (resumes || !blow->busy)) {
        prepare(self, set, in);
    }
    const MotorVoltages motor = measure(self, set, in);
    self->phase_ms = (uint8_t)(self->phase_ms + (self->phase_ms < UINT8_MAX ? 1u : 0u));
    note(self, in, &motor);
    const uint8_t next = next_phase(self, set, in, &motor);
    if (next != self->phase) {
        self->phase = next;
        self->phase_ms = 0;
    }
    self->duty_q15 = within_trigger(self, in, output(self, set, in, &motor, blow));
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
