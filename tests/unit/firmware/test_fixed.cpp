// Saturation and rounding at, just under and just over each limit.
#include <gtest/gtest.h>

extern "C" {
#include "core/fixed.h"
#include "core/ring.h"
#include "core/slew.h"
}

namespace {

TEST(Fixed, SaturatesAtInt16AndSaysSo) {
    bool saturated = false;
    EXPECT_EQ(fixed_saturate_i16(32767, &saturated), 32767);
    EXPECT_EQ(fixed_saturate_i16(-32768, &saturated), -32768);
    EXPECT_FALSE(saturated);
    EXPECT_EQ(fixed_saturate_i16(32768, &saturated), 32767);
    EXPECT_TRUE(saturated);
    saturated = false;
    EXPECT_EQ(fixed_saturate_i16(-32769, &saturated), -32768);
    EXPECT_TRUE(saturated);
    EXPECT_EQ(fixed_saturate_i16(0, &saturated), 0);
    EXPECT_TRUE(saturated) << "a later good value must not hide an earlier bad one";
}

TEST(Fixed, RoundsToNearest) {
    EXPECT_EQ(FIXED_ROUND_SHIFT((int32_t)511, 10u), 0);
    EXPECT_EQ(FIXED_ROUND_SHIFT((int32_t)512, 10u), 1);
    EXPECT_EQ(FIXED_ROUND_SHIFT((int32_t)-512, 10u), 0);
    EXPECT_EQ(FIXED_ROUND_SHIFT((int32_t)-513, 10u), -1);
}

TEST(Fixed, ConstantsRoundAwayFromZero) {
    EXPECT_EQ(Q(1.5, 9u), 768);
    EXPECT_EQ(Q(-55.0, 9u), -28160);
    EXPECT_EQ(Q(0.0005, 10u), 1);
}

TEST(Fixed, ClampsToItsEnds) {
    EXPECT_EQ(fixed_clamp_i32(-1, 0, 5), 0);
    EXPECT_EQ(fixed_clamp_i32(0, 0, 5), 0);
    EXPECT_EQ(fixed_clamp_i32(5, 0, 5), 5);
    EXPECT_EQ(fixed_clamp_i32(6, 0, 5), 5);
}

TEST(Slew, NeverPassesTheTargetNorTheRate) {
    EXPECT_EQ(slew_towards(0, 197, 197), 197);
    EXPECT_EQ(slew_towards(0, 198, 197), 197);
    EXPECT_EQ(slew_towards(0, 196, 197), 196);
    EXPECT_EQ(slew_towards(0, -198, 197), -197);
    EXPECT_EQ(slew_towards(-32768, 32767, 32767), -1);
    EXPECT_EQ(slew_towards(32767, -32768, 32767), 0);
}

TEST(Ring, HoldsItsSizeAndDropsTheNext) {
    RingWords ring{};
    for (uint16_t k = 0; k < RING_WORDS; ++k)
        EXPECT_TRUE(ring_push_word(&ring, static_cast<uint16_t>(k * 2047u)));
    EXPECT_FALSE(ring_push_word(&ring, 1));
    for (uint16_t k = 0; k < RING_WORDS; ++k) {
        EXPECT_EQ(ring_peek_word(&ring), static_cast<uint16_t>(k * 2047u));
        ring_drop_word(&ring);
    }
    EXPECT_EQ(ring_count_words(&ring), 0);
}

TEST(Ring, WrapsAfter256Bytes) {
    RingBytes ring{};
    uint8_t out = 0;
    for (unsigned k = 0; k < 1000; ++k) {
        ASSERT_TRUE(ring_push_byte(&ring, static_cast<uint8_t>(k)));
        ASSERT_TRUE(ring_pop_byte(&ring, &out));
        ASSERT_EQ(out, static_cast<uint8_t>(k));
    }
    EXPECT_FALSE(ring_pop_byte(&ring, &out));
}

TEST(Ring, TakesAMessageWholeOrNotAtAll) {
    RingBytes ring{};
    const uint8_t bytes[RING_BYTES] = {1, 2, 3};
    EXPECT_TRUE(ring_push_bytes(&ring, bytes, RING_BYTES - 1));
    EXPECT_FALSE(ring_push_bytes(&ring, bytes, 2));
    EXPECT_TRUE(ring_push_bytes(&ring, bytes, 1));
    EXPECT_FALSE(ring_push_bytes(&ring, bytes, 1));
}

}  // namespace
