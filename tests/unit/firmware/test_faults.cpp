// Faults: found at, not under and just over each limit and time; latched until cleared.
#include <gtest/gtest.h>

extern "C" {
#include "app/faults.h"
#include "drivers/h_bridge.h"
#include "telemetry/telemetry_signals.h"
}

namespace {

struct FaultsTest : testing::Test {
    Faults faults{};
    Measurement m{};
    FaultLimits limits{12000, 90, 500};

    void SetUp() override {
        m.supply_mv = 18500;
        m.temperature_c_q4 = 25 * 16;
    }

    // Ticks until `fault` latches, at most `most`.
    int ticks_to(uint8_t fault, int compare, int most = 2000, bool edges = false) {
        for (int k = 1; k <= most; ++k) {
            faults_step(&faults, &m, &limits, static_cast<int16_t>(compare), edges);
            if ((faults.latched & fault) != 0)
                return k;
        }
        return -1;
    }
};

TEST_F(FaultsTest, NoneInAHealthyTool) {
    EXPECT_EQ(ticks_to(0xFF, 255, 2000, true), -1);
    EXPECT_EQ(ticks_to(0xFF, H_BRIDGE_COAST), -1);
}

TEST_F(FaultsTest, UnderVoltageAfterTenTicks) {
    m.supply_mv = 12000;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_UNDER_VOLTAGE, H_BRIDGE_COAST), -1);
    m.supply_mv = 11999;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_UNDER_VOLTAGE, H_BRIDGE_COAST), 10);
    m.supply_mv = 18500;
    faults_step(&faults, &m, &limits, H_BRIDGE_COAST, false);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_UNDER_VOLTAGE) << "latched";
    EXPECT_EQ(faults.active, 0);
    faults_clear(&faults);
    EXPECT_EQ(faults.latched, 0);
}

TEST_F(FaultsTest, ClearingKeepsWhatStillHolds) {
    m.supply_mv = 5000;
    ticks_to(TELEMETRY_FAULTS_UNDER_VOLTAGE, 0);
    faults_clear(&faults);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_UNDER_VOLTAGE);
}

TEST_F(FaultsTest, OverTemperature) {
    m.temperature_c_q4 = 90 * 16;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_OVER_TEMPERATURE, 0), -1);
    m.temperature_c_q4 = 90 * 16 + 1;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_OVER_TEMPERATURE, 0), 100);
}

TEST_F(FaultsTest, ALostTemperatureSensorIsNoHeat) {
    m.temperature_c_q4 = 400 * 16;
    m.temperature_lost = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_SENSOR_LOST, 0), 100);
    EXPECT_EQ(faults.latched & TELEMETRY_FAULTS_OVER_TEMPERATURE, 0);
}

TEST_F(FaultsTest, OverCurrentAtOnce) {
    m.adc.trips = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_OVER_CURRENT, 100), 1);
}

TEST_F(FaultsTest, StallIsAStandingShaftThatDraws) {
    m.current_a_q9 = 45 * 512;  // half duty, 9.3 V over 0.21 ohm
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_STALL | TELEMETRY_FAULTS_SENSOR_LOST, 128), 501);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_STALL);
}

TEST_F(FaultsTest, LostHallIsAShaftThatTurnsUnseen) {
    m.current_a_q9 = -10 * 512;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_STALL | TELEMETRY_FAULTS_SENSOR_LOST, -255), 501);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_SENSOR_LOST);
}

TEST_F(FaultsTest, NeitherBelowSixPercentNorWithEdgesNorCoasting) {
    m.current_a_q9 = 45 * 512;
    EXPECT_EQ(ticks_to(0xFF, 15), -1);
    EXPECT_EQ(ticks_to(0xFF, 255, 2000, true), -1);
    EXPECT_EQ(ticks_to(0xFF, H_BRIDGE_COAST), -1);
    EXPECT_EQ(ticks_to(0xFF, 16), 501);
}

TEST_F(FaultsTest, CadenceAndOverrunAreFaultsOfTheirOwn) {
    m.adc.lost = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_ADC_CADENCE, 0), 1);
    faults.overrun = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_OVERRUN, 0), 1);
    EXPECT_FALSE(faults.overrun) << "one tick's event";
}

}  // namespace
