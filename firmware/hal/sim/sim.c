// Simulated hardware: timers, ADC, UART, EEPROM and bridge outputs of the ATmega, event by event
// within a PWM period.
#include "hal/sim/sim.h"

#include <string.h>

#include "app/app.h"
#include "build_hash.h"
#include "hal/hal.h"

#define PERIOD ((int32_t)HAL_CYCLES_PER_PERIOD)
#define CAPTURE_CYCLES 4             // noise canceller of the input capture
#define EEPROM_WRITE_CYCLES 54400    // 3.4 ms, data sheet ATmega328P, "EEPROM Programming Time"
#define CYCLES_PER_BYTE_250000 640   // 10 bits of 64 cycles
#define CYCLES_PER_BYTE_115200 1360  // 10 bits of 8 (16 + 1) cycles: 117,647 Bd
#define NEVER INT32_MAX
#define RECEIVE_CYCLE 128  // within the period, for each byte received in it
#define PERIODS_PER_SAMPLE (HAL_CYCLES_PER_SAMPLE / HAL_CYCLES_PER_PERIOD)

// Times are cycles since the beginning of the present period; its end subtracts 510 from them.
typedef enum {
    EVENT_TICK,
    EVENT_APPLY,
    EVENT_EDGE,
    EVENT_SAMPLE,
    EVENT_RECEIVED,
    EVENT_SENT,
    EVENT_MAIN,
    EVENT_NONE,
} EventKind;

typedef struct {
    EventKind kind;
    int32_t at;
} Event;

typedef struct {
    App app;
    SimStart start;
    SimInputs in;
    SimOutputs out;
    uint8_t eeprom[SIM_EEPROM_BYTES];
    SimBlow blows[SIM_BLOWS_MAX];
    uint16_t blow_count;
    SimTick ticks[SIM_TICKS_MAX];
    uint16_t tick_count;
    uint16_t stamps[SIM_STAMPS_MAX];  // since the last tick
    uint8_t stamp_count;
    bool receive_off;
    uint64_t cycles;  // from the start of the timers to the beginning of the period
    uint32_t periods;
    int32_t tick_at;
    int32_t apply_at;
    int32_t main_at;
    int32_t sample_at;
    int32_t sent_at;
    int32_t eeprom_busy_until;
    int32_t now;
    int32_t cycles_per_byte;
    uint16_t sampled_counts;
    uint8_t channel;
    uint8_t ticks_waiting;
    uint8_t edge_next;
    uint8_t rx_next;
    uint8_t sending;
    bool sending_any;
    bool enabled;
    bool armed;
    bool apply_later;
    uint8_t switches;  // at the last tick
    bool leg_b_high;
    uint8_t high_below;
    uint8_t low_above;
} Sim;

_Static_assert(sizeof(BlowSetpoints) == sizeof((SimTick *)0)->blow_set, "blow_set");
_Static_assert(CONTROL_SETPOINTS_MAX == SIM_SETPOINTS, "set");

static Sim sim;

// --- hal.h ---

void hal_bridge_cut(void) {
    sim.enabled = false;
    sim.armed = false;
}

void hal_bridge_open(void) {
    hal_bridge_cut();
    sim.high_below = 0;
    sim.low_above = HAL_COMPARE_MAX;
}

void hal_bridge_arm(bool leg_b_high) {
    sim.armed = true;
    sim.leg_b_high = leg_b_high;
}

void hal_bridge_set(uint8_t high_below, uint8_t low_above) {
    sim.high_below = high_below;
    sim.low_above = low_above;
    sim.enabled = sim.armed;
}

void hal_apply_at(bool later) {
    sim.apply_later = later;
}

uint8_t hal_switches(void) {
    return sim.switches;
}

void hal_uart_start(uint8_t baud) {
    sim.cycles_per_byte = baud == HAL_BAUD_115200 ? CYCLES_PER_BYTE_115200 : CYCLES_PER_BYTE_250000;
}

void hal_uart_receive(bool on) {
    sim.receive_off = !on;
}

void hal_uart_wake(void) {
    if (!sim.sending_any && app_on_ready(&sim.app, &sim.sending)) {
        sim.sending_any = true;
        sim.sent_at = sim.now + sim.cycles_per_byte;
    }
}

bool hal_eeprom_ready(void) {
    return sim.now >= sim.eeprom_busy_until;
}

uint8_t hal_eeprom_read(uint16_t address) {
    return sim.eeprom[address % SIM_EEPROM_BYTES];
}

void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    sim.eeprom[address % SIM_EEPROM_BYTES] = value;
    sim.eeprom_busy_until = sim.now + EEPROM_WRITE_CYCLES;
}

uint8_t hal_reset_cause(void) {
    return sim.start.reset_cause;
}

uint8_t hal_target(void) {
    return sim.start.target;
}

// --- events ---

