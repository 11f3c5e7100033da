// Saturation and rounding at, just under and just over each limit.
#include <gtest/gtest.h>

#include <algorithm>

extern "C" {
#include "core/divide.h"
#include "core/fixed.h"
#include "core/ring.h"
#include "core/slew.h"
}

namespace {

TEST(Fixed, SaturatesAtInt16AndSetsTheFlag) {
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

TEST(Fixed, MagnitudeIsNeverNegativeAndOffByOneAtMost) {
    for (int32_t value = INT16_MIN; value <= INT16_MAX; ++value) {
        const int16_t magnitude = fixed_magnitude(static_cast<int16_t>(value));
        ASSERT_EQ(magnitude, value < 0 ? -value - 1 : value);
    }
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

TEST(Ring, WrapsAtItsSize) {
    RingBytes ring{};
    uint8_t out = 0;
    for (unsigned k = 0; k < 1000; ++k) {
        ASSERT_TRUE(ring_push_byte(&ring, static_cast<uint8_t>(k)));
        ASSERT_TRUE(ring_pop_byte(&ring, &out));
        ASSERT_EQ(out, static_cast<uint8_t>(k));
    }
    EXPECT_FALSE(ring_pop_byte(&ring, &out));
}

TEST(Ring, DropsTheByteThatDoesNotFit) {
    RingBytes ring{};
    uint8_t out = 0;
    for (unsigned k = 0; k < RING_BYTES - 1; ++k)
        ASSERT_TRUE(ring_push_byte(&ring, static_cast<uint8_t>(k)));
    EXPECT_FALSE(ring_push_byte(&ring, 0xFF));
    EXPECT_TRUE(ring_pop_byte(&ring, &out));
    EXPECT_EQ(out, 0);
    EXPECT_TRUE(ring_push_byte(&ring, 0xFF));
}

RingFrames empty_frames() {
    RingFrames ring{};
    ring_clear_frames(&ring);
    return ring;
}

// Frames are built in their slots and sent byte by byte; a slot is free when the last byte of its
// frame has been sent.
TEST(RingFramesQueue, KeepsFramesWholeAndInOrder) {
    RingFrames ring = empty_frames();
    uint8_t out = 0;
    unsigned built = 0, left = 0;
    for (unsigned round = 0; round < 200; ++round) {
        const uint8_t room = ring_frames_free(&ring);
        const auto frames = static_cast<uint8_t>(std::min<unsigned>(room, 1 + round % 2));
        for (uint8_t ahead = 0; ahead < frames; ++ahead, ++built)
            for (unsigned k = 0; k < RING_FRAME; ++k)
                ring_frame_at(&ring, ahead)[k] = static_cast<uint8_t>(built * 7 + k);
        ring_push_frames(&ring, frames);
        for (unsigned k = 0; k < 25 && ring_pop_frame_byte(&ring, &out); ++k, ++left)
            ASSERT_EQ(out, static_cast<uint8_t>(left / RING_FRAME * 7 + left % RING_FRAME));
    }
    EXPECT_GT(left, 200u * RING_FRAME);
}

TEST(RingFramesQueue, HoldsThreeFramesAndNotOneMore) {
    RingFrames ring = empty_frames();
    uint8_t out = 0;
    for (const int free : {3, 2, 1}) {
        EXPECT_EQ(ring_frames_free(&ring), free);
        ring_push_frames(&ring, 1);
    }
    EXPECT_EQ(ring_frames_free(&ring), 0);
    EXPECT_TRUE(ring_pop_frame_byte(&ring, &out));
    EXPECT_EQ(ring_frames_free(&ring), 1)
        << "the fourth slot stays free, so that head and tail differ";
}

TEST(Divide, IsTheFloorAtEveryLimit) {
    const uint32_t divisors[] = {
        1,           2,         3,     255,    256,      32767,          32768,
        65535,       65536,     65537, 131071, 1u << 24, (1u << 24) + 1, 0x7FFFFFFFu,
        0x80000000u, UINT32_MAX};
    for (const uint32_t divisor : divisors) {
        for (uint64_t q :
             {0ull, 1ull, 2ull, 255ull, 32767ull, 32768ull, 65534ull, 65535ull, 65536ull}) {
            for (const int64_t beside : {-1, 0, 1}) {
                const int64_t dividend = static_cast<int64_t>(q * divisor) + beside;
                if (dividend < 0 || dividend > UINT32_MAX)
                    continue;
                const uint64_t wanted =
                    std::min<uint64_t>(static_cast<uint64_t>(dividend) / divisor, UINT16_MAX);
                ASSERT_EQ(divide_u16(static_cast<uint32_t>(dividend), divisor), wanted)
                    << dividend << " / " << divisor;
                if (divisor > UINT16_MAX)
                    continue;
                ASSERT_EQ(
                    divide_by_u16(static_cast<uint32_t>(dividend), static_cast<uint16_t>(divisor)),
                    wanted);
                ASSERT_EQ(
                    divide_u32(static_cast<uint32_t>(dividend), static_cast<uint16_t>(divisor)),
                    static_cast<uint64_t>(dividend) / divisor);
            }
        }
    }
    EXPECT_EQ(divide_u16(5, 0), UINT16_MAX);
    EXPECT_EQ(divide_u16(0, 0), UINT16_MAX);
}

}  // namespace
