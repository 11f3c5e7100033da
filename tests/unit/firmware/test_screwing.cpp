// Precise screwing on a kinematic tool model: each blow turns the screw by its energy over the
// torque, and the motor produces the Hall edges.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>

extern "C" {
#include "controllers/screwing.h"
}

namespace {

constexpr double GEAR = 5.6, FULL_Q15 = 32767.0, STEP_S = 5e-5;
constexpr int TICK_STEPS = 20, PULSES = 4;
constexpr int SUPPLY_MV = 18500, LEAST = 5650 * 32768 / SUPPLY_MV;
const ScrewingSetpoints SET{PULSES, 717, 9994, 5650, 200, 340};
constexpr double SHARE = 9994 / 32768.0;

using Torque = std::function<double(double)>;  // N m over the angle of the head in degrees

struct Tool {
    Torque torque;
    double energy_j, rpm;      // of a blow; mean of the motor
    double ripple = 0.08;      // of the speed
    bool follows_duty = true;  // energy and speed fall with the duty
    double motor_turns = 0.2, phase = 0.0, head_deg = 0.0, period_s = 1.0, since_s = 0.0;
    int blows = 0, ticks = 0;
    int16_t requested = 0;
    Screwing screwing{};
    Blow blow{};
    ScrewingSetpoints set = SET;

    double share() const { return follows_duty ? requested / (FULL_Q15 * travel) : 1.0; }
    double travel = 1.0;

    double blow_deg() const { return energy_j * share() / torque(head_deg) * 180.0 / M_PI; }

    void advance(ControllerInputs &in) {
        const double wave = -std::cos(2 * M_PI * phase) + 0.4 * std::cos(4 * M_PI * phase + 1.0);
        const double turns = rpm * std::sqrt(share()) * (1 + ripple * wave) / 60.0 * STEP_S;
        const double before = std::floor(motor_turns * PULSES);
        motor_turns += turns;
        since_s += STEP_S;
        if (std::floor(motor_turns * PULSES) > before) {
            in.edges++;
            const double after_s = (motor_turns * PULSES - std::floor(motor_turns * PULSES)) /
                                   (turns * PULSES) * STEP_S;
            period_s = since_s - after_s;
            since_s = after_s;
        }
        const double per_blow = GEAR * (0.5 + blow_deg() / 360.0);
        phase += turns / per_blow;
        if (phase >= 1.0) {
            phase -= 1.0;
            head_deg += blow_deg();
            blows++;
        }
    }

    // One tick, after the drive up to the first blows.
    void tick() {
        ControllerInputs in{};
        in.travel_q15 = static_cast<int16_t>(travel * FULL_Q15);
        in.supply_mv = SUPPLY_MV;
        if (ticks == 0) {
            screwing_start(&screwing, &set);
            requested = in.travel_q15;
        }
        for (int n = 0; n < TICK_STEPS; ++n)
            advance(in);
        in.speed_rpm_q1 =
            static_cast<int16_t>(std::lround(2 * 60.0 / (PULSES * std::max(period_s, since_s))));
        blow.impacting = blows > 0;
        blow.count = static_cast<uint16_t>(blows);
        const int16_t answer = screwing_step(&screwing, &set, &in, &blow);
        requested = answer < 0 ? int16_t{0} : answer;
        ticks++;
    }

