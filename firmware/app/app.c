// Start, tick and interrupts of the firmware, see app.h.
#include "app/app.h"

#include "app/calibrate.h"
#include "app/configure.h"
#include "app/drive.h"
#include "app/execute.h"
#include "app/report.h"
#include "core/inline.h"
#include "hal/hal.h"

#define OVERRUN_FAULT_TICKS 2u
#ifndef APP_START_MS
#define APP_START_MS 0u  // the telemetry's time at the start; a test sets it near 2^32
#endif
#define FULL_TICKS_MAX 30u  // most ticks in a row without slow work because of edges

void app_init(App *self, uint32_t build_hash) {
    *self = (App){.duty_limit_q15 = INT16_MAX,
                  .calibration = TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET,
                  .report = {.now_ms = APP_START_MS}};
    param_load(&self->params);
    adc_sequence_init(&self->adc);
    current_sense_init(&self->current, self->params.value[PARAM_CURRENT_GAIN_A_Q15],
                       self->params.value[PARAM_CURRENT_OFFSET_COUNT_Q4]);
    h_bridge_init(&self->bridge, (uint8_t)self->params.value[PARAM_DEAD_TIME_COUNT]);
    trigger_init(&self->trigger);
    self->host_mode = control_built((uint8_t)self->params.value[PARAM_MODE]);
    self->mode = self->host_mode;
    modes_init(&self->modes);
    uart_init(&self->uart, (uint8_t)self->params.value[PARAM_BAUD_SELECT]);
    while (configure_pending(self)) {
        configure_step(self);
    }
    report_start(self, build_hash);
}

static void read_inputs(App *self) {
    trigger_set_switches(&self->trigger,
                         hal_switches());  // first, next to the tick: no hardware latches the pins
    h_bridge_next_row(&self->bridge);
    measure_analog(&self->measured, &self->adc, &self->current, &self->trigger,
                   self->params.value[PARAM_BUS_GAIN_MV_Q8]);
    measure_speed(&self->measured, &self->hall);
    if (self->measured.adc.trips) {
        h_bridge_note_trip(&self->bridge);
    }
}

static void find_faults(App *self) {
    const FaultsDrive drive = {.compare = self->bridge.row_compare,
                               .new_edge = self->hall.new_edges > 0u,
                               .goes_on = self->driving};
    faults_step(&self->faults, &self->measured, &self->fault_limits, &drive);
}

// Whether the shaft stands. Called only in ticks with a Hall speed of 0, since it needs many
// cycles.
INLINE_NEVER static bool rests(App *self) {
    const bool ended = self->standstill.turned;  // the speed has become 0 in this tick
    const bool coasts = self->bridge.row_compare == H_BRIDGE_COAST;
    const bool settled = self->faults.settled_ms >= FAULTS_SETTLED_MS;
    // The shaft may turn although the sensor gives no edges.
    const bool unseen = (self->faults.active & TELEMETRY_FAULTS_SENSOR_LOST) != 0u ||
                        (ended && settled &&
                         !faults_draws_like_standing(&self->measured, self->bridge.row_compare));
    const StandstillInputs in = {
        .lost = !coasts && unseen,
        .coasts = coasts,
        .ended_rpm_q1 = ended ? hall_speed_last_rpm_q1(&self->hall) : 0u,
    };
    return standstill_step(&self->standstill, &in);
}

// Standstill by the Hall sensor, confirmed by current and run-down time (standstill.h).
static void find_standstill(App *self) {
    const int16_t compare = self->bridge.row_compare;
    if (self->hall.new_edges > 0u) {
        self->standstill.driven_ms = 0;
    } else if (compare != H_BRIDGE_COAST && standstill_driven(&self->standstill, compare)) {
        self->standstill.stood = faults_draws_like_standing(&self->measured, compare);
    }
    if (self->measured.standstill) {
        self->measured.standstill = rests(self);
    } else {
        self->standstill.turned = true;
    }
}

static void step_modes(App *self) {
    const uint8_t before = self->modes.state;
    const ModesInputs in = {
        .pressed = trigger_pressed(&self->trigger) && !self->control.start_due,
        .contact = trigger_contact(&self->trigger),
        .reverse_switch = trigger_reverse(&self->trigger),
        .standstill = self->measured.standstill,
        .fault = self->faults.latched != 0u,
        .fault_persists = self->faults.active != 0u,
        .calibrating = calibrate_holds(self),
        .stopped = self->control.stopped,
    };
    modes_step(&self->modes, &in);
    if (before == MODES_FAULT && self->modes.state != MODES_FAULT) {
        faults_clear(&self->faults);
        h_bridge_clear_trip(&self->bridge);
    }
    (void)hall_speed_set_reverse(&self->hall, self->modes.reverse);
}

// The mode switch has priority over the mode that the host has set.
static void select_mode(App *self) {
    if (!execute_mode_may_change(self)) {
        return;
    }
    const uint8_t position = trigger_mode(&self->trigger);
    if (position == 0u) {
        self->mode = self->host_mode;
        return;
    }
    self->mode = control_built((uint8_t)self->params.value[PARAM_MODE_SWITCH_1 + position - 1]);
}

static void note_lateness(App *self, uint8_t ticks_late) {
    if (ticks_late > 0u && self->overruns < UINT8_MAX) {
        self->overruns++;
    }
    self->faults.overrun = ticks_late > OVERRUN_FAULT_TICKS;
}

