// Commands, see execute.h.
#include "app/execute.h"

#include "app/calibrate.h"
#include "app/configure.h"
#include "app/param_command.h"
#include "core/inline.h"

#define BYTES_PER_TICK                                                                             \
    2u  // about 70 commands/s with their ACKs; the receive queue holds three commands

static bool idle(const App *app) {
    return app->modes.state != MODES_DRIVE && app->modes.state != MODES_RELEASE &&
           app->modes.state != MODES_STOPPED;
}

bool execute_mode_may_change(const App *app) {
    return idle(app) && !trigger_contact(&app->trigger) && app->measured.standstill;
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

// Whether a PARAM_WRITE sets a parameter to a mode that this build does not have.
static bool writes_missing_mode(const Command *command) {
    TelemetryParamWrite write;
    (void)telemetry_unpack_param_write(&write, command->data);
    const uint8_t index = write.write_index;
    const bool is_mode = index == PARAM_MODE || index == PARAM_MODE_SWITCH_1 ||
                         index == PARAM_MODE_SWITCH_2 || index == PARAM_MODE_SWITCH_3;
    return is_mode && !control_has((uint8_t)write.write_value);
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
    if (command->id == TELEMETRY_PARAM_WRITE_ID && writes_missing_mode(command)) {
        return TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
    }
    const uint8_t result = param_command(&app->params, &app->telemetry, command, idle(app));
    if (command->id == TELEMETRY_PARAM_WRITE_ID && result == TELEMETRY_ACK_RESULT_OK) {
        configure_begin(app);
    }
    return result;
}

INLINE_NEVER static void answer(App *app) {
    if (app->command.fresh) {
        app->command.result = execute(app, &app->command);
    }
    command_answered(&app->parser, &app->command, &app->telemetry);
    app->command_pending = false;
}

bool execute_pending(const App *app) {
    return !telemetry_ack_pending(&app->telemetry) &&
           (app->command_pending || !command_reading(&app->parser) || uart_received(&app->uart));
}

bool execute_answers(const App *app) {
    return app->command_pending || !command_reading(&app->parser);
}

void execute_received(App *app) {
    uint8_t byte = 0;
    if (app->command_pending) {
        answer(app);
        return;
    }
    if (!command_reading(&app->parser)) {
        app->command_pending = command_step(&app->parser, &app->command);
        return;
    }
    for (uint8_t k = BYTES_PER_TICK;
         k > 0u && command_reading(&app->parser) && uart_receive(&app->uart, &byte); k--) {
        command_byte(&app->parser, byte);
    }
}
