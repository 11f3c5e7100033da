// Fixed point: constants from decimals, and the way back from int32_t to int16_t, which saturates and says so.
#ifndef VGROOVE_CORE_FIXED_H
#define VGROOVE_CORE_FIXED_H

#include <stdbool.h>
#include <stdint.h>

// Folded by the compiler: nothing of it is left at run time.
#define Q(value, n) ((int32_t)((value) * (double)((uint32_t)1 << (n)) + ((value) < 0 ? -0.5 : 0.5)))

// Nearest int16_t; `*saturated` becomes true when that is another value and is left alone otherwise.
int16_t fixed_saturate_i16(int32_t value, bool *saturated);

int32_t fixed_clamp_i32(int32_t value, int32_t least, int32_t greatest);

// Hides a value from the optimiser: avr-gcc would join two shifts, of which one is a move of bytes, into one loop over all bits.
#ifdef __AVR__
#define FIXED_HIDE(value) __asm__("" : "+r"(value))
#else
#define FIXED_HIDE(value) ((void)(value))
#endif

// value / 2^n, rounded to nearest, halves up; n a constant: a variable shift is a loop on the AVR.
#define FIXED_ROUND_SHIFT(value, n) (((value) + ((int32_t)1 << ((n)-1u))) >> (n))

#endif
