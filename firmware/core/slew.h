// Rate limiter.
#ifndef VGROOVE_CORE_SLEW_H
#define VGROOVE_CORE_SLEW_H

#include <stdint.h>

// `now` moved towards `target` by at most `step` (>= 0).
int16_t slew_towards(int16_t now, int16_t target, int16_t step);

#endif
