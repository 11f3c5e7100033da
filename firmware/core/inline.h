// Function attributes that avoid slow or large code of avr-gcc. Without INLINE_NEVER the tick
// becomes one function whose locals exceed the registers.
#ifndef VGROOVE_CORE_INLINE_H
#define VGROOVE_CORE_INLINE_H

#define INLINE_NEVER __attribute__((noinline))

// For short assembly, whose call takes more time than itself.
#define INLINE_ALWAYS static inline __attribute__((always_inline))

// For rarely called functions: no clone with constant addresses, which are longer than a pointer.
#ifdef __clang__
#define CLONE_NEVER INLINE_NEVER
#else
#define CLONE_NEVER __attribute__((noinline, noclone))
#endif

// Hides the address of a struct from the optimiser: members are then accessed by displacement (2
// bytes) instead of by absolute address (4 bytes).
#ifdef __AVR__
#define BY_POINTER(self) __asm__("" : "+r"(self))
#else
#define BY_POINTER(self) ((void)(self))
#endif

#endif
