// Duty of a tick, see drive.h.
#include "app/drive.h"

#include "core/divide.h"
#include "core/slew.h"
#include "hal/hal.h"

// The value counted positive in the direction of the drive; -32768 becomes 32767.
static int16_t along(const App *app, int16_t value) {
    return app->modes.reverse ? (int16_t)(value == INT16_MIN ? INT16_MAX : -value) : value;
}

// A drive that begins with a turning shaft starts at the duty whose voltage equals the back-EMF:
// duty 0 would short the motor and brake it.
static int16_t resumed_duty(const App *app, int16_t speed_rpm_q1) {
    if (app->ramp_speed_rpm_q1 <= 0 || speed_rpm_q1 <= 0) {
        return 0;
    }
    const uint16_t ramp_q15 = (uint16_t)app->ramp_duty_q15;
    const uint16_t duty_q15 = divide_by_u16((uint32_t)ramp_q15 * (uint16_t)speed_rpm_q1,
                                            (uint16_t)app->ramp_speed_rpm_q1);
    return (int16_t)(duty_q15 < ramp_q15 ? duty_q15 : ramp_q15);
}

// Travel of the trigger times the duty limit.
static int16_t limited_travel(const App *app) {
    if (app->duty_limit_q15 == INT16_MAX) {
        return app->trigger.travel_q15;  // most ticks
    }
    return (int16_t)(((uint32_t)(uint16_t)(2 * app->trigger.travel_q15) *
                      (uint16_t)((uint16_t)app->duty_limit_q15 + 1u)) >>
                     16);
}

// Ramped trigger: the duty of the plain mode, and the trigger input of the controllers.
static int16_t ramp(App *app, ModesCommand command, int16_t wanted_q15) {
    if (app->controlled && command == MODES_COMMAND_RAMP_DOWN &&
        app->requested_q15 < app->ramp_q15) {
        app->ramp_q15 = app->requested_q15;  // no more than the controller's duty
    }
    const bool releases = command == MODES_COMMAND_RAMP_DOWN;
    app->ramp_q15 =
        slew_towards(app->ramp_q15, wanted_q15, releases ? app->run_down_q15 : app->slew_q15);
    return app->ramp_q15;
}

// Duty applied in the tick just measured. A count of the compare value is 2^15 / 255 in Q15,
// computed as 257 / 2.
static int16_t applied_duty_q15(const App *app) {
    const int16_t compare = app->bridge.row_compare;
    return (int16_t)(compare == H_BRIDGE_COAST
                         ? 0
                         : (uint16_t)((uint16_t)(compare < 0 ? -compare : compare) * 257u) >> 1);
}

// The duty at which the next drive would begin is computed before it, since a first tick has no
// cycles for the division.
static int16_t coast(App *app) {
    app->ramp_q15 = resumed_duty(app, along(app, app->measured.speed_rpm_q1));
    foldback_reset(&app->foldback);
    app->driving = false;
    app->controlled = false;
    balance_reset(&app->balance);
    app->faults.contradiction = false;
    return H_BRIDGE_COAST;
}

// Duty that the controller returns; a released trigger ends its drive.
static int16_t requested_duty(App *app, ModesCommand command, const ControllerInputs *in) {
    if (command == MODES_COMMAND_RAMP_DOWN) {
        app->controlled = false;
        return in->travel_q15;
    }
    app->controlled = true;
    hal_mark_control(true);
    const int16_t requested_q15 = control_step(&app->control, in);
    hal_mark_control(false);
    if (control_was_heavy(&app->control)) {
        app->heavy = true;
    }
    return requested_q15;
}

// At most the duty limit. When the limit is lowered in a drive, the duty falls to it at the slew
// rate: a step would brake with a large current.
static int16_t limited_duty(const App *app, int16_t duty_q15) {
    const int16_t falling_q15 = (int16_t)(app->requested_q15 - app->slew_q15);
    const int16_t most_q15 = falling_q15 > app->duty_limit_q15 ? falling_q15 : app->duty_limit_q15;
    return duty_q15 < most_q15 ? duty_q15 : most_q15;
}

// Keeps duty and speed for resumed_duty(); not while braking, when duty and speed do not match.
static void note_driven(App *app, int16_t duty_q15, const ControllerInputs *in) {
    if (in->current_a_q9 >= 0) {
        app->ramp_duty_q15 = duty_q15;
        app->ramp_speed_rpm_q1 = in->speed_rpm_q1;
    }
}

int16_t drive_step(App *app) {
    app->heavy = false;
    const ModesCommand command =
        modes_output(&app->modes, app->params.value[PARAM_RELEASE_MODE] != 0 &&
                                      app->bridge.staged.phase != H_BRIDGE_OPEN);
    if (command == MODES_COMMAND_COAST) {
        return coast(app);
    }
    const int16_t speed_rpm_q1 = along(app, app->measured.speed_rpm_q1);
    ControllerInputs *const in = &app->control.in;
    in->trigger_q15 = command == MODES_COMMAND_RAMP_DOWN ? 0 : limited_travel(app);
    in->travel_q15 = ramp(app, command, in->trigger_q15);
    if (command == MODES_COMMAND_RAMP_DOWN && in->travel_q15 == 0) {
        return coast(app);  // no braking after the run-down
    }
    in->speed_rpm_q1 = speed_rpm_q1;
    in->current_a_q9 = along(app, app->measured.current_a_q9);
    in->supply_mv = app->measured.supply_mv;
    in->duty_q15 = applied_duty_q15(app);
    in->coasted = app->bridge.row_compare == H_BRIDGE_COAST;
    in->edges = app->hall.new_edges;
    app->driving = true;
    const int16_t requested_q15 = limited_duty(app, requested_duty(app, command, in));
    app->requested_q15 = requested_q15;
    const int16_t duty_q15 = foldback_step(&app->foldback, requested_q15, in->current_a_q9);
    if (foldback_active(&app->foldback)) {
        app->measured.flags |= TELEMETRY_FLAGS_FOLDBACK;
    }
    if (requested_q15 < 0) {
        return H_BRIDGE_COAST;
    }
    note_driven(app, duty_q15, in);
    return h_bridge_compare(along(app, duty_q15));
}
