// Rate limiter, see slew.h.
#include "core/slew.h"

int16_t slew_towards(int16_t now, int16_t target, int16_t step) {
    // The difference of two int16_t needs 16 bits without sign.
    if (target > now) {
        return (uint16_t)((uint16_t)target - (uint16_t)now) > (uint16_t)step ? (int16_t)(now + step)
                                                                             : target;
    }
    return (uint16_t)((uint16_t)now - (uint16_t)target) > (uint16_t)step ? (int16_t)(now - step)
                                                                         : target;
}
