// Saturation, see fixed.h.
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
