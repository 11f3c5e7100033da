// Shift and subtract in 16 bits, see divide.h.
#include "core/divide.h"

#include <stdbool.h>

#include "core/inline.h"

#define BITS 16u

// For dividend / 2^16 < divisor. The high word of `rest` is what is left, the quotient comes in from below. The compiler's loop takes twice as long as
// that by hand, four bits a turn.
INLINE_NEVER static uint16_t quotient(uint32_t rest, uint16_t divisor) {
#ifdef __AVR__
    uint8_t turns = BITS / 4u;
    (void)divisor;  // linters do not look into the lines below
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
            : [rest] "+r"(rest), [turns] "+r"(turns)
            : [divisor] "r"(divisor));
#else
    for (uint8_t bits = BITS; bits > 0u; bits--) {
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

// The same for a divisor of more than 16 bits: 48 bits of rest. No dividend of 32 bits reaches 2^16 times such a divisor.
INLINE_NEVER static uint16_t quotient_by_long(uint32_t rest, uint32_t divisor) {
#ifdef __AVR__
    uint16_t high = 0;
    uint8_t turns = BITS / 2u;
    (void)divisor;  // linters do not look into the lines below
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

INLINE_NEVER uint16_t divide_u16(uint32_t dividend, uint32_t divisor) {
    if (divisor > UINT16_MAX) {
        return quotient_by_long(dividend, divisor);
    }
    return (uint16_t)(dividend >> BITS) >= (uint16_t)divisor ? UINT16_MAX : quotient(dividend, (uint16_t)divisor);
}

uint32_t divide_u32(uint32_t dividend, uint16_t divisor) {
    const uint16_t top = (uint16_t)(dividend >> BITS);
    const uint16_t high = top < divisor ? 0u : divide_u16(top, divisor);
    const uint16_t rest = (uint16_t)(top - (uint16_t)((uint32_t)high * divisor));
    return ((uint32_t)high << BITS) | divide_u16(((uint32_t)rest << BITS) | (uint16_t)dividend, divisor);
}
