// Choice of the controller, see control.h.
#include "app/control.h"

#include <stddef.h>
#include <string.h>

#include "app/param_store.h"
#include "core/inline.h"
#include "telemetry/telemetry_signals.h"

#define FORWARD_TERM(MODE, name, Type, directions) || (mode == TELEMETRY_MODE_##MODE && (directions) == CONTROL_FORWARD)
#define START_CASE(MODE, name, Type, directions)                                                                                                     \
    case TELEMETRY_MODE_##MODE:                                                                                                                      \
        fill_##name(&self->set.name, value);                                                                                                         \
        name##_start(&self->state.name, &self->set.name);                                                                                            \
        break;
#define STEP_CASE(MODE, name, Type, directions)                                                                                                      \
    case TELEMETRY_MODE_##MODE:                                                                                                                      \
        return name##_step(&self->state.name, &self->set.name, in, &self->blow);
#define REPORT_CASE(MODE, name, Type, directions)                                                                                                    \
    case TELEMETRY_MODE_##MODE:                                                                                                                      \
        out->control_state = name##_state(&self->state.name) & TELEMETRY_CONTROL_STATE_MAX;                                                          \
        out->stop_reason = name##_stop_reason(&self->state.name) & TELEMETRY_STOP_REASON_MAX;                                                        \
        out->estimate = name##_estimate(&self->state.name);                                                                                          \
        return;

// Setpoints out of the parameters. A controller's own parameters stand in the table in the order of its setpoints: they are copied as a block.

#define SAME_ORDER(Type, first, last, FIRST, LAST)                                                                                                   \
    _Static_assert(offsetof(Type, last) - offsetof(Type, first) == ((LAST) - (FIRST)) * sizeof(int16_t), "setpoints in the order of the parameters")
#define COPY(set, FIRST, LAST) (void)memcpy((set), &value[FIRST], ((LAST) - (FIRST) + 1) * sizeof(int16_t))

SAME_ORDER(BlowSetpoints, turn_q8, motor_rpm_per_v, PARAM_BLOW_TURN_Q8, PARAM_MOTOR_RPM_PER_V);
SAME_ORDER(SyncSetpoints, method, current_a_q9, PARAM_SYNC_METHOD, PARAM_SYNC_CURRENT_A_Q9);
SAME_ORDER(ScrewingSetpoints, share_q15, rise_q8, PARAM_SCREWING_SHARE_Q15, PARAM_SCREWING_RISE_Q8);
SAME_ORDER(VibrationSetpoints, method, hard_mv, PARAM_VIBRATION_METHOD, PARAM_VIBRATION_HARD_MV);

static void fill_sync(SyncSetpoints *set, const int16_t *value) {
    COPY(set, PARAM_SYNC_METHOD, PARAM_SYNC_CURRENT_A_Q9);
}

static void fill_screwing(ScrewingSetpoints *set, const int16_t *value) {
    COPY(&set->share_q15, PARAM_SCREWING_SHARE_Q15, PARAM_SCREWING_RISE_Q8);
    set->pulses = (uint8_t)value[PARAM_HALL_PULSES];
    set->turn_q8 = (uint16_t)value[PARAM_BLOW_TURN_Q8];
}

static void fill_torque(TorqueSetpoints *set, const int16_t *value) {
    set->target_nm = value[PARAM_TORQUE_TARGET_NM];
}

static void fill_vibration(VibrationSetpoints *set, const int16_t *value) {
    COPY(set, PARAM_VIBRATION_METHOD, PARAM_VIBRATION_HARD_MV);
    set->motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    set->motor_rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
}

static void fill_drill(DrillSetpoints *set, const int16_t *value) {
    set->clutch_dnm = value[PARAM_DRILL_CLUTCH_DNM];
    set->ratio_q8 = (uint16_t)value[PARAM_DRILL_RATIO_Q8];
    set->pulse = value[PARAM_DRILL_PULSE] != 0;
    set->kickback = value[PARAM_DRILL_KICKBACK] != 0;
    set->motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    set->rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
}

// Synchronisation finds the blows in what its method is named after.
static uint8_t blow_source(uint8_t mode, const int16_t *value) {
    if (mode != TELEMETRY_MODE_SYNC) {
        return (uint8_t)value[PARAM_BLOW_SOURCE];
    }
    return value[PARAM_SYNC_METHOD] == SYNC_METHOD_SPEED ? BLOW_SOURCE_SPEED : BLOW_SOURCE_CURRENT;
}

#define COUNT_TERM(MODE, name, Type, directions) +1
enum { MODE_LAST = 0 CONTROL_LIST(COUNT_TERM) };  // the plain mode is 0
#define IN_A_ROW(MODE, name, Type, directions) _Static_assert(TELEMETRY_MODE_##MODE <= MODE_LAST, "the modes of the list are numbered in a row");
CONTROL_LIST(IN_A_ROW)

bool control_has(uint8_t mode) {
    return mode <= MODE_LAST;
}

static bool forward_only(uint8_t mode) {
    return false CONTROL_LIST(FORWARD_TERM);
}

INLINE_NEVER void control_start(Control *self, uint8_t mode, bool reverse, const int16_t *value) {
    self->stopped = false;
    self->mode = control_has(mode) && !(reverse && forward_only(mode)) ? mode : TELEMETRY_MODE_DUTY;
    COPY(&self->blow_set, PARAM_BLOW_TURN_Q8, PARAM_MOTOR_RPM_PER_V);
    self->blow_set.source = blow_source(self->mode, value);
    blow_start(&self->blow, &self->blow_set);
    switch (self->mode) { CONTROL_LIST(START_CASE) }
    if (reverse && self->mode == TELEMETRY_MODE_DRILL) {  // clutch and pulse mode tighten; a jam kicks either way
        self->set.drill.clutch_dnm = 0;
        self->set.drill.pulse = false;
    }
}

static int16_t step(Control *self, const ControllerInputs *in) {
    switch (self->mode) { CONTROL_LIST(STEP_CASE) }
    return in->travel_q15;
}

int16_t control_step(Control *self, const ControllerInputs *in) {
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

void control_report(const Control *self, TelemetryControl *out) {
    const uint16_t period_q4 = self->blow.period_q4;
    out->blow_count = self->blow.count & TELEMETRY_BLOW_COUNT_MAX;
    out->blow_period_ms = period_q4 < TELEMETRY_BLOW_PERIOD_MS_MAX ? period_q4 : TELEMETRY_BLOW_PERIOD_MS_MAX;
    switch (self->mode) { CONTROL_LIST(REPORT_CASE) }
    out->control_state = 0;
    out->stop_reason = CONTROLLER_REASON_NONE;
    out->estimate = 0;
}
