// The lock-step drivetrain has the figures of the reference tool of docs/spec/model.md: free speed,
// stall current, braking, coasting, edges.
#include <cmath>
#include <gtest/gtest.h>

#include "plant/lockstep/drive_plant.hpp"
#include "reference_tool.hpp"

using namespace vgroove;

static DrivePlant tool(const Parameters &p, LoadKind load = LoadKind::NONE) {
    return DrivePlant(p, load, hall_wheel(4, 0.3, {}), 1);
}

static void run_for(DrivePlant &plant, double seconds, double duty, bool coast = false,
                    double dead = 0.0, double load_nm = 0.0) {
    for (int n = 0; n < static_cast<int>(seconds / PERIOD_S); ++n)
        plant.period(coast, duty, dead, load_nm);
}

TEST(DrivePlant, FreeSpeedOfTheReferenceTool) {
    DrivePlant plant = tool(reference_tool());
    run_for(plant, 2.0, 1.0);
    EXPECT_NEAR(plant.speed_rad_s() * 60.0 / 6.283185307 / 5.6, 2813.0, 1.0);
    EXPECT_NEAR(plant.current_a(), 1.8, 0.03);
}

TEST(DrivePlant, StallCurrent) {
    DrivePlant plant = tool(reference_tool(), LoadKind::TORQUE);
    run_for(plant, 0.1, 1.0, false, 0.0, 20.0);
    EXPECT_NEAR(plant.current_a(), 63.8, 0.05);
    EXPECT_EQ(plant.speed_rad_s(), 0.0);
}

TEST(DrivePlant, BrakingFromFreeSpeedGives89Amperes) {
    DrivePlant plant = tool(reference_tool());
    run_for(plant, 2.0, 1.0);
    run_for(plant, 0.002, 0.0);
    EXPECT_NEAR(plant.current_a(), -89.0, 0.5);
}

TEST(DrivePlant, CoastEndsTheCurrentAndTheBridgeStaysOpen) {
    DrivePlant plant = tool(reference_tool(), LoadKind::TORQUE);
    run_for(plant, 0.2, 1.0, false, 0.0, 1.5);
    ASSERT_GT(plant.current_a(), 20.0);
    run_for(plant, 0.001, 1.0, true, 0.0, 1.5);
    EXPECT_EQ(plant.current_a(), 0.0);
    const double before = plant.speed_rad_s();
    run_for(plant, 0.01, 1.0, true);
    EXPECT_EQ(plant.current_a(), 0.0);
    EXPECT_LT(plant.speed_rad_s(), before);
    EXPECT_GT(plant.speed_rad_s(), 0.0);
}

TEST(DrivePlant, ShaftRestsExactlyUpToTheCoulombTorque) {
    const Parameters p = reference_tool();
    const double held = p.motor_coulomb_nm / p.motor_torque_constant * (p.motor_resistance_ohm) /
                        p.supply_voltage_v;
    DrivePlant plant = tool(p);
    run_for(plant, 0.5, 0.999 * held);
    EXPECT_EQ(plant.speed_rad_s(), 0.0);
    EXPECT_EQ(plant.angle_rad(), 0.0);
    run_for(plant, 0.5, 1.01 * held);
    EXPECT_GT(plant.speed_rad_s(), 0.0);
}

TEST(DrivePlant, DeadTimeTakesItsShareOfTheBus) {
    DrivePlant plain = tool(reference_tool(), LoadKind::TORQUE),
               dead = tool(reference_tool(), LoadKind::TORQUE);
    run_for(plain, 1.0, 0.5 - 0.02, false, 0.0, 1.0);
    run_for(dead, 1.0, 0.5, false, 0.02, 1.0);
    EXPECT_NEAR(dead.speed_rad_s(), plain.speed_rad_s(),
                2.0);  // approximate: the bus voltage falls with d i
    run_for(plain, 1.0, 1.0, false, 0.0, 1.0);
    run_for(dead, 1.0, 1.0, false, 0.02, 1.0);
    EXPECT_NEAR(dead.speed_rad_s(), plain.speed_rad_s(),
                1e-6);  // a bridge that does not switch loses nothing
}

TEST(DrivePlant, EdgesCountTheAngleBothWays) {
    DrivePlant plant = tool(reference_tool());
    for (const double duty : {0.8, -0.7}) {
        int edges = 0;
        const double from = plant.angle_rad();
        double path = 0.0, last = from;
        for (int n = 0; n < 20000; ++n) {
            const PeriodResult r = plant.period(false, duty, 0.0, 0.0);
            edges += r.edge_count;
            path += std::fabs(plant.angle_rad() - last);
            last = plant.angle_rad();
            for (int e = 0; e < r.edge_count; ++e) {
                ASSERT_GE(r.edge_cycle[e], 0);
                ASSERT_LT(r.edge_cycle[e], PERIOD_CYCLES);
            }
        }
        EXPECT_NEAR(edges, path / 1.5707963268, 2.0);
    }
}

TEST(DrivePlant, UnequalSpacingAndEccentricityMoveEdgesNotTheShaft) {
    Parameters p = reference_tool();
    p.effects.hall_eccentricity.amplitude_rad = 0.1;
    DrivePlant plain = tool(reference_tool()),
               odd(p, LoadKind::NONE, hall_wheel(4, 0.3, {0.2, 0.3, 0.24, 0.26}), 1);
    int differ = 0, plain_edges = 0, odd_edges = 0;
    for (int n = 0; n < 30000; ++n) {
        const PeriodResult a = plain.period(false, 1.0, 0.0, 0.0),
                           b = odd.period(false, 1.0, 0.0, 0.0);
        plain_edges += a.edge_count;
        odd_edges += b.edge_count;
        differ += a.edge_count != b.edge_count;
    }
    EXPECT_EQ(plain.speed_rad_s(), odd.speed_rad_s());
    EXPECT_NEAR(plain_edges, odd_edges, 2);
    EXPECT_GT(differ, 100);
}

TEST(DrivePlant, DropoutLosesItsShareOfEdgesAndIsSeeded) {
    Parameters p = reference_tool();
    p.effects.hall_dropout.probability = 0.1;
    DrivePlant all = tool(reference_tool()), some = tool(p), same_seed = tool(p);
    int edges = 0, kept = 0;
    for (int n = 0; n < 60000; ++n) {
        edges += all.period(false, 1.0, 0.0, 0.0).edge_count;
        const int seen = some.period(false, 1.0, 0.0, 0.0).edge_count;
        ASSERT_EQ(seen, same_seed.period(false, 1.0, 0.0, 0.0).edge_count);
        kept += seen;
    }
    EXPECT_NEAR(static_cast<double>(kept) / edges, 0.9, 0.02);
}

TEST(DrivePlant, CommandActsAfterTheTransportDelay) {
    Parameters p = reference_tool();
    p.effects.transport_delay.delay_s = 0.01;
    DrivePlant plant = tool(p);
    run_for(plant, 0.0099, 1.0);
    EXPECT_EQ(plant.current_a(), 0.0);
    run_for(plant, 0.001, 1.0);
    EXPECT_GT(plant.current_a(), 10.0);
}
