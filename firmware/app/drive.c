// Duty of a tick, see drive.h.
#include "app/drive.h"

#include "core/divide.h"
#include "core/slew.h"

static int16_t along(const App *app, int16_t value) {
    return app->modes.reverse ? (int16_t)(value == INT16_MIN ? INT16_MAX : -value) : value;
}

// A drive that resumes while the shaft still turns begins with the duty whose back-EMF share matches: from 0 it would brake with all it has.
static int16_t resumed_duty(const App *app, int16_t speed_rpm_q1) {
    if (app->ramp_speed_rpm_q1 <= 0 || speed_rpm_q1 <= 0) {
        return 0;
    }
    const uint16_t ramp_q15 = (uint16_t)app->ramp_duty_q15;
    const uint16_t duty_q15 = divide_u16((uint32_t)ramp_q15 * (uint16_t)speed_rpm_q1, (uint16_t)app->ramp_speed_rpm_q1);
    return (int16_t)(duty_q15 < ramp_q15 ? duty_q15 : ramp_q15);
}

static int16_t wish(App *app, ModesCommand command, const ControllerInputs *in) {
    if (command == MODES_COMMAND_RAMP_DOWN) {
        app->open_loop.duty_q15 = slew_towards(app->open_loop.duty_q15, 0, app->open_loop.slew_q15);
        return app->open_loop.duty_q15;
    }
    if (app->bridge.next_compare == H_BRIDGE_COAST && app->bridge.staged.phase == H_BRIDGE_OPEN) {
        app->open_loop.duty_q15 = resumed_duty(app, in->speed_rpm_q1);
        app->report.hold_slow = true;  // the division was this tick's share
    }
    return open_loop_step(&app->open_loop, in);
}

static int16_t coast(App *app) {
    foldback_init(&app->foldback, app->foldback.limit_a_q9);
    app->open_loop.duty_q15 = 0;
    return H_BRIDGE_COAST;
}

static int16_t limited_travel(const App *app) {
    if (app->duty_limit_q15 == INT16_MAX) {
        return app->trigger.travel_q15;  // the usual case
    }
    return (int16_t)(((uint32_t)(uint16_t)(2 * app->trigger.travel_q15) * (uint16_t)((uint16_t)app->duty_limit_q15 + 1u)) >> 16);
}

int16_t drive_step(App *app) {
    const ModesCommand command = modes_output(&app->modes, app->params.value[PARAM_RELEASE_MODE] != 0);
    if (command == MODES_COMMAND_COAST) {
        return coast(app);
    }
    const ControllerInputs in = {
        .travel_q15 = limited_travel(app),
        .speed_rpm_q1 = along(app, app->measured.speed_rpm_q1),
        .current_a_q9 = along(app, app->measured.current_a_q9),
        .supply_mv = app->measured.supply_mv,
    };
    const int16_t duty_q15 = foldback_step(&app->foldback, wish(app, command, &in), in.current_a_q9);
    if (foldback_active(&app->foldback)) {
        app->measured.flags |= TELEMETRY_FLAGS_FOLDBACK;
    }
    app->ramp_duty_q15 = duty_q15;
    app->ramp_speed_rpm_q1 = in.speed_rpm_q1;
    return h_bridge_compare(along(app, duty_q15));
}
