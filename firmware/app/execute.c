// Commands, see execute.h.
#include "app/execute.h"

#include "core/inline.h"

#include "app/calibrate.h"
#include "app/param_command.h"

#define BYTES_A_TICK                                                                               \
    2u  // some 70 commands a second with their ACKs; the queue holds three that come at once
#define CONFIGURE_STEPS 7u

static bool idle(const App *app) {
    return app->modes.state != MODES_DRIVE && app->modes.state != MODES_RELEASE &&
           app->modes.state != MODES_STOPPED;
}

bool execute_mode_may_change(const App *app) {
    return idle(app) && !trigger_contact(&app->trigger) && app->measured.standstill;
}

static void configure_limits(App *app) {
    const int16_t *value = app->params.value;
    app->current.gain_a_q15 = value[PARAM_CURRENT_GAIN_A_Q15];
    app->slew_q15 = value[PARAM_SLEW_PER_MS_Q15];
    app->foldback.limit_a_q9 = value[PARAM_FOLDBACK_A_Q9];
    app->fault_limits = (FaultLimits){
        .under_voltage_mv = (uint16_t)value[PARAM_UNDER_VOLTAGE_MV],
        .over_temperature_c_q4 = (int16_t)((uint8_t)value[PARAM_OVER_TEMPERATURE_C] * 16u),
        .stall_ms = (uint16_t)value[PARAM_STALL_MS],
    };
    app->bridge.dead_counts = (uint8_t)value[PARAM_DEAD_TIME_COUNT];
    const CurrentLimits limits = current_sense_limits(&app->current, value[PARAM_TRIP_A_Q9]);
    adc_sequence_set_trip(&app->adc, limits.low, limits.high);
}

static void configure_hall_pitch(App *app, uint8_t pitch) {
    hall_speed_set_pitch(&app->hall, pitch, app->params.value[PARAM_HALL_PITCH_0_Q15 + pitch]);
}

// 0: limits, 1: trigger, 2: Hall, 3..6: its pitches
void execute_parameters_step(App *app) {
    const int16_t *value = app->params.value;
    const uint8_t step = app->configure_step;
    if (step >= CONFIGURE_STEPS) {
        return;
    }
    if (step == 0u) {
        configure_limits(app);
    } else if (step == 1u) {
        trigger_set_ends(&app->trigger, (uint16_t)value[PARAM_TRIGGER_LOW_COUNT],
                         (uint16_t)value[PARAM_TRIGGER_HIGH_COUNT]);
    } else if (step == 2u) {
        hall_speed_configure(&app->hall, (uint8_t)value[PARAM_HALL_PULSES],
                             (uint16_t)value[PARAM_HALL_TIMEOUT_MS]);
    } else {
        configure_hall_pitch(app, (uint8_t)(step - 3u));
    }
    app->configure_step = (uint8_t)(step + 1u);
}

bool execute_parameters_pending(const App *app) {
    return app->configure_step < CONFIGURE_STEPS;
}

void execute_parameters(App *app) {
    app->configure_step = 0;
}

static uint8_t set_mode(App *app, const Command *command) {
    TelemetrySetMode set;
    (void)telemetry_unpack_set_mode(&set, command->data);
    if (!control_has(set.mode_request)) {
        return TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
    }
    if (!execute_mode_may_change(app) || trigger_mode(&app->trigger) != 0u) {
        return TELEMETRY_ACK_RESULT_NOT_NOW;
    }
    app->host_mode = set.mode_request;
    return TELEMETRY_ACK_RESULT_OK;
}

static uint8_t set_point(App *app, const Command *command) {
    TelemetrySetpoint set;
    (void)telemetry_unpack_setpoint(&set, command->data);
    if (set.setpoint_which == TELEMETRY_SETPOINT_WHICH_TORQUE_TARGET_NM) {
        if (!idle(app)) {
            return TELEMETRY_ACK_RESULT_NOT_NOW;
        }
        return param_try(&app->params, PARAM_TORQUE_TARGET_NM, set.setpoint_value)
                   ? TELEMETRY_ACK_RESULT_OK
                   : TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
    }
    if (set.setpoint_which != TELEMETRY_SETPOINT_WHICH_DUTY_LIMIT_Q15 || set.setpoint_value < 0 ||
        set.setpoint_value > INT16_MAX) {
        return TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
    }
    app->duty_limit_q15 = (int16_t)set.setpoint_value;
    return TELEMETRY_ACK_RESULT_OK;
}

static uint8_t take_profile(App *app, const Command *command) {
    TelemetryProfile frame;
    if (!telemetry_unpack_profile(&frame, command->data)) {
        return TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
    }
    if (app->mode != TELEMETRY_MODE_DUTY) {
        return TELEMETRY_ACK_RESULT_NOT_NOW;
    }
    profile_take(&app->control.profile, frame.profile_duty_q15);
    return TELEMETRY_ACK_RESULT_OK;
}

static uint8_t calibrate(App *app, const Command *command) {
    TelemetryCalibrate ask;
    if (!telemetry_unpack_calibrate(&ask, command->data)) {
        return TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
    }
    return calibrate_begin(app, ask.calibrate_what) ? TELEMETRY_ACK_RESULT_OK
                                                    : TELEMETRY_ACK_RESULT_NOT_NOW;
}

static uint8_t execute(App *app, const Command *command) {
    switch (command->id) {
    case TELEMETRY_SET_MODE_ID:
        return set_mode(app, command);
    case TELEMETRY_SETPOINT_ID:
        return set_point(app, command);
    case TELEMETRY_CALIBRATE_ID:
        return calibrate(app, command);
    case TELEMETRY_PROFILE_ID:
        return take_profile(app, command);
    }
    const uint8_t result = param_command(&app->params, &app->telemetry, command, idle(app));
    if (command->id == TELEMETRY_PARAM_WRITE_ID && result == TELEMETRY_ACK_RESULT_OK) {
        execute_parameters(app);
    }
    return result;
}

INLINE_NEVER static void answer(App *app) {
    if (app->command.fresh) {
        app->command.result = execute(app, &app->command);
    }
    command_answered(&app->parser, &app->command, &app->telemetry);
    app->command_waits = false;
}

bool execute_pending(const App *app) {
    return !telemetry_ack_waits(&app->telemetry) &&
           (app->command_waits || !command_wants(&app->parser) || uart_received(&app->uart));
}

void execute_received(App *app) {
    uint8_t byte = 0;
    if (app->command_waits) {
        answer(app);
        return;
    }
    if (!command_wants(&app->parser)) {
        app->command_waits = command_step(&app->parser, &app->command);
        return;
    }
    for (uint8_t k = BYTES_A_TICK;
         k > 0u && command_wants(&app->parser) && uart_receive(&app->uart, &byte); k--) {
        command_byte(&app->parser, byte);
    }
}
