// Laws of the commanded duty profile: never beyond the trigger, never after its time limit, and the
// trigger sets the duty again after its release.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

extern "C" {
#include "app/profile.h"
#include "controllers/controller.h"
}

namespace {

TEST(Profile, WithoutAFrameTheTriggerIsTheDuty) {
    Profile profile{};
    for (const int16_t travel : {int16_t{0}, int16_t{1}, int16_t{INT16_MAX}}) {
        profile_tick(&profile, true);
        EXPECT_EQ(profile_duty(&profile, travel), travel);
    }
}

TEST(Profile, AFrameIsValidForItsTimeAndNotATickLonger) {
    Profile profile{};
    profile_take(&profile, 9000);
    for (unsigned ms = 1; ms < PROFILE_HOLD_MS; ++ms) {
        profile_tick(&profile, true);
        ASSERT_EQ(profile_duty(&profile, 20000), 9000) << ms;
    }
    profile_tick(&profile, true);
    EXPECT_EQ(profile_duty(&profile, 20000), CONTROLLER_STOP);
    profile_tick(&profile, true);
    EXPECT_EQ(profile_duty(&profile, 20000), CONTROLLER_STOP)
        << "the trigger does not take over during a drive";
}

TEST(Profile, TheTriggerLimitsIt) {
    Profile profile{};
    profile_take(&profile, 9000);
    EXPECT_EQ(profile_duty(&profile, 9001), 9000);
    EXPECT_EQ(profile_duty(&profile, 9000), 9000);
    EXPECT_EQ(profile_duty(&profile, 8999), 8999);
    EXPECT_EQ(profile_duty(&profile, 0), 0);
}

TEST(Profile, ANegativeDutyOpensTheBridge) {
    Profile profile{};
    profile_take(&profile, -1);
    EXPECT_EQ(profile_duty(&profile, 20000), CONTROLLER_COAST);
}

TEST(Profile, AProfileThatEndsAtAReleasedTriggerReturnsTheDutyToTheTrigger) {
    Profile profile{};
    profile_take(&profile, 100);
    for (unsigned ms = 0; ms < PROFILE_HOLD_MS; ++ms)
        profile_tick(&profile, false);
    EXPECT_EQ(profile_duty(&profile, 20000), CONTROLLER_STOP)
        << "a trigger pulled in the same tick does not take over";
    profile_tick(&profile, false);
    EXPECT_EQ(profile_duty(&profile, 20000), 20000);
}

TEST(Profile, RandomFramesNeverDriveBeyondTheTriggerNorAfterTheirTime) {
    std::mt19937 rng(5);
    Profile profile{};
    unsigned since = 1000;
    bool drives = false, any = false;
    for (int k = 0; k < 200000; ++k) {
        drives = rng() % 97 == 0 ? !drives : drives;
        profile_tick(&profile, drives);
        ++since;
        const auto travel = static_cast<int16_t>(rng() % 32768);
        const int16_t requested = profile_duty(&profile, travel);
        ASSERT_LE(requested, travel);
        ASSERT_GE(requested, CONTROLLER_COAST);
        if (any && drives && since >= PROFILE_HOLD_MS && profile.acts) {
            ASSERT_EQ(requested, CONTROLLER_STOP);
        }
        if (rng() % 60 == 0) {
            profile_take(&profile, static_cast<int16_t>(static_cast<int>(rng() % 32769) - 1));
            since = 0;
            any = true;
        }
    }
}

}  // namespace
