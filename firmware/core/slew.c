// Rate limiter, see slew.h.
#include "core/slew.h"

int16_t slew_towards(int16_t now, int16_t target, int16_t step) {
    if (now == target) {
        return now;
    }
    const int32_t distance = (int32_t)target - now;
    if (distance > step) {
        return (int16_t)(now + step);
    }
    return distance < -(int32_t)step ? (int16_t)(now - step) : target;
}
