// Faults: detected at each limit and time, not below it; latched until cleared.
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
    FaultLimits limits{12000, 90 * 16, 500};

    void SetUp() override {
        m.supply_mv = 18500;
        m.temperature_c_q4 = 25 * 16;
    }

    void tick(int compare, bool edge = false, bool goes_on = true) {
        const FaultsDrive drive{static_cast<int16_t>(compare), edge, goes_on};
        faults_step(&faults, &m, &limits, &drive);
    }

    // Ticks until `fault` latches, at most `most`.
    int ticks_to(uint8_t fault, int compare, int most = 2000, bool edges = false) {
        for (int k = 1; k <= most; ++k) {
            tick(compare, edges);
            if ((faults.latched & fault) != 0)
                return k;
        }
        return -1;
    }
};

TEST_F(FaultsTest, NoFaultInNormalOperation) {
    EXPECT_EQ(ticks_to(0xFF, 255, 2000, true), -1);
    EXPECT_EQ(ticks_to(0xFF, H_BRIDGE_COAST), -1);
}

TEST_F(FaultsTest, UnderVoltageAfterTenTicks) {
    m.supply_mv = 12000;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_UNDER_VOLTAGE, H_BRIDGE_COAST), -1);
    m.supply_mv = 11999;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_UNDER_VOLTAGE, H_BRIDGE_COAST), 10);
    m.supply_mv = 18500;
    tick(H_BRIDGE_COAST);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_UNDER_VOLTAGE) << "latched";
    EXPECT_EQ(faults.active, 0);
    faults_clear(&faults);
    EXPECT_EQ(faults.latched, 0);
}

TEST_F(FaultsTest, ClearingKeepsFaultsWhoseConditionIsPresent) {
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

TEST_F(FaultsTest, ALostTemperatureSensorIsNotOverTemperature) {
    m.temperature_c_q4 = 400 * 16;
    m.temperature_lost = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_SENSOR_LOST, 0), 100);
    EXPECT_EQ(faults.latched & TELEMETRY_FAULTS_OVER_TEMPERATURE, 0);
}

TEST_F(FaultsTest, OverCurrentAtOnce) {
    m.adc.trips = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_OVER_CURRENT, 100), 1);
}

TEST_F(FaultsTest, StallIsAShaftAtRestThatDrawsCurrent) {
    m.current_a_q9 = 45 * 512;  // half duty, 9.3 V over 0.21 ohm
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_STALL | TELEMETRY_FAULTS_SENSOR_LOST, 128), 501);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_STALL);
}

TEST_F(FaultsTest, SensorLostIsATurningShaftWithoutEdges) {
    m.current_a_q9 = -10 * 512;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_STALL | TELEMETRY_FAULTS_SENSOR_LOST, -255), 501);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_SENSOR_LOST);
}

TEST_F(FaultsTest, NoStallBelowSixPercentNorWithEdgesNorCoasting) {
    m.current_a_q9 = 45 * 512;
    EXPECT_EQ(ticks_to(0xFF, 15), -1);
    EXPECT_EQ(ticks_to(0xFF, 255, 2000, true), -1);
    m.current_a_q9 = 0;
    EXPECT_EQ(ticks_to(0xFF, H_BRIDGE_COAST), -1);
    m.current_a_q9 = 45 * 512;
    EXPECT_EQ(ticks_to(0xFF, 16), 501);
}

TEST_F(FaultsTest, AContradictionOfTheBalancesIsALostSensor) {
    faults.contradiction = true;
    EXPECT_EQ(ticks_to(0xFF, 128, 10, true), 1);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_SENSOR_LOST);
    faults.contradiction = false;
    tick(H_BRIDGE_COAST);
    EXPECT_EQ(faults.active, 0);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_SENSOR_LOST) << "latched";
}

