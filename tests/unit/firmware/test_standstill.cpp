// Standstill: immediate after slow edges, after the run-down time where the shaft may turn without
// edges; values at the limits.
#include <gtest/gtest.h>

extern "C" {
#include "app/standstill.h"
}

namespace {

// Ticks until the shaft counts as standing, after one tick with `first`.
int ticks_to_rest(const StandstillInputs &first, bool coasts = true, int most = 10000) {
    Standstill self{};
    if (standstill_step(&self, &first))
        return 0;
    const StandstillInputs after{false, coasts, 0};
    for (int k = 1; k <= most; ++k)
        if (standstill_step(&self, &after))
            return k;
    return -1;
}

TEST(Standstill, FollowsTheSensorAfterSlowEdges) {
    Standstill self{};
    self.turned = true;
    const StandstillInputs rests{false, true, 0};
    EXPECT_TRUE(standstill_step(&self, &rests));
    EXPECT_FALSE(self.turned);
}

TEST(Standstill, WaitsForTheRunDownFromTheLastSpeed) {
    EXPECT_EQ(ticks_to_rest({false, true, 6}), 0) << "3 rpm";
    EXPECT_EQ(ticks_to_rest({false, true, 120}), 18) << "60 rpm";
    EXPECT_EQ(ticks_to_rest({false, true, 32767}), 4999);
    EXPECT_EQ(ticks_to_rest({false, true, 65535}), 5000)
        << "limited to the run-down from full speed";
}

TEST(Standstill, WaitsForTheWholeRunDownAfterALostSensor) {
    EXPECT_EQ(ticks_to_rest({true, true, 0}), 5000);
    EXPECT_EQ(ticks_to_rest({true, true, 120}), 5000);
}

TEST(Standstill, DoesNotCountWhileDriven) {
    EXPECT_EQ(ticks_to_rest({true, false, 0}, false), -1);
    EXPECT_EQ(ticks_to_rest({false, false, 2000}, false), -1);
}

TEST(Standstill, ASlowEndDoesNotShortenAPendingWait) {
    Standstill self{};
    const StandstillInputs lost{true, true, 0}, slow{false, true, 60};
    (void)standstill_step(&self, &lost);
    (void)standstill_step(&self, &slow);
    EXPECT_EQ(self.unseen_ms, STANDSTILL_RUN_DOWN_MS);
}

// Ticks until rest after `ms` ticks of drive without an edge, with the speed at the last edges.
int rest_after_drive(int ms, int compare, bool stood, uint16_t ended_rpm_q1 = 0) {
    Standstill self{};
    for (int k = 0; k < ms; ++k)
        if (standstill_driven(&self, static_cast<int16_t>(compare)))
            self.stood = stood;
    StandstillInputs coasts{false, true, ended_rpm_q1};
    for (int k = 0; k < 10000; ++k) {
        if (standstill_step(&self, &coasts))
            return k;
        coasts.ended_rpm_q1 = 0;
    }
    return -1;
}

TEST(Standstill, WaitsForTheSpeedThatADriveMayHaveGivenWithoutEdges) {
    EXPECT_EQ(rest_after_drive(0, 255, false), 0);
    EXPECT_EQ(rest_after_drive(1, 255, false), 636 * 10000 / 65536);
    EXPECT_EQ(rest_after_drive(10, -255, false), 6360 * 10000 / 65536);
    EXPECT_EQ(rest_after_drive(99, 255, false), 255 * 128 * 10000 / 65536)
        << "full duty, full speed";
    EXPECT_EQ(rest_after_drive(99, 20, false), 20 * 128 * 10000 / 65536) << "limited by the duty";
    EXPECT_EQ(rest_after_drive(99, 255, true), 255 * 128 * 10000 / 65536)
        << "too early to evaluate the current";
    EXPECT_EQ(rest_after_drive(100, 255, true), 0) << "a shaft at rest under load";
    EXPECT_EQ(rest_after_drive(300, 255, false), 255 * 128 * 10000 / 65536);
}

TEST(Standstill, ASpeedBeyondFullSpeedWaitsForTheWholeRunDown) {
    for (const int ended_rpm_q1 : {32766, 32767, 32894, 32896, 34976, 65535})
        for (const int ms : {1, 10, 48, 49, 50, 51, 52, 99, 100, 300})
            EXPECT_EQ(rest_after_drive(ms, 255, false, static_cast<uint16_t>(ended_rpm_q1)),
                      static_cast<int>(STANDSTILL_RUN_DOWN_MS))
                << ended_rpm_q1 / 2 << " rpm, driven " << ms << " ms";
}

TEST(Standstill, TheWaitNeverFallsWithTheSpeedAtTheLastEdges) {
    for (const int ms : {0, 5, 60}) {
        int last = 0;
        for (int rpm_q1 = 0; rpm_q1 < 65536; rpm_q1 += 151) {
            const int waits = rest_after_drive(ms, 255, false, static_cast<uint16_t>(rpm_q1));
            ASSERT_GE(waits, last) << rpm_q1 << ' ' << ms;
            last = waits;
        }
    }
}

}  // namespace
