// Synchronisation on synthetic blows: level over supply, trim by the depth of the valleys and by
// current, limits, and random inputs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>

extern "C" {
#include "controllers/sync.h"
}

namespace {

constexpr double V = 1000.0;
const SyncSetpoints BY_SPEED{CONTROLLER_METHOD_SPEED, 14200, 15500, 393, 1966, 12800},
    BY_CURRENT{CONTROLLER_METHOD_CURRENT, 14200, 15500, 393, 1966, 12800};

ControllerInputs inputs(double travel, double supply_v, double current_a = 25.0) {
    return {static_cast<int16_t>(travel * 32767),
            16000,
            static_cast<int16_t>(current_a * 512),
            static_cast<uint16_t>(supply_v * V),
            20000,
            false,
            0,
            0};
}

// Impacts at 8,000 rpm with valleys of a given depth; `struck`: a blow in this tick.
Blow impacting(double depth, bool struck) {
    Blow blow{};
    blow.impacting = true;
    blow.lugs = struck ? 1 : 0;
    blow.base_rpm = 8000;
    blow.ripple_rpm = static_cast<int16_t>(depth * 8000);
    return blow;
}

struct Tool {
    SyncSetpoints set;
    Sync sync{};
    int16_t duty = 0;

    explicit Tool(const SyncSetpoints &s) : set(s) { sync_start(&sync, &set); }

    // Blows 20 ms apart; returns the mean voltage of the motor at the end.
    double run(int ms, double travel, double supply_v, double depth, double current_a = 25.0) {
        const ControllerInputs in = inputs(travel, supply_v, current_a);
        for (int n = 0; n < ms; ++n) {
            const Blow blow = impacting(depth, n % 20 == 19);
            duty = sync_step(&sync, &set, &in, &blow);
        }
        return duty / 32767.0 * supply_v;
    }

    // Regular valleys every 20 ms with periods that are off their mean by a share, alternately, and
    // blows of so many lugs; returns the level in V.
    double uneven(int blows, double off, double supply_v = 20.5, uint8_t lugs = 1) {
        const ControllerInputs in = inputs(0.6, supply_v);
        for (int n = 0; n < 20 * blows; ++n) {
            Blow blow = impacting(0.03, n % 20 == 19);
            blow.lugs = blow.lugs > 0 ? lugs : uint8_t{0};
            blow.mean_period_q7 = 20 * 128;
            blow.period_q4 =
                static_cast<uint16_t>(20 * 16 * (1 + (n / 20 % 2 == 0 ? off : -off)) + 0.5);
            duty = sync_step(&sync, &set, &in, &blow);
        }
        return sync_estimate(&sync) / V;
    }

