// Blow detection on synthetic signals: counts, repeats, notches, missed valleys, pauses, and random
// inputs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

extern "C" {
#include "controllers/blow.h"
}

namespace {

constexpr double TURN = 2.8;  // of the motor, from lug to lug
constexpr double PI = 3.14159265358979;
const BlowSetpoints SPEED{717, BLOW_SOURCE_SPEED, 190, 876},
    CURRENT{717, BLOW_SOURCE_CURRENT, 190, 876};
constexpr double SUPPLY_MV = 17000, MOHM = 190, RPM_PER_V = 876, DUTY = 0.8;

// Inputs that the board measures at a motor speed and a duty.
ControllerInputs measured(double rpm, double duty = DUTY) {
    const double current = 1e3 * (duty * SUPPLY_MV * 1e-3 - rpm / RPM_PER_V) / MOHM;
    return {0,
            static_cast<int16_t>(std::lround(2 * rpm)),
            static_cast<int16_t>(std::min(32767L, std::lround(512 * current))),
            static_cast<uint16_t>(SUPPLY_MV),
            static_cast<int16_t>(duty * 32767),
            false,
            0,
            0};
}

struct Swing {
    double per_min, ripple;  // blows; peak to peak as a share of the mean
    double second = 0.0;     // depth of a second valley, as a share of the first
    double duty = DUTY;
};

// Mean speed at which the motor turns by TURN from blow to blow; valleys at phase 0, second ones at
// phase 0.4.
double speed_at(const Swing &s, double time_s) {
    const double phase = time_s * s.per_min / 60.0;
    const double mean = TURN * s.per_min;
    const auto dip = [](double x) {
        return std::exp(-40.0 * (1.0 - std::cos(2.0 * PI * x)) / 8.0);
    };
    return mean * (1.0 + s.ripple * (0.3 - dip(phase) - s.second * dip(phase - 0.4)));
}

struct Found {
    int lugs = 0, repeats = 0, hits = 0;  // hits: ticks that reported blows
    double period_ms = 0.0, longest_ms = 0.0, shortest_ms = 1e9;
};

Found run(Blow &blow, const BlowSetpoints &set, const Swing &swing, double from_s, double to_s) {
    Found found;
    for (int ms = static_cast<int>(from_s * 1e3); ms < static_cast<int>(to_s * 1e3); ++ms) {
        const ControllerInputs in = measured(speed_at(swing, 1e-3 * ms), swing.duty);
        blow_step(&blow, &set, &in);
        found.lugs += blow.lugs;
        found.repeats += blow.lugs * blow.repeats;
        found.hits += blow.lugs > 0 ? 1 : 0;
        if (blow.lugs > 0 && found.hits > 3) {
            found.period_ms = blow.period_q4 / 16.0;
            found.longest_ms = std::max(found.longest_ms, found.period_ms);
            found.shortest_ms = std::min(found.shortest_ms, found.period_ms);
        }
    }
    return found;
}

// A constant speed with valleys; the times between them repeat, the first valley comes so much
// earlier than the first of these times.
Found run_valleys(Blow &blow, const BlowSetpoints &set, double rpm, double ripple,
                  const std::vector<double> &gaps_ms, double seconds, double earlier_ms = 0.0) {
    Found found;
    std::vector<double> valleys_ms{gaps_ms[0] - earlier_ms};
    while (valleys_ms.back() < 1e3 * seconds)
        valleys_ms.push_back(valleys_ms.back() + gaps_ms[valleys_ms.size() % gaps_ms.size()]);
    for (int ms = 0; ms < static_cast<int>(1e3 * seconds); ++ms) {
        double dip = 0.0;
        for (const double at_ms : valleys_ms)
            dip += std::exp(-0.5 * std::pow((ms - at_ms) / 2, 2));
        const ControllerInputs in = measured(rpm * (1.0 + ripple * (0.3 - dip)));
        blow_step(&blow, &set, &in);
        found.lugs += blow.lugs;
    }
    return found;
}

class BlowSources : public ::testing::TestWithParam<BlowSetpoints> {
protected:
    void SetUp() override { blow_start(&blow, &GetParam()); }
    Blow blow{};
};

TEST_P(BlowSources, CountsEveryBlowFrom1200To4000PerMinute) {
    for (const double ripple : {0.01, 0.05, 0.2})
        for (double rate = 1200; rate <= 4000; rate += 175) {
            blow_start(&blow, &GetParam());
            run(blow, GetParam(), {rate, ripple}, 0.0, 0.2);
            const Found found = run(blow, GetParam(), {rate, ripple}, 0.2, 2.2);
            EXPECT_NEAR(found.lugs, rate / 30.0, 0.01 * rate / 30.0 + 1.0)
                << rate << " ripple " << ripple;
        }
}

TEST_P(BlowSources, PeriodIsFinerThanTheTick) {
    const Found found = run(blow, GetParam(), {3000, 0.05}, 0.0, 1.0);
    EXPECT_NEAR(found.period_ms, 20.0, 0.3);
    run(blow, GetParam(), {2890, 0.05}, 0.0, 2.0);
    EXPECT_NEAR(blow.mean_period_q7 / 128.0, 60e3 / 2890, 0.2);
    EXPECT_LT(blow.spread_q15, 0.03 * 32768);
}

TEST_P(BlowSources, ANotchOfASmallRippleIsNoSecondBlow) {
    const Found found = run(blow, GetParam(), {3000, 0.03, 0.7}, 0.0, 2.0);
    EXPECT_NEAR(found.lugs, 100, 1);
    EXPECT_EQ(found.repeats, 0);
}

TEST_P(BlowSources, RippleAndBaseSpeedAreThoseOfTheSignal) {
    run(blow, GetParam(), {3000, 0.05}, 0.0, 1.0);
    const double mean = TURN * 3000;
    EXPECT_NEAR(blow.base_rpm, mean, 0.03 * mean);
    EXPECT_NEAR(blow.ripple_rpm, 0.05 * mean, 0.02 * mean);
}

// Duty at which the motor draws a mean current while the hammer needs `ms` from lug to lug.
double duty_at(double ms, double amps) {
    return (TURN * 60e3 / ms / RPM_PER_V + 1e-3 * MOHM * amps) / (1e-3 * SUPPLY_MV);
}

// Repeats per lug that are reported at a time per lug, a mean current and a ripple.
double repeats_at(const BlowSetpoints &set, double ms, double amps, double ripple) {
    Blow blow{};
    const Swing swing{60e3 / ms, ripple, 0.0, duty_at(ms, amps)};
    blow_start(&blow, &set);
    run(blow, set, swing, 0.0, 0.3);
    const Found found = run(blow, set, swing, 0.3, 1.5);
    EXPECT_NEAR(found.lugs, 1200 / ms, 1.5) << ms;
    return static_cast<double>(found.repeats) / found.lugs;
}

// From lug to lug in 31 ms or less the hammer has no time for a second swing, in 50 ms or more it
// has time for a third.
TEST_P(BlowSources, RepeatsFollowFromTheTimePerLug) {
    const struct {
        double ms, amps;
        int repeats;
    } cases[] = {{27.0, 10, 0}, {30.0, 10, 0}, {32.5, 10, 1}, {35.0, 18, 1},
                 {40.0, 10, 1}, {47.0, 16, 1}, {54.0, 16, 2}};
    for (const auto &c : cases)
        EXPECT_EQ(repeats_at(GetParam(), c.ms, c.amps, 0.1), c.repeats) << c.ms << ' ' << c.amps;
}

// Between 33.9 and 36.0 ms, and for a third landing, the current decides beside the Hall speed.
TEST(Blow, ASmallCurrentIsAFreeSwing) {
    EXPECT_EQ(repeats_at(SPEED, 35.0, 10, 0.1), 0);
    EXPECT_EQ(repeats_at(SPEED, 54.0, 10, 0.1), 1);
    EXPECT_EQ(repeats_at(CURRENT, 35.0, 10, 0.1), 1);
    EXPECT_EQ(repeats_at(CURRENT, 54.0, 10, 0.1), 2);
}

// Just below 31 ms a contact shows by the current, detected by the Hall speed alone.
TEST(Blow, ACurrentAboveThatOfAFreeSwingIsARepeat) {
    EXPECT_EQ(repeats_at(SPEED, 30.0, 18, 0.1), 1);
    EXPECT_EQ(repeats_at(SPEED, 30.0, 15, 0.1), 0);
    EXPECT_EQ(repeats_at(CURRENT, 30.0, 18, 0.1), 0);
}

// Up to 23 ms it shows by current, small ripple and the slip of the joint together.
TEST(Blow, AGrazingContactNeedsCurrentRippleAndSlip) {
    constexpr double SLIPPING = 1.03 * 60e3 / 2500;
    const auto slipping_at = [&](double amps, double ripple) {
        Blow blow{};
        blow_start(&blow, &SPEED);
        Swing swing{60e3 / SLIPPING, ripple, 0.0, DUTY};
        Found found;
        for (int ms = 0; ms < 2000; ++ms) {  // 3 % faster than lug by lug of a held anvil
            const double rpm = 1.03 * speed_at(swing, 1e-3 * ms);
            ControllerInputs in = measured(rpm);
            in.current_a_q9 = static_cast<int16_t>(512 * amps);
            blow_step(&blow, &SPEED, &in);
            found.lugs += ms > 1000 ? blow.lugs : 0;
            found.repeats += ms > 1000 ? blow.lugs * blow.repeats : 0;
        }
        return static_cast<double>(found.repeats) / found.lugs;
    };
    EXPECT_GT(slipping_at(22, 0.08), 0.8);
    EXPECT_EQ(slipping_at(17, 0.08), 0);
    EXPECT_EQ(slipping_at(22, 0.15), 0);
    EXPECT_LT(repeats_at(SPEED, SLIPPING, 22, 0.08), 0.2);  // a joint that is held
}

// A screw without load for seconds, then impacts with a small ripple.
TEST_P(BlowSources, BlowsAreDetectedAfterALongFreeRun) {
    run(blow, GetParam(), {3000, 0.0}, 0.0, 3.0);
    EXPECT_EQ(blow.count, 0);
    EXPECT_NEAR(run(blow, GetParam(), {3000, 0.02}, 3.0, 5.0).lugs, 1 + 100, 2.0);
}

TEST_P(BlowSources, ConstantSpeedHasNoBlow) {
    const Found found = run(blow, GetParam(), {3000, 0.0}, 0.0, 2.0);
    EXPECT_EQ(found.lugs, 0);
    EXPECT_FALSE(blow.impacting);
}

TEST(Blow, TheIntegralOfTheCurrentStaysInRangeWithoutABlow) {
    for (const int16_t extreme : std::vector<int16_t>{INT16_MAX, INT16_MIN}) {
        Blow blow{};
        blow_start(&blow, &SPEED);
        ControllerInputs in = measured(8000);
        in.current_a_q9 = extreme;
        for (int ms = 0; ms < 3000; ++ms) {
            blow_step(&blow, &SPEED, &in);
            ASSERT_EQ(blow.charge_q1 > 0, extreme > 0) << ms;
        }
    }
}

TEST_P(BlowSources, ARunUpHasNoBlow) {
    for (int ms = 0; ms < 400; ++ms) {
        const ControllerInputs in = measured(
            11000.0 *
            (1.0 - std::exp(-(ms + 20) / 80.0)));  // starting with a current within its range
        blow_step(&blow, &GetParam(), &in);
        ASSERT_EQ(blow.lugs, 0) << ms;
    }
}

TEST_P(BlowSources, AMissingValleyCountsAsABlow) {
    run(blow, GetParam(), {2400, 0.1}, 0.0, 0.5);
    const uint16_t before = blow.count;
    int lugs = 0;
    for (int ms = 500; ms < 600; ++ms) {  // 4 periods of 25 ms, the valley at 550 is missing
        const double phase = ms * 0.04;
        const bool filled = phase > 21.6 && phase < 22.4;
        const ControllerInputs in =
            measured(filled ? TURN * 2400 * 1.03 : speed_at({2400, 0.1}, 1e-3 * ms));
        blow_step(&blow, &GetParam(), &in);
        lugs += blow.lugs;
    }
    EXPECT_EQ(lugs, 4);
    EXPECT_EQ(blow.count - before, 4);
}

// When the next valley does not come, a lug is counted by its angle. The first blow after the pause
// corrects that and adds the first contact, which leaves no valley.
TEST_P(BlowSources, TwoValleysForThreeLugsAreNoJointThatTurns) {
    const Found found = run_valleys(blow, GetParam(), 8200, 0.07, {29.1, 32.4}, 4.0);
    EXPECT_NEAR(found.lugs, 4000 / 61.5 * 3, 6);
}

TEST_P(BlowSources, AJointThatTurnsByNearlyALugBetweenTheBlowsDoublesNone) {
    for (const double period_ms : {24.0, 26.0, 28.0}) {
        blow_start(&blow, &GetParam());
        const double rpm = 1.77 * TURN * 60e3 / period_ms;
        const Found found = run_valleys(blow, GetParam(), rpm, 0.07, {period_ms}, 2.0);
        EXPECT_NEAR(found.lugs, 2000 / period_ms, 3) << period_ms;
    }
}

TEST_P(BlowSources, AFirstValleyBeyondOneAndAHalfLugsIsThatOfTheSecond) {
    for (const auto &[lugs, counted] : {std::pair{1.2, 2}, {1.8, 3}, {2.2, 3}, {2.7, 2}}) {
        blow_start(&blow, &GetParam());
        const double lug_ms = TURN * 60e3 / 7000;
        const Found found = run_valleys(blow, GetParam(), 7000, 0.2, {1000},
                                        (lugs + 0.3) * lug_ms * 1e-3, 1000 - lugs * lug_ms);
        EXPECT_EQ(found.lugs, counted) << lugs;
    }
}

TEST_P(BlowSources, AValleyBetweenTheBlowsHidesNone) {
    run(blow, GetParam(), {2000, 0.05}, 0.0, 1.01);  // 10 ms after a blow
    ASSERT_TRUE(blow.even);
    blow.hit_angle = static_cast<int16_t>(blow.mean_angle / 2);
    EXPECT_EQ(run(blow, GetParam(), {2000, 0.05}, 1.01, 1.04).lugs, 1);
}

TEST_P(BlowSources, APauseEndsTheImpacts) {
    run(blow, GetParam(), {2400, 0.1}, 0.0, 0.5);
    EXPECT_TRUE(blow.impacting);
    const uint16_t count = blow.count;
    run(blow, GetParam(), {2400, 0.0}, 0.5, 1.5);
    EXPECT_FALSE(blow.impacting);
    EXPECT_LE(blow.count - count, 2);
    run(blow, GetParam(), {2400, 0.1}, 1.5, 2.5);
    EXPECT_NEAR(blow.count - count, 1 + 40, 1.5);
}

// A ripple of 5 % is below the hysteresis until the learned ripple has decayed, after 1/8 s.
TEST_P(BlowSources, FollowsAChangeOfRateAndRipple) {
    const Found slow = run(blow, GetParam(), {1500, 0.25}, 0.0, 1.0);
    const Found fast = run(blow, GetParam(), {3600, 0.012}, 1.0, 2.0);
    EXPECT_NEAR(slow.lugs + fast.lugs, 25 + 60, 7.5);
}

TEST_P(BlowSources, StartResetsThePreviousDrive) {
    run(blow, GetParam(), {3000, 0.05}, 0.0, 1.0);
    blow_start(&blow, &GetParam());
    EXPECT_EQ(blow.count, 0);
    EXPECT_FALSE(blow.impacting);
    EXPECT_NEAR(run(blow, GetParam(), {1500, 0.1}, 0.0, 1.0).lugs, 25, 1);
}

TEST_P(BlowSources, RandomInputsGiveConsistentEvents) {
    std::mt19937 random(7);
    std::uniform_int_distribution<int> any(-32768, 32767);
    uint16_t lugs = 0;
    for (int n = 0; n < 200000; ++n) {
        const bool wild = random() % 4 != 0;
        const ControllerInputs in{0,
                                  static_cast<int16_t>(wild ? any(random) : 18000),
                                  static_cast<int16_t>(any(random)),
                                  static_cast<uint16_t>(any(random)),
                                  static_cast<int16_t>(any(random) & 0x7FFF),
                                  (random() & 31u) == 0u,
                                  0,
                                  0};
        blow_step(&blow, &GetParam(), &in);
        lugs = static_cast<uint16_t>(lugs + blow.lugs);
        ASSERT_LE(blow.repeats, 2);
        ASSERT_LE(static_cast<uint16_t>(blow.count - lugs), 1);
        ASSERT_GE(blow.spread_q15, 0);
        ASSERT_GE(blow.ripple_rpm, 0);
    }
}

INSTANTIATE_TEST_SUITE_P(Sources, BlowSources, ::testing::Values(SPEED, CURRENT),
                         [](const auto &set) {
                             return set.param.source == BLOW_SOURCE_SPEED ? "Speed" : "Current";
                         });

TEST(Blow, AnOpenBridgeHoldsTheSpeedComputedFromTheCurrent) {
    Blow blow{};
    blow_start(&blow, &CURRENT);
    run(blow, CURRENT, {3000, 0.05}, 0.0, 1.0);
    const int16_t held = blow.speed_rpm;
    const ControllerInputs in{0, 0, 0, 17000, 0, true, 0, 0};
    for (int n = 0; n < 10; ++n)
        blow_step(&blow, &CURRENT, &in);
    EXPECT_EQ(blow.speed_rpm, held);
}

}  // namespace
