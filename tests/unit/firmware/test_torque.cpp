// Torque control on a motor with a given mean current: level for any supply and winding, hard and
// soft joints, refused and missed targets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

extern "C" {
#include "controllers/torque.h"
#include "controllers/torque_map.h"
}

namespace {

constexpr double K = 0.0109, R = 0.19, RPM = 30.0 / M_PI;

uint8_t row_of(int target_nm) {
    return static_cast<uint8_t>(target_nm - TORQUE_MAP_FIRST_NM);
}

// A motor that draws a given current at once, with any supply and winding; a duty is applied in the
// next tick.
struct Tool {
    TorqueSetpoints set;
    Torque torque{};
    Blow blow{};
    double supply_v = 18.5, winding = 1.0, current_a = 13.0, duty = 0.0,
           own_v = 0.0;       // own_v: k w + R i
    double duty_limit = 1.0;  // of the board, by its setpoint or by the fold-back
    int16_t travel_q15 = INT16_MAX, requested = 0;
    int ticks = 0, steps = 0;
    bool blows_busy = false;  // every fifth tick

    explicit Tool(int16_t target_nm) : set{target_nm} { torque_start(&torque, &set); }

    int16_t step() {
        const double speed = std::fmax(duty * supply_v - R * winding * current_a, 0.0) / K;
        own_v = K * speed + R * current_a;
        ControllerInputs in{};
        in.trigger_q15 = travel_q15;
        in.travel_q15 = static_cast<int16_t>(
            std::min<int>(travel_q15, 197 * (ticks + 1)));  // the ramp of the trigger
        in.speed_rpm_q1 = static_cast<int16_t>(std::fmin(std::lround(2 * speed * RPM), 32767));
        in.current_a_q9 = static_cast<int16_t>(std::lround(current_a * 512));
        in.supply_mv = static_cast<uint16_t>(supply_v * 1000);
        in.duty_q15 = static_cast<int16_t>(std::lround(duty * 255) * 257 / 2);
        blow.count = static_cast<uint16_t>(ticks / 50);
        blow.busy = steps < 2 || (blows_busy && steps % 5 == 1);  // at its start, or at a blow
        ++steps;
        requested = torque_step(&torque, &set, &in, &blow);
        duty = requested < 0 ? 0.0 : std::min(requested / 32767.0, duty_limit);
        ++ticks;
        return requested;
    }

    // Runs for at most `ms`; whether the drive has not ended.
    bool run(int ms) {
        for (int n = 0; n < ms && requested != CONTROLLER_STOP; ++n)
            step();
        return requested != CONTROLLER_STOP;
    }

    bool run_into(TorqueState state, int ms = 3000) {
        for (int n = 0; n < ms && requested != CONTROLLER_STOP && torque_state(&torque) != state;
             ++n)
            step();
        return torque_state(&torque) == state;
    }
};

// Milliseconds until the present state ends.
int stay(Tool &tool) {
    const uint8_t state = torque_state(&tool.torque);
    int ms = 0;
    while (ms < 20000 && torque_state(&tool.torque) == state) {
        tool.step();
        ++ms;
    }
    return ms;
}

double amperes(int16_t a_q8) {
    return a_q8 / 256.0;
}

// A drive to a target at the current of a hard joint at that target, plus above_a.
Tool tool_beside(int target_nm, double above_a) {
    Tool tool(static_cast<int16_t>(target_nm));
    tool.current_a = amperes(torque_map_settled_a_q8(row_of(target_nm))) + above_a;
    return tool;
}

TEST(Torque, RefusesTargetsOutsideItsMap) {
    for (const int target : {-5, 0, TORQUE_MAP_FIRST_NM - 1, TORQUE_MAP_LAST_NM + 1, 32767}) {
        Tool tool(static_cast<int16_t>(target));
        EXPECT_EQ(tool.step(), CONTROLLER_STOP) << target;
        EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_UNREACHABLE) << target;
    }
    for (const int target : {TORQUE_MAP_FIRST_NM, TORQUE_MAP_LAST_NM})
        EXPECT_GE(Tool(static_cast<int16_t>(target)).step(), 0) << target;
}

