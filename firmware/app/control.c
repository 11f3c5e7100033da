// Dispatch to the controller of the mode, see control.h; the cases are generated from CONTROL_LIST.
#include "app/control.h"

#include "core/flash.h"
#include "core/inline.h"

#define HAS_TERM(MODE, name, Type, ...) || mode == TELEMETRY_MODE_##MODE
#define FORWARD_TERM(MODE, name, Type, directions, ...)                                            \
    || (mode == TELEMETRY_MODE_##MODE && (directions) == CONTROL_FORWARD)
#define BLOWS_TERM(MODE, name, Type, directions, reversed, blows, ...)                             \
    || (mode == TELEMETRY_MODE_##MODE && (blows) == source)
#define HEAVY_TERM(MODE, name, Type, directions, reversed, blows, heavy, ...)                      \
    || (self->mode == TELEMETRY_MODE_##MODE && heavy(&self->state.name))
#define START_CASE(MODE, name, Type, directions, reversed, ...)                                    \
    case TELEMETRY_MODE_##MODE:                                                                    \
        name##_start(&self->state.name, &self->set.name);                                          \
        if (reverse) {                                                                             \
            reversed(&self->set.name);                                                             \
        }                                                                                          \
        break;
#define STEP_CASE(MODE, name, Type, ...)                                                           \
    case TELEMETRY_MODE_##MODE:                                                                    \
        return name##_step(&self->state.name, &self->set.name, in, &self->blow);
#define REPORT_CASE(MODE, name, Type, ...)                                                         \
    case TELEMETRY_MODE_##MODE:                                                                    \
        out->control_state = name##_state(&self->state.name) & TELEMETRY_CONTROL_STATE_MAX;        \
        out->stop_reason = name##_stop_reason(&self->state.name) & TELEMETRY_STOP_REASON_MAX;      \
        out->estimate = name##_estimate(&self->state.name);                                        \
        return;

// Parameter of each setpoint, in the order of the struct; unused places of a row are 0.
#define SOURCE_ROW(MODE, name, Type, directions, reversed, blows, heavy, ...)                      \
    [TELEMETRY_MODE_##MODE] = {__VA_ARGS__},
#define SOURCE_COUNT_CHECK(MODE, name, Type, directions, reversed, blows, heavy, ...)              \
    _Static_assert(sizeof(Type##Setpoints) / sizeof(int16_t) == sizeof((uint8_t[]){__VA_ARGS__}),  \
                   "a parameter for each setpoint");
CONTROL_LIST(SOURCE_COUNT_CHECK)
static const uint8_t sources[][CONTROL_SETPOINTS_MAX] FLASH_TABLE = {CONTROL_LIST(SOURCE_ROW)};

#define COUNT_TERM(MODE, name, Type, ...) +1
enum {
    MODES_LISTED = CONTROL_LIST_ALL(COUNT_TERM),
};
_Static_assert(MODES_LISTED == TELEMETRY_MODE_LAST, "an entry for each mode of the DBC");

bool control_has(uint8_t mode) {
    return mode == TELEMETRY_MODE_DUTY CONTROL_LIST(HAS_TERM);
}

uint8_t control_built(uint8_t mode) {
    return control_has(mode) ? mode : TELEMETRY_MODE_DUTY;
}

static bool forward_only(uint8_t mode) {
    return false CONTROL_LIST(FORWARD_TERM);
}

static bool blows_are(uint8_t mode, uint8_t source) {
    return false CONTROL_LIST(BLOWS_TERM);
}

// `method`: the first setpoint of the mode.
static uint8_t blow_source(uint8_t mode, int16_t method, const int16_t *value) {
    if (!blows_are(mode, CONTROL_BLOWS_BY_METHOD)) {
        return (uint8_t)value[PARAM_BLOW_SOURCE];
    }
    return method == CONTROLLER_METHOD_SPEED ? BLOW_SOURCE_SPEED : BLOW_SOURCE_CURRENT;
}

INLINE_NEVER bool control_prepare(Control *self, uint8_t mode, const int16_t *value) {
    const uint8_t *source = sources[mode];
    int16_t *const last = &self->set.words[CONTROL_SETPOINTS_MAX];
    uint16_t changed = 0;
    for (int16_t *word = self->set.words; word != last; word++, source++) {
        const int16_t now = value[FLASH_U8(source)];
        changed |= (uint16_t)(now ^ *word);
        *word = now;
    }
    self->blow_set.turn_q8 = (uint16_t)value[PARAM_BLOW_TURN_Q8];
    self->blow_set.source = blow_source(mode, self->set.words[0], value);
    self->blow_set.motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    self->blow_set.motor_rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
    return changed != 0u;
}

INLINE_NEVER void control_start(Control *self, uint8_t mode, bool reverse) {
    self->stopped = false;
    self->stepped = false;
    self->start_due = false;
    self->asked = mode;
    self->asked_reverse = reverse;
    self->mode = reverse && forward_only(mode) ? TELEMETRY_MODE_DUTY : control_built(mode);
    blow_start(&self->blow, &self->blow_set);
    switch (self->mode) { CONTROL_LIST(START_CASE) }
}

void control_ready(Control *self, uint8_t mode, bool reverse, const int16_t *value) {
    if (self->start_due) {
        control_start(self, mode, reverse);
    } else {
        const bool changed = control_prepare(self, mode, value);
        self->start_due =
            changed || self->stepped || mode != self->asked || reverse != self->asked_reverse;
    }
}

static int16_t step(Control *self, const ControllerInputs *in) {
    switch (self->mode) { CONTROL_LIST(STEP_CASE) }
    return profile_duty(&self->profile, in->travel_q15);
}

INLINE_NEVER int16_t control_step(Control *self, const ControllerInputs *in) {
    self->stepped = true;
    if (self->stopped) {
        return CONTROLLER_STOP;
    }
    if (!blows_are(self->mode, CONTROL_BLOWS_NONE)) {
        blow_step(&self->blow, &self->blow_set, in);
    }
    const int16_t requested_q15 = step(self, in);
    self->stopped = requested_q15 < 0 && requested_q15 != CONTROLLER_COAST;
    return self->stopped ? CONTROLLER_STOP : requested_q15;
}

bool control_was_heavy(const Control *self) {
    if (self->blow.busy) {
        return true;
    }
    return false CONTROL_LIST(HEAVY_TERM);
}

bool control_has_stepped(const Control *self) {
    return self->stepped;
}

void control_report(const Control *self, TelemetryControl *out) {
    const uint16_t period_q4 = self->blow.period_q4;
    out->blow_count = self->blow.count & TELEMETRY_BLOW_COUNT_MAX;
    out->blow_period_ms =
        period_q4 < TELEMETRY_BLOW_PERIOD_MS_MAX ? period_q4 : TELEMETRY_BLOW_PERIOD_MS_MAX;
    switch (self->mode) { CONTROL_LIST(REPORT_CASE) }
    out->control_state = (uint8_t)profile_state(&self->profile);
    out->stop_reason = self->stopped ? CONTROLLER_REASON_TIMEOUT : CONTROLLER_REASON_NONE;
    out->estimate = 0;
}
