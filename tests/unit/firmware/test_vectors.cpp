// The golden vectors on the host; tests/avr/vectors_main.c runs the same table on the target.
#include <gtest/gtest.h>

#include "vectors.h"

namespace {

TEST(Vectors, AllVectorsAreEqualBitForBit) {
    for (uint16_t k = 0; k < VECTORS_COUNT; ++k) {
        const Vector v = vectors_at(k);
        EXPECT_EQ(vectors_evaluate(v.function, v.a, v.b), v.expected)
            << "vector " << k << ": function " << int(v.function) << ", " << v.a << ", " << v.b;
    }
}

}  // namespace
