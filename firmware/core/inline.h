// Where avr-gcc's choice of what to inline costs time: a tick as one function has more locals than registers, and spills them.
#ifndef VGROOVE_CORE_INLINE_H
#define VGROOVE_CORE_INLINE_H

#define INLINE_NEVER __attribute__((noinline))

#endif
