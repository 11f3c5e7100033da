// Fixed point: constants from decimal numbers, and saturating conversion from int32_t to int16_t.
#ifndef VGROOVE_CORE_FIXED_H
#define VGROOVE_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

// Evaluated by the compiler: no float remains at run time.
#define Q(value, n) ((int32_t)((value) * (double)((uint32_t)1 << (n)) + ((value) < 0 ? -0.5 : 0.5)))

// Nearest int16_t; sets `*saturated` when the value does not fit, otherwise leaves it unchanged.
int16_t fixed_saturate_i16(int32_t value, bool *saturated);

int32_t fixed_clamp_i32(int32_t value, int32_t least, int32_t greatest);

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
