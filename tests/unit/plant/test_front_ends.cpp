// Counts of the front ends at, just under and just over their limits; noise is seeded.
#include <cmath>
#include <gtest/gtest.h>

#include "plant/components/front_ends.hpp"
#include "plant/numeric/noise.hpp"

using namespace vgroove;

TEST(FrontEnds, CurrentIsCentredAndClips) {
    EXPECT_EQ(current_counts(0.0, 0.0, 0.0), 512);
    EXPECT_EQ(current_counts(0.0624, 0.0, 0.0), 512);
    EXPECT_EQ(current_counts(0.0626, 0.0, 0.0), 513);
    EXPECT_EQ(current_counts(63.875, 0.0, 0.0), 1023);
    EXPECT_EQ(current_counts(80.0, 0.0, 0.0), 1023);
    EXPECT_EQ(current_counts(-64.0, 0.0, 0.0), 0);
    EXPECT_EQ(current_counts(-70.0, 0.0, 0.0), 0);
    EXPECT_EQ(current_counts(1.0, 0.5, 0.25), 512 + 14);
}

TEST(FrontEnds, BusTriggerTemperature) {
    EXPECT_EQ(bus_counts(40.96), 1023);
    EXPECT_EQ(bus_counts(50.0), 1023);
    EXPECT_EQ(bus_counts(18.5), 462);
    EXPECT_EQ(trigger_counts(0.0), 102);
    EXPECT_EQ(trigger_counts(1.0), 921);
    EXPECT_EQ(temperature_counts(25.0), 153);
    EXPECT_EQ(temperature_counts(-60.0), 0);
}

TEST(FrontEnds, NoiseIsSeededAndHasUnitSigma) {
    Noise a{5}, b{5};
    double sum = 0.0, squares = 0.0;
    for (int n = 0; n < 20000; ++n) {
        const double x = noise_normal(a);
        ASSERT_EQ(x, noise_normal(b));
        sum += x;
        squares += x * x;
    }
    EXPECT_NEAR(sum / 20000, 0.0, 0.03);
    EXPECT_NEAR(squares / 20000, 1.0, 0.05);
}
