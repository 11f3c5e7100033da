// Low vibration: each phase, its end and its limits; random inputs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

extern "C" {
#include "controllers/vibration.h"
}

namespace {

constexpr double RPM_PER_V = 876, OHM = 0.190, SUPPLY_V = 18.0;
constexpr int16_t FULL = INT16_MAX;

VibrationSetpoints setpoints(uint8_t method) {
    return {method, 8520, 7700, 108, 175, 40 * 512, 21234, 14400, 190, 876};
}

// Inputs that the board measures at a motor speed and a duty.
ControllerInputs measured(double rpm, int16_t duty_q15, int16_t trigger_q15 = FULL,
                          int16_t travel_q15 = 0) {
    const double current = (duty_q15 / 32768.0 * SUPPLY_V - rpm / RPM_PER_V) / OHM;
    ControllerInputs in{};
    in.travel_q15 = travel_q15;
    in.speed_rpm_q1 = static_cast<int16_t>(std::lround(2 * rpm));
    in.current_a_q9 = static_cast<int16_t>(std::clamp(std::lround(512 * current), -32768L, 32767L));
    in.supply_mv = static_cast<uint16_t>(1e3 * SUPPLY_V);
    in.duty_q15 = duty_q15;
    in.trigger_q15 = trigger_q15;
    return in;
}

struct Drive {
    VibrationSetpoints set;
    Vibration self{};
    Blow blow{};
    int16_t duty_q15 = 0;

    explicit Drive(uint8_t method = CONTROLLER_METHOD_CURRENT) : set(setpoints(method)) {
        vibration_start(&self, &set);
    }
    int16_t step(double rpm, int16_t trigger_q15 = FULL, int16_t travel_q15 = 0) {
        const ControllerInputs in = measured(rpm, duty_q15, trigger_q15, travel_q15);
        duty_q15 = vibration_step(&self, &set, &in, &blow);
        return duty_q15;
    }
    // Runs up to `rpm` in `ms`.
    void run_up(double rpm, int ms) {
        for (int n = 0; n < ms; ++n)
            step(rpm * n / ms);
    }
    // Runs until the climb begins.
    void meet_anvil() {
        run_up(2800, 40);
        for (int ms = 0; self.phase == VIBRATION_APPROACH && ms < 1000; ++ms)
            step(2500);
    }
    // Runs until the hammer is released: the surge begins.
    void release() {
        meet_anvil();
        for (int ms = 0; self.phase == VIBRATION_CLIMB && ms < 1000; ++ms)
            step(1500);
    }
};

class BothMethods : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Vibration, BothMethods,
                         testing::Values(CONTROLLER_METHOD_SPEED, CONTROLLER_METHOD_CURRENT));

TEST_P(BothMethods, ApproachesWithASmallDuty) {
    Drive drive(static_cast<uint8_t>(GetParam()));
    drive.run_up(2800, 40);
    EXPECT_EQ(vibration_state(&drive.self), VIBRATION_APPROACH);
    EXPECT_EQ(drive.duty_q15, drive.set.approach_q15);
}

TEST_P(BothMethods, DipOfASixteenthIsTheAnvil) {
    Drive drive(static_cast<uint8_t>(GetParam()));
    drive.run_up(3200, 40);
    drive.step(3200);
    for (int n = 0; n < 10; ++n)
        drive.step(3030);  // 5.3 % less
    EXPECT_EQ(drive.self.phase, VIBRATION_APPROACH);
    drive.step(2960);  // 7.5 % less
    drive.step(2960);
    EXPECT_EQ(drive.self.phase, VIBRATION_CLIMB);
    EXPECT_LT(drive.duty_q15, drive.set.approach_q15);
}

TEST_P(BothMethods, SurgesAfterTheAngleOfTheClimb) {
    Drive drive(static_cast<uint8_t>(GetParam()));
    drive.meet_anvil();
    const double per_ms = 1500.0 / 60e3, wanted = 175.0 / 256.0;
    double turned = 0.0;
    for (int ms = 0; drive.self.phase == VIBRATION_CLIMB && ms < 1000; ++ms) {
        drive.step(1500);
        turned += per_ms;
    }
    EXPECT_EQ(drive.self.phase, VIBRATION_SURGE);
    EXPECT_NEAR(turned, wanted, 2.1 * per_ms);
}

TEST(Vibration, DutyGrowsAlongTheClimb) {
    Drive drive;
    drive.meet_anvil();
    const int16_t first = drive.duty_q15;
    for (int n = 0; n < 5; ++n)
        drive.step(500);
    EXPECT_EQ(drive.duty_q15 - first, 5 * drive.set.climb_per_ms_q15);
}

TEST(Vibration, ClimbEndsAfterATenthOfASecond) {
    Drive drive;
    drive.meet_anvil();
    int ms = 0;
    for (; drive.self.phase == VIBRATION_CLIMB && ms < 1000; ++ms)
        drive.step(0);
    EXPECT_NEAR(ms, 100, 1);
}

