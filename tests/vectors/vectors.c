// Evaluation of a golden vector with the firmware's functions.
#include "vectors.h"

#include "controllers/foldback.h"
#include "core/divide.h"
#include "core/fixed.h"
#include "core/flash.h"
#include "core/slew.h"
#include "drivers/analog.h"
#include "drivers/current_sense.h"
#include "drivers/h_bridge.h"
#include "drivers/hall_speed.h"
#include "drivers/trigger.h"
#include "hal/hal.h"

#define MID_SCALE_Q4 8192
#define TIMEOUT_MS 2000u
#define SLEW_Q15 197
#define FOLDBACK_A_Q9 (40 * 512)

static const Vector table[VECTORS_COUNT] FLASH_TABLE = {VECTORS_TABLE};

Vector vectors_at(uint16_t index) {
    Vector vector;
#ifdef __AVR__
    memcpy_P(&vector, &table[index], sizeof vector);
#else
    vector = table[index];
#endif
    return vector;
}

static int32_t current(int32_t mean_q4, int32_t gain_a_q15) {
    CurrentSense self;
    bool saturated = false;
    current_sense_init(&self, (int16_t)gain_a_q15, MID_SCALE_Q4);
    return current_sense_a_q9(&self, (int16_t)mean_q4, &saturated);
}

static int32_t travel(int32_t counts, int32_t low) {
    Trigger self = {0};
    trigger_set_ends(&self, (uint16_t)low, (uint16_t)(low + 820));
    trigger_set_travel(&self, (uint16_t)counts);
    return self.travel_q15;
}

// Speed from two edges `period` cycles apart, the second at the end of a tick.
static int32_t speed(int32_t period, int32_t pulses) {
    HallSpeed self = {0};
    hall_speed_configure(&self, (uint8_t)pulses, TIMEOUT_MS);
    const uint32_t ticks = (uint32_t)period / HAL_CYCLES_PER_TICK + 1u;
    const uint32_t second = (ticks + 1u) * HAL_CYCLES_PER_TICK;
    const uint32_t first = second - (uint32_t)period;
    int16_t rpm_q1 = 0;
    for (uint32_t tick = 1; tick <= ticks + 1u; tick++) {
        const uint32_t now = tick * HAL_CYCLES_PER_TICK;
        if (first > now - HAL_CYCLES_PER_TICK && first <= now) {
            hall_speed_on_edge(&self, (uint16_t)first);
        }
        if (second == now) {
            hall_speed_on_edge(&self, (uint16_t)second);
        }
        rpm_q1 = hall_speed_tick(&self).rpm_q1;
    }
    return rpm_q1;
}

static int32_t folded_back(int32_t requested_q15, int32_t current_a_q9) {
    Foldback self;
    foldback_init(&self, FOLDBACK_A_Q9);
    return foldback_step(&self, (int16_t)requested_q15, (int16_t)current_a_q9);
}

int32_t vectors_evaluate(uint8_t function, int32_t a, int32_t b) {
    bool saturated = false;
    switch (function) {
    case VECTORS_SATURATE:
        return fixed_saturate_i16(a, &saturated);
    case VECTORS_MEAN:
        return current_sense_mean_q4((uint16_t)a, (uint8_t)b);
    case VECTORS_CURRENT:
        return current(a, b);
    case VECTORS_COMPARE:
        return h_bridge_compare((int16_t)a);
    case VECTORS_SUPPLY:
        return analog_supply_mv((uint16_t)a, (int16_t)b);
    case VECTORS_SUPPLY_25MV:
        return analog_supply_25mv((uint16_t)a, &saturated);
    case VECTORS_TEMPERATURE:
        return analog_temperature_c_q4((uint16_t)a);
    case VECTORS_TRAVEL:
        return travel(a, b);
    case VECTORS_SPEED:
        return speed(a, b);
    case VECTORS_SLEW:
        return slew_towards((int16_t)a, (int16_t)b, SLEW_Q15);
    case VECTORS_DIVIDE:
        return divide_u16((uint32_t)a, (uint32_t)b);
    case VECTORS_FOLDBACK:
        return folded_back(a, b);
    }
    return INT32_MIN;
}
