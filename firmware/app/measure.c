// Measurements of a tick, see measure.h.
#include "app/measure.h"

#include "drivers/analog.h"
#include "hal/hal.h"
#include "telemetry/telemetry_signals.h"

_Static_assert(TELEMETRY_FLAGS_EDGE_OVERFLOW <= UINT8_MAX, "flags of a tick");

static void note(Measurement *self, bool happened, uint8_t flag) {
    if (happened) {
        self->flags |= flag;
    }
}

static void take_bus(Measurement *self, uint16_t counts, int16_t gain_mv_q8) {
    bool saturated = counts >= ADC_SEQUENCE_TOP_COUNT;
    self->supply_mv = analog_supply_mv(counts, gain_mv_q8);
    self->supply_25mv = analog_supply_25mv(self->supply_mv, &saturated);
    note(self, saturated, TELEMETRY_FLAGS_SUPPLY_SATURATED);
}

static void take_temperature(Measurement *self, uint16_t counts) {
    self->temperature_lost = !analog_temperature_plausible(counts);
    self->temperature_c_q4 = analog_temperature_c_q4(counts);
}

static bool fresh(const AdcTick *adc, uint8_t channel) {
    return (adc->fresh & (1u << channel)) != 0u;
}

static void take_current(Measurement *self, const CurrentSense *current) {
    const AdcTick *adc = &self->adc;
    if (adc->current_count == 0u) {
        return;
    }
    bool saturated = adc->saturated;
    self->current_a_q9 = current_sense_a_q9(
        current, current_sense_mean_q4(adc->current_sum, adc->current_count), &saturated);
    note(self, saturated, TELEMETRY_FLAGS_CURRENT_SATURATED);
}

void measure_analog(Measurement *self, AdcSequence *adc, const CurrentSense *current,
                    Trigger *trigger, int16_t bus_gain_mv_q8) {
    self->flags = 0;
    adc_sequence_tick(adc, &self->adc);
    take_current(self, current);
    if (fresh(&self->adc, HAL_ADC_BUS)) {
        take_bus(self, self->adc.latest[HAL_ADC_BUS], bus_gain_mv_q8);
    }
    if (fresh(&self->adc, HAL_ADC_TRIGGER)) {
        trigger_set_travel(trigger, self->adc.latest[HAL_ADC_TRIGGER]);
    }
    if (fresh(&self->adc, HAL_ADC_TEMPERATURE)) {
        self->trigger_lost = trigger_implausible(trigger);  // with the slowest channel: few ticks
        take_temperature(self, self->adc.latest[HAL_ADC_TEMPERATURE]);
    }
}

void measure_speed(Measurement *self, HallSpeed *hall) {
    const HallSpeedResult result = hall_speed_tick(hall);
    self->speed_rpm_q1 = result.rpm_q1;
    self->standstill = hall_speed_at_rest(hall);
    note(self, result.saturated, TELEMETRY_FLAGS_SPEED_SATURATED);
    note(self, result.missed, TELEMETRY_FLAGS_MISSED_EDGE);
    note(self, result.doubled, TELEMETRY_FLAGS_DOUBLE_EDGE);
    note(self, result.overflowed, TELEMETRY_FLAGS_EDGE_OVERFLOW);
}
