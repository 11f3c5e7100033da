// Bridge: compare values, dead time, phases, never both transistors of a leg, times at which orders
// are applied.
#include <gtest/gtest.h>

extern "C" {
#include "drivers/h_bridge.h"
#include "hal/hal.h"
}
#include "hal/native/native.h"

namespace {

struct BridgeTest : testing::Test {
    HBridge bridge{};

    void SetUp() override {
        native_reset();
        h_bridge_init(&bridge, 2);
    }

    void tick(int compare) {
        h_bridge_on_apply(&bridge);
        h_bridge_next_row(&bridge);
        h_bridge_stage(&bridge, static_cast<int16_t>(compare));
    }
};

TEST(HBridge, CompareIsTheNearest) {
    for (int duty = -32768; duty <= 32767; ++duty)
        ASSERT_NEAR(h_bridge_compare(static_cast<int16_t>(duty)), duty * 255.0 / 32768.0, 0.5)
            << duty;
    EXPECT_EQ(h_bridge_compare(32767), 255);
    EXPECT_EQ(h_bridge_compare(-32768), -255);
}

TEST(HBridge, LegANeverTurnsBothOnAndDoesNotSwitchAtTheEnds) {
    for (uint8_t dead = 2; dead <= 60; ++dead) {
        for (int c = 0; c <= 255; ++c) {
            HBridgeOrder order{};
            h_bridge_leg_a(&order, static_cast<uint8_t>(c), dead);
            if (c == 0 || c == 255) {  // one transistor on all the time, the other never
                ASSERT_EQ(order.high_below, c);
                ASSERT_EQ(order.low_above, c);
                continue;
            }
            ASSERT_LE(order.high_below, c);
            ASSERT_GE(order.low_above, c);
            if (order.high_below > 0 && order.low_above < 255) {
                ASSERT_EQ(order.low_above - order.high_below, dead) << c;
            }
        }
    }
}

TEST_F(BridgeTest, ArmsForOneTickBeforeItDrives) {
    tick(100);
    EXPECT_FALSE(native.armed);
    tick(101);
    EXPECT_TRUE(native.armed);
    EXPECT_FALSE(native.enabled);
    EXPECT_EQ(bridge.row_compare, H_BRIDGE_COAST);
    tick(102);
    EXPECT_TRUE(native.enabled);
    EXPECT_EQ(native.high_below, 100);
    EXPECT_EQ(native.low_above, 102);
    tick(103);
    EXPECT_EQ(bridge.row_compare, 101) << "the row has the compare value applied at its beginning";
}

TEST_F(BridgeTest, ReverseHoldsLegBHigh) {
    for (int k = 0; k < 4; ++k)
        tick(-55);
    EXPECT_TRUE(native.leg_b_high);
    EXPECT_EQ(native.high_below, 199);
    EXPECT_EQ(native.low_above, 201);
    EXPECT_EQ(bridge.row_compare, -55);
}

TEST_F(BridgeTest, AChangeOfLegBPassesThroughOpen) {
    for (int k = 0; k < 4; ++k)
        tick(10);
    ASSERT_TRUE(native.enabled);
    const uint32_t opened = native.opened;
    tick(-10);
    tick(-10);
    EXPECT_FALSE(native.enabled);
    EXPECT_EQ(native.opened, opened + 1);
    tick(-10);
    EXPECT_TRUE(native.armed && native.leg_b_high && !native.enabled);
    tick(-10);
    EXPECT_TRUE(native.enabled);
}

TEST_F(BridgeTest, BrakeKeepsTheLeg) {
    for (int k = 0; k < 4; ++k)
        tick(-10);
    tick(0);
    tick(0);
    EXPECT_EQ(native.high_below, 253) << "via the value at which the low side is off";
    EXPECT_EQ(native.low_above, 255);
    tick(0);
    EXPECT_TRUE(native.enabled && native.leg_b_high);
    EXPECT_EQ(native.high_below, 255) << "both high sides on: short circuit";
    EXPECT_EQ(native.low_above, 255);
}

TEST_F(BridgeTest, CoastOpensAtTheNextTick) {
    for (int k = 0; k < 4; ++k)
        tick(200);
    tick(H_BRIDGE_COAST);
    ASSERT_TRUE(native.enabled);
    h_bridge_on_apply(&bridge);
    EXPECT_FALSE(native.enabled);
    EXPECT_EQ(native.high_below, 0);
    EXPECT_EQ(native.low_above, 255);
}

TEST_F(BridgeTest, ATripOpensAtOnceAndHoldsUntilCleared) {
    for (int k = 0; k < 4; ++k)
        tick(200);
    h_bridge_on_trip(&bridge);
    EXPECT_FALSE(native.enabled);
    tick(200);
    EXPECT_FALSE(native.enabled) << "a staged order must not enable it";
    h_bridge_note_trip(&bridge);
    EXPECT_EQ(bridge.row_compare, H_BRIDGE_COAST);
    tick(H_BRIDGE_COAST);
    h_bridge_clear_trip(&bridge);
    for (int k = 0; k < 3; ++k)
        tick(50);
    EXPECT_TRUE(native.enabled);
}

// The compare values are written with a margin before the TOP that latches them, at every phase of
// the tick.
TEST_F(BridgeTest, IsAppliedWithAMarginBeforeTop) {
    for (uint64_t k = 0; k < 5000; ++k) {
        h_bridge_next_row(&bridge);
        h_bridge_stage(&bridge, 10);
        const uint64_t applied =
            16000 * (k + 2) +
            (native.apply_later ? HAL_APPLY_LATER_CYCLES : 0);  // ordered in the previous tick
        const uint64_t since_top = (applied - HAL_FIRST_TOP_CYCLES) % HAL_CYCLES_PER_PERIOD;
        ASSERT_GE(HAL_CYCLES_PER_PERIOD - since_top, HAL_APPLY_MARGIN_CYCLES) << k;
        ASSERT_EQ(native.locks, 0);
    }
}

}  // namespace
