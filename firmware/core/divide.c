// Shift and subtract in 16 bits, see divide.h.
#include "core/divide.h"

#include <stdbool.h>

#include "core/inline.h"

#define BITS 16u

// For dividend / 2^16 < divisor. The high word of `rest` is what is left, the quotient comes in from below. The compiler's loop takes half as long again
// as that by hand.
static uint16_t quotient(uint32_t rest, uint16_t divisor) {
    uint8_t bits = BITS;
#ifdef __AVR__
    (void)divisor;  // linters do not look into the lines below
    __asm__("1: lsl %A[rest]\n\t"
            "rol %B[rest]\n\t"
            "rol %C[rest]\n\t"
            "rol %D[rest]\n\t"
            "brcs 2f\n\t"
            "cp %C[rest], %A[divisor]\n\t"
            "cpc %D[rest], %B[divisor]\n\t"
            "brcs 3f\n\t"
            "2: sub %C[rest], %A[divisor]\n\t"
            "sbc %D[rest], %B[divisor]\n\t"
            "inc %A[rest]\n\t"
            "3: dec %[bits]\n\t"
            "brne 1b\n\t"
            : [rest] "+r"(rest), [bits] "+r"(bits)
            : [divisor] "r"(divisor));
#else
    for (; bits > 0u; bits--) {
        const bool carry = (rest & 0x80000000u) != 0u;
        rest <<= 1;
        if (carry || (uint16_t)(rest >> BITS) >= divisor) {
            rest -= (uint32_t)divisor << BITS;
            rest |= 1u;
        }
    }
#endif
    return (uint16_t)rest;
}

// From the quotient of both shifted right, which is at most a few off, to the exact one.
static uint16_t corrected(uint16_t estimate, uint32_t dividend, uint32_t divisor) {
    int32_t rest = (int32_t)(dividend - estimate * divisor);
    while (rest < 0) {
        rest += (int32_t)divisor;
        estimate--;
    }
    while (rest >= (int32_t)divisor) {
        rest -= (int32_t)divisor;
        estimate++;
    }
    return estimate;
}

// Apart from the usual case, which would have to save its registers.
INLINE_NEVER static uint16_t divide_by_long(uint32_t dividend, uint32_t divisor) {
    uint32_t shifted = dividend;
    uint32_t by = divisor;
    while (by > UINT16_MAX) {
        by >>= 1;
        shifted >>= 1;
    }
    const uint16_t estimate = shifted >> BITS >= by ? UINT16_MAX : quotient(shifted, (uint16_t)by);
    return corrected(estimate, dividend, divisor);
}

uint16_t divide_u16(uint32_t dividend, uint32_t divisor) {
    if (divisor > UINT16_MAX) {
        return divide_by_long(dividend, divisor);
    }
    return (uint16_t)(dividend >> BITS) >= (uint16_t)divisor ? UINT16_MAX : quotient(dividend, (uint16_t)divisor);
}
