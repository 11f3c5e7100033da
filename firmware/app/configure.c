// Parameters to drivers, see configure.h.
#include "app/configure.h"

// Steps in their order; each Hall pitch is a step of its own.
typedef enum {
    STEP_LIMITS,
    STEP_TRIGGER,
    STEP_BALANCE,
    STEP_HALL,
    STEP_PITCH,
    STEP_DONE = STEP_PITCH + HALL_SPACING_PITCHES,
} Step;

static void configure_limits(App *app) {
    const int16_t *value = app->params.value;
    app->current.gain_a_q15 = value[PARAM_CURRENT_GAIN_A_Q15];
    app->slew_q15 = value[PARAM_SLEW_PER_MS_Q15];
    app->run_down_q15 = value[PARAM_RUN_DOWN_PER_MS_Q15];
    foldback_init(&app->foldback, value[PARAM_FOLDBACK_A_Q9]);
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

void configure_step(App *app) {
    const int16_t *value = app->params.value;
    const uint8_t step = app->configuration_step;
    if (step >= STEP_DONE) {
        return;
    }
    if (step == STEP_LIMITS) {
        configure_limits(app);
    } else if (step == STEP_TRIGGER) {
        trigger_set_ends(&app->trigger, (uint16_t)value[PARAM_TRIGGER_LOW_COUNT],
                         (uint16_t)value[PARAM_TRIGGER_HIGH_COUNT]);
    } else if (step == STEP_BALANCE) {
        balance_set_motor(&app->balance, value[PARAM_MOTOR_MOHM],
                          (uint16_t)value[PARAM_MOTOR_RPM_PER_V]);
    } else if (step == STEP_HALL) {
        hall_speed_configure(&app->hall, (uint8_t)value[PARAM_HALL_PULSES],
                             (uint16_t)value[PARAM_HALL_TIMEOUT_MS]);
    } else {
        configure_hall_pitch(app, (uint8_t)(step - STEP_PITCH));
    }
    app->configuration_step = (uint8_t)(step + 1u);
}

bool configure_pending(const App *app) {
    return app->configuration_step < STEP_DONE;
}

void configure_begin(App *app) {
    app->configuration_step = STEP_LIMITS;
}