// Pending computation of a tick: none, one that takes about as many cycles as packing a slow frame,
// one that takes more.
typedef enum { SLOW_NONE, SLOW_USUAL, SLOW_LONG } SlowWork;

static SlowWork slow_work(App *self) {
    const bool no_edge = self->hall.new_edges == 0u;
    if (execute_pending(self)) {
        const bool answers = execute_answers(self);
        execute_received(self);
        return answers ? SLOW_LONG : SLOW_USUAL;
    }
    if (no_edge && configure_pending(self)) {
        configure_step(self);
        return SLOW_LONG;
    }
    if (no_edge && calibrate_pitch_due(self)) {
        calibrate_pitch(self);
    } else if (hall_speed_search_due(&self->hall)) {
        hall_speed_search(&self->hall);
        return SLOW_LONG;
    } else if (balance_due(&self->balance)) {
        self->faults.contradiction = balance_judge(&self->balance);
        return SLOW_LONG;
    } else if (param_due(&self->params)) {
        param_step(&self->params);
        self->report.params.table.table_slot = self->params.slot;
        self->report.params.table.table_status = self->params.status;
    } else {
        return SLOW_NONE;
    }
    return SLOW_USUAL;
}

// The balances take ticks with cycles left. Beside an edge they hold the update of STATE, and leave
// every second tick to it. A release is left out: duty and current change too much within a span.
static void collect_balance(App *self, bool edge) {
    if (self->faults.settled_ms < FAULTS_SETTLED_MS || self->faults.under_voltage_ms > 0u ||
        (edge && (self->report.now_ms & 1u) == 0u)) {
        return;
    }
    if (edge) {
        self->report.hold_state = true;
    }
    balance_collect(&self->balance, &self->measured, self->bridge.row_compare);
}

// A tick has cycles for one of these: slow work, a slow frame, a second edge, an edge with
// fold-back, or the computations of a controller at a blow, which last for three ticks. A slow
// frame that had to wait has priority over slow work in the next tick. Long work, and slow work in
// a tick with an edge, hold the update of STATE as well; a pending slow frame ends that within two
// ticks. So does packing a slow frame.
static void share_tick(App *self, bool drives) {
    const bool two_edges =
        self->hall.new_edges > 1u || (self->measured.flags & TELEMETRY_FLAGS_DOUBLE_EDGE) != 0u;
    const bool edges = two_edges || (foldback_active(&self->foldback) && self->hall.new_edges > 0u);
    if (!self->heavy) {
        self->full_ticks =
            (uint8_t)(edges && self->full_ticks < FULL_TICKS_MAX ? self->full_ticks + 1u : 0u);
    }
    const bool full = self->heavy || self->full_ticks > 0u;
    const SlowWork work = full || self->slow_turn ? SLOW_NONE : slow_work(self);
    const bool edge = self->hall.new_edges > 0u;
    const bool packs = telemetry_packs(&self->telemetry);
    const bool pending = packs || telemetry_sends_slow(&self->telemetry);
    self->report.hold_slow = full || work != SLOW_NONE;
    self->report.hold_state =
        full || work == SLOW_LONG || (work == SLOW_USUAL && edge) || (work == SLOW_NONE && packs);
    self->slow_turn = self->report.hold_slow && pending;
    if (drives && !self->report.hold_slow && !pending) {
        collect_balance(self, edge);
    }
}

void app_tick(App *self, uint8_t ticks_late) {
    read_inputs(self);
    self->report.now_ms++;
    note_lateness(self, ticks_late);
    find_faults(self);
    find_standstill(self);
    if (self->calibration != TELEMETRY_CALIBRATE_WHAT_CANCEL) {
        calibrate_step(self);
    }
    step_modes(self);
    const bool drives = self->modes.state == MODES_DRIVE;
    if (!drives) {
        select_mode(self);
    }
    profile_tick(&self->control.profile, drives);
    h_bridge_stage(&self->bridge, drive_step(self));
    share_tick(self, drives);
    report_tick(self);
    if (!drives && self->modes.state != MODES_STOPPED) {
        control_ready(&self->control, self->mode, self->modes.reverse, self->params.value);
    }
    const uint16_t cycles = hal_tick_cycles((uint16_t)self->hall.now_cycles);
    if (cycles > self->worst_cycles) {
        self->worst_cycles = cycles;
    }
}

void app_on_tick(App *self) {
    uart_on_tick(&self->uart);
}

void app_on_apply(App *self) {
    h_bridge_on_apply(&self->bridge);
    uart_on_apply(&self->uart);
}

void app_on_edge(App *self, uint16_t stamp) {
    hall_speed_on_edge(&self->hall, stamp);
}

uint8_t app_next_channel(const App *self) {
    return self->adc.next_channel;
}

void app_on_sample(App *self, uint16_t counts) {
    if (adc_sequence_on_result(&self->adc, counts)) {
        h_bridge_on_trip(&self->bridge);
    }
}

void app_on_received(App *self, uint8_t byte, bool damaged) {
    uart_on_received(&self->uart, byte, damaged);
}

bool app_on_ready(App *self, uint8_t *byte) {
    return uart_on_ready(&self->uart, byte);
}
