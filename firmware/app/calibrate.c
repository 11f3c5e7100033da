// Calibrations, see calibrate.h.
#include "app/calibrate.h"

#include "app/execute.h"

bool calibrate_begin(App *app, uint8_t what) {
    if (app->modes.state != MODES_IDLE && app->modes.state != MODES_CALIBRATE) {
        return false;
    }
    app->calibration = what;
    app->save_offset = true;
    app->calibrated = false;
    current_sense_rest_begin(&app->current);
    return true;
}

static void offset_step(App *app) {
    bool implausible = false;
    if (!current_sense_rest(&app->current, app->measured.adc.current_sum, app->measured.adc.current_count, &implausible)) {
        return;
    }
    app->calibration = TELEMETRY_CALIBRATE_WHAT_CANCEL;
    app->faults.current_implausible = implausible;
    app->calibrated = app->save_offset && !implausible;
    if (app->calibrated) {
        (void)param_set(&app->params, PARAM_CURRENT_OFFSET_COUNT_Q4, app->current.offset_q4);
    }
    execute_parameters(app);
}

void calibrate_step(App *app) {
    if (app->calibration == TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET && app->modes.state == MODES_CALIBRATE) {
        offset_step(app);
    }
}

bool calibrate_holds(const App *app) {
    return app->calibration == TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET || app->calibration == TELEMETRY_CALIBRATE_WHAT_TRIGGER;
}
