// Current: scaling, offset, saturation, limits of the trip.
#include <gtest/gtest.h>

extern "C" {
#include "core/fixed.h"
#include "drivers/analog.h"
#include "drivers/current_sense.h"
}

namespace {

CurrentSense sense(int16_t gain_a_q15 = 4096, int16_t offset_q4 = 8192) {
    CurrentSense self;
    current_sense_init(&self, gain_a_q15, offset_q4);
    return self;
}

TEST(CurrentSense, MeanIsExactToASixteenthOfACount) {
    for (uint16_t count = 1; count <= 8; ++count)
        for (uint32_t sum = 0; sum <= 1023u * count; ++sum)
            ASSERT_NEAR(
                current_sense_mean_q4(static_cast<uint16_t>(sum), static_cast<uint8_t>(count)),
                16.0 * sum / count, 0.51)
                << sum << "/" << count;
}

TEST(CurrentSense, OneCountIsAnEighthOfAnAmpere) {
    const CurrentSense self = sense();
    bool saturated = false;
    EXPECT_EQ(current_sense_a_q9(&self, 512 * 16, &saturated), 0);
    EXPECT_EQ(current_sense_a_q9(&self, 513 * 16, &saturated), Q(0.125, 9u));
    EXPECT_EQ(current_sense_a_q9(&self, 511 * 16, &saturated), Q(-0.125, 9u));
    EXPECT_EQ(current_sense_a_q9(&self, 0, &saturated), -32768);
    EXPECT_EQ(current_sense_a_q9(&self, 1023 * 16, &saturated), Q(63.875, 9u));
    EXPECT_FALSE(saturated);
}

TEST(CurrentSense, SaturatesBeyondSixtyFourAmperes) {
    const CurrentSense self = sense(4096, 8191);
    bool saturated = false;
    EXPECT_EQ(current_sense_a_q9(&self, 16376, &saturated), 32740);
    EXPECT_FALSE(saturated);
    const CurrentSense wide = sense(16384);
    EXPECT_EQ(current_sense_a_q9(&wide, 8192 + 2047, &saturated), 32752);
    EXPECT_FALSE(saturated);
    EXPECT_EQ(current_sense_a_q9(&wide, 8192 + 2048, &saturated), 32767);
    EXPECT_TRUE(saturated);
}

TEST(CurrentSense, TripLimitsAreTheLastCountsThatDoNotTrip) {
    const CurrentSense self = sense();
    const CurrentLimits limits = current_sense_limits(&self, static_cast<int16_t>(Q(50.0, 9u)));
    EXPECT_EQ(limits.high, 912);  // 50.0 A exactly
    EXPECT_EQ(limits.low, 112);
    const CurrentLimits least = current_sense_limits(&self, static_cast<int16_t>(Q(50.0, 9u) - 1));
    EXPECT_EQ(least.high, 911);
    EXPECT_EQ(least.low, 113);
}

TEST(CurrentSense, TripIsWithinTheRangeOfTheAdc) {
    const CurrentSense self = sense(1024);  // 0.031 A per count: full scale is 16 A
    const CurrentLimits limits = current_sense_limits(&self, static_cast<int16_t>(Q(55.0, 9u)));
    EXPECT_EQ(limits.low, 1);
    EXPECT_EQ(limits.high, 1022);
}

TEST(CurrentSense, OffsetIsTheMeanAtRest) {
    CurrentSense self = sense();
    bool implausible = true;
    current_sense_rest_begin(&self);
    int ticks = 1;
    while (!current_sense_rest(&self, 5 * 520 + 2, 5, &implausible))
        ++ticks;
    EXPECT_EQ(ticks, 205);
    EXPECT_FALSE(implausible);
    EXPECT_EQ(self.offset_q4, 8326);  // 520.4 counts
}

TEST(CurrentSense, RejectsTheOffsetOfABrokenSensor) {
    for (const int count : {512 - 20, 512 + 20, 512 - 21, 512 + 21}) {
        CurrentSense self = sense();
        bool implausible = false;
        while (!current_sense_rest(&self, static_cast<uint16_t>(8 * count), 8, &implausible)) {
        }
        const bool within = count >= 492 && count <= 532;
        EXPECT_EQ(implausible, !within) << count;
        EXPECT_EQ(self.offset_q4, within ? 16 * count : 8192);
    }
}

TEST(Analog, SupplyInMillivoltsAndInTelemetrySteps) {
    EXPECT_EQ(analog_supply_mv(740, 6400), 18500);
    EXPECT_EQ(analog_supply_mv(1023, 12800), 51150);
    bool saturated = false;
    for (uint32_t mv = 0; mv <= 25587; ++mv)
        ASSERT_EQ(analog_supply_25mv(static_cast<uint16_t>(mv), &saturated), (mv + 12) / 25) << mv;
    EXPECT_FALSE(saturated);
    EXPECT_EQ(analog_supply_25mv(25588, &saturated), 1023);
    EXPECT_TRUE(saturated);
}

TEST(Analog, TemperatureOfTheTmp36) {
    EXPECT_EQ(analog_temperature_c_q4(154), (154 * 125 + 8) / 16 - 800);
    EXPECT_NEAR(analog_temperature_c_q4(154) / 16.0, 25.2, 0.05);
    EXPECT_FALSE(analog_temperature_plausible(19));
    EXPECT_TRUE(analog_temperature_plausible(20));
    EXPECT_TRUE(analog_temperature_plausible(1003));
    EXPECT_FALSE(analog_temperature_plausible(1004));
}

}  // namespace
