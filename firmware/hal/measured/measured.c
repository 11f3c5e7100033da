// Inputs of a tick from the row of a log, see measured.h.
#include "hal/measured/measured.h"

#include <string.h>

#include "app/app.h"
#include "app/measure.h"
#include "drivers/analog.h"
#include "drivers/trigger.h"
#include "hal/hal.h"

_Static_assert(MEASURED_DEBOUNCE_TICKS == TRIGGER_DEBOUNCE_TICKS, "ticks of the debouncing");

#define REST_COUNTS 512u  // every sample of the ADC ring: zero current, no trip
#define TEMPERATURE_C_Q4 (25 * 16)

static const uint8_t *image;  // EEPROM of the start
static const MeasuredInputs *given;

// --- hal.h ---

void hal_bridge_cut(void) {}

void hal_bridge_open(void) {}

void hal_bridge_arm(bool leg_b_high) {
    (void)leg_b_high;
}

void hal_bridge_set(uint8_t high_below, uint8_t low_above) {
    (void)high_below;
    (void)low_above;
}

void hal_apply_at(bool later) {
    (void)later;
}

uint8_t hal_switches(void) {
    return given->switches;
}

void hal_uart_start(uint8_t baud) {
    (void)baud;
}

void hal_uart_wake(void) {}

void hal_uart_receive(bool on) {
    (void)on;
}

uint8_t hal_reset_cause(void) {
    return 1;  // power-on
}

uint8_t hal_target(void) {
    return 0;
}

bool hal_eeprom_ready(void) {
    return true;
}

uint8_t hal_eeprom_read(uint16_t address) {
    return image[address % MEASURED_EEPROM_BYTES];
}

void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    (void)address;
    (void)value;
}

// --- app/measure.h ---

void measure_analog(Measurement *self, AdcSequence *adc, const CurrentSense *current,
                    Trigger *trigger, int16_t bus_gain_mv_q8) {
    (void)current;
    (void)bus_gain_mv_q8;
    bool saturated = false;
    self->flags = 0;
    adc_sequence_tick(adc, &self->adc);
    self->current_a_q9 = given->current_a_q9;
    self->supply_mv = given->supply_mv;
    self->supply_25mv = analog_supply_25mv(given->supply_mv, &saturated);
    self->temperature_c_q4 = TEMPERATURE_C_Q4;
    if ((self->adc.fresh & (1u << HAL_ADC_TRIGGER)) != 0u) {
        trigger_set_travel(trigger, given->trigger_counts);
    }
}

static uint8_t edges_since_rest(const HallSpeed *hall) {
    if (given->speed_rpm_q1 != 0) {
        return 2;
    }
    if (given->edges > 0u) {
        return 1;
    }
    return hall->edges > 1u ? 0u : hall->edges;
}

void measure_speed(Measurement *self, HallSpeed *hall) {
    const int16_t speed = given->speed_rpm_q1;
    hall->now_cycles += HAL_CYCLES_PER_TICK;
    hall->new_edges = given->edges;
    hall->edges = edges_since_rest(hall);
    hall->magnitude_rpm_q1 = (uint16_t)(speed < 0 ? -speed : speed);
    if (given->edges > 0u && speed != 0) {
        hall->period_cycles = hall->factor_equal / hall->magnitude_rpm_q1;
    }
    self->speed_rpm_q1 = speed;
    self->standstill = hall_speed_at_rest(hall);
}

// --- ticks ---

// Results of the ADC schedule that are complete at the tick.
static void complete_samples(App *app, uint32_t tick_cycles) {
    const uint32_t done = (tick_cycles - HAL_FIRST_SAMPLE_CYCLES) / HAL_CYCLES_PER_SAMPLE + 1u;
    while (app->adc.head != (uint8_t)done) {
        app_on_sample(app, REST_COUNTS);
    }
}

size_t measured_bytes(void) {
    return sizeof(App);
}

void measured_start(void *block, const uint8_t *eeprom) {
    image = eeprom;
    app_init((App *)block, 0);
}

void measured_tick(void *block, const MeasuredInputs *inputs, MeasuredOutputs *outputs) {
    App *const app = (App *)block;
    uint8_t sent = 0;
    given = inputs;
    app->trigger.stable = inputs->switches;
    complete_samples(app, app->hall.now_cycles + HAL_CYCLES_PER_TICK);
    app_on_tick(app);
    app_tick(app, 0);
    while (app_on_ready(app, &sent)) {
    }
    *outputs = (MeasuredOutputs){app->bridge.row_compare, app->report.state.state};
}

bool measured_takes_trigger(const void *block) {
    App app = *(const App *)block;
    AdcTick tick = {0};
    complete_samples(&app, app.hall.now_cycles + HAL_CYCLES_PER_TICK);
    adc_sequence_tick(&app.adc, &tick);
    return (tick.fresh & (1u << HAL_ADC_TRIGGER)) != 0u;
}

uint16_t measured_travel_q15(const void *block, uint16_t counts) {
    Trigger trigger = ((const App *)block)->trigger;
    trigger.travel_q15 = 1;
    trigger_set_travel(&trigger, counts);
    return (uint16_t)trigger.travel_q15;
}

// Telemetry, and contents of buffers and inputs that the next tick replaces.
static void clear_passing(App *app) {
    memset(&app->uart, 0, sizeof app->uart);
    memset(app->spare, 0, sizeof app->spare);
    memset(&app->telemetry, 0, sizeof app->telemetry);
    memset(&app->report, 0, sizeof app->report);
    memset(&app->control.in, 0, sizeof app->control.in);
    memset(&app->measured.adc, 0, sizeof app->measured.adc);
    app->hall.new_edges = 0;
}

static bool travel_acts(const App *app, uint8_t sample_ticks) {
    const int32_t reached_q15 = app->ramp_q15 + (int32_t)sample_ticks * app->slew_q15;
    return sample_ticks == 0u || (sample_ticks > 1u && app->trigger.travel_q15 <= reached_q15);
}

uint64_t measured_key(const void *block, uint8_t sample_ticks) {
    App app;
    memcpy(&app, block, sizeof app);
    clear_passing(&app);
    if (!travel_acts(&app, sample_ticks)) {
        app.trigger.travel_q15 = app.trigger.travel_q15 > 0 ? INT16_MAX : 0;
    }
    const uint8_t *byte = (const uint8_t *)&app;
    uint64_t key = 1469598103934665603u;
    size_t at = 0;
    for (; at + sizeof key <= sizeof app; at += sizeof key) {
        uint64_t word = 0;
        memcpy(&word, &byte[at], sizeof word);
        key = (key ^ word) * 0x9E3779B97F4A7C15u;
        key ^= key >> 29;
    }
    for (; at < sizeof app; at++) {
        key = (key ^ byte[at]) * 1099511628211u;
    }
    return key;
}
