// Current from ADC counts, see current_sense.h.
#include "drivers/current_sense.h"

#include "core/divide.h"
#include "core/fixed.h"
#include "core/flash.h"

#define ADC_TOP 1023
#define SPAN_MAX_Q4 16384u  // the whole scale: sums with the offset fit in 16 bits
#define MID_SCALE_Q4 8192
#define SAMPLES_MAX 8u
// Counts Q4 times A/count Q15 is A Q19; the result is Q9.
#define PRODUCT_SHIFT (UNITS_COUNT_Q + 15u - UNITS_CURRENT_Q)
#if PRODUCT_SHIFT != 10u
#error "the product is shifted by a byte and two bits"
#endif
#define REST_SAMPLES (1u << CURRENT_SENSE_REST_SAMPLES_LOG2)

// 2^20 / n, high and low word: converts a sum of n counts into its mean in Q4 by a shift of 16.
static const uint8_t factor_high[SAMPLES_MAX + 1u] FLASH_TABLE = {0, 16, 8, 5, 4, 3, 2, 2, 2};
static const int16_t factor_low[SAMPLES_MAX + 1u] FLASH_TABLE = {
    0, 0, 0, 21845, 0, 13107, (int16_t)43691, 18725, 0};

void current_sense_init(CurrentSense *self, int16_t gain_a_q15, int16_t offset_q4) {
    *self = (CurrentSense){.gain_a_q15 = gain_a_q15, .offset_q4 = offset_q4};
}

int16_t current_sense_mean_q4(uint16_t sum, uint8_t count) {
    const uint8_t n = count <= SAMPLES_MAX ? count : SAMPLES_MAX;
    const uint16_t low =
        (uint16_t)(((uint32_t)sum * (uint16_t)FLASH_I16(&factor_low[n]) + 0x8000u) >> 16);
    return (int16_t)(sum * FLASH_U8(&factor_high[n]) + low);
}

int16_t current_sense_a_q9(const CurrentSense *self, int16_t mean_q4, bool *saturated) {
    int32_t value = (int32_t)(int16_t)(mean_q4 - self->offset_q4) * self->gain_a_q15;
    value = (value + ((int32_t)1 << (PRODUCT_SHIFT - 1u))) >> 8;
    FIXED_HIDE(value);
    return fixed_saturate_i16(fixed_quarter_i32(value), saturated);
}

static uint16_t within_scale(int16_t counts) {
    const int16_t least = counts < 1 ? 1 : counts;
    return (uint16_t)(least > ADC_TOP - 1 ? ADC_TOP - 1 : least);
}

CurrentLimits current_sense_limits(const CurrentSense *self, int16_t trip_a_q9) {
    const uint16_t wanted_q4 =
        divide_by_u16((uint32_t)(uint16_t)trip_a_q9 << PRODUCT_SHIFT, (uint16_t)self->gain_a_q15);
    const int16_t span_q4 = (int16_t)(wanted_q4 < SPAN_MAX_Q4 ? wanted_q4 : SPAN_MAX_Q4);
    const int16_t low = (int16_t)((int16_t)(self->offset_q4 - span_q4 + 15) >> UNITS_COUNT_Q);
    const int16_t high = (int16_t)((int16_t)(self->offset_q4 + span_q4) >> UNITS_COUNT_Q);
    return (CurrentLimits){.low = within_scale(low), .high = within_scale(high)};
}

void current_sense_rest_begin(CurrentSense *self) {
    self->rest_sum = 0;
    self->rest_count = 0;
}

bool current_sense_rest(CurrentSense *self, uint16_t sum, uint8_t count, bool *implausible) {
    self->rest_sum += sum;
    self->rest_count = (uint16_t)(self->rest_count + count);
    if (self->rest_count < REST_SAMPLES) {
        return false;
    }
    const int16_t mean_q4 = (int16_t)divide_by_u16(
        (self->rest_sum << UNITS_COUNT_Q) + self->rest_count / 2u, self->rest_count);
    *implausible = mean_q4 > MID_SCALE_Q4 + CURRENT_SENSE_REST_SPREAD_Q4 ||
                   mean_q4 < MID_SCALE_Q4 - CURRENT_SENSE_REST_SPREAD_Q4;
    if (!*implausible) {
        self->offset_q4 = mean_q4;
    }
    current_sense_rest_begin(self);
    return true;
}
