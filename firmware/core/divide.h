// Division with quotients of 16 bits, in a third of the time of the C library's.
#ifndef VGROOVE_CORE_DIVIDE_H
#define VGROOVE_CORE_DIVIDE_H

#include <stdint.h>

// floor(dividend / divisor), at most UINT16_MAX; a divisor of 0 gives that too.
uint16_t divide_u16(uint32_t dividend, uint32_t divisor);

// The same for a divisor of 16 bits.
uint16_t divide_by_u16(uint32_t dividend, uint16_t divisor);

// Whole quotient of 32 bits, for a divisor above 0: two divisions of 16 bits.
uint32_t divide_u32(uint32_t dividend, uint16_t divisor);

#endif
