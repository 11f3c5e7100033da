// Zeroes a struct, see clear.h.
#include "core/clear.h"

#include "core/inline.h"

INLINE_NEVER void clear_bytes(uint8_t *byte, uint8_t count) {
    for (uint8_t eights = count / 8u; eights > 0u; eights--) {
        byte[0] = 0;
        byte[1] = 0;
        byte[2] = 0;
        byte[3] = 0;
        byte[4] = 0;
        byte[5] = 0;
        byte[6] = 0;
        byte[7] = 0;
        byte = &byte[8];
    }
    for (uint8_t ones = count % 8u; ones > 0u; ones--) {
        *byte = 0;
        byte = &byte[1];
    }
}