    // Runs until the controller stops; false: not within the time or the angle of the head.
    bool run(double seconds, double to_deg) {
        for (int n = 0; n < 1000 * seconds && head_deg < to_deg; ++n) {
            tick();
            if (screwing_stop_reason(&screwing) != CONTROLLER_REASON_NONE)
                return true;
        }
        return false;
    }
};

// Wood, then a ramp to twice the torque within 90 degrees at the head.
Torque seat_at(double deg, double end_nm, double rise_per_turn = 0.02) {
    return [=](double at) {
        const double wood = end_nm * (1.0 + rise_per_turn * std::min(at - deg, 0.0) / 360.0);
        return wood + end_nm * std::max(at - deg, 0.0) / 90.0;
    };
}

struct Screw {
    double energy_j, end_nm, rpm;
};

class ScrewingSizes : public ::testing::TestWithParam<Screw> {
protected:
    Tool tool(const Torque &torque) const {
        return Tool{torque, GetParam().energy_j, GetParam().rpm};
    }
};

TEST_P(ScrewingSizes, StopsOnTheRampOfTheSeat) {
    Tool t = tool(seat_at(1500, GetParam().end_nm));
    ASSERT_TRUE(t.run(20, 3000));
    EXPECT_EQ(screwing_stop_reason(&t.screwing), CONTROLLER_REASON_SEATED);
    EXPECT_EQ(screwing_state(&t.screwing), SCREWING_SEATED);
    EXPECT_GT(t.head_deg, 1500 + 10);
    EXPECT_LT(t.head_deg, 1500 + 75);
}

TEST_P(ScrewingSizes, LearnsTheRotationPerBlow) {
    Tool t = tool([this](double) { return GetParam().end_nm; });
    EXPECT_FALSE(t.run(4, 1e9));
    EXPECT_EQ(screwing_state(&t.screwing), SCREWING_TRACK);
    const double twelve_pitches = 12 * 360 / (GEAR * PULSES),
                 measured = t.blow_deg() * twelve_pitches / (180 + t.blow_deg());
    EXPECT_NEAR(t.screwing.learned / 364.0, measured, 0.01 * measured + 0.1);
    EXPECT_NEAR(screwing_estimate(&t.screwing), 256, 8);
}

TEST_P(ScrewingSizes, AKnotIsNoSeat) {
    const double end = GetParam().end_nm;
    Tool t = tool([=](double at) {
        return seat_at(2400, end)(at) + (at > 1200 && at < 1560 ? 0.7 * end : 0.0);
    });
    ASSERT_TRUE(t.run(30, 3600));
    EXPECT_GT(t.head_deg, 2400);
    EXPECT_LT(t.head_deg, 2400 + 75);
}

TEST_P(ScrewingSizes, TorqueThatRisesWithTheDepthIsNoSeat) {
    const double end = GetParam().end_nm;
    Tool t = tool([=](double at) { return end * (0.3 + 0.1 * at / 360.0); });
    EXPECT_FALSE(t.run(10, 3600));
}

INSTANTIATE_TEST_SUITE_P(Sizes, ScrewingSizes,
                         ::testing::Values(Screw{2.7, 6.0, 8000}, Screw{4.2, 11.0, 9500},
                                           Screw{3.0, 11.0, 6500}, Screw{4.2, 18.0, 9800}),
                         [](const auto &one) { return "Case" + std::to_string(one.index); });

// Too flat for a seat: after 60 degrees it becomes the reference for what follows.
TEST(Screwing, AConstantTorqueIsLearned) {
    Tool t{[](double at) {
               return 9.0 * (1.0 + 0.25 * std::min(std::max((at - 1500) / 40, 0.0), 1.0));
           },
           4.2, 9500};
    EXPECT_FALSE(t.run(20, 1500 + 80));
    EXPECT_EQ(screwing_state(&t.screwing), SCREWING_SUSPECT);
    EXPECT_NEAR(screwing_estimate(&t.screwing), 1.25 * 256, 15);
    EXPECT_FALSE(t.run(20, 1500 + 260));
    EXPECT_EQ(screwing_state(&t.screwing), SCREWING_TRACK);
    EXPECT_NEAR(screwing_estimate(&t.screwing), 256, 12);
}

TEST(Screwing, StopsAtTheRiseOfTheParameter) {
    double last = 0;
    for (const int16_t rise : {int16_t{300}, int16_t{420}}) {
        Tool t{seat_at(1500, 11.0), 4.2, 9500};
        t.set.rise_q8 = rise;
        ASSERT_TRUE(t.run(20, 3000));
        EXPECT_GE(screwing_estimate(&t.screwing), rise);
        EXPECT_GT(t.head_deg, last);
        last = t.head_deg;
    }
}

constexpr double UNIT = 364.0;  // of a rotation per degree

// Computations of a finished wave with given instead of measured rotations.
struct Judged {
    Screwing s{};

