// Fixed point: constants from decimal numbers, and saturating conversion from int32_t to int16_t.
#ifndef VGROOVE_CORE_FIXED_H
#define VGROOVE_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

#include "core/inline.h"

// Evaluated by the compiler: no float remains at run time.
#define Q(value, n) ((int32_t)((value) * (double)((uint32_t)1 << (n)) + ((value) < 0 ? -0.5 : 0.5)))

// Nearest int16_t; sets `*saturated` when the value does not fit, otherwise leaves it unchanged.
int16_t fixed_saturate_i16(int32_t value, bool *saturated);

int32_t fixed_clamp_i32(int32_t value, int32_t least, int32_t greatest);

// value if value >= 0, else -value - 1, so that -32768 gives 32767 without overflow.
int16_t fixed_magnitude(int16_t value);

// Hides a value from the optimiser: avr-gcc merges two shifts, one of which is a move of bytes,
// into one loop over all bits.
#ifdef __AVR__
#define FIXED_HIDE(value) __asm__("" : "+r"(value))
#else
#define FIXED_HIDE(value) ((void)(value))
#endif

// value / 2^8 as a move of bytes, to be shifted further.
static inline uint32_t fixed_byte_down(uint32_t value) {
    uint32_t down = value >> 8;
    FIXED_HIDE(down);
    return down;
}

// value / 4 by two shifts by one bit: a third of the time of the compiler's loop.
static inline int32_t fixed_quarter_i32(int32_t value) {
    int32_t half = value >> 1;
    FIXED_HIDE(half);
    return half >> 1;
}

static inline uint32_t fixed_quarter_u32(uint32_t value) {
    uint32_t half = value >> 1;
    FIXED_HIDE(half);
    return half >> 1;
}

// value + by * gain * 2^8: two products of bytes take a third of the time of one of words.
INLINE_ALWAYS int32_t fixed_add_product_q8(int32_t value, int16_t by, uint8_t gain) {
#ifdef __AVR__
    (void)by;  // used by the assembly below
    (void)gain;
    __asm__("mul %A[by], %[gain]\n\t"
            "add %B[value], r0\n\t"
            "adc %C[value], r1\n\t"
            "clr r1\n\t"
            "adc %D[value], r1\n\t"
            "mulsu %B[by], %[gain]\n\t"
            "add %C[value], r0\n\t"
            "adc %D[value], r1\n\t"
            "clr r1\n\t"
            : [value] "+&r"(value)
            : [by] "a"(by), [gain] "a"(gain));
    return value;
#else
    return value + (int32_t)by * gain * 256;
#endif
}

// a * b / 2^8, rounded down, of a result within 16 bits.
INLINE_ALWAYS int16_t fixed_byte_part(int16_t a, uint8_t b) {
#ifdef __AVR__
    int16_t part;
    (void)a;  // used by the assembly below
    (void)b;
    __asm__("mulsu %B[a], %[b]\n\t"
            "movw %A[part], r0\n\t"
            "mul %A[a], %[b]\n\t"
            "add %A[part], r1\n\t"
            "clr r1\n\t"
            "adc %B[part], r1\n\t"
            : [part] "=&r"(part)
            : [a] "a"(a), [b] "a"(b));
    return part;
#else
    return (int16_t)(((int32_t)a * b) >> 8);
#endif
}

// value / 16 by swapping nibbles: a quarter of the time of the compiler's loop.
static inline uint16_t fixed_sixteenth(uint16_t value) {
#ifdef __AVR__
    __asm__("swap %A0\n\t"
            "swap %B0\n\t"
            "andi %A0, 0x0F\n\t"
            "eor %A0, %B0\n\t"
            "andi %B0, 0x0F\n\t"
            "eor %A0, %B0\n\t"
            : "+d"(value));
    return value;
#else
    return (uint16_t)(value >> 4);
#endif
}

// value / 2^n, rounded to nearest, halves up; n must be constant: a variable shift is a loop.
#define FIXED_ROUND_SHIFT(value, n) (((value) + ((int32_t)1 << ((n)-1u))) >> (n))

#endif