TEST(Vibration, SurgeHoldsItsCurrent) {
    Drive drive;
    drive.release();
    double rpm = 1500, current = 0.0;
    int n = 0;
    for (; n < 99 && drive.self.phase == VIBRATION_SURGE; ++n) {
        rpm += 90;
        current = (drive.duty_q15 / 32768.0 * SUPPLY_V - rpm / RPM_PER_V) / OHM;
        drive.step(rpm);
        if (n > 5) {
            EXPECT_LE(current, 41.0);
            EXPECT_GE(current, 35.0);
        }
    }
    EXPECT_GT(n,
              60);  // (18 V - 0.19 ohm 40 A) 876 rpm/V less 1,500 rpm, at 90 rpm per ms, is 84 ms
    EXPECT_EQ(drive.self.phase, VIBRATION_RUN);
    EXPECT_EQ(drive.duty_q15, FULL);
}

// With more current the third climb would end on top of a lug.
TEST(Vibration, AWeakBatterySurgesWithLessCurrent) {
    struct Wanted {
        double supply_v, set_a, surge_a;
    };
    for (const Wanted &wanted : {Wanted{16.89, 42, 30.5},
                                 {16.9, 42, 42},
                                 {16.0, 42, 30.5},
                                 {16.0, 20, 20},
                                 {18.5, 20, 20}}) {
        VibrationSetpoints set = setpoints(CONTROLLER_METHOD_CURRENT);
        set.surge_a_q9 = static_cast<int16_t>(512 * wanted.set_a);
        Vibration self{};
        const Blow blow{};
        vibration_start(&self, &set);
        ControllerInputs in = measured(0, 0);
        in.supply_mv = static_cast<uint16_t>(std::lround(1000 * wanted.supply_v));
        for (int ms = 0; ms < 5; ++ms)
            vibration_step(&self, &set, &in, &blow);
        self.phase = VIBRATION_SURGE;
        self.duty_q15 = in.duty_q15 = 16000;
        in.current_a_q9 = static_cast<int16_t>(512 * wanted.surge_a);
        EXPECT_EQ(vibration_step(&self, &set, &in, &blow), 16000) << wanted.supply_v;
        in.current_a_q9 = static_cast<int16_t>(in.current_a_q9 - 256);
        EXPECT_GT(vibration_step(&self, &set, &in, &blow), 16000) << wanted.supply_v;
    }
}

// At 20 V the soft start begins with a trigger of 0.77: 15.4 V.
TEST(Vibration, BelowItsLeastVoltageItIsThePlainMode) {
    for (const double trigger : {0.765, 0.775}) {
        Drive drive;
        const auto most = static_cast<int16_t>(32767 * trigger);
        int16_t travel = 0, step = 0;
        bool plain = true;
        for (int ms = 0; ms < 200; ++ms) {
            travel = static_cast<int16_t>(std::min<int>(most, travel + 197));
            ControllerInputs in = measured(std::min(60.0 * ms, 3600.0), step, most, travel);
            in.supply_mv = 20000;
            step = vibration_step(&drive.self, &drive.set, &in, &drive.blow);
            plain = plain && step == travel;
        }
        EXPECT_EQ(plain, trigger < 0.77) << trigger;
    }
}

// The duty follows the trigger's ramp until the trigger is known to be strong enough.
TEST(Vibration, ASlowPullBeginsTheApproachWhenItIsStrongEnough) {
    Drive drive;
    int16_t step = 0;
    for (int ms = 0; ms < 60; ++ms) {
        const auto trigger = static_cast<int16_t>(std::min(ms * 1100, 32767));
        ControllerInputs in =
            measured(0, step, trigger, static_cast<int16_t>(std::min(ms * 197, 32767)));
        step = vibration_step(&drive.self, &drive.set, &in, &drive.blow);
        const bool weak = trigger < 32767 * 15.4 / SUPPLY_V;
        EXPECT_EQ(drive.self.phase_ms == 0, weak) << ms;
        if (weak) {
            EXPECT_EQ(step, in.travel_q15) << ms;
        }
    }
    EXPECT_EQ(drive.self.phase, VIBRATION_APPROACH);
    EXPECT_EQ(step, drive.set.approach_q15);
}

// duty + R (surge_a - i) / Vs, at most 0.12 more than the last; above surge_a what it is.
TEST(Vibration, SurgeAddsTheDropOfTheWinding) {
    struct Case {
        double current;
        int duty;
    };
    for (const Case &c : {Case{34.0, 15000 + 2075}, Case{10.0, 15000 + 3932},
                          Case{39.99, 15000 + 3}, Case{40.0, 15000}, Case{47.0, 15000}}) {
        Drive drive;
        drive.release();
        drive.self.duty_q15 = 15000;
        ControllerInputs in = measured(3000, 15000);
        in.current_a_q9 = static_cast<int16_t>(std::lround(512 * c.current));
        EXPECT_NEAR(vibration_step(&drive.self, &drive.set, &in, &drive.blow), c.duty, 3)
            << c.current;
    }
}

