// Measurements of a tick, see measure.h.
#include "app/measure.h"

#include "drivers/analog.h"
#include "hal/hal.h"
#include "telemetry/telemetry_signals.h"

static void raise(Measurement *self, bool happened, uint16_t flag) {
    if (happened) {
        self->flags |= flag;
    }
}

static void take_bus(Measurement *self, uint16_t counts, int16_t gain_mv_q8) {
    bool saturated = counts >= ADC_SEQUENCE_TOP_COUNT;
    self->supply_mv = analog_supply_mv(counts, gain_mv_q8);
    self->supply_25mv = analog_supply_25mv(self->supply_mv, &saturated);
    raise(self, saturated, TELEMETRY_FLAGS_SUPPLY_SATURATED);
}

static void take_temperature(Measurement *self, uint16_t counts) {
    self->temperature_lost = !analog_temperature_plausible(counts);
    self->temperature_c_q4 = analog_temperature_c_q4(counts);
}

static void take_sample(Measurement *self, const AdcSample *sample, Trigger *trigger, int16_t bus_gain_mv_q8) {
    switch (sample->channel) {
    case HAL_ADC_CURRENT:
        current_sense_add(&self->current, sample->counts);
        break;
    case HAL_ADC_BUS:
        take_bus(self, sample->counts, bus_gain_mv_q8);
        break;
    case HAL_ADC_TRIGGER:
        trigger_set_travel(trigger, sample->counts);
        break;
    case HAL_ADC_TEMPERATURE:
        take_temperature(self, sample->counts);
        break;
    }
}

void measure_analog(Measurement *self, AdcSequence *adc, const CurrentSense *current, Trigger *trigger, int16_t bus_gain_mv_q8) {
    self->flags = 0;
    self->over_current = false;
    self->adc_lost = false;
    self->current = (CurrentSamples){0};
    for (uint8_t due = adc_sequence_due(adc, &self->adc_lost); due > 0u; due--) {
        const AdcSample sample = adc_sequence_take(adc);
        self->over_current = self->over_current || adc_sequence_trips(adc, &sample);
        take_sample(self, &sample, trigger, bus_gain_mv_q8);
    }
    bool saturated = self->current.at_limit;
    if (self->current.count > 0u) {
        self->current_a_q9 = current_sense_a_q9(current, current_sense_mean_q4(&self->current), &saturated);
    }
    raise(self, saturated, TELEMETRY_FLAGS_CURRENT_SATURATED);
}

void measure_speed(Measurement *self, HallSpeed *hall) {
    const HallSpeedResult result = hall_speed_tick(hall);
    self->speed_rpm_q1 = result.rpm_q1;
    self->standstill = hall_speed_at_rest(hall);
    raise(self, result.saturated, TELEMETRY_FLAGS_SPEED_SATURATED);
    raise(self, result.missed, TELEMETRY_FLAGS_MISSED_EDGE);
    raise(self, result.doubled, TELEMETRY_FLAGS_DOUBLE_EDGE);
    raise(self, result.overflowed, TELEMETRY_FLAGS_EDGE_OVERFLOW);
}