static void on_tick(void) {
    app_on_tick(&sim.app);
    sim.ticks_waiting++;
    sim.switches = sim.in.switches;
    sim.apply_at = sim.tick_at + (sim.apply_later ? (int32_t)HAL_APPLY_LATER_CYCLES : 0);
    sim.main_at = sim.tick_at + (int32_t)sim.start.tick_cycles;
    sim.tick_at += (int32_t)HAL_CYCLES_PER_TICK;
}

static void on_apply(void) {
    app_on_apply(&sim.app);
    sim.apply_at = NEVER;
}

// Records the blow of this tick for sim_blows().
static void keep_blow(void) {
    const Blow *blow = &sim.app.control.blow;
    if (!sim.app.controlled || blow->lugs == 0u || sim.blow_count >= SIM_BLOWS_MAX) {
        return;
    }
    sim.blows[sim.blow_count++] =
        (SimBlow){sim.app.report.now_ms, blow->lugs,           blow->repeats,
                  blow->period_q4,       blow->mean_period_q7, blow->spread_q15};
}

uint16_t sim_blows(const SimBlow **blows) {
    *blows = sim.blows;
    return sim.blow_count;
}

uint16_t sim_ticks(const SimTick **ticks) {
    *ticks = sim.ticks;
    return sim.tick_count;
}

static void keep_control(SimTick *tick) {
    const Control *control = &sim.app.control;
    const ControllerInputs *in = &control->in;
    TelemetryControl report = {0};
    control_report(control, &report);
    tick->mode = control->mode;
    tick->state = report.control_state;
    tick->stop_reason = report.stop_reason;
    tick->estimate = report.estimate;
    tick->travel_q15 = in->travel_q15;
    tick->in_speed_rpm_q1 = in->speed_rpm_q1;
    tick->in_current_a_q9 = in->current_a_q9;
    tick->duty_q15 = in->duty_q15;
    tick->trigger_q15 = in->trigger_q15;
    tick->supply_mv = in->supply_mv;
    tick->coasted = in->coasted ? 1u : 0u;
    tick->edges = in->edges;
    tick->requested_q15 = sim.app.requested_q15;
    tick->blow_count = control->blow.count;
    memcpy(tick->set, control->set.words, sizeof tick->set);
    memcpy(tick->blow_set, &control->blow_set, sizeof tick->blow_set);
}

// Records this tick for sim_ticks().
static void keep_tick(void) {
    if (sim.tick_count >= SIM_TICKS_MAX) {
        return;
    }
    SimTick *tick = &sim.ticks[sim.tick_count++];
    *tick = (SimTick){.time_ms = sim.app.report.now_ms,
                      .stamp_count = sim.stamp_count,
                      .current_sum = sim.app.measured.adc.current_sum,
                      .current_count = sim.app.measured.adc.current_count,
                      .current_offset_q4 = (uint16_t)sim.app.current.offset_q4,
                      .current_gain_a_q15 = (uint16_t)sim.app.current.gain_a_q15,
                      .current_a_q9 = sim.app.measured.current_a_q9,
                      .speed_rpm_q1 = sim.app.measured.speed_rpm_q1,
                      .controlled = sim.app.controlled ? 1u : 0u};
    memcpy(tick->stamps, sim.stamps, sizeof tick->stamps);
    sim.stamp_count = 0;
    keep_control(tick);
}

static void on_main(void) {
    sim.ticks_waiting--;
    sim.main_at = NEVER;
    app_tick(&sim.app, sim.ticks_waiting);
    keep_blow();
    keep_tick();
}

static void on_edge(void) {
    const uint64_t stamp = sim.cycles + sim.in.edge_cycle[sim.edge_next] + CAPTURE_CYCLES;
    sim.edge_next++;
    app_on_edge(&sim.app, (uint16_t)stamp);
    if (sim.stamp_count < SIM_STAMPS_MAX) {
        sim.stamps[sim.stamp_count++] = (uint16_t)stamp;
    }
}

static void on_sample(void) {
    sim.channel = app_next_channel(&sim.app);
    app_on_sample(&sim.app, sim.sampled_counts);
    sim.sample_at += (int32_t)HAL_CYCLES_PER_SAMPLE;
}

static void on_received(void) {
    if (!sim.receive_off) {
        app_on_received(&sim.app, sim.in.rx[sim.rx_next], false);
    }
    sim.rx_next++;
}

static void on_sent(void) {
    if (sim.out.tx_count < SIM_BYTES_MAX) {
        sim.out.tx[sim.out.tx_count] = sim.sending;
        sim.out.tx_count++;
    }
    sim.sending_any = app_on_ready(&sim.app, &sim.sending);
    sim.sent_at = sim.sending_any ? sim.sent_at + sim.cycles_per_byte : NEVER;
}

static void keep_earlier(Event *first, EventKind kind, int32_t at) {
    if (at < first->at) {
        *first = (Event){.kind = kind, .at = at};
    }
}

