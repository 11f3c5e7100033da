// Voltage equations of motor and pack: no fault is found at any load while motor and pack are
// within their ranges; a step of the current sensor or of the bus voltage is found just above the
// tolerance, not just below it.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

extern "C" {
#include "app/balance.h"
#include "telemetry/telemetry_signals.h"
}

namespace {

constexpr double MOTOR_OHM = 0.19, MOTOR_RPM_PER_V = 876.0, PACK_V = 18.5;

struct Machine {
    double ohm = MOTOR_OHM;
    double rpm_per_v = MOTOR_RPM_PER_V;
    double pack_ohm = 0.1;
    double brush_v = 0.8;
    int sign = 1;  // -1 in reverse
};

// What the sensors add to the true values.
struct SensorFault {
    double amps = 0.0, volts = 0.0;
};

struct BalanceTest : testing::Test {
    Balance balance{};
    Measurement m{};

    void SetUp() override { balance_set_motor(&balance, 190, 876); }

    // Sets the measurement of a turning motor; returns the compare value.
    int16_t turn(const Machine &tool, double duty, double amps, SensorFault fault = {}) {
        const double bus_v = PACK_V - tool.pack_ohm * duty * amps;
        const double rpm = (duty * bus_v - tool.ohm * amps - tool.brush_v) * tool.rpm_per_v;
        m.current_a_q9 = static_cast<int16_t>(std::lround(512 * (tool.sign * amps + fault.amps)));
        m.speed_rpm_q1 = static_cast<int16_t>(std::lround(2 * tool.sign * rpm));
        m.supply_25mv = static_cast<uint16_t>(std::lround((bus_v + fault.volts) / 0.025));
        return static_cast<int16_t>(std::lround(tool.sign * 255 * duty));
    }

    // Runs a whole span at this duty and current; returns whether a contradiction is found.
    bool span(const Machine &tool, double duty, double amps, SensorFault fault = {}) {
        const int16_t compare = turn(tool, duty, amps, fault);
        for (unsigned k = 0; k < BALANCE_TICKS; ++k) {
            EXPECT_FALSE(balance_due(&balance));
            balance_collect(&balance, &m, compare);
        }
        EXPECT_TRUE(balance_due(&balance));
        return judge();
    }

    bool judge() {
        EXPECT_FALSE(balance_judge(&balance)) << "the means alone";
        EXPECT_TRUE(balance_due(&balance));
        const bool found = balance_judge(&balance);
        EXPECT_FALSE(balance_due(&balance));
        return found;
    }

