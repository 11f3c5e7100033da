// Telemetry of a tick, see report.h.
#include "app/report.h"

#include "app/param_command.h"
#include "hal/hal.h"

#define RESET_BROWN_OUT 4u
#define RESET_WATCHDOG 8u

static uint16_t flags_of_start(uint8_t cause, uint8_t params) {
    uint16_t flags = 0;
    if ((cause & RESET_WATCHDOG) != 0u) {
        flags |= TELEMETRY_FLAGS_WATCHDOG_RESET;
    }
    if ((cause & RESET_BROWN_OUT) != 0u) {
        flags |= TELEMETRY_FLAGS_BROWN_OUT_RESET;
    }
    if (params == PARAM_BLANK || params == PARAM_CORRUPT) {
        flags |= TELEMETRY_FLAGS_PARAM_DEFAULTS;
    }
    if (params == PARAM_UNKNOWN_VERSION) {
        flags |= TELEMETRY_FLAGS_PARAM_DEFAULTS | TELEMETRY_FLAGS_PARAM_REFUSED;
    }
    return flags;
}

void report_start(App *app, uint32_t build_hash) {
    const TelemetryBoot boot = {
        .build_hash = build_hash,
        .duty_full_scale = HAL_COMPARE_MAX,
        .fast_divider = (uint8_t)app->params.value[PARAM_FAST_DIVIDER],
        .reset_cause = (uint8_t)(hal_reset_cause() & TELEMETRY_RESET_CAUSE_MAX),
        .target = hal_target(),
    };
    app->standing_flags = flags_of_start(boot.reset_cause, app->params.status);
    app->report.params = param_report(&app->params);
    telemetry_init(&app->telemetry, &boot, (uint8_t)app->params.value[PARAM_BAUD_SELECT]);
}

static void fill_state(const App *app, TelemetryState *state) {
    uint16_t flags = app->kept_flags | app->standing_flags;
    if (param_saving(&app->params)) {
        flags |= TELEMETRY_FLAGS_PARAM_SAVING;
    }
    if (app->calibrated) {
        flags |= TELEMETRY_FLAGS_CALIBRATED;
    }
    state->trigger = (uint8_t)((uint16_t)((uint16_t)app->trigger.travel_q15 << 1) >> 8);
    state->state = app->modes.state;
    state->mode = app->mode;
    state->reverse = app->modes.reverse;
    state->faults = app->faults.latched;
    state->flags = flags;
    state->contact = trigger_contact(&app->trigger);
}

// Saturating sum.
static uint8_t sum_u8(uint8_t a, uint8_t b) {
    return (uint8_t)(a > UINT8_MAX - b ? UINT8_MAX : a + b);
}

static void fill_health(const App *app, TelemetryHealth *health) {
    const uint16_t stack = hal_stack_free();
    health->worst_tick_cycles = app->worst_cycles;
    health->stack_free_bytes =
        stack < TELEMETRY_STACK_FREE_BYTES_MAX ? stack : TELEMETRY_STACK_FREE_BYTES_MAX;
    health->overruns = app->overruns;
    health->missed_edges = app->hall.missed;
    health->double_edges = app->hall.doubled < TELEMETRY_DOUBLE_EDGES_MAX
                               ? app->hall.doubled
                               : TELEMETRY_DOUBLE_EDGES_MAX;
    health->rx_errors = sum_u8(app->parser.errors, app->uart.receive_errors);
}

void report_tick(App *app) {
    TelemetryInputs *report = &app->report;
    const TelemetryFast fast = {
        .current_a = app->measured.current_a_q9,
        .speed_rpm = app->measured.speed_rpm_q1,
        .duty_compare = app->bridge.row_compare,
        .supply_v = app->measured.supply_25mv,
    };
    app->kept_flags |= app->measured.flags;
    if (!report->hold_state) {
        fill_state(app, &report->state);
        app->kept_flags = 0;
    }
    if (control_has_stepped(&app->control) &&
        (!report->hold_state || app->modes.state != MODES_DRIVE)) {
        control_report(&app->control, &report->control);  // kept until the next drive
    }
    if (!report->hold_slow && telemetry_health_due(&app->telemetry)) {
        fill_health(app, &report->health);
    }
    uint8_t *place[2];
    uart_places(&app->uart, place, app->spare);
    const uint8_t frames = telemetry_frames(&app->telemetry, report, &fast, place);
    if (telemetry_health_sent(&app->telemetry)) {
        app->worst_cycles = 0;
    }
    uart_send(&app->uart, frames);
}
