// Trigger: dead bands, travel, debouncing of each switch.
#include <gtest/gtest.h>

#include <random>

extern "C" {
#include "drivers/trigger.h"
#include "hal/hal.h"
}

namespace {

Trigger trigger(uint16_t low = 100, uint16_t high = 920) {
    Trigger self{};
    trigger_set_ends(&self, low, high);
    return self;
}

TEST(Trigger, TravelIsLinearBetweenTheDeadBands) {
    for (const auto &[low, high] : {std::pair{100, 920}, {500, 523}, {0, 1023}}) {
        Trigger self = trigger(static_cast<uint16_t>(low), static_cast<uint16_t>(high));
        for (int counts = 1023; counts >= 0; --counts) {
            trigger_set_travel(&self, static_cast<uint16_t>(counts));
            const double share = counts <= low    ? 0.0
                                 : counts >= high ? 1.0
                                                  : double(counts - low) / (high - low);
            ASSERT_NEAR(self.travel_q15, std::min(32767.0, share * 32768.0), 12.0)
                << low << " " << counts;
        }
    }
}

TEST(Trigger, ATravelBeginsBeyondTheDeadBandAndEndsInIt) {
    Trigger self = trigger();
    for (const auto &[counts, begun] : {std::pair{100, false},
                                        {104, false},
                                        {105, true},
                                        {101, true},
                                        {100, false},
                                        {101, false}}) {
        trigger_set_travel(&self, static_cast<uint16_t>(counts));
        EXPECT_EQ(self.travel_q15 > 0, begun) << counts;
    }
    trigger_set_travel(&self, 919);
    EXPECT_LT(self.travel_q15, 32767);
    trigger_set_travel(&self, 920);
    EXPECT_EQ(self.travel_q15, 32767);
}

// A trigger held anywhere at the edge, with noise of one count either way: pressed once at most.
TEST(Trigger, NoiseAtTheEdgeOfTheDeadBandDoesNotRepeatThePress) {
    std::mt19937 rng(1);
    for (int held = 98; held <= 108; ++held) {
        Trigger self = trigger();
        int changes = 0;
        for (int n = 0; n < 2000; ++n) {
            const bool before = self.travel_q15 > 0;
            trigger_set_travel(&self,
                               static_cast<uint16_t>(held + static_cast<int>(rng() % 3) - 1));
            changes += before != (self.travel_q15 > 0) ? 1 : 0;
        }
        EXPECT_LE(changes, 1) << held;
    }
}

TEST(Trigger, ATravelBeyondHalfWithAnOpenContactIsImplausible) {
    Trigger self = trigger();
    trigger_set_travel(&self, 500);
    EXPECT_FALSE(trigger_implausible(&self));
    trigger_set_travel(&self, 1023);
    EXPECT_TRUE(trigger_implausible(&self));
    for (int k = 0; k < 5; ++k)
        trigger_set_switches(&self, HAL_SWITCH_CONTACT);
    EXPECT_FALSE(trigger_implausible(&self));
}

TEST(Trigger, EachSwitchIsDebouncedIndependently) {
    for (const uint8_t bit : {uint8_t{1}, uint8_t{2}, uint8_t{4}, uint8_t{8}}) {
        Trigger self = trigger();
        for (unsigned k = 1; k < TRIGGER_DEBOUNCE_TICKS; ++k)
            trigger_set_switches(&self, bit);
        EXPECT_EQ(self.stable, 0);
        trigger_set_switches(&self, bit);
        EXPECT_EQ(self.stable, bit);
        for (unsigned k = 1; k < TRIGGER_DEBOUNCE_TICKS; ++k)
            trigger_set_switches(&self, 0);
        EXPECT_EQ(self.stable, bit);
        trigger_set_switches(&self, 0);
        EXPECT_EQ(self.stable, 0);
    }
}

TEST(Trigger, ABounceRestartsTheDebouncing) {
    Trigger self = trigger();
    for (int k = 0; k < 50; ++k) {
        trigger_set_switches(&self, static_cast<uint8_t>(k % 5 == 4 ? 0 : 15));
        ASSERT_EQ(self.stable, 0);
    }
    for (int k = 0; k < 5; ++k)
        trigger_set_switches(&self, 15);
    EXPECT_TRUE(trigger_contact(&self) && trigger_reverse(&self));
    EXPECT_EQ(trigger_mode(&self), 3);
}

TEST(Trigger, IsPressedByContactAndTravelTogether) {
    Trigger self = trigger();
    trigger_set_travel(&self, 500);
    EXPECT_FALSE(trigger_pressed(&self));
    for (int k = 0; k < 5; ++k)
        trigger_set_switches(&self, HAL_SWITCH_CONTACT);
    EXPECT_TRUE(trigger_pressed(&self));
    trigger_set_travel(&self, 100);
    EXPECT_FALSE(trigger_pressed(&self));
}

}  // namespace
