// Drill driver's controller on a simple motor model: ramp, pulse mode, clutch, jams, ordinary
// loads, limits, and random inputs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

extern "C" {
#include "controllers/drill.h"
}

namespace {

// Of the reference motor: winding, J / k^2 in A s/V, Tc / k.
constexpr double R = 0.19, L = 1e-4, INERTIA_AS_PER_V = 0.1347, FRICTION_A = 1.1;
constexpr double TICK_S = 1e-3;
constexpr int SUBSTEPS = 50;
const DrillSetpoints PLAIN{0, 8064, 190, 876, false, true};

DrillSetpoints with_clutch(double torque_nm) {
    DrillSetpoints set = PLAIN;
    set.clutch_dnm = static_cast<int16_t>(std::lround(10.0 * torque_nm));
    return set;
}

// Motor and controller; a returned duty is applied in the next tick.
struct Drive {
    DrillSetpoints set;
    Drill drill{};
    double supply_v = 18.0, emf_v = 0.0, current_a = 0.0, turned = 0.0;
    int16_t now = CONTROLLER_COAST, requested = CONTROLLER_COAST;

    explicit Drive(const DrillSetpoints &s, double volts = 18.0) : set(s), supply_v(volts) {
        drill_start(&drill, &set);
    }

    // The trigger's ramp begins at 0 for a shaft at rest.
    Drive &begun() {
        tick(0.0, 0.0);
        return *this;
    }

    // load_a: current of the load while the shaft turns. Returns the duty of the controller.
    int16_t tick(double travel, double load_a) {
        const bool open = now < 0;
        const double volts = now / 32767.0 * supply_v;
        double mean_a = 0.0;
        for (int n = 0; n < SUBSTEPS; ++n) {
            const double h = TICK_S / SUBSTEPS;
            const double across = open ? (current_a > 0.0 ? -supply_v : emf_v) : volts;
            current_a += h / L * (across - R * current_a - emf_v);
            current_a = open ? std::max(current_a, 0.0) : current_a;
            const double torque_a =
                current_a -
                (emf_v > 0.0 ? load_a + FRICTION_A : std::min(current_a, load_a + FRICTION_A));
            emf_v = std::max(0.0, emf_v + h / INERTIA_AS_PER_V * torque_a);
            mean_a += current_a / SUBSTEPS;
            turned += h * emf_v;
        }
        ControllerInputs in{};
        in.travel_q15 = static_cast<int16_t>(travel * 32767);
        in.speed_rpm_q1 = static_cast<int16_t>(std::min(emf_v * 876 * 2, 32767.0));
        in.current_a_q9 = static_cast<int16_t>(std::min(mean_a * 512, 32767.0));
        in.supply_mv = static_cast<uint16_t>(supply_v * 1000);
        in.duty_q15 = static_cast<int16_t>(open ? 0 : now);
        in.coasted = open;
        const Blow none{};
        now = requested;
        requested = drill_step(&drill, &set, &in, &none);
        return requested;
    }

    void run(int ms, double travel, double load_a) {
        for (int n = 0; n < ms; ++n)
            tick(travel, load_a);
    }

