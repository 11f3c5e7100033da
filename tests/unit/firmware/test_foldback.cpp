// Fold-back: laws, and the closed loop with the reference motor (physics.md).
#include <gtest/gtest.h>

extern "C" {
#include "controllers/foldback.h"
#include "controllers/open_loop.h"
}

namespace {

Foldback foldback() {
    Foldback self;
    foldback_init(&self, 45 * 512);
    return self;
}

TEST(Foldback, LeavesTheWishAloneWithinTheLimit) {
    Foldback self = foldback();
    for (int current = -45 * 512; current <= 45 * 512; current += 64)
        ASSERT_EQ(foldback_step(&self, 12345, static_cast<int16_t>(current)), 12345);
    EXPECT_FALSE(foldback_active(&self));
    EXPECT_LT(foldback_step(&self, 12345, 45 * 512 + 13), 12345);
    EXPECT_TRUE(foldback_active(&self));
}

TEST(Foldback, BrakingCurrentRaisesTheDuty) {
    Foldback self = foldback();
    EXPECT_GT(foldback_step(&self, 0, -60 * 512), 0);
}

TEST(Foldback, StaysADutyWhateverHappens) {
    Foldback self = foldback();
    for (int k = 0; k < 4000; ++k) {
        const int16_t duty = foldback_step(&self, 32767, k < 2000 ? 32767 : -32768);
        ASSERT_GE(duty, 0);
    }
}

// A locked shaft at 20.5 V and full trigger: the static gain is the highest there is. Current follows within a tick, two ticks late.
TEST(Foldback, LimitsALockedMotorWithoutTripping) {
    for (const double resistance : {0.19, 0.29}) {
        Foldback self = foldback();
        OpenLoop loop{197, 0};
        const ControllerInputs in{32767, 0, 0, 20500};
        double staged = 0.0, applied = 0.0, worst = 0.0, current = 0.0;
        for (int k = 0; k < 2000; ++k) {
            current = applied * 20.5 / resistance;
            worst = std::max(worst, current);
            applied = staged;
            staged = foldback_step(&self, open_loop_step(&loop, &in), static_cast<int16_t>(std::min(32767.0, current * 512))) / 32768.0;
        }
        EXPECT_LT(worst, 50.0) << resistance;
        EXPECT_NEAR(current, 45.0, 0.5) << resistance;
    }
}

TEST(OpenLoop, FollowsTheTriggerAtItsRate) {
    OpenLoop loop{197, 0};
    ControllerInputs in{32767, 0, 0, 18500};
    int ticks = 0;
    while (open_loop_step(&loop, &in) < 32767)
        ++ticks;
    EXPECT_EQ(ticks, 166);
    in.travel_q15 = 100;
    EXPECT_EQ(open_loop_step(&loop, &in), 32767 - 197);
}

}  // namespace
