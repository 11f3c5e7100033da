// The firmware's arithmetic behind one function, so that the same golden vectors run on host and
// AVR.
#ifndef VGROOVE_TESTS_VECTORS_H
#define VGROOVE_TESTS_VECTORS_H

#include <stdint.h>

#include "firmware_vectors.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint8_t function;
    int32_t a;
    int32_t b;
    int32_t expected;
} Vector;

Vector vectors_at(uint16_t index);
int32_t vectors_evaluate(uint8_t function, int32_t a, int32_t b);

#ifdef __cplusplus
}
#endif

#endif