    explicit Judged(double learned_deg) {
        s.state = SCREWING_TRACK;
        s.share_q15 = SET.share_q15;
        s.least_q15 = s.duty_q15 = LEAST;
        s.learned = s.now = s.turn = s.last_turn = s.before_last = turn_of(learned_deg);
    }

    static int16_t turn_of(double deg) { return static_cast<int16_t>(std::lround(deg * UNIT)); }

    // Learns again at the initial power.
    void settle() {
        s.state = SCREWING_SETTLE;
        s.left = 28;
        for (int n = 0; n < 300; ++n)
            wave(0.0, 0);
    }

    // Evaluates a wave with this rotation per blow in `stages` steps; 0: a step without a wave.
    uint8_t wave(double turn_deg, int stages = 2) {
        constexpr uint8_t JUDGE = 2;  // STAGE_JUDGE of screwing.c
        if (stages > 0) {
            s.before_last = s.last_turn;
            s.last_turn = s.turn;
            s.turn = turn_of(turn_deg);
            s.stage = JUDGE;
        }
        ControllerInputs in{};
        in.travel_q15 = 32767;
        in.supply_mv = SUPPLY_MV;
        Blow blow{};
        blow.impacting = true;
        for (int n = 0; n < std::max(stages, 1); ++n)
            screwing_step(&s, &SET, &in, &blow);
        return s.state;
    }
};

// 14 blows, of which the first 4 are skipped.
TEST(ScrewingLaw, TheRotationIsLearnedFromTenBlows) {
    Judged judged(30.0);
    judged.settle();
    for (int n = 0; n < 8; ++n)
        judged.wave(30.0);
    for (int n = 0; n < 20; ++n) {
        EXPECT_EQ(judged.s.state, SCREWING_SETTLE) << n;
        judged.wave(15.0);
    }
    EXPECT_EQ(judged.s.state, SCREWING_TRACK);
    EXPECT_NEAR(judged.s.learned / UNIT, 15.0 + 15.0 * std::pow(7.0 / 8.0, 20), 0.4);
    EXPECT_EQ(judged.s.share_q15, SET.share_q15);
}

// After 7 blows; then the rotation is learned again.
TEST(ScrewingLaw, AMissingRotationRaisesThePower) {
    for (const double turn : {6.0, 11.0}) {
        Judged judged(turn);
        judged.settle();
        for (int n = 0; n < 13; ++n)
            judged.wave(turn);
        EXPECT_EQ(judged.s.share_q15, SET.share_q15);
        judged.wave(turn);
        EXPECT_NEAR(judged.s.share_q15, SET.share_q15 + 48.0 / 8.0 * UNIT * (12.5 - turn), 30)
            << turn;
        EXPECT_EQ(judged.s.left, 28);
        EXPECT_EQ(judged.s.state, SCREWING_SETTLE);
    }
}

// Angle in degrees at which a seat is detected when the torque follows `rise`; -1: none.
double seat_deg(double learned_deg, const std::function<double(double)> &rise,
                double last_deg = 360.0) {
    Judged judged(learned_deg);
    double at = 0.0;
    while (at < last_deg) {
        const double turn = learned_deg / rise(at);
        at += turn / 2;
        if (judged.wave(turn) == SCREWING_SEATED)
            return at;
    }
    return -1.0;
}

double slope_seat_deg(double learned_deg, double per_deg) {
    return seat_deg(learned_deg, [=](double at) { return 1.0 + per_deg * at; });
}

TEST(ScrewingLaw, ASlowRiseIsASeatAtOnce) {
    const double lag_deg = 10.0;
    for (const auto &[learned, per_deg] :
         {std::pair{14.0, 0.012}, std::pair{8.0, 0.014}, std::pair{5.0, 0.022}}) {
        EXPECT_GE(slope_seat_deg(learned, per_deg), 0.33 / per_deg);
        EXPECT_LE(slope_seat_deg(learned, per_deg), 0.33 / per_deg + lag_deg);
    }
}

TEST(ScrewingLaw, ASteepRiseIsASeatAfterTheAngleThatExcludesAnEdge) {
    for (const auto &[learned, per_deg] :
         {std::pair{5.0, 0.055}, std::pair{8.0, 0.036}, std::pair{14.0, 0.036}}) {
        const double onset = 0.12 / per_deg;
        EXPECT_NEAR(slope_seat_deg(learned, per_deg) - onset, (9.0 + learned / 5.0) / 0.3, 9.0)
            << learned;
    }
}

// The limit of a slow rise is inverse to the rotation up to 11 degrees per blow, then 0.0195 per
// degree.
TEST(ScrewingLaw, TheLimitOfASlowRiseDependsOnTheRotationPerBlow) {
    for (const auto &[learned, slow, steep] :
         {std::tuple{5.5, 0.034, 0.046}, std::tuple{14.0, 0.017, 0.027}}) {
        const double waits = (9.0 + learned / 5.0) / 0.3;
        EXPECT_LT(slope_seat_deg(learned, slow), waits) << learned;
        EXPECT_GT(slope_seat_deg(learned, steep), waits) << learned;
    }
}

TEST(ScrewingLaw, NoRiseIsSlowAtALargeRotationPerBlow) {
    EXPECT_LT(slope_seat_deg(15.5, 0.010), 40.0);
    EXPECT_GT(slope_seat_deg(16.5, 0.010), 50.0);
    EXPECT_LT(slope_seat_deg(20.0, 0.012), 75.0);
}

// An edge over up to two blows, then constant for a turn.
TEST(ScrewingLaw, AConstantTorqueIsNoSeat) {
    for (const double learned : {4.0, 8.0, 12.0, 14.0, 18.0})
        for (const double level : {1.55, 1.7, 2.0})
            for (const double blows : {0.0, 1.0, 2.0}) {
                const double edge = 1e-3 + blows * learned / level;
                EXPECT_EQ(seat_deg(learned,
                                   [=](double at) {
                                       return 1.0 + (level - 1.0) * std::min(at / edge, 1.0);
                                   }),
                          -1.0)
                    << learned << ' ' << level << ' ' << blows;
            }
}

TEST(ScrewingLaw, AConstantTorqueIsLearnedAfterSixtyDegrees) {
    Judged judged(14.0);
    double turned = 0.0;
    while (judged.s.learned == Judged::turn_of(14.0)) {
        judged.wave(9.0);
        turned += 4.5;
        ASSERT_LT(turned, 80.0);
    }
    EXPECT_NEAR(turned, 62.0, 4.6);
    EXPECT_EQ(judged.s.state, SCREWING_TRACK);
    EXPECT_EQ(judged.wave(9.0), SCREWING_TRACK);
    EXPECT_NEAR(screwing_estimate(&judged.s), 256, 2);
}

TEST(ScrewingLaw, ARiseThatFallsBackIsDiscarded) {
    Judged judged(14.0);
    for (int n = 0; n < 5; ++n)
        judged.wave(11.0);
    EXPECT_EQ(judged.s.state, SCREWING_SUSPECT);
    judged.wave(14.0);
    EXPECT_EQ(judged.s.state, SCREWING_TRACK);
    EXPECT_EQ(judged.s.turned, 0);
    EXPECT_EQ(judged.s.area, 0u);
    EXPECT_EQ(judged.s.over_q8, 0);
}

// A constant rise followed by an edge is not the ramp that both together resemble; a real seat
// after it is detected as well.
TEST(ScrewingLaw, ARiseAfterAnEarlyOnsetIsIntegratedByItself) {
    for (const double learned : {9.0, 14.0, 18.0}) {
        EXPECT_EQ(seat_deg(learned, [](double at) { return at < 30.0 ? 1.14 : 1.7; }), -1.0)
            << learned;
        const double seat =
            seat_deg(learned, [](double at) { return 1.14 + 0.014 * std::max(at - 30.0, 0.0); });
        EXPECT_GT(seat, 30.0 + 13.0) << learned;
        EXPECT_LT(seat, 30.0 + 80.0) << learned;
    }
}

TEST(ScrewingLaw, TheReferenceFollowsTheWoodUpAndDown) {
    for (const double turn : {2.0, 6.0, 15.0})
        for (const double off : {0.95, 1.25}) {
            Judged judged(turn);
            for (double at = 0.0; at < 1500.0; at += off * turn / 2)
                ASSERT_EQ(judged.wave(off * turn), SCREWING_TRACK);
            EXPECT_NEAR(judged.s.learned / UNIT, off * turn, 0.02 * turn + 0.25) << turn;
            EXPECT_NEAR(judged.s.now / UNIT, off * turn, 0.02 * turn + 0.08) << turn;
        }
}

// The Hall pitches repeat every second blow.
TEST(ScrewingLaw, AnErrorWithAPeriodOfTwoBlowsCancels) {
    Judged judged(8.0);
    for (int n = 0; n < 200; ++n) {
        judged.wave(8.0 + 1.5 * std::cos(M_PI / 2 * n));
        if (n > 4) {
            EXPECT_NEAR(judged.s.now / UNIT, 8.0, 0.05);
        }
    }
}

// Noise is averaged over 16 waves, or 11 degrees; over more with a small rotation per blow.
TEST(ScrewingLaw, SmallRotationsAreAveragedOverMoreBlows) {
    const auto reached = [](double learned, int waves) {
        Judged judged(learned);
        for (int n = 0; n < waves; ++n)
            judged.wave(1.1 * learned);
        return (judged.s.now / UNIT / learned - 1.0) / 0.1;
    };
    EXPECT_NEAR(reached(14.0, 1), 1.0, 0.01);
    EXPECT_NEAR(reached(6.0, 4), 1.0 - std::pow(1.0 - 6.0 * 16 * UNIT / 65536, 3), 0.15);
    EXPECT_NEAR(reached(2.0, 20), 1.0 - std::pow(1.0 - 32.0 / 256, 19), 0.15);
    EXPECT_NEAR(reached(1.0, 20), 1.0 - std::pow(1.0 - 8.0 / 256, 19), 0.15);
}

TEST(Screwing, TheTriggerDoesNotMoveTheStop) {
    double least = 1e9, most = 0.0;
    for (const double travel : {0.5, 0.65, 0.8, 1.0}) {
        Tool t{seat_at(1500, 9.0), 4.2 * travel, 9500 * std::sqrt(travel)};
        t.travel = travel;
        ASSERT_TRUE(t.run(30, 3000)) << travel;
        least = std::min(least, t.head_deg);
        most = std::max(most, t.head_deg);
    }
    EXPECT_LT(most - least, 25.0);
}

TEST(Screwing, ThePowerIsLoweredAtTheTwelfthBlow) {
    Tool t{[](double) { return 2.0; }, 4.2, 9000};
    int16_t last = 0;
    while (t.blows < 12) {
        last = t.requested;
        t.tick();
        if (t.blows < 12) {
            EXPECT_TRUE(t.ticks == 1 || t.requested == 32767);
        }
    }
    for (int n = 0; n < 200; ++n) {
        const int16_t before = t.requested;
        t.tick();
        EXPECT_LE(before - t.requested, 110);
    }
    EXPECT_EQ(last, 32767);
    EXPECT_NEAR(t.requested, SHARE * 32767 + LEAST / 4, 3);
}

// Duty of a drive at this trigger after 4 s on a constant torque.
int16_t settled_duty(double travel, double torque_nm) {
    Tool t{[=](double) { return torque_nm; }, 4.2, 9000};
    t.travel = travel;
    t.follows_duty = false;
    t.run(4, 1e9);
    return t.requested;
}

// 0.067 of the trigger's duty per degree of missing rotation to the setpoint, once; then to half of
// it.
TEST(Screwing, ASmallRotationGetsMorePower) {
    constexpr double WIDE_NM = 4.0, LITTLE_NM = 26.0,
                     LEAST_NM = 60.0;  // 60, 9 and 4 degrees per blow
    const double per_deg = 48.0 / 8.0 * UNIT, small_deg = 12.5;
    const double little_deg = 4.2 / LITTLE_NM * 180 / M_PI,
                 measured_deg = little_deg * 12 * 360 / (GEAR * PULSES) / (180 + little_deg);
    const auto power = [](double share_q15) { return share_q15 * 32767 / 32768 + LEAST / 4; };
    EXPECT_NEAR(settled_duty(1.0, WIDE_NM), power(SET.share_q15), 3);
    EXPECT_NEAR(settled_duty(1.0, LITTLE_NM),
                power(SET.share_q15 + per_deg * (small_deg - measured_deg)), 400);
    EXPECT_NEAR(settled_duty(1.0, LEAST_NM), 17 * LEAST / 8, 3);
    EXPECT_NEAR(settled_duty(0.5, LEAST_NM), 16383, 3);
}

TEST(Screwing, ThePowerHasALowerLimit) {
    EXPECT_NEAR(settled_duty(0.5, 4.0), LEAST, 3);
    EXPECT_NEAR(settled_duty(0.25, 4.0), 0.25 * 32767, 1);  // limited by the trigger
}

TEST(Screwing, WithoutBlowsTheTriggerDrives) {
    Screwing s{};
    screwing_start(&s, &SET);
    const Blow none{};
    for (int n = 0; n < 3000; ++n) {
        ControllerInputs in{};
        in.travel_q15 = static_cast<int16_t>(std::min(32767, n * 20));
        in.speed_rpm_q1 = static_cast<int16_t>(n % 7 * 3000);
        in.edges = static_cast<uint8_t>(n % 2);
        ASSERT_EQ(screwing_step(&s, &SET, &in, &none), in.travel_q15);
    }
    EXPECT_EQ(screwing_state(&s), SCREWING_RUN_IN);
}

TEST(Screwing, WhenBlowsEndTheRunInReturns) {
    Tool t{[](double) { return 5.0; }, 4.2, 9000};
    t.run(1, 1e9);
    EXPECT_NE(screwing_state(&t.screwing), SCREWING_RUN_IN);
    t.blow.impacting = false;
    ControllerInputs in{};
    in.travel_q15 = 20000;
    EXPECT_EQ(screwing_step(&t.screwing, &SET, &in, &t.blow), 20000);
    EXPECT_EQ(screwing_state(&t.screwing), SCREWING_RUN_IN);
}

TEST(Screwing, StaysStoppedUntilTheNextDrive) {
    Tool t{seat_at(1500, 11.0), 4.2, 9500};
    ASSERT_TRUE(t.run(20, 3000));
    ControllerInputs in{};
    in.travel_q15 = 32767;
    const Blow none{};
    for (int n = 0; n < 100; ++n)
        EXPECT_EQ(screwing_step(&t.screwing, &SET, &in, &none), CONTROLLER_STOP);
    screwing_start(&t.screwing, &SET);
    EXPECT_EQ(screwing_step(&t.screwing, &SET, &in, &none), 32767);
    EXPECT_EQ(screwing_stop_reason(&t.screwing), CONTROLLER_REASON_NONE);
}

TEST(Screwing, RandomInputsGiveADutyOrAStop) {
    std::mt19937 random(11);
    std::uniform_int_distribution<int> any(-32768, 32767);
    for (int drive = 0; drive < 200; ++drive) {
        const ScrewingSetpoints set{
            static_cast<uint8_t>(1 + random() % 64), static_cast<uint16_t>(128 + random() % 1873),
            static_cast<int16_t>(random() % 32768),  static_cast<int16_t>(3000 + random() % 9001),
            static_cast<int16_t>(random() % 1441),   static_cast<int16_t>(290 + random() % 223)};
        Screwing s{};
        screwing_start(&s, &set);
        for (int n = 0; n < 1000; ++n) {
            ControllerInputs in{};
            in.travel_q15 = static_cast<int16_t>(any(random));
            in.supply_mv = static_cast<uint16_t>(any(random));
            in.speed_rpm_q1 = static_cast<int16_t>(any(random));
            in.edges = static_cast<uint8_t>(random() % 5);
            Blow blow{};
            blow.impacting = random() % 50 != 0;
            blow.count = 9;
            const int16_t requested = screwing_step(&s, &set, &in, &blow);
            ASSERT_TRUE(requested == CONTROLLER_STOP ||
                        (requested >= 0 && requested <= std::max<int>(in.travel_q15, 0)))
                << requested;
            ASSERT_LE(screwing_state(&s), SCREWING_SEATED);
            ASSERT_GE(screwing_estimate(&s), 0);
        }
    }
}

}  // namespace
