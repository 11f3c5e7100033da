// Choice of the controller, see control.h.
#include "app/control.h"

#include "app/param_store.h"
#include "core/flash.h"
#include "core/inline.h"
#include "telemetry/telemetry_signals.h"

#define FORWARD_TERM(MODE, name, Type, directions)                                                 \
    || (mode == TELEMETRY_MODE_##MODE && (directions) == CONTROL_FORWARD)
#define START_CASE(MODE, name, Type, directions)                                                   \
    case TELEMETRY_MODE_##MODE:                                                                    \
        name##_start(&self->state.name, &self->set.name);                                          \
        break;
#define STEP_CASE(MODE, name, Type, directions)                                                    \
    case TELEMETRY_MODE_##MODE:                                                                    \
        return name##_step(&self->state.name, &self->set.name, in, &self->blow);
#define REPORT_CASE(MODE, name, Type, directions)                                                  \
    case TELEMETRY_MODE_##MODE:                                                                    \
        out->control_state = name##_state(&self->state.name) & TELEMETRY_CONTROL_STATE_MAX;        \
        out->stop_reason = name##_stop_reason(&self->state.name) & TELEMETRY_STOP_REASON_MAX;      \
        out->estimate = name##_estimate(&self->state.name);                                        \
        return;

// Where the setpoints come from: each is a word and a parameter, in the order of the struct. Rows
// are as long as the longest.
#define ROW(MODE, name, Type, directions) [TELEMETRY_MODE_##MODE] = {SETPOINTS_##MODE},
#define WORDS(MODE, name, Type, directions)                                                        \
    _Static_assert(sizeof(Type##Setpoints) / sizeof(int16_t) ==                                    \
                       sizeof((uint8_t[]){SETPOINTS_##MODE}),                                      \
                   "a parameter for each setpoint");

#define SETPOINTS_SYNC                                                                             \
    PARAM_SYNC_METHOD, PARAM_SYNC_LOW_MV, PARAM_SYNC_HIGH_MV, PARAM_SYNC_DEPTH_MIN_Q15,            \
        PARAM_SYNC_DEPTH_MAX_Q15, PARAM_SYNC_CURRENT_A_Q9
#define SETPOINTS_SCREWING                                                                         \
    PARAM_HALL_PULSES, PARAM_BLOW_TURN_Q8, PARAM_SCREWING_SHARE_Q15, PARAM_SCREWING_LEAST_MV,      \
        PARAM_SCREWING_SMALL_DEG_Q4, PARAM_SCREWING_RISE_Q8
#define SETPOINTS_VIBRATION                                                                        \
    PARAM_VIBRATION_METHOD, PARAM_VIBRATION_APPROACH_Q15, PARAM_VIBRATION_CLIMB_Q15,               \
        PARAM_VIBRATION_CLIMB_PER_MS_Q15, PARAM_VIBRATION_CLIMB_TURN_Q8,                           \
        PARAM_VIBRATION_SURGE_A_Q9, PARAM_VIBRATION_HARD_SHARE_Q15, PARAM_VIBRATION_HARD_MV,       \
        PARAM_MOTOR_MOHM, PARAM_MOTOR_RPM_PER_V
#define SETPOINTS_TORQUE PARAM_TORQUE_TARGET_NM
#define SETPOINTS_DRILL                                                                            \
    PARAM_DRILL_CLUTCH_DNM, PARAM_DRILL_RATIO_Q8, PARAM_MOTOR_MOHM, PARAM_MOTOR_RPM_PER_V,         \
        PARAM_DRILL_PULSE, PARAM_DRILL_KICKBACK

CONTROL_LIST(WORDS)
static const uint8_t sources[][CONTROL_SETPOINTS_MOST] FLASH_TABLE = {CONTROL_LIST(ROW)};

// Synchronisation finds the blows in what its method is named after.
static uint8_t blow_source(uint8_t mode, const int16_t *value) {
    if (mode != TELEMETRY_MODE_SYNC) {
        return (uint8_t)value[PARAM_BLOW_SOURCE];
    }
    return value[PARAM_SYNC_METHOD] == SYNC_METHOD_SPEED ? BLOW_SOURCE_SPEED : BLOW_SOURCE_CURRENT;
}

#define COUNT_TERM(MODE, name, Type, directions) +1
enum { MODE_LAST = 0 CONTROL_LIST(COUNT_TERM) };  // the plain mode is 0
#define IN_A_ROW(MODE, name, Type, directions)                                                     \
    _Static_assert(TELEMETRY_MODE_##MODE <= MODE_LAST,                                             \
                   "the modes of the list are numbered in a row");
CONTROL_LIST(IN_A_ROW)

bool control_has(uint8_t mode) {
    return mode <= MODE_LAST;
}

static bool forward_only(uint8_t mode) {
    return false CONTROL_LIST(FORWARD_TERM);
}

INLINE_NEVER void control_prepare(Control *self, uint8_t mode, const int16_t *value) {
    self->blow_set.turn_q8 = (uint16_t)value[PARAM_BLOW_TURN_Q8];
    self->blow_set.source = blow_source(mode, value);
    self->blow_set.motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    self->blow_set.motor_rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
    const uint8_t *source = sources[mode];
    int16_t *const last = &self->set.words[CONTROL_SETPOINTS_MOST];
    for (int16_t *word = self->set.words; word != last; word++, source++) {
        *word = value[FLASH_U8(source)];
    }
}

INLINE_NEVER void control_start(Control *self, uint8_t mode, bool reverse) {
    self->stopped = false;
    self->mode = control_has(mode) && !(reverse && forward_only(mode)) ? mode : TELEMETRY_MODE_DUTY;
    blow_start(&self->blow, &self->blow_set);
    switch (self->mode) { CONTROL_LIST(START_CASE) }
    if (reverse &&
        self->mode ==
            TELEMETRY_MODE_DRILL) {  // clutch and pulse mode tighten; a jam kicks either way
        self->set.drill.clutch_dnm = 0;
        self->set.drill.pulse = false;
    }
}

static int16_t step(Control *self, const ControllerInputs *in) {
    switch (self->mode) { CONTROL_LIST(STEP_CASE) }
    return profile_wish(&self->profile, in->travel_q15);
}

INLINE_NEVER int16_t control_step(Control *self, const ControllerInputs *in) {
    if (self->stopped) {
        return CONTROLLER_STOP;
    }
    if (self->mode != TELEMETRY_MODE_DRILL) {
        blow_step(&self->blow, &self->blow_set, in);
    }
    const int16_t wish_q15 = step(self, in);
    self->stopped = wish_q15 < 0 && wish_q15 != CONTROLLER_COAST;
    return self->stopped ? CONTROLLER_STOP : wish_q15;
}

bool control_was_heavy(const Control *self) {
    return self->blow.busy ||
           (self->mode == TELEMETRY_MODE_TORQUE && torque_has_measured(&self->state.torque));
}

void control_report(const Control *self, TelemetryControl *out) {
    const uint16_t period_q4 = self->blow.period_q4;
    out->blow_count = self->blow.count & TELEMETRY_BLOW_COUNT_MAX;
    out->blow_period_ms =
        period_q4 < TELEMETRY_BLOW_PERIOD_MS_MAX ? period_q4 : TELEMETRY_BLOW_PERIOD_MS_MAX;
    switch (self->mode) { CONTROL_LIST(REPORT_CASE) }
    out->control_state = self->profile.acts ? 1u : 0u;
    out->stop_reason = self->stopped ? CONTROLLER_REASON_TIMEOUT : CONTROLLER_REASON_NONE;
    out->estimate = 0;
}