    double free_run(int ms, double travel, double supply_v) {
        const ControllerInputs in = inputs(travel, supply_v);
        const Blow none{};
        for (int n = 0; n < ms; ++n)
            duty = sync_step(&sync, &set, &in, &none);
        return duty / 32767.0;
    }
};

class SyncMethods : public ::testing::TestWithParam<SyncSetpoints> {};

TEST_P(SyncMethods, TheTriggerSetsTheDutyUntilTheToolImpacts) {
    Tool tool(GetParam());
    EXPECT_NEAR(tool.free_run(1, 0.7, 18.5), 0.7, 1e-4);
    EXPECT_NEAR(tool.free_run(31, 0.4, 18.5), 0.4, 1e-4);
    EXPECT_EQ(sync_state(&tool.sync), SYNC_PLAIN);
}

TEST_P(SyncMethods, TheLevelDoesNotDependOnTheSupply) {
    for (double supply_v = 15.6; supply_v < 20.6; supply_v += 0.7) {
        Tool tool(GetParam());
        EXPECT_NEAR(tool.run(400, 1.0, supply_v, 0.03), 15.5, 0.02) << supply_v;
        EXPECT_NEAR(sync_estimate(&tool.sync), 15500, 2);
    }
}

TEST_P(SyncMethods, TheTriggerMovesTheLevelWithinTheBand) {
    Tool light(GetParam()), full(GetParam());
    const double low = light.run(400, 0.31, 18.5, 0.03), high = full.run(400, 1.0, 18.5, 0.03);
    EXPECT_NEAR(low, 14.2 + 0.31 * 1.3, 0.03);
    EXPECT_NEAR(high, 15.5, 0.03);
}

TEST_P(SyncMethods, ANearlyReleasedTriggerSetsTheDuty) {
    Tool tool(GetParam());
    EXPECT_NEAR(tool.run(400, 0.29, 18.5, 0.3) / 18.5, 0.29, 1e-3);
}

TEST_P(SyncMethods, TheDutyMovesAtALimitedRate) {
    Tool tool(GetParam());
    tool.free_run(10, 0.6, 18.5);
    int16_t last = tool.duty;
    for (int n = 0; n < 200; ++n) {
        tool.run(1, 0.6, 18.5, 0.03);
        ASSERT_LE(tool.duty - last, 328);
        ASSERT_GE(tool.duty, last);
        last = tool.duty;
    }
    EXPECT_GT(last, 0.7 * 32767);
}

TEST_P(SyncMethods, TheStateChangesInTheTickAfterABlowWhateverElseIsDue) {
    const ControllerInputs in = inputs(0.6, 18.5);
    for (int before = 1; before < 12; ++before) {
        Tool tool(GetParam());
        const auto tick = [&](bool struck) {
            const Blow blow = impacting(0.03, struck);
            sync_step(&tool.sync, &tool.set, &in, &blow);
            return sync_state(&tool.sync);
        };
        for (int n = 0; n < before; ++n)
            ASSERT_EQ(tick(false), SYNC_HOLD);
        ASSERT_EQ(tick(true), SYNC_HOLD) << before;
        ASSERT_EQ(tick(false), SYNC_SEEK) << before << " ticks before the blow";
    }
}

TEST_P(SyncMethods, RegularPeriodsKeepTheLevel) {
    Tool tool(GetParam());
    const double before = tool.uneven(10, 0.0);
    EXPECT_NEAR(tool.uneven(200, 0.06), before, 0.01);
    EXPECT_EQ(sync_state(&tool.sync), SYNC_HOLD);
}

TEST_P(SyncMethods, IrregularPeriodsMoveTheLevelAcrossOnceAndLaterRegularOnesKeepIt) {
    Tool tool(GetParam());
    const double before = tool.uneven(20, 0.0);
    EXPECT_NEAR(tool.uneven(8, 0.15), before, 0.01);
    EXPECT_NEAR(tool.uneven(6, 0.15), before + 0.9, 0.01);
    EXPECT_NEAR(tool.uneven(100, 0.03), before + 0.9, 0.01);
}

TEST_P(SyncMethods, LugsWithoutAValleyAreIrregularToo) {
    Tool tool(GetParam());
    const double before = tool.uneven(20, 0.0);
    EXPECT_NEAR(tool.uneven(14, 0.0, 20.5, 2), before + 0.9, 0.01);
}

TEST_P(SyncMethods, TheFirstBlowsOfADriveMayBeIrregular) {
    Tool tool(GetParam());
    const double before = tool.uneven(1, 0.3);
    EXPECT_NEAR(tool.uneven(22, 0.3), before, 0.01);
    EXPECT_GT(tool.uneven(10, 0.3), before + 0.5);
}

TEST_P(SyncMethods, IrregularPeriodsAtFullDutyMoveTheLevelDownFromTheSupply) {
    Tool tool(GetParam());
    EXPECT_GT(tool.uneven(20, 0.0, 14.5), 14.8);
    EXPECT_NEAR(tool.uneven(14, 0.15, 14.5), 14.5 - 0.9, 0.03);
    EXPECT_NEAR(tool.duty / 32767.0 * 14.5, 13.6, 0.1);
}

TEST_P(SyncMethods, PersistentIrregularitySearchesTheWholeBandUpAndDown) {
    Tool tool(GetParam());
    double least = 20, most = 0;
    for (int n = 0; n < 400; ++n) {
        const double level = tool.uneven(1, 0.2);
        least = level > 0 ? std::min(least, level) : least;
        most = std::max(most, level);
    }
    EXPECT_NEAR(most, 16.6, 0.01);
    EXPECT_NEAR(least, 13.4, 0.01);
}

// For another tool: its level, and the limits of the trim around it.
TEST_P(SyncMethods, TheParametersSetTheLevelAndItsLimits) {
    for (const auto &[low_mv, high_mv] : {std::pair{6000, 6000},
                                          {6000, 25000},
                                          {10000, 12000},
                                          {12922, 14105},
                                          {15833, 17282},
                                          {18000, 18000},
                                          {25000, 25000}}) {
        SyncSetpoints set = GetParam();
        set.low_mv = static_cast<int16_t>(low_mv);
        set.high_mv = static_cast<int16_t>(high_mv);
        Tool full(set), part(set), deep(set);
        EXPECT_NEAR(full.run(600, 1.0, 31.0, 0.03), high_mv / V, 0.05) << low_mv;
        EXPECT_NEAR(sync_estimate(&full.sync), high_mv, 2) << low_mv;
        part.run(600, 0.5, 31.0, 0.03);
        EXPECT_NEAR(sync_estimate(&part.sync), (low_mv + high_mv) / 2, 2) << low_mv;
        deep.run(9000, 1.0, 31.0, 0.25);
        EXPECT_NEAR(sync_estimate(&deep.sync), high_mv + 1100, 2) << low_mv;
        double least = 40;
        Tool irregular(set);
        for (int n = 0; n < 1200; ++n) {
            const double level = irregular.uneven(1, 0.2, 31.0);
            least = level > 0 ? std::min(least, level) : least;
        }
        EXPECT_NEAR(least, (low_mv - 800) / V, 0.01) << high_mv;
    }
}

// If sync_low_mv is far above sync_high_mv, the lower limit of the level exceeds the upper one: the
// upper one then holds.
TEST_P(SyncMethods, CrossedLimitsGiveOneLevel) {
    SyncSetpoints set = GetParam();
    set.low_mv = 20000;
    set.high_mv = 8000;
    Tool tool(set);
    tool.run(600, 1.0, 31.0, 0.03);
    for (int n = 0; n < 50; ++n) {
        tool.run(1, 1.0, 31.0, 0.03);
        ASSERT_EQ(sync_estimate(&tool.sync), 8000 + 1100) << n;
    }
}

TEST_P(SyncMethods, ALevelFarFromTheVoltageIsApproachedWithoutOverflow) {
    SyncSetpoints high = GetParam(), low = GetParam();
    high.low_mv = high.high_mv = 25000;
    low.low_mv = low.high_mv = 6000;
    Tool up(high), down(low);
    EXPECT_NEAR(up.run(600, 1.0, 12.0, 0.03), 12.0, 0.01);
    down.free_run(400, 1.0, 32.0);
    EXPECT_NEAR(down.run(600, 1.0, 32.0, 0.03), 6.0, 0.05);
}

TEST_P(SyncMethods, OutOfStepRaisesTheLevelFastToItsLimit) {
    Tool tool(GetParam());
    const double before = tool.run(200, 0.6, 20.5, 0.03), after = tool.run(200, 0.6, 20.5, 0.25);
    EXPECT_GT(after, before + 1.0);
    EXPECT_EQ(sync_state(&tool.sync), SYNC_SEEK);
    EXPECT_NEAR(tool.run(2000, 0.6, 20.5, 0.25), 16.6, 0.03);
    tool.run(20, 0.6, 20.5, 0.03);
    EXPECT_EQ(sync_state(&tool.sync), SYNC_HOLD);
}

TEST_P(SyncMethods, AnEmptyBatteryCausesNoWindUp) {
    Tool tool(GetParam());
    EXPECT_NEAR(tool.run(4000, 1.0, 13.0, 0.25), 13.0, 0.01);
    EXPECT_EQ(tool.duty, 32767);
    EXPECT_LT(tool.sync.trim_mv, 1000);
}

TEST_P(SyncMethods, WithoutBlowsTheTriggerSetsTheDutyAndTheTrimIsKept) {
    Tool tool(GetParam());
    const double level = tool.run(600, 0.6, 20.5, 0.15);
    EXPECT_NEAR(tool.free_run(300, 0.6, 20.5), 0.6, 1e-4);
    EXPECT_NEAR(tool.run(100, 0.6, 20.5, 0.03), level, 0.3);
    sync_start(&tool.sync, &tool.set);
    EXPECT_EQ(tool.sync.trim_mv, 0);
}

TEST_P(SyncMethods, RandomInputsGiveADuty) {
    std::mt19937 random(3);
    std::uniform_int_distribution<int> any(-32768, 32767);
    Tool tool(GetParam());
    for (int n = 0; n < 200000; ++n) {
        const ControllerInputs in{static_cast<int16_t>(any(random) & 0x7FFF),
                                  static_cast<int16_t>(any(random)),
                                  static_cast<int16_t>(any(random)),
                                  static_cast<uint16_t>(any(random) * (n % 3)),
                                  static_cast<int16_t>(any(random) & 0x7FFF),
                                  n % 5 == 0,
                                  0,
                                  0};
        Blow blow{};
        blow.impacting = random() % 4 != 0;
        blow.lugs = static_cast<uint8_t>(random() % 3);
        blow.base_rpm = static_cast<int16_t>(any(random));
        blow.ripple_rpm = static_cast<int16_t>(any(random));
        ASSERT_GE(sync_step(&tool.sync, &tool.set, &in, &blow), 0) << n;
        ASSERT_GE(sync_estimate(&tool.sync), 0);
        ASSERT_LE(sync_estimate(&tool.sync), 16600);
    }
}

INSTANTIATE_TEST_SUITE_P(Methods, SyncMethods, ::testing::Values(BY_SPEED, BY_CURRENT),
                         [](const auto &set) {
                             return set.param.method == CONTROLLER_METHOD_SPEED ? "Speed"
                                                                                : "Current";
                         });

TEST(Sync, DeepValleysRaiseTheLevelAndShallowOnesLowerIt) {
    Tool tool(BY_SPEED);
    EXPECT_NEAR(tool.run(100, 0.6, 18.5, 0.0601), 14.98 + 0.5,
                0.12);  // five blows: the limit is 0.06
    Tool even(BY_SPEED);
    EXPECT_NEAR(even.run(100, 0.6, 18.5, 0.0597), 14.98, 0.03);
    EXPECT_NEAR(even.run(100, 0.6, 18.5, 0.0121), 14.98, 0.03);
    Tool high(BY_SPEED);
    EXPECT_NEAR(high.run(2000, 0.6, 18.5, 0.0117), 13.4, 0.03);
}

TEST(Sync, CurrentIsHeldWithinItsDeadBand) {
    Tool held(BY_CURRENT), low(BY_CURRENT), high(BY_CURRENT);
    EXPECT_NEAR(held.run(1000, 0.6, 18.5, 0.03, 25.0), held.run(1000, 0.6, 18.5, 0.03, 27.9), 0.01);
    EXPECT_GT(low.run(3000, 0.6, 18.5, 0.03, 20.0), 16.5);
    EXPECT_LT(high.run(3000, 0.6, 18.5, 0.03, 30.0), 13.42);
}

}  // namespace
