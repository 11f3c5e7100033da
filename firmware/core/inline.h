// Where avr-gcc's choice of what to inline costs time: a tick as one function has more locals than
// registers, and spills them.
#ifndef VGROOVE_CORE_INLINE_H
#define VGROOVE_CORE_INLINE_H

#define INLINE_NEVER __attribute__((noinline))

// What runs seldom: no copy with the address of its data in every instruction, which is longer than
// a pointer.
#ifdef __clang__
#define CLONE_NEVER INLINE_NEVER
#else
#define CLONE_NEVER __attribute__((noinline, noclone))
#endif

// Hides from the optimiser where a struct lies, so that its members are reached by displacement, in
// two bytes, and not by address, in four.
#ifdef __AVR__
#define BY_POINTER(self) __asm__("" : "+r"(self))
#else
#define BY_POINTER(self) ((void)(self))
#endif

#endif
