// Fixed point: constants from decimals, and the way back from int32_t to int16_t, which saturates
// and says so.
#ifndef VGROOVE_CORE_FIXED_H
#define VGROOVE_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

// Folded by the compiler: nothing of it is left at run time.
#define Q(value, n) ((int32_t)((value) * (double)((uint32_t)1 << (n)) + ((value) < 0 ? -0.5 : 0.5)))

// Nearest int16_t; `*saturated` becomes true when that is another value and is left alone
// otherwise.
int16_t fixed_saturate_i16(int32_t value, bool *saturated);

int32_t fixed_clamp_i32(int32_t value, int32_t least, int32_t greatest);

// Hides a value from the optimiser: avr-gcc would join two shifts, of which one is a move of bytes,
// into one loop over all bits.
#ifdef __AVR__
#define FIXED_HIDE(value) __asm__("" : "+r"(value))
#else
#define FIXED_HIDE(value) ((void)(value))
#endif

// value / 2^8, to be shifted on: a move, which the compiler would join with the rest into one loop
// over all bits.
static inline uint32_t fixed_byte_down(uint32_t value) {
    uint32_t down = value >> 8;
    FIXED_HIDE(down);
    return down;
}

// value / 16 by exchanging nibbles: what the compiler makes of a shift by 4, a loop, takes four
// times as long.
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

// value / 2^n, rounded to nearest, halves up; n a constant: a variable shift is a loop on the AVR.
#define FIXED_ROUND_SHIFT(value, n) (((value) + ((int32_t)1 << ((n)-1u))) >> (n))

#endif