    // Runs three spans without and one with the fault; returns whether it is found.
    bool finds(SensorFault fault, const Machine &tool = {}) {
        balance_reset(&balance);
        for (int k = 0; k < 3; ++k)
            EXPECT_FALSE(span(tool, 0.7, 20.0));
        return span(tool, 0.7, 20.0, fault);
    }
};

TEST_F(BalanceTest, EveryLoadIsPlausibleForEveryMotorAndPackInTheRanges) {
    for (const double ohm : {0.78, 1.0, 1.7})
        for (const double constant : {0.89, 1.0, 1.1})
            for (const double pack_ohm : {0.0, 0.1, 0.38})
                for (const int sign : {1, -1}) {
                    const Machine tool{MOTOR_OHM * ohm, MOTOR_RPM_PER_V * constant, pack_ohm, 0.8,
                                       sign};
                    std::srand(1);
                    balance_reset(&balance);
                    for (int k = 0; k < 60; ++k) {
                        const double duty = 0.5 + 0.03 * (std::rand() % 8);
                        const double amps = -5.0 + 2.0 * (std::rand() % 9);
                        EXPECT_FALSE(span(tool, duty, amps))
                            << ohm << " " << constant << " " << pack_ohm << " " << duty << " "
                            << amps;
                    }
                }
}

TEST_F(BalanceTest, AStepOfTheCurrentSensorBy8AIsFoundInBothDirections) {
    for (const int sign : {1, -1})
        for (const double amps : {8.0, -8.0})
            EXPECT_TRUE(finds({amps, 0.0}, {MOTOR_OHM, MOTOR_RPM_PER_V, 0.0, 0.8, sign}));
}

// At the least resistance, 0.75 * 0.19 ohm, 4.2 A cause a voltage drop of 0.6 V. The rounded factor
// of the resistance is 2 % too low.
TEST_F(BalanceTest, TheToleranceOfTheMotorsBalanceIs600mV) {
    EXPECT_FALSE(finds({4.1, 0.0}));
    EXPECT_FALSE(finds({-4.1, 0.0}));
    EXPECT_TRUE(finds({4.5, 0.0}));
    EXPECT_TRUE(finds({-4.5, 0.0}));
}

// At a duty of 0.5 the motor's balance sees half of the step.
TEST_F(BalanceTest, TheToleranceOfThePacksBalanceIs900mV) {
    for (const double volts : {0.875, -0.875, 0.95, -0.95}) {
        balance_reset(&balance);
        for (int k = 0; k < 3; ++k)
            EXPECT_FALSE(span({}, 0.5, 10.0));
        EXPECT_EQ(span({}, 0.5, 10.0, {0.0, volts}), std::abs(volts) > 0.9) << volts;
    }
}

// The motor's balance explains this pair of steps, the pack's does not.
TEST_F(BalanceTest, ABusThatRisesWithTheCurrentIsFound) {
    EXPECT_TRUE(finds({3.0, 1.0}));
}

TEST_F(BalanceTest, TheMotorsParametersDecide) {
    balance_set_motor(&balance, 90, 876);
    EXPECT_FALSE(finds({8.0, 0.0}));
    EXPECT_TRUE(finds({10.0, 0.0}));
}

TEST_F(BalanceTest, TheFactorsOfExtremeParametersStayPositive) {
    balance_set_motor(&balance, 2000, 50);
    EXPECT_GT(balance.drop_q16, 32000);
    EXPECT_EQ(balance.emf_q16, INT16_MAX);
    balance_set_motor(&balance, 10, 950);
    EXPECT_EQ(balance.drop_q16, 200);
    EXPECT_EQ(balance.emf_q16, 5497);
}

TEST_F(BalanceTest, ALoadOfASlowMotorOfHighResistanceIsPlausible) {
    balance_set_motor(&balance, 2000, 158);
    EXPECT_FALSE(span({2.0, 170.0, 0.0, 0.0, 1}, 1.0, 0.1));
    for (const double amps : {-0.3, 0.2, -0.3, 0.1})
        EXPECT_FALSE(span({2.0, 170.0, 0.0, 0.0, 1}, 1.0, amps));
}

TEST_F(BalanceTest, AFaultInTheMiddleOfASpanIsFoundInTheNext) {
    const Machine tool;
    for (int k = 0; k < 3; ++k)
        EXPECT_FALSE(span(tool, 0.7, 20.0));
    const int16_t compare = turn(tool, 0.7, 20.0);
    for (unsigned k = 0; k < BALANCE_TICKS / 2; ++k)
        balance_collect(&balance, &m, compare);
    (void)turn(tool, 0.7, 20.0, {8.0, 0.0});
    while (!balance_due(&balance))
        balance_collect(&balance, &m, compare);
    EXPECT_FALSE(judge()) << "half of the step";
    EXPECT_TRUE(span(tool, 0.7, 20.0, {8.0, 0.0}));
}

TEST_F(BalanceTest, AFaultFromTheStartOfTheDriveIsNotFound) {
    for (int k = 0; k < 5; ++k)
        EXPECT_FALSE(span({}, 0.7, 20.0, {8.0, 0.0}));
}

TEST_F(BalanceTest, ADriveBeginsWithNewSpans) {
    EXPECT_FALSE(finds({0.0, 0.0}));
    balance_reset(&balance);
    EXPECT_FALSE(span({}, 0.7, 20.0, {8.0, 0.0}));
    EXPECT_FALSE(span({}, 0.7, 20.0, {8.0, 0.0}));
    EXPECT_FALSE(span({}, 0.7, 20.0, {8.0, 0.0}));
    EXPECT_TRUE(span({}, 0.7, 20.0));
}

TEST_F(BalanceTest, ATickBelow3000RpmOrWithASaturatedSensorRestartsTheSpan) {
    const int16_t compare = turn({}, 0.7, 20.0);
    for (const int rpm_q1 : {5999, -5999}) {
        for (unsigned k = 1; k < BALANCE_TICKS; ++k)
            balance_collect(&balance, &m, compare);
        EXPECT_EQ(balance.ticks, BALANCE_TICKS - 1);
        const int16_t before = m.speed_rpm_q1;
        m.speed_rpm_q1 = static_cast<int16_t>(rpm_q1);
        balance_collect(&balance, &m, compare);
        EXPECT_EQ(balance.ticks, 0);
        m.speed_rpm_q1 = static_cast<int16_t>(rpm_q1 + (rpm_q1 < 0 ? -1 : 1));
        balance_collect(&balance, &m, compare);
        EXPECT_EQ(balance.ticks, 1);
        m.speed_rpm_q1 = before;
        balance.ticks = 0;
    }
    for (const unsigned flag : {TELEMETRY_FLAGS_SPEED_SATURATED, TELEMETRY_FLAGS_CURRENT_SATURATED,
                                TELEMETRY_FLAGS_SUPPLY_SATURATED}) {
        balance_collect(&balance, &m, compare);
        m.flags = static_cast<uint8_t>(flag);
        balance_collect(&balance, &m, compare);
        EXPECT_EQ(balance.ticks, 0);
        m.flags = 0;
    }
    m.flags = TELEMETRY_FLAGS_FOLDBACK | TELEMETRY_FLAGS_MISSED_EDGE;
    balance_collect(&balance, &m, compare);
    EXPECT_EQ(balance.ticks, 1);
}

TEST_F(BalanceTest, ExtremeMeasurementsDoNotOverflowTheSums) {
    m.current_a_q9 = INT16_MIN;
    m.speed_rpm_q1 = INT16_MIN;
    m.supply_25mv = 1023;
    for (unsigned k = 0; k < BALANCE_TICKS; ++k)
        balance_collect(&balance, &m, -255);
    EXPECT_EQ(balance.current_sum, INT16_MIN);
    EXPECT_EQ(balance.speed_sum, INT16_MIN);
    EXPECT_EQ(balance.compare_sum, -255 * 32);
    EXPECT_EQ(balance.supply_sum, 1023 * 32);
}

}  // namespace