TEST(Torque, RefusesALevelAboveTheSupplyBeforeTheFirstBlow) {
    const double most = torque_map_raised_mv(row_of(120)) * 1.125e-3;
    Tool weak(120), strong(120), low(60);
    weak.supply_v = low.supply_v = most - 0.01;
    strong.supply_v = most + 0.01;
    EXPECT_FALSE(weak.run(8));
    EXPECT_EQ(torque_stop_reason(&weak.torque), CONTROLLER_REASON_UNREACHABLE);
    EXPECT_EQ(torque_estimate(&weak.torque), 0);
    EXPECT_TRUE(strong.run(8));
    EXPECT_TRUE(low.run(8));
}

TEST(Torque, DoesNotDriveAtAReleasedTrigger) {
    Tool tool(80);
    tool.run(500);
    tool.travel_q15 = 0;
    EXPECT_EQ(tool.step(), CONTROLLER_COAST);
}

TEST(Torque, StaysAtTheRunLevelUntilTheFirstBlows) {
    Tool tool(100);
    tool.current_a = 2.0;
    for (int n = 0; n < 5000; ++n) {
        tool.ticks = 0;  // without blows
        ASSERT_GE(tool.step(), 0);
    }
    EXPECT_EQ(torque_state(&tool.torque), TORQUE_RUN);
    EXPECT_NEAR(tool.own_v, 5.5, 0.1);
}

TEST(Torque, HoldsItsLevelForAnySupplyAndWinding) {
    for (const int target : {60, 85, 110}) {
        for (const double supply_v : {16.65, 18.5, 20.35}) {
            for (const double winding : {0.9, 1.0, 1.1, 1.4}) {
                Tool tool(static_cast<int16_t>(target));
                tool.supply_v = supply_v;
                tool.winding = winding;
                tool.current_a = amperes(torque_map_settled_a_q8(row_of(target))) + 0.5;
                ASSERT_TRUE(tool.run_into(TORQUE_SETTLE, 4000)) << target;
                double sum = 0;
                for (int n = 0; n < 500; ++n) {
                    tool.step();
                    sum += tool.own_v / 500;
                }
                EXPECT_NEAR(sum, torque_map_level_mv(row_of(target)) / 1000.0, 0.05)
                    << target << " " << supply_v << " " << winding;
            }
        }
    }
}

TEST(Torque, SettlesAHardJointAndReportsReached) {
    Tool tool = tool_beside(100, 0.1);
    ASSERT_TRUE(tool.run_into(TORQUE_SETTLE));
    EXPECT_TRUE(tool.run(2500));
    EXPECT_FALSE(tool.run(400));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_REACHED);
    EXPECT_EQ(torque_estimate(&tool.torque), 1000);
}

TEST(Torque, RaisesForASoftJointAndStopsAtItsCurrent) {
    for (const int target : {60, 80, 85, 100, 120}) {
        Tool tool = tool_beside(target, -0.1);
        ASSERT_TRUE(tool.run_into(TORQUE_RAISED)) << target;
        tool.current_a = amperes(torque_map_stop_a_q8(row_of(target))) - 0.1;
        ASSERT_TRUE(tool.run(3000)) << target;
        EXPECT_NEAR(tool.own_v, torque_map_raised_mv(row_of(target)) / 1000.0, 0.15) << target;
        tool.current_a += 0.12;
        EXPECT_FALSE(tool.run(1000)) << target;
        EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_REACHED) << target;
        EXPECT_NEAR(torque_estimate(&tool.torque), 10 * target, 20) << target;
    }
}

TEST(Torque, ReportsMissedWithTheTorqueOnAJointTooHardForALowTarget) {
    Tool tool(40);
    tool.current_a = amperes(torque_map_stop_a_q8(row_of(52))) + 0.01;
    EXPECT_FALSE(tool.run(3000));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED);
    EXPECT_NEAR(torque_estimate(&tool.torque), 560,
                20);  // 52 N m plus the lag of the filters
}

