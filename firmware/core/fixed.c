// Saturation, see fixed.h.
#include "core/fixed.h"

#include "core/inline.h"

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

INLINE_NEVER int16_t fixed_magnitude(int16_t value) {
    return (int16_t)(value < 0 ? -(int16_t)(value + 1) : value);
}