TEST(Vibration, WithoutADipItBecomesThePlainMode) {
    Drive drive;
    int ms = 0;
    for (; drive.self.phase == VIBRATION_APPROACH && ms < 1000; ++ms)
        drive.step(std::min(60.0 * ms, 3600.0));
    EXPECT_NEAR(ms, 92, 1);  // from the tick on in which the least trigger is computed
    EXPECT_EQ(drive.self.phase, VIBRATION_RUN);
    for (; drive.duty_q15 < FULL && ms < 1000; ++ms)
        drive.step(6000);
    EXPECT_NEAR(ms, 92 + (32767 - 8520) / 197.0, 2);  // the trigger's ramp of 6 per second
}

TEST(Vibration, ResumedDriveKeepsTheDutyOfItsSpeed) {
    Drive drive;
    EXPECT_NEAR(drive.step(8000, FULL, 16000), 16000, 200);
    EXPECT_EQ(drive.self.phase, VIBRATION_RUN);
}

// With back-EMF below 0.648 of the voltage, in impacts.
TEST_P(BothMethods, AHardJointReducesTheVoltage) {
    for (const double share : {0.62, 0.67}) {
        Drive drive(static_cast<uint8_t>(GetParam()));
        drive.release();
        drive.blow.impacting = true;
        for (int n = 0; n < 1500; ++n)
            drive.step(share * RPM_PER_V * SUPPLY_V * drive.duty_q15 / 32768.0);
        const double volts = SUPPLY_V * drive.duty_q15 / 32768.0;
        if (share < 0.648) {
            EXPECT_NEAR(volts, 14.4, 0.15);
        } else {
            EXPECT_NEAR(volts, SUPPLY_V, 0.01);
        }
    }
}

TEST(Vibration, WithoutBlowsThereIsNoLimit) {
    Drive drive;
    drive.release();
    for (int n = 0; n < 500; ++n)
        drive.step(0.5 * RPM_PER_V * SUPPLY_V * drive.duty_q15 / 32768.0);
    EXPECT_EQ(drive.duty_q15, FULL);
    EXPECT_EQ(vibration_estimate(&drive.self), FULL);
}

TEST(Vibration, NeverBeyondTheTrigger) {
    Drive drive;
    for (int n = 0; n < 300; ++n) {
        const auto trigger = static_cast<int16_t>(std::min(n * 400, 12000));
        const auto travel = static_cast<int16_t>(std::min<int>(trigger, n * 197));
        EXPECT_LE(drive.step(n < 40 ? 70.0 * n : 2000, trigger, travel), trigger);
    }
    EXPECT_EQ(drive.duty_q15, 12000);
    const int16_t less = drive.step(4000, 9000);
    EXPECT_EQ(12000 - less, 197);  // a partly released trigger: at the rate of its ramp
}

TEST(Vibration, SensorsWithoutSignalEndInThePlainMode) {
    Drive drive;
    ControllerInputs in{};
    in.trigger_q15 = in.travel_q15 = FULL;
    for (int n = 0; n < 1000; ++n)
        drive.duty_q15 = vibration_step(&drive.self, &drive.set, &in, &drive.blow);
    EXPECT_EQ(drive.self.phase, VIBRATION_RUN);
    EXPECT_EQ(drive.duty_q15, FULL);
}

TEST(Vibration, RandomInputsGiveADutyWithinTheTrigger) {
    std::mt19937 random(7);
    std::uniform_int_distribution<int> word(INT16_MIN, INT16_MAX), unsigned_word(0, UINT16_MAX),
        coin(0, 3);
    for (int run = 0; run < 200; ++run) {
        Drive drive(static_cast<uint8_t>(1 + run % 2));
        int16_t last = 0;
        bool first = true;
        for (int n = 0; n < 400; ++n) {
            ControllerInputs in{};
            const auto duty = [&] {
                return static_cast<int16_t>(std::max(0, coin(random) != 0 ? word(random) : FULL));
            };
            in.travel_q15 = in.trigger_q15 = duty();
            in.speed_rpm_q1 = static_cast<int16_t>(coin(random) != 0 ? word(random) : 0);
            in.current_a_q9 = static_cast<int16_t>(word(random));
            in.supply_mv = static_cast<uint16_t>(coin(random) != 0 ? unsigned_word(random) : 0);
            in.duty_q15 = duty();
            drive.blow.impacting = coin(random) == 0;
            const int16_t requested = vibration_step(&drive.self, &drive.set, &in, &drive.blow);
            ASSERT_GE(requested, 0);
            ASSERT_LE(requested, std::max<int>(in.trigger_q15, first ? in.travel_q15 : last))
                << run << ' ' << n;
            ASSERT_LE(vibration_state(&drive.self), VIBRATION_RUN);
            ASSERT_GE(vibration_estimate(&drive.self), 0);
            last = requested;
            first = false;
        }
    }
}

}  // namespace