TEST(Torque, ALowTargetExceededAtTheFirstEvaluationIsMissedAndLaterReached) {
    int missed = 0, reached = 0;
    for (int from_ms = 250; from_ms < 600; from_ms += 10) {
        Tool tool(40);
        tool.current_a = amperes(torque_map_stop_a_q8(row_of(40))) - 1.0;
        ASSERT_TRUE(tool.run_into(TORQUE_RAISED));
        while (tool.torque.ticks < from_ms)
            tool.step();
        tool.current_a += 1.0 + 0.3;
        int last = 0;
        while (torque_state(&tool.torque) == TORQUE_RAISED && last < 4000) {
            last = tool.torque.ticks;
            tool.step();
        }
        const bool late = last < 450 + 40;
        (late ? missed : reached)++;
        EXPECT_EQ(torque_stop_reason(&tool.torque),
                  late ? CONTROLLER_REASON_MISSED : CONTROLLER_REASON_REACHED)
            << last;
        EXPECT_NEAR(torque_estimate(&tool.torque), late ? 460 : 400, late ? 30 : 10) << last;
    }
    EXPECT_GT(missed, 3);
    EXPECT_GT(reached, 3);
}

// A current that rises from below stops earlier than the target's, by 2^-8 A for 16 ms up to 850
// ms.
TEST(Torque, ALowTargetStopsAheadOfAFastRise) {
    for (const int from_ms : {500, 700, 900}) {
        Tool tool(40);
        const double stop_a = amperes(torque_map_stop_a_q8(row_of(40)));
        tool.current_a = stop_a - 1.0;
        ASSERT_TRUE(tool.run_into(TORQUE_RAISED));
        while (tool.torque.ticks < from_ms)
            tool.step();
        const double lead_a = std::max(0, 850 - from_ms) / 16 / 256.0;
        tool.torque.slow_a_q24 = static_cast<int32_t>((stop_a - lead_a - 0.02) * 256.0) * 65536;
        tool.torque.current_a_q24 = tool.torque.quick_a_q24 = tool.torque.slow_a_q24;
        tool.current_a = stop_a - lead_a - 0.02;
        tool.step();
        EXPECT_EQ(torque_state(&tool.torque), TORQUE_RAISED) << from_ms;
        tool.torque.slow_a_q24 += static_cast<int32_t>(0.04 * 256.0) * 65536;
        tool.torque.current_a_q24 = tool.torque.quick_a_q24 = tool.torque.slow_a_q24;
        tool.current_a += 0.04;
        for (int n = 0; n < 4; ++n)
            tool.step();
        EXPECT_EQ(torque_state(&tool.torque), TORQUE_OVER) << from_ms;
    }
}

TEST(Torque, EndsAfterTheTimeLimit) {
    Tool tool(60);
    tool.current_a = 12.0;
    EXPECT_TRUE(tool.run(9000));
    EXPECT_FALSE(tool.run(2500));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED);
    EXPECT_LT(torque_estimate(&tool.torque), 600);
}

TEST(Torque, ReportsMissedWhenTheSupplyFallsBelowTheLevel) {
    Tool tool = tool_beside(110, 0.2);
    ASSERT_TRUE(tool.run_into(TORQUE_SETTLE));
    tool.supply_v = 10.0;
    EXPECT_FALSE(tool.run(400));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED);
    EXPECT_NEAR(torque_estimate(&tool.torque), 980, 30);  // 10 V: about 98 N m
}

TEST(Torque, ALevelAboveTheDutyLimitIsMissedWithTheTorqueOfTheHeldVoltage) {
    Tool tool(100);
    const double level_v = torque_map_level_mv(row_of(100)) / 1000.0;
    tool.current_a = amperes(torque_map_settled_a_q8(row_of(100))) + 0.1;
    tool.duty_limit = 0.4;
    ASSERT_TRUE(tool.run_into(TORQUE_LEVEL));
    EXPECT_FALSE(tool.run(1500));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED);
    EXPECT_NEAR(torque_estimate(&tool.torque), 1000 + (tool.own_v - level_v) / 0.0105, 30);
}

TEST(Torque, ADutyLimitReachedInSettlingOrOnTheRaisedLevelIsMissed) {
    for (const auto &[state, above_a] : {std::pair{TORQUE_SETTLE, 0.2}, {TORQUE_RAISED, -0.1}}) {
        Tool tool = tool_beside(100, above_a);
        ASSERT_TRUE(tool.run_into(state));
        tool.duty_limit = 0.4;
        const int ms = stay(tool);
        EXPECT_NEAR(ms, 300, 10) << state;
        EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED) << state;
    }
}

