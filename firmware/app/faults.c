// Fault detection, see faults.h.
#include "app/faults.h"

#include "core/fixed.h"
#include "core/inline.h"
#include "drivers/h_bridge.h"
#include "hal/hal.h"
#include "telemetry/telemetry_signals.h"

#define UNDER_VOLTAGE_MS 10u
#define OVER_TEMPERATURE_MS 100u
#define STALL_COMPARE_MIN 16  // 6 % duty: below it a shaft at rest is not a stall
#define FROZEN_TICKS 32u
#define FROZEN_RPM_Q1 500  // 250 rpm
#define OPEN_MS 50u
// 3 A, 24 counts of the converter: more than the sensor's drift since its calibration at the start,
// and its noise.
#define OPEN_MAX_A_Q9 1536

// Consecutive ticks in which a condition held, saturating at `limit`.
static uint8_t held_for(bool holds, uint8_t ticks, uint8_t limit) {
    if (!holds) {
        return 0;
    }
    return (uint8_t)(ticks < limit ? ticks + 1u : limit);
}

// |duty| Vs / |i| < 0.5 ohm. For the reference motor of docs/spec/model.md, section 4, this ratio
// is 0.29 ohm at rest (pack and winding), 0.6 ohm turning at 30 A, and 10 ohm turning without load.
INLINE_NEVER bool faults_draws_like_standing(const Measurement *m, int16_t compare) {
    const uint32_t current_ma =
        fixed_byte_down((uint32_t)(uint16_t)fixed_magnitude(m->current_a_q9) * 1000u) >> 1;
    return current_ma * HAL_COMPARE_MAX >
           2u * ((uint32_t)m->supply_mv * (uint16_t)fixed_magnitude(compare));
}

static uint8_t find_no_edge(Faults *self, const Measurement *m, uint16_t stall_ms,
                            const FaultsDrive *drive) {
    const bool open = drive->compare == H_BRIDGE_COAST;
    self->settled_ms = held_for(!open, self->settled_ms, FAULTS_SETTLED_MS);
    if (drive->new_edge || !drive->goes_on) {
        self->no_edge_ms = 0;
    }
    if (drive->new_edge || open || fixed_magnitude(drive->compare) < STALL_COMPARE_MIN) {
        return 0;
    }
    if (self->no_edge_ms < stall_ms) {
        self->no_edge_ms++;
        return 0;
    }
    if (self->settled_ms < FAULTS_SETTLED_MS) {
        return 0;
    }
    return faults_draws_like_standing(m, drive->compare) ? TELEMETRY_FAULTS_STALL
                                                         : TELEMETRY_FAULTS_SENSOR_LOST;
}

static void count_conditions(Faults *self, const Measurement *m, const FaultLimits *limits) {
    self->under_voltage_ms =
        held_for(m->supply_mv < limits->under_voltage_mv, self->under_voltage_ms, UNDER_VOLTAGE_MS);
    const bool hot = m->temperature_c_q4 > limits->over_temperature_c_q4;
    self->over_temperature_ms =
        held_for(hot && !m->temperature_lost, self->over_temperature_ms, OVER_TEMPERATURE_MS);
    self->sensor_lost_ms =
        held_for(m->temperature_lost || m->trigger_lost, self->sensor_lost_ms, OVER_TEMPERATURE_MS);
}

// Whether the current has kept its value in FROZEN_TICKS ticks with an edge in a drive, while the
// speed has changed by more than an eighth: at a constant load both may be constant.
static bool find_frozen_current(Faults *self, const Measurement *m, const FaultsDrive *drive) {
    if (drive->compare == H_BRIDGE_COAST || m->current_a_q9 != self->frozen_a_q9) {
        self->frozen_a_q9 = m->current_a_q9;
        self->frozen_rpm_q1 = m->speed_rpm_q1;
        self->frozen_ticks = 0;
        return false;
    }
    if (!drive->new_edge) {
        return false;
    }
    if (self->frozen_ticks < FROZEN_TICKS) {
        self->frozen_ticks++;
        return false;
    }
    const int16_t change =
        (int16_t)(fixed_magnitude(m->speed_rpm_q1) - fixed_magnitude(self->frozen_rpm_q1));
    return fixed_magnitude(change) >
           (int16_t)(fixed_magnitude(self->frozen_rpm_q1) >> 3) + FROZEN_RPM_Q1;
}

static bool find_current_of_open_bridge(Faults *self, const Measurement *m, int16_t compare) {
    if (compare != H_BRIDGE_COAST || fixed_magnitude(m->current_a_q9) <= OPEN_MAX_A_Q9) {
        self->open_current_ms = 0;
        return false;
    }
    self->open_current_ms = held_for(true, self->open_current_ms, OPEN_MS);
    return self->open_current_ms == OPEN_MS;
}

void faults_step(Faults *self, const Measurement *m, const FaultLimits *limits,
                 const FaultsDrive *drive) {
    uint8_t active = find_no_edge(self, m, limits->stall_ms, drive);
    count_conditions(self, m, limits);
    if (m->adc.trips) {
        active |= TELEMETRY_FAULTS_OVER_CURRENT;
    }
    if (self->under_voltage_ms >= UNDER_VOLTAGE_MS) {
        active |= TELEMETRY_FAULTS_UNDER_VOLTAGE;
    }
    if (self->over_temperature_ms >= OVER_TEMPERATURE_MS) {
        active |= TELEMETRY_FAULTS_OVER_TEMPERATURE;
    }
    if (self->sensor_lost_ms >= OVER_TEMPERATURE_MS || self->current_implausible ||
        self->contradiction || find_frozen_current(self, m, drive) ||
        find_current_of_open_bridge(self, m, drive->compare)) {
        active |= TELEMETRY_FAULTS_SENSOR_LOST;
    }
    if (m->adc.lost) {
        active |= TELEMETRY_FAULTS_ADC_CADENCE;
    }
    if (self->overrun) {
        active |= TELEMETRY_FAULTS_OVERRUN;
    }
    self->overrun = false;
    self->active = active;
    self->latched |= active;
}

void faults_clear(Faults *self) {
    self->latched = self->active;
}
