// Calibrations, see calibrate.h.
#include "app/calibrate.h"

#include "app/configure.h"
#include "core/inline.h"
#include "hal/hal.h"

#define TRIGGER_TICKS 5000u
#define TRIGGER_SPAN_MIN 200u  // counts; less: the trigger was not moved

bool calibrate_begin(App *app, uint8_t what) {
    if (app->modes.state != MODES_IDLE && app->modes.state != MODES_CALIBRATE) {
        return false;
    }
    app->calibration = what;
    app->save_offset = true;
    app->calibrated = false;
    app->calibration_ticks = 0;
    app->trigger_least = UINT16_MAX;
    app->trigger_greatest = 0;
    current_sense_rest_begin(&app->current);
    hall_speed_learn(&app->hall, what == TELEMETRY_CALIBRATE_WHAT_HALL_PITCH);
    return true;
}

static void offset_step(App *app) {
    bool implausible = false;
    if (!current_sense_rest(&app->current, app->measured.adc.current_sum,
                            app->measured.adc.current_count, &implausible)) {
        return;
    }
    app->calibration = TELEMETRY_CALIBRATE_WHAT_CANCEL;
    app->faults.current_implausible = implausible;
    app->calibrated = app->save_offset && !implausible;
    if (app->calibrated) {
        (void)param_set(&app->params, PARAM_CURRENT_OFFSET_COUNT_Q4, app->current.offset_q4);
    }
    configure_begin(app);
}

// Ends of the travel: the extremes that the user reached in five seconds, less 1/32 of their
// distance.
static void trigger_step(App *app) {
    const AdcTick *adc = &app->measured.adc;
    if ((adc->fresh & (1u << HAL_ADC_TRIGGER)) != 0u) {
        const uint16_t counts = adc->latest[HAL_ADC_TRIGGER];
        app->trigger_least = counts < app->trigger_least ? counts : app->trigger_least;
        app->trigger_greatest = counts > app->trigger_greatest ? counts : app->trigger_greatest;
    }
    app->calibration_ticks++;
    if (app->calibration_ticks < TRIGGER_TICKS) {
        return;
    }
    const uint16_t span = (uint16_t)(app->trigger_greatest > app->trigger_least
                                         ? app->trigger_greatest - app->trigger_least
                                         : 0);
    const uint16_t margin = span >> 5;
    const bool wide = span >= TRIGGER_SPAN_MIN;
    app->calibrated =
        wide && param_set(&app->params, PARAM_TRIGGER_LOW_COUNT, app->trigger_least + margin) &&
        param_set(&app->params, PARAM_TRIGGER_HIGH_COUNT, app->trigger_greatest - margin);
    app->calibration = TELEMETRY_CALIBRATE_WHAT_CANCEL;
    configure_begin(app);
}

bool calibrate_pitch_due(const App *app) {
    return app->hall.learned && app->calibration == TELEMETRY_CALIBRATE_WHAT_HALL_PITCH;
}

INLINE_NEVER void calibrate_pitch(App *app) {
    const uint8_t k = (uint8_t)app->calibration_ticks;
    const uint8_t pitch =
        (uint8_t)(app->hall.reverse ? (HALL_SPACING_PITCHES - k) % HALL_SPACING_PITCHES
                                    : k);  // stored for forward rotation
    const bool taken = param_set(&app->params, (ParamIndex)(PARAM_HALL_PITCH_0_Q15 + pitch),
                                 hall_spacing_share(&app->hall.spacing, k));
    app->hall_taken = taken && (k == 0u || app->hall_taken);
    app->calibration_ticks++;
    if (app->calibration_ticks < HALL_SPACING_PITCHES) {
        return;
    }
    app->hall.learned = false;
    app->calibration = TELEMETRY_CALIBRATE_WHAT_CANCEL;
    app->calibrated = app->hall_taken;
    configure_begin(app);
}

INLINE_NEVER void calibrate_step(App *app) {
    if (app->modes.state != MODES_CALIBRATE) {
        return;
    }
    if (app->calibration == TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET) {
        offset_step(app);
    } else if (app->calibration == TELEMETRY_CALIBRATE_WHAT_TRIGGER) {
        trigger_step(app);
    }
}

bool calibrate_holds(const App *app) {
    return app->calibration == TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET ||
           app->calibration == TELEMETRY_CALIBRATE_WHAT_TRIGGER;
}