    int until(uint8_t state, int ms, double travel, double load_a) {
        for (int n = 0; n < ms; ++n) {
            tick(travel, load_a);
            if (drill_state(&drill) == state)
                return n + 1;
        }
        return -1;
    }
};

TEST(Drill, RunsUpInThreeTenthsOfASecondAndFollowsTheTrigger) {
    Drive drive = Drive(PLAIN).begun();
    drive.run(150, 1.0, 0.0);
    EXPECT_NEAR(drive.requested / 32767.0, 0.5, 0.01);
    drive.run(155, 1.0, 0.0);
    EXPECT_EQ(drive.requested, 32767);
    drive.run(200, 0.4, 0.0);
    EXPECT_NEAR(drive.requested / 32767.0, 0.4, 1e-3);
    EXPECT_EQ(drill_state(&drive.drill), DRILL_RUN);
}

TEST(Drill, ATurningShaftKeepsItsDuty) {
    Drive drive(PLAIN);
    EXPECT_NEAR(drive.tick(0.7, 0.0) / 32767.0, 0.7, 0.01);
}

TEST(Drill, PulsesAbove15AInPulseModeAndNotAt14) {
    DrillSetpoints pulse = PLAIN;
    pulse.pulse = true;
    for (const auto &[set, load_a, expected] :
         {std::tuple{pulse, 16.0, true}, {pulse, 13.0, false}, {PLAIN, 16.0, false}}) {
        Drive drive = Drive(set).begun();
        drive.run(800, 1.0, 0.0);
        EXPECT_EQ(drive.until(DRILL_COAST, 400, 1.0, load_a) > 0, expected) << load_a;
    }
}

TEST(Drill, APulseIsACoastOf25MsAndADriveOf75Ms) {
    DrillSetpoints set = PLAIN;
    set.pulse = true;
    Drive drive = Drive(set).begun();
    drive.run(800, 1.0, 0.0);
    ASSERT_GT(drive.until(DRILL_COAST, 400, 1.0, 18.0), 0);
    for (int turn = 0; turn < 5; ++turn) {
        EXPECT_EQ(drive.until(DRILL_PULSE, 100, 1.0, 18.0), 24);
        EXPECT_GT(drive.requested, 20000);
        EXPECT_EQ(drive.until(DRILL_COAST, 100, 1.0, 18.0), 76);
        EXPECT_EQ(drive.requested, CONTROLLER_COAST);
    }
}

TEST(Drill, PulsesEndWhenTheMeanFallsBelow8AAndNotBeforeATenthOfASecond) {
    DrillSetpoints set = PLAIN;
    set.pulse = true;
    Drive drive = Drive(set).begun();
    drive.run(800, 1.0, 0.0);
    ASSERT_GT(drive.until(DRILL_COAST, 400, 1.0, 18.0), 0);
    const int ended = drive.until(DRILL_RUN, 400, 1.0, 0.0);
    EXPECT_GE(ended, 100);
    EXPECT_LE(ended, 220);
    EXPECT_EQ(drive.until(DRILL_RUN, 1, 1.0, 0.0), 1);
}

TEST(Drill, AJamOpensTheBridgeWithin15Ms) {
    for (const double volts : {16.0, 20.5})
        for (const double travel : {0.3, 1.0})
            for (const double load_a : {60.0, 100.0}) {
                Drive drive = Drive(PLAIN, volts).begun();
                drive.run(900, travel, 3.0);
                int ms = 0;
                while (ms < 30 && drill_state(&drive.drill) != DRILL_STOPPED) {
                    ++ms;
                    drive.tick(travel, 3.0 + std::min(1.0, ms / 5.0) * (load_a - 3.0));
                }
                EXPECT_LE(ms, 15) << volts << " V, " << travel << ", " << load_a << " A";
                EXPECT_EQ(drill_stop_reason(&drive.drill), CONTROLLER_REASON_KICKBACK);
                EXPECT_EQ(drive.tick(travel, 0.0), CONTROLLER_STOP);
            }
}

// The controller with given inputs: pulse mode from full speed, until the coast.
struct Pulses {
    DrillSetpoints set = PLAIN;
    Drill drill{};
    ControllerInputs in{};
    int16_t out = 0;

    explicit Pulses(uint16_t rpm_per_v, double volts = 18.0, double current_a = 20.0) {
        set.pulse = true;
        set.rpm_per_v = rpm_per_v;
        drill_start(&drill, &set);
        in.travel_q15 = in.trigger_q15 = INT16_MAX;
        in.supply_mv = static_cast<uint16_t>(volts * 1000);
        in.edges = 1;
        for (int n = 0; n < 100 && drill.state != DRILL_COAST; ++n) {
            in.current_a_q9 = static_cast<int16_t>((n < 50 ? 10.0 : current_a) * 512);
            in.speed_rpm_q1 = static_cast<int16_t>(2 * rpm_per_v * emf_v());
            step();
        }
    }

    double emf_v() const {
        return in.supply_mv / 1000.0 - in.current_a_q9 / 512.0 * set.motor_mohm / 1000.0;
    }