TEST(Torque, ADutyLimitBelowTheRunLevelIsUnreachable) {
    Tool tool(100);
    tool.current_a = 2.0;
    tool.duty_limit = 0.2;
    for (int n = 0; n < 1000 && tool.requested != CONTROLLER_STOP; ++n) {
        tool.ticks = std::min(tool.ticks, 20);  // without blows
        tool.step();
    }
    EXPECT_EQ(tool.requested, CONTROLLER_STOP);
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_UNREACHABLE);
    EXPECT_EQ(torque_estimate(&tool.torque), 0);
}

// The board drives in steps of 1/255, and the fold-back acts for some ticks.
TEST(Torque, AReductionOfAStepOrForAShortTimeIsNoMiss) {
    Tool tool = tool_beside(100, 0.1);
    ASSERT_TRUE(tool.run_into(TORQUE_SETTLE));
    const double duty = tool.duty;
    tool.duty_limit = duty - 1.0 / 255.0;
    EXPECT_TRUE(tool.run(1000));
    tool.duty_limit = 0.3;
    EXPECT_TRUE(tool.run(280));
    tool.duty_limit = 1.0;
    EXPECT_FALSE(tool.run(2000));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_REACHED);
}

TEST(Torque, TheFirstBlowsAreAQuarterOfAVoltLowerAndRamped) {
    Tool tool(100);
    tool.current_a = 2.0;
    for (int n = 0; n < 80; ++n) {
        tool.ticks = 0;
        tool.step();
    }
    EXPECT_NEAR(tool.duty * tool.supply_v, 80 * 0.03, 0.15);
    for (int n = 80; n < 195; ++n) {
        tool.ticks = 0;
        tool.step();
    }
    EXPECT_GT(tool.own_v, 5.2);
    EXPECT_LT(tool.own_v, 5.4);  // the nominal tool's excess is measured later
}

TEST(Torque, AResumedDriveBeginsWithTheDutyOfItsSpeed) {
    Tool tool(100);
    tool.ticks = 80;
    EXPECT_EQ(tool.step(), 81 * 197);
}

TEST(Torque, EvaluatesAndSettlesForTheirTimes) {
    struct Wanted {
        int target, evaluate_ms, settle_ms;
    };
    for (const Wanted &wanted : {Wanted{60, 600, 4400}, {100, 1200, 2800}}) {
        Tool tool = tool_beside(wanted.target, 0.5);
        ASSERT_TRUE(tool.run_into(TORQUE_LEVEL));
        const int way_ms = (torque_map_level_mv(row_of(wanted.target)) - tool.torque.level_mv) / 8;
        EXPECT_NEAR(stay(tool), way_ms + wanted.evaluate_ms, 8) << wanted.target;
        ASSERT_EQ(torque_state(&tool.torque), TORQUE_SETTLE);
        EXPECT_NEAR(stay(tool), wanted.settle_ms, 8) << wanted.target;
    }
}

TEST(Torque, ADeviationOfASixteenthIsMissed) {
    for (const auto &[beside_nm, reason] :
         {std::pair{5, CONTROLLER_REASON_REACHED}, {9, CONTROLLER_REASON_MISSED}}) {
        Tool tool = tool_beside(110, -0.1);
        ASSERT_TRUE(tool.run_into(TORQUE_RAISED));
        tool.current_a =
            amperes(static_cast<int16_t>(torque_map_stop_a_q8(row_of(110)) + 12 * beside_nm));
        EXPECT_FALSE(tool.run(3000));
        EXPECT_EQ(torque_stop_reason(&tool.torque), reason) << beside_nm;
        EXPECT_NEAR(torque_estimate(&tool.torque), 10 * (110 + beside_nm), 10);
    }
}

TEST(Torque, ATargetNearlyReachedForTooLongTimesOut) {
    Tool tool = tool_beside(60, -0.1);
    ASSERT_TRUE(tool.run_into(TORQUE_RAISED));
    tool.current_a = amperes(torque_map_stop_a_q8(row_of(60))) - 0.1;
    EXPECT_NEAR(stay(tool),
                8000 + (torque_map_raised_mv(row_of(60)) - torque_map_level_mv(row_of(60))) / 8,
                10);
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_TIMEOUT);
}

