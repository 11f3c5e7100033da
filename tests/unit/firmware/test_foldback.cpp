// Fold-back: laws, and the closed loop with the reference motor (docs/spec/model.md, section 4).
#include <gtest/gtest.h>

extern "C" {
#include "controllers/foldback.h"
#include "core/slew.h"
}

namespace {

Foldback foldback() {
    Foldback self;
    foldback_init(&self, 45 * 512);
    return self;
}

TEST(Foldback, DoesNotChangeTheDutyWithinTheLimit) {
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

TEST(Foldback, EndsAtNoChangeBeforeItActsInTheOtherDirection) {
    Foldback self = foldback();
    for (int k = 0; k < 10; ++k)
        foldback_step(&self, 20000, 60 * 512);
    const int16_t lowered = foldback_step(&self, 20000, 60 * 512);
    ASSERT_LT(lowered, 20000);
    int16_t last = lowered;
    bool ended = false;
    for (int k = 0; k < 100; ++k) {
        const int16_t duty = foldback_step(&self, 20000, -60 * 512);
        ASSERT_GE(duty, last);
        ended = ended || duty == 20000;
        ASSERT_TRUE(ended || duty < 20000);
        last = duty;
    }
    EXPECT_GT(last, 20000);
}

TEST(Foldback, ReturnsADutyForAnyInput) {
    Foldback self = foldback();
    for (int k = 0; k < 4000; ++k) {
        const int16_t duty = foldback_step(&self, 32767, k < 2000 ? 32767 : -32768);
        ASSERT_GE(duty, 0);
    }
}

// A locked shaft at 20.5 V and full trigger, the greatest static gain. The current follows within a
// tick, with a delay of two ticks.
TEST(Foldback, LimitsALockedMotorWithoutTripping) {
    for (const double resistance : {0.19, 0.29}) {
        Foldback self = foldback();
        int16_t requested = 0;
        double staged = 0.0, applied = 0.0, worst = 0.0, current = 0.0;
        for (int k = 0; k < 2000; ++k) {
            current = applied * 20.5 / resistance;
            worst = std::max(worst, current);
            applied = staged;
            requested = slew_towards(requested, 32767, 197);
            staged = foldback_step(&self, requested,
                                   static_cast<int16_t>(std::min(32767.0, current * 512))) /
                     32768.0;
        }
        EXPECT_LT(worst, 50.0) << resistance;
        EXPECT_NEAR(current, 45.0, 0.5) << resistance;
    }
}

TEST(Slew, FollowsTheTriggerAtItsRate) {
    int16_t duty = 0;
    int ticks = 0;
    while ((duty = slew_towards(duty, 32767, 197)) < 32767)
        ++ticks;
    EXPECT_EQ(ticks, 166);
    EXPECT_EQ(slew_towards(duty, 100, 197), 32767 - 197);
}

}  // namespace
