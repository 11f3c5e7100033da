// Shift and subtract in 16 bits, see divide.h.
#include "core/divide.h"

#include <stdbool.h>

#include "core/inline.h"

#define BITS 16u

// Restoring division for dividend / 2^16 < divisor: quotient in the high word of the result,
// remainder in the low word. The high word of `rest` is the remainder, the quotient is shifted in
// from below. Four bits per loop in assembly take half of the time of the compiler's loop.
INLINE_NEVER static uint32_t divided(uint32_t rest, uint16_t divisor) {
#ifdef __AVR__
    uint8_t turns = BITS / 4u;
    (void)divisor;  // used by the assembly below
    __asm__("1:\n\t"
            ".rept 4\n\t"
            "lsl %A[rest]\n\t"
            "rol %B[rest]\n\t"
            "rol %C[rest]\n\t"
            "rol %D[rest]\n\t"
            "brcs .+6\n\t"
            "cp %C[rest], %A[divisor]\n\t"
            "cpc %D[rest], %B[divisor]\n\t"
            "brcs .+6\n\t"
            "sub %C[rest], %A[divisor]\n\t"
            "sbc %D[rest], %B[divisor]\n\t"
            "inc %A[rest]\n\t"
            ".endr\n\t"
            "dec %[turns]\n\t"
            "brne 1b\n\t"
            "movw r0, %A[rest]\n\t"
            "movw %A[rest], %C[rest]\n\t"
            "movw %C[rest], r0\n\t"
            "clr r1\n\t"
            : [rest] "+r"(rest), [turns] "+r"(turns)
            : [divisor] "r"(divisor));
    return rest;
#else
    for (uint8_t bits = BITS; bits > 0u; bits--) {
        const bool carry = (rest & 0x80000000u) != 0u;
        rest <<= 1;
        if (carry || (uint16_t)(rest >> BITS) >= divisor) {
            rest -= (uint32_t)divisor << BITS;
            rest |= 1u;
        }
    }
    return (rest << BITS) | (rest >> BITS);
#endif
}

// The same for a divisor of more than 16 bits with 48 bits of `rest`: the quotient has 16 bits.
INLINE_NEVER static uint16_t quotient_by_long(uint32_t rest, uint32_t divisor) {
#ifdef __AVR__
    uint16_t high = 0;
    uint8_t turns = BITS / 2u;
    (void)divisor;  // used by the assembly below
    __asm__("1:\n\t"
            ".rept 2\n\t"
            "lsl %A[rest]\n\t"
            "rol %B[rest]\n\t"
            "rol %C[rest]\n\t"
            "rol %D[rest]\n\t"
            "rol %A[high]\n\t"
            "rol %B[high]\n\t"
            "cp %C[rest], %A[divisor]\n\t"
            "cpc %D[rest], %B[divisor]\n\t"
            "cpc %A[high], %C[divisor]\n\t"
            "cpc %B[high], %D[divisor]\n\t"
            "brcs .+10\n\t"
            "sub %C[rest], %A[divisor]\n\t"
            "sbc %D[rest], %B[divisor]\n\t"
            "sbc %A[high], %C[divisor]\n\t"
            "sbc %B[high], %D[divisor]\n\t"
            "inc %A[rest]\n\t"
            ".endr\n\t"
            "dec %[turns]\n\t"
            "brne 1b\n\t"
            : [rest] "+r"(rest), [high] "+r"(high), [turns] "+r"(turns)
            : [divisor] "r"(divisor));
    return (uint16_t)rest;
#else
    return (uint16_t)(rest / divisor);
#endif
}

INLINE_NEVER uint16_t divide_by_u16(uint32_t dividend, uint16_t divisor) {
    return (uint16_t)(dividend >> BITS) >= divisor ? UINT16_MAX
                                                   : (uint16_t)(divided(dividend, divisor) >> BITS);
}

INLINE_NEVER uint16_t divide_u16(uint32_t dividend, uint32_t divisor) {
    return divisor > UINT16_MAX ? quotient_by_long(dividend, divisor)
                                : divide_by_u16(dividend, (uint16_t)divisor);
}

uint32_t divide_u32(uint32_t dividend, uint16_t divisor) {
    const uint32_t high = divided(dividend >> BITS, divisor);
    const uint32_t low = divided((high << BITS) | (uint16_t)dividend, divisor);
    return (high & 0xFFFF0000u) | (low >> BITS);
}