// Milliseconds from a step of the current to 1.5 A above the target's until the stop.
int lag_ms(int target_nm, bool busy = false) {
    Tool tool(static_cast<int16_t>(target_nm));
    tool.blows_busy = busy;
    tool.current_a = amperes(torque_map_settled_a_q8(row_of(target_nm))) - 0.1;
    tool.run_into(TORQUE_RAISED);
    tool.current_a = amperes(torque_map_stop_a_q8(row_of(target_nm))) - 1.5;
    EXPECT_TRUE(tool.run(2500)) << target_nm;
    tool.current_a += 3.0;
    return stay(tool);
}

TEST(Torque, AFastGainOfTorqueIsDetectedInTime) {
    for (const auto &[target, most_ms] : {std::pair{70, 60}, {85, 115}, {100, 40}, {115, 40}}) {
        const int quiet_ms = lag_ms(target);
        EXPECT_LE(quiet_ms, most_ms) << target;
        EXPECT_NEAR(lag_ms(target, true), quiet_ms, 6) << target;
    }
}

// A drive that went from RUN to a raised level, and its current there.
Tool preset_on(int raised_mv, double current_a) {
    Tool tool(80);
    tool.torque.settled_a_q8 = TORQUE_MAP_NEVER;
    tool.torque.raised_mv = static_cast<int16_t>(raised_mv);
    EXPECT_TRUE(tool.run_into(TORQUE_RAISED));
    tool.current_a = current_a;
    return tool;
}

TEST(Torque, NoTransientOfTheStartEndsADrive) {
    for (const int raised_mv : {5600, 8600, 10000}) {
        Tool tool = preset_on(raised_mv, 25.0);
        EXPECT_TRUE(tool.run(300)) << raised_mv;
        tool.current_a = amperes(torque_map_stop_a_q8(row_of(80))) - 1.0;
        EXPECT_TRUE(tool.run(3000)) << raised_mv;
    }
}

TEST(Torque, AHammerThatDoesNotPassTheLugsIsMissed) {
    Tool tool(60);
    tool.current_a = 25.0;
    ASSERT_TRUE(tool.run_into(TORQUE_SETTLE));
    EXPECT_FALSE(tool.run(6000));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED);
    EXPECT_EQ(torque_estimate(&tool.torque), 0);
}

TEST(Torque, AHammerThatDoesNotPassTheLugsAtTheFoldbackIsMissedWithoutAnEstimate) {
    Tool tool(100);
    tool.current_a = 44.0;
    tool.duty_limit = 0.45;
    ASSERT_TRUE(tool.run_into(TORQUE_LEVEL));
    EXPECT_FALSE(tool.run(6000));
    EXPECT_EQ(torque_stop_reason(&tool.torque), CONTROLLER_REASON_MISSED);
    EXPECT_EQ(torque_estimate(&tool.torque), 0);
}

TEST(Torque, AnEndedDriveStaysEnded) {
    Tool tool(40);
    tool.current_a = 30.0;
    EXPECT_FALSE(tool.run(3000));
    tool.current_a = 5.0;
    for (int n = 0; n < 100; ++n)
        EXPECT_EQ(tool.step(), CONTROLLER_STOP);
}

TEST(Torque, TheMapIsMonotonicAndWithinItsLimits) {
    for (uint8_t row = 0; row < TORQUE_MAP_ROWS; ++row) {
        EXPECT_EQ(torque_map_settled_a_q8(row) == TORQUE_MAP_NEVER, row < row_of(58)) << int{row};
        if (row < row_of(58)) {
            EXPECT_EQ(torque_map_raised_mv(row), torque_map_raised_mv(0)) << int{row};
        }
        EXPECT_GE(torque_map_level_mv(row), 5000);
        EXPECT_GT(torque_map_raised_mv(row), torque_map_level_mv(row));
        EXPECT_LE(torque_map_raised_mv(row), 14000);
        if (row > 0) {
            EXPECT_GE(torque_map_raised_mv(row),
                      torque_map_raised_mv(static_cast<uint8_t>(row - 1)));
            if (torque_map_raised_mv(row) == torque_map_raised_mv(static_cast<uint8_t>(row - 1))) {
                EXPECT_GE(torque_map_stop_a_q8(row),
                          torque_map_stop_a_q8(static_cast<uint8_t>(row - 1)))
                    << int{row};
            }
        }
    }
}

}  // namespace