    uint8_t step() {
        in.coasted = out == CONTROLLER_COAST;
        in.duty_q15 = in.coasted ? int16_t{0} : INT16_MAX;
        const Blow none{};
        out = drill_step(&drill, &set, &in, &none);
        return drill.state;
    }
};

// The jam begins in the coast: the bridge must not close on the standing shaft.
TEST(Drill, AJamWhileCoastingStopsBeforeThePulse) {
    for (const int jams_at : {1, 10, 22}) {
        Pulses pulses(876);
        ASSERT_EQ(pulses.drill.state, DRILL_COAST);
        for (int ms = 0; ms < 24; ++ms) {
            ASSERT_EQ(pulses.drill.state, DRILL_COAST) << ms;
            pulses.in.speed_rpm_q1 = ms < jams_at ? pulses.in.speed_rpm_q1 : int16_t{0};
            pulses.in.current_a_q9 = 0;
            pulses.step();
        }
        EXPECT_EQ(pulses.drill.state, DRILL_STOPPED) << jams_at;
        EXPECT_EQ(drill_stop_reason(&pulses.drill), CONTROLLER_REASON_KICKBACK) << jams_at;
    }
}

// 12 N m in low gear take 36 A: the back-EMF falls by 6.7 V in a coast of 25 ms.
TEST(Drill, AnOrdinaryLoadWhileCoastingIsNoJam) {
    Pulses pulses(876);
    const double emf_v = pulses.emf_v();
    for (int ms = 0; ms < 24; ++ms) {
        pulses.in.current_a_q9 = 0;
        pulses.in.speed_rpm_q1 = static_cast<int16_t>(2 * 876 * (emf_v - (ms + 1) * 0.27));
        pulses.step();
    }
    EXPECT_EQ(pulses.drill.state, DRILL_PULSE);
}

TEST(Drill, ThePulseOfEveryMotorIsLimitedByItsBackEmf) {
    for (const int rpm_per_v : {50, 100, 300, 400, 499, 500, 501, 876, 950}) {
        Pulses pulses(static_cast<uint16_t>(rpm_per_v), 25.0, 45.0);
        ASSERT_EQ(pulses.drill.state, DRILL_COAST) << rpm_per_v;
        pulses.in.speed_rpm_q1 = static_cast<int16_t>(2 * rpm_per_v * 10.0);
        for (int ms = 0; ms < 60; ++ms)
            pulses.step();
        ASSERT_EQ(pulses.drill.state, DRILL_PULSE) << rpm_per_v;
        EXPECT_NEAR(pulses.out / 32767.0 * 25.0, 10.0 + 44 * 0.19, 0.02) << rpm_per_v;
    }
}

TEST(Drill, TheGovernedSpeedOfAWindingOfHighResistance) {
    for (const int mohm : {190, 1000, 1092, 1093, 1500, 2000}) {
        DrillSetpoints set = with_clutch(13.0);
        set.motor_mohm = static_cast<uint16_t>(mohm);
        set.kickback = false;
        Drill drill;
        drill_start(&drill, &set);
        ControllerInputs in{};
        in.travel_q15 = in.duty_q15 = INT16_MAX;
        in.supply_mv = 65000;
        in.current_a_q9 = 39 * 512;
        int16_t out = 0;
        for (int n = 0; n < 400; ++n) {
            const Blow none{};
            drill.set_a2_q8 = INT32_MAX;  // the clutch never releases
            out = drill_step(&drill, &set, &in, &none);
        }
        const double wanted_v = drill.limit_mv / 1000.0 + 0.75 * 39 * mohm / 1000.0;
        EXPECT_NEAR(out / 32767.0 * 65.0, wanted_v, 0.5) << mohm << " mohm";
    }
}

TEST(Drill, AnOrdinaryOverloadIsNoJam) {
    for (const double volts : {16.0, 20.5}) {
        Drive drive = Drive(PLAIN, volts).begun();
        drive.run(900, 1.0, 0.0);
        drive.run(300, 1.0, 36.0);  // 12 N m in low gear, at once
        drive.run(300, 0.5, 5.0);
        drive.run(300, 1.0, 36.0);
        EXPECT_EQ(drill_state(&drive.drill), DRILL_RUN);
    }
}

TEST(Drill, AntiKickbackCanBeTurnedOff) {
    DrillSetpoints set = PLAIN;
    set.kickback = false;
    Drive drive = Drive(set).begun();
    drive.run(900, 1.0, 3.0);
    drive.run(40, 1.0, 90.0);
    EXPECT_EQ(drill_state(&drive.drill), DRILL_RUN);
}

// A screw whose torque rises with the angle: the set current is reached after `degrees` of the
// chuck.
double tightened_a(Drive &drive, double set_a, double degrees) {
    drive.run(500, 1.0, 0.0);
    const double from = drive.turned;
    const double span = degrees / 180.0 * 3.14159265 * 31.5 * 0.0109;  // emf time: k N angle
    double load_a = 0.0;
    for (int ms = 0;
         ms < 3000 && (drill_state(&drive.drill) != DRILL_STOPPED || drive.emf_v > 0.01); ++ms) {
        load_a = set_a * (drive.turned - from) / span;
        drive.tick(1.0, load_a);
    }
    return load_a;
}

TEST(Drill, TheClutchStopsAtItsSettingOnSoftAndHardJoints) {
    for (const double torque_nm : {4.0, 8.0, 12.0})
        for (const double degrees : {30.0, 90.0, 360.0})
            for (const double volts : {16.0, 20.5}) {
                Drive drive = Drive(with_clutch(torque_nm), volts).begun();
                const double set_a = torque_nm / 31.5 / 0.0109;
                EXPECT_NEAR(tightened_a(drive, set_a, degrees) / set_a, 1.03, 0.11)
                    << torque_nm << " N m, " << degrees << " deg, " << volts << " V";
                EXPECT_EQ(drill_stop_reason(&drive.drill), CONTROLLER_REASON_CLUTCH);
            }
}

TEST(Drill, TheClutchLetsTheFreeShaftRunAtItsSpeed) {
    Drive drive = Drive(with_clutch(5.0)).begun();
    drive.run(2000, 1.0, 0.0);
    EXPECT_EQ(drill_state(&drive.drill), DRILL_RUN);
    EXPECT_NEAR(drive.emf_v, 2.9, 0.3);
    EXPECT_NEAR(drill_estimate(&drive.drill) / 16.0, FRICTION_A, 0.5);
}

TEST(Drill, ATorqueOutOfRangeIsRefused) {
    EXPECT_EQ(Drive(with_clutch(13.3)).tick(0.1, 0.0) >= 0, true);
    Drive drive(with_clutch(14.0));
    EXPECT_EQ(drive.tick(0.1, 0.0), CONTROLLER_STOP);
    EXPECT_EQ(drill_stop_reason(&drive.drill), CONTROLLER_REASON_UNREACHABLE);
}

TEST(Drill, RandomInputsGiveADutyOrACode) {
    std::mt19937 random(5);
    const auto any = [&random](int low, int high) {
        return std::uniform_int_distribution<int>(low, high)(random);
    };
    for (int round = 0; round < 300; ++round) {
        const DrillSetpoints set{static_cast<int16_t>(any(0, 300)),
                                 static_cast<uint16_t>(any(256, 32767)),
                                 static_cast<uint16_t>(any(10, 2000)),
                                 static_cast<uint16_t>(any(50, 3900)),
                                 any(0, 1) == 1,
                                 any(0, 1) == 1};
        Drill drill;
        drill_start(&drill, &set);
        bool stopped = false;
        for (int n = 0; n < 300; ++n) {
            ControllerInputs in{};
            in.travel_q15 = static_cast<int16_t>(any(0, 32767));
            in.speed_rpm_q1 = static_cast<int16_t>(any(-32768, 32767));
            in.current_a_q9 = static_cast<int16_t>(any(-32768, 32767));
            in.supply_mv = static_cast<uint16_t>(any(0, 65535));
            in.duty_q15 = static_cast<int16_t>(any(0, 32767));
            in.coasted = any(0, 3) == 0;
            const Blow none{};
            const int16_t requested = drill_step(&drill, &set, &in, &none);
            ASSERT_GE(requested, CONTROLLER_COAST);
            ASSERT_TRUE(!stopped || requested == CONTROLLER_STOP);
            stopped = requested == CONTROLLER_STOP;
            ASSERT_EQ(stopped, drill_state(&drill) == DRILL_STOPPED);
            ASSERT_EQ(stopped, drill_stop_reason(&drill) != CONTROLLER_REASON_NONE);
        }
    }
}

TEST(Drill, APulseDoesNotDriveWithoutTheTrigger) {
    DrillSetpoints set = PLAIN;
    set.pulse = true;
    Drive drive = Drive(set).begun();
    drive.run(800, 1.0, 0.0);
    ASSERT_GT(drive.until(DRILL_COAST, 400, 1.0, 18.0), 0);
    ASSERT_GT(drive.until(DRILL_PULSE, 100, 1.0, 18.0), 0);
    EXPECT_EQ(drive.tick(0.0, 18.0), CONTROLLER_COAST);
}

}  // namespace