// Next event of the period; at equal times the tick's interrupts come first, as on the chip.
static Event next_event(void) {
    Event first = {.kind = EVENT_NONE, .at = PERIOD};
    keep_earlier(&first, EVENT_TICK, sim.tick_at);
    keep_earlier(&first, EVENT_APPLY, sim.apply_at);
    if (sim.edge_next < sim.in.edge_count) {
        keep_earlier(&first, EVENT_EDGE, sim.in.edge_cycle[sim.edge_next]);
    }
    keep_earlier(&first, EVENT_SAMPLE, sim.sample_at + (int32_t)sim.start.isr_cycles);
    if (sim.rx_next < sim.in.rx_count) {
        keep_earlier(&first, EVENT_RECEIVED, RECEIVE_CYCLE);
    }
    keep_earlier(&first, EVENT_SENT, sim.sent_at);
    keep_earlier(&first, EVENT_MAIN, sim.main_at);
    return first;
}

static void run(const Event *event) {
    sim.now = event->at;
    switch (event->kind) {
    case EVENT_TICK:
        on_tick();
        break;
    case EVENT_APPLY:
        on_apply();
        break;
    case EVENT_EDGE:
        on_edge();
        break;
    case EVENT_SAMPLE:
        on_sample();
        break;
    case EVENT_RECEIVED:
        on_received();
        break;
    case EVENT_SENT:
        on_sent();
        break;
    case EVENT_MAIN:
        on_main();
        break;
    case EVENT_NONE:
        break;
    }
}

// --- periods ---

static void move_back(int32_t *at) {
    if (*at != NEVER) {
        *at -= PERIOD;
    }
}

static void end_period(void) {
    if (sim.periods % PERIODS_PER_SAMPLE == 0u) {
        sim.sampled_counts = (uint16_t)(sim.in.adc_counts[sim.channel] & 0x3FFu);
    }
    move_back(&sim.tick_at);
    move_back(&sim.apply_at);
    move_back(&sim.main_at);
    move_back(&sim.sample_at);
    move_back(&sim.sent_at);
    if (sim.eeprom_busy_until > 0) {
        move_back(&sim.eeprom_busy_until);
    }
    sim.cycles += HAL_CYCLES_PER_PERIOD;
    sim.periods++;
    sim.now = 0;
}

// Of leg A while it is enabled: the counts between its two compare values, in which neither side is
// on, and the signed compare value in their middle. Where the dead time exceeds the duty, one side
// stays off and the counts between are fewer than the dead time.
static void latch_bridge(void) {
    const uint8_t between = (uint8_t)(sim.low_above - sim.high_below);
    const int16_t leg_a = (int16_t)(sim.high_below + between / 2u);
    const int16_t compare = sim.leg_b_high ? (int16_t)(leg_a - HAL_COMPARE_MAX) : leg_a;
    sim.out.coast = (uint8_t)(sim.enabled ? 0 : 1);
    sim.out.compare = sim.enabled ? compare : 0;
    sim.out.dead_counts = sim.enabled ? between : 0;
}

_Static_assert(sizeof(TorqueMap) == SIM_TORQUE_MAP_BYTES, "the map has no padding");

// Replaces the torque map; NULL: by the one in the source, kept before the first replacement.
static void replace_torque_map(const uint8_t *replacement) {
    static TorqueMap in_source;
    static bool kept;
    if (!kept) {
        in_source = torque_map;
        kept = true;
    }
    if (replacement != NULL) {
        memcpy(&torque_map, replacement, sizeof torque_map);
    } else {
        torque_map = in_source;
    }
}

void sim_reset(const SimStart *start, SimOutputs *outputs) {
    memset(&sim, 0, sizeof sim);
    sim.start = *start;
    replace_torque_map(start->torque_map);
    if (start->eeprom != NULL) {
        memcpy(sim.eeprom, start->eeprom, SIM_EEPROM_BYTES);
    } else {
        memset(sim.eeprom, UINT8_MAX, SIM_EEPROM_BYTES);
    }
    sim.cycles = HAL_FIRST_TOP_CYCLES;
    sim.tick_at = (int32_t)HAL_CYCLES_PER_TICK - (int32_t)HAL_FIRST_TOP_CYCLES;
    sim.sample_at = (int32_t)HAL_FIRST_SAMPLE_CYCLES - (int32_t)HAL_FIRST_TOP_CYCLES;
    sim.apply_at = NEVER;
    sim.main_at = NEVER;
    sim.sent_at = NEVER;
    app_init(&sim.app, VGROOVE_BUILD_HASH);
    sim.app.report.now_ms = start->start_ms;
    sim.channel = adc_sequence_channel(0);
    latch_bridge();
    *outputs = sim.out;
}

void sim_period(const SimInputs *inputs, SimOutputs *outputs) {
    sim.in = *inputs;
    sim.edge_next = 0;
    sim.rx_next = 0;
    sim.out.tx_count = 0;
    for (Event event = next_event(); event.kind != EVENT_NONE; event = next_event()) {
        run(&event);
    }
    end_period();
    latch_bridge();
    *outputs = sim.out;
}

const uint8_t *sim_eeprom(void) {
    return sim.eeprom;
}

uint32_t sim_periods(void) {
    return sim.periods;
}

uint64_t sim_cycles(void) {
    return sim.cycles;
}