TEST_F(FaultsTest, ACurrentThatStaysWhileTheSpeedChangesIsALostSensor) {
    m.current_a_q9 = 20 * 512;
    m.speed_rpm_q1 = 2 * 8000;
    EXPECT_EQ(ticks_to(0xFF, 128, 500, true), -1) << "a constant load";
    m.speed_rpm_q1 = 2 * 9240;  // the limit is 8000 + 8000 / 8 + 250 = 9250
    EXPECT_EQ(ticks_to(0xFF, 128, 500, true), -1);
    m.speed_rpm_q1 = 2 * 9260;
    tick(128, false);
    EXPECT_EQ(faults.latched, 0) << "without an edge the speed only ages";
    tick(128, true);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_SENSOR_LOST);
}

TEST_F(FaultsTest, ACurrentThatChangesOnceIn32TicksIsPlausible) {
    for (int k = 0; k < 2000; ++k) {
        m.current_a_q9 = static_cast<int16_t>(20 * 512 + (k % 31 == 0 ? 1 : 0));
        m.speed_rpm_q1 = static_cast<int16_t>(k % 40 < 20 ? 4000 : 20000);
        tick(128, true);
    }
    EXPECT_EQ(faults.latched, 0);
}

TEST_F(FaultsTest, ACurrentThroughAnOpenBridgeIsALostSensor) {
    for (const int sign : {-1, 1}) {
        faults = Faults{};
        m.current_a_q9 = static_cast<int16_t>(sign * 3 * 512);
        EXPECT_EQ(ticks_to(0xFF, H_BRIDGE_COAST), -1);
        m.current_a_q9 = static_cast<int16_t>(sign * (3 * 512 + 2));
        EXPECT_EQ(ticks_to(0xFF, 0, 200, true), -1) << "a bridge that brakes";
        EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_SENSOR_LOST, H_BRIDGE_COAST), 50);
        faults_clear(&faults);
        EXPECT_NE(faults.latched, 0) << "it stays until the current is plausible";
        m.current_a_q9 = 0;
        tick(H_BRIDGE_COAST);
        faults_clear(&faults);
        EXPECT_EQ(faults.latched, 0);
    }
}

// A shaft at rest under a controller's pulses: the stall time accumulates over the pauses, and the
// rise of the current after a pause is not mistaken for a turning shaft.
TEST_F(FaultsTest, AStallUnderPulsesIsDetectedAndIsNoLostSensor) {
    int driven = 0;
    for (int k = 0; k < 3000 && faults.latched == 0; ++k) {
        const int phase = k % 10;
        m.current_a_q9 = static_cast<int16_t>(phase == 1 ? 6 * 512 : phase > 1 ? 45 * 512 : 0);
        driven += phase > 0 ? 1 : 0;
        tick(phase > 0 ? 128 : H_BRIDGE_COAST);
    }
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_STALL);
    EXPECT_NEAR(driven, 501, FAULTS_SETTLED_MS);
}

TEST_F(FaultsTest, AStallUnderAnIntermittentDutyIsDetected) {
    m.current_a_q9 = 45 * 512;
    for (int k = 0; k < 1010; ++k)
        tick(k % 2 == 0 ? 128 : 0);
    EXPECT_EQ(faults.latched, TELEMETRY_FAULTS_STALL);
}

TEST_F(FaultsTest, ANewDriveAndAnEdgeRestartTheStallTime) {
    m.current_a_q9 = 45 * 512;
    for (const bool edge : {true, false}) {
        for (int k = 0; k < 500; ++k)
            tick(128);
        tick(edge ? 128 : H_BRIDGE_COAST, edge, edge);
        EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_STALL, 128), 501);
        faults = Faults{};
    }
}

TEST_F(FaultsTest, AdcCadenceAndOverrunAreFaults) {
    m.adc.lost = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_ADC_CADENCE, 0), 1);
    faults.overrun = true;
    EXPECT_EQ(ticks_to(TELEMETRY_FAULTS_OVERRUN, 0), 1);
    EXPECT_FALSE(faults.overrun) << "an event of one tick";
}

}  // namespace
