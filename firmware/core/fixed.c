// Saturation and rounding, see fixed.h.
#include "core/fixed.h"

int16_t fixed_saturate_i16(int32_t value, bool *saturated) {
    if (value > INT16_MAX) {
        *saturated = true;
        return INT16_MAX;
    }
    if (value < INT16_MIN) {
        *saturated = true;
        return INT16_MIN;
    }
    return (int16_t)value;
}

int32_t fixed_clamp_i32(int32_t value, int32_t least, int32_t greatest) {
    if (value < least) {
        return least;
    }
    return value > greatest ? greatest : value;
}

int32_t fixed_round_shift(int32_t value, uint8_t shift) {
    const int32_t half = (int32_t)((uint32_t)1 << (shift - 1u));
    return value < 0 ? -(int32_t)((uint32_t)(half - value) >> shift) : (int32_t)((uint32_t)(value + half) >> shift);
}
