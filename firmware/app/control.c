// Choice of the controller, see control.h.
#include "app/control.h"

#include "app/param_store.h"
#include "telemetry/telemetry_signals.h"

#define HAS_CASE(MODE, name, Type, directions) case TELEMETRY_MODE_##MODE:
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

// Setpoints out of the parameters, one function for each controller of the list.

static void fill_sync(SyncSetpoints *set, const int16_t *value) {
    set->method = (uint8_t)value[PARAM_SYNC_METHOD];
    set->low_mv = value[PARAM_SYNC_LOW_MV];
    set->high_mv = value[PARAM_SYNC_HIGH_MV];
    set->depth_min_q15 = value[PARAM_SYNC_DEPTH_MIN_Q15];
    set->depth_max_q15 = value[PARAM_SYNC_DEPTH_MAX_Q15];
    set->current_a_q9 = value[PARAM_SYNC_CURRENT_A_Q9];
}

static void fill_screwing(ScrewingSetpoints *set, const int16_t *value) {
    set->pulses = (uint8_t)value[PARAM_HALL_PULSES];
    set->turn_q8 = (uint16_t)value[PARAM_BLOW_TURN_Q8];
    set->share_q15 = value[PARAM_SCREWING_SHARE_Q15];
    set->share_hard_q15 = value[PARAM_SCREWING_SHARE_HARD_Q15];
    set->hard_turn_deg_q4 = value[PARAM_SCREWING_HARD_TURN_DEG_Q4];
    set->rise_q8 = value[PARAM_SCREWING_RISE_Q8];
}

// Synchronisation finds the blows in what its method is named after.
static uint8_t blow_source(uint8_t mode, const int16_t *value) {
    if (mode != TELEMETRY_MODE_SYNC) {
        return (uint8_t)value[PARAM_BLOW_SOURCE];
    }
    return value[PARAM_SYNC_METHOD] == SYNC_METHOD_SPEED ? BLOW_SOURCE_SPEED : BLOW_SOURCE_CURRENT;
}

static void fill_blow(BlowSetpoints *set, uint8_t mode, const int16_t *value) {
    set->turn_q8 = (uint16_t)value[PARAM_BLOW_TURN_Q8];
    set->motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    set->motor_rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
    set->source = blow_source(mode, value);
}

static void fill_torque(TorqueSetpoints *set, const int16_t *value) {
    set->target_nm = value[PARAM_TORQUE_TARGET_NM];
}

static void fill_vibration(VibrationSetpoints *set, const int16_t *value) {
    set->method = (uint8_t)value[PARAM_VIBRATION_METHOD];
    set->motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    set->motor_rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
    set->approach_q15 = value[PARAM_VIBRATION_APPROACH_Q15];
    set->climb_q15 = value[PARAM_VIBRATION_CLIMB_Q15];
    set->climb_per_ms_q15 = value[PARAM_VIBRATION_CLIMB_PER_MS_Q15];
    set->climb_turn_q8 = (uint16_t)value[PARAM_VIBRATION_CLIMB_TURN_Q8];
    set->surge_a_q9 = value[PARAM_VIBRATION_SURGE_A_Q9];
    set->hard_share_q15 = value[PARAM_VIBRATION_HARD_SHARE_Q15];
    set->hard_mv = (uint16_t)value[PARAM_VIBRATION_HARD_MV];
}

static void fill_drill(DrillSetpoints *set, const int16_t *value) {
    set->clutch_dnm = value[PARAM_DRILL_CLUTCH_DNM];
    set->ratio_q8 = (uint16_t)value[PARAM_DRILL_RATIO_Q8];
    set->motor_mohm = (uint16_t)value[PARAM_MOTOR_MOHM];
    set->rpm_per_v = (uint16_t)value[PARAM_MOTOR_RPM_PER_V];
    set->pulse = value[PARAM_DRILL_PULSE] != 0;
    set->kickback = value[PARAM_DRILL_KICKBACK] != 0;
}

bool control_has(uint8_t mode) {
    switch (mode) {
    case TELEMETRY_MODE_DUTY:
        CONTROL_LIST(HAS_CASE)
        return true;
    }
    return false;
}

static bool forward_only(uint8_t mode) {
    return false CONTROL_LIST(FORWARD_TERM);
}

void control_start(Control *self, uint8_t mode, bool reverse, const int16_t *value) {
    self->stopped = false;
    self->mode = control_has(mode) && !(reverse && forward_only(mode)) ? mode : TELEMETRY_MODE_DUTY;
    fill_blow(&self->blow_set, self->mode, value);
    blow_start(&self->blow, &self->blow_set);
    switch (self->mode) { CONTROL_LIST(START_CASE) }
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
