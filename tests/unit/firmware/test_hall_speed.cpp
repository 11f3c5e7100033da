// Speed: accuracy over the range, decrease and timeout, missed and double edges, unequal pitches,
// sign.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

extern "C" {
#include "drivers/hall_speed.h"
#include "hal/hal.h"
}

namespace {

struct Shaft {
    HallSpeed hall{};
    uint64_t now = 0;
    HallSpeedResult last{};

    Shaft() { configure(4, 300); }

    void configure(uint8_t pulses, uint16_t timeout_ms) {
        hall_speed_configure(&hall, pulses, timeout_ms);
        for (uint8_t k = 0; k < 4; ++k)
            hall_speed_set_pitch(&hall, k, HALL_SPEED_PITCH_EQUAL_Q15);
    }

    void tick(const std::vector<uint64_t> &edges) {
        for (const uint64_t edge : edges)
            hall_speed_on_edge(&hall, static_cast<uint16_t>(edge));
        now += HAL_CYCLES_PER_TICK;
        last = hall_speed_tick(&hall);
        if (hall_speed_search_due(&hall))
            hall_speed_search(&hall);
    }

    // Ticks until `end`, with an edge each `period` cycles from `*edge` on.
    void run(uint64_t end, double *edge, double period) {
        while (now < end) {
            std::vector<uint64_t> edges;
            for (; *edge <= static_cast<double>(now + HAL_CYCLES_PER_TICK); *edge += period)
                edges.push_back(static_cast<uint64_t>(*edge));
            tick(edges);
        }
    }
};

struct HallTest : testing::Test, Shaft {};

// Cycles from edge to edge.
double period_of(double rpm, int pulses) {
    return 60.0 * HAL_CPU_HZ / (rpm * pulses);
}

TEST_F(HallTest, SteadySpeedWithinTwoPerMilleOrHalfALsb) {
    for (const int pulses : {1, 4, 8}) {
        for (double rpm = 60.0 * 4 / std::min(pulses, 4); rpm < 16383.0; rpm *= 1.07) {
            Shaft fresh;
            fresh.configure(static_cast<uint8_t>(pulses), 1100);
            double edge = 1234.0;
            const double period = period_of(rpm, pulses);
            fresh.run(static_cast<uint64_t>(10 * period) + 64000, &edge, period);
            ASSERT_NEAR(fresh.last.rpm_q1 / 2.0, rpm, std::max(0.002 * rpm, 0.25)) << pulses;
            ASSERT_FALSE(fresh.last.saturated || fresh.last.missed || fresh.last.doubled);
        }
    }
}

TEST_F(HallTest, SaturatesAboveTheRangeAndSetsTheFlag) {
    double edge = 1000.0;
    run(1600000, &edge, 480e6 / 32767.0 + 0.4);  // just within
    EXPECT_GE(last.rpm_q1, 32764);
    EXPECT_FALSE(last.saturated);
    run(3200000, &edge, 480e6 / 32769.0 - 1.0);  // just over
    EXPECT_EQ(last.rpm_q1, 32767);
    EXPECT_TRUE(last.saturated);
}

TEST_F(HallTest, NeverExceedsOnePitchOverTheTimeSinceTheEdgeAndEndsAtTheTimeout) {
    double edge = 1000.0;
    run(1600000, &edge, 48000.0);
    const double newest = edge - 48000.0;
    bool ended = false;
    while (static_cast<double>(now) < newest + 0.31 * HAL_CPU_HZ) {
        tick({});
        const double age = static_cast<double>(now) - std::floor(newest);
        ASSERT_LE(last.rpm_q1, 480e6 / age);
        const double wanted = age < 48000.0 ? 10000.0 : age >= 0.3 * HAL_CPU_HZ ? 0.0 : 480e6 / age;
        ASSERT_NEAR(last.rpm_q1, wanted, 1.0);
        ended = last.rpm_q1 == 0;
    }
    EXPECT_TRUE(ended);
    EXPECT_TRUE(hall_speed_at_rest(&hall));
}

TEST_F(HallTest, TwoEdgesGiveASpeedAndOneDoesNot) {
    tick({5000});
    EXPECT_EQ(last.rpm_q1, 0);
    EXPECT_FALSE(hall_speed_at_rest(&hall));
    tick({5000 + 16000});
    EXPECT_EQ(last.rpm_q1, 30000);
}

TEST_F(HallTest, EdgesAfterTheTickBelongToTheNext) {
    tick({8000});
    hall_speed_on_edge(&hall, static_cast<uint16_t>(8000 + 16000));
    hall_speed_on_edge(&hall,
                       static_cast<uint16_t>(32000 + 5));  // edge during the delay of the tick
    now += HAL_CYCLES_PER_TICK;
    last = hall_speed_tick(&hall);
    EXPECT_EQ(hall.new_edges, 1);
    tick({});
    EXPECT_EQ(hall.new_edges, 1);
    EXPECT_EQ(last.rpm_q1, 30009) << "one pitch over the age of 15,995 cycles";
}

TEST_F(HallTest, AnEdgeAtTheTickBelongsToIt) {
    tick({16000});
    EXPECT_EQ(hall.new_edges, 1);
}

TEST_F(HallTest, ADoubleEdgeIsCountedAndChangesNothing) {
    double edge = 1000.0;
    run(1600000, &edge, 24000.0);
    const int16_t before = last.rpm_q1;
    hall_speed_on_edge(&hall, static_cast<uint16_t>(edge - 24000.0 + 300.0));
    run(1632000, &edge, 24000.0);
    EXPECT_EQ(last.rpm_q1, before);
    EXPECT_EQ(hall.doubled, 1);
    EXPECT_EQ(hall.missed, 0);
}

TEST_F(HallTest, AMissedEdgeIsCountedAndTheSpeedStays) {
    double edge = 1000.0;
    run(1600000, &edge, 24000.0);
    edge += 24000.0;
    bool flagged = false;
    while (now < 1760000) {
        run(now + 16000, &edge, 24000.0);
        flagged = flagged || last.missed;
    }
    EXPECT_TRUE(flagged);
    EXPECT_EQ(hall.missed, 1);
    EXPECT_EQ(last.rpm_q1, 20000);
}

TEST_F(HallTest, ADecreaseOfALowSpeedIsNoMissedEdge) {
    double edge = 1000.0;
    run(3200000, &edge, 200000.0);  // 1,200 rpm
    edge += 200000.0;
    run(6400000, &edge, 400000.0);
    EXPECT_EQ(hall.missed, 0);
    EXPECT_EQ(last.rpm_q1, 1200);
}

TEST_F(HallTest, TheSignChangesAtStandstillOnly) {
    EXPECT_TRUE(hall_speed_set_reverse(&hall, true));
    double edge = 1000.0;
    run(160000, &edge, 24000.0);
    EXPECT_EQ(last.rpm_q1, -20000);
    EXPECT_FALSE(hall_speed_set_reverse(&hall, false));
    run(now + 16000, &edge, 24000.0);
    EXPECT_EQ(last.rpm_q1, -20000);
    for (int k = 0; k < 301; ++k)
        tick({});
    EXPECT_TRUE(hall_speed_set_reverse(&hall, false));
}

TEST_F(HallTest, KnownUnequalPitchesGiveAConstantSpeed) {
    const int16_t share[4] = {9000, 7600, 8600, 7568};
    for (uint8_t k = 0; k < 4; ++k)
        hall_speed_set_pitch(&hall, k, share[k]);
    hall.index_known = true;
    double turn = 96000.0, at = 1000.0;
    std::vector<uint64_t> edges;
    for (int k = 0; k < 60; ++k) {
        edges.push_back(static_cast<uint64_t>(at));
        at += turn * share[(k + 1) % 4] / 32768.0;  // the first edge begins pitch 1
    }
    size_t next = 0;
    for (int t = 0; t < 80; ++t) {
        std::vector<uint64_t> mine;
        for (; next < edges.size() && edges[next] <= now + 16000; ++next)
            mine.push_back(edges[next]);
        tick(mine);
        ASSERT_TRUE(t <= 6 || std::abs(last.rpm_q1 - 20000) <= 20) << t << ": " << last.rpm_q1;
    }
}

TEST_F(HallTest, AnOverflowOfTheRingIsReported) {
    for (int k = 0; k < 33; ++k)
        hall_speed_on_edge(&hall, static_cast<uint16_t>(k * 400));
    tick({});
    EXPECT_TRUE(last.overflowed);
    tick({});
    EXPECT_FALSE(last.overflowed);
}

// A shaft with unequal pitches at constant speed, which then stops: its speed never exceeds the
// true pitch over the time since the last edge. Some turns at constant speed measure
// the pitches.
TEST(HallSpacing, BoundsTheSpeedByTheTruePitchBeforeItIsLearned) {
    const double share[4] = {9200, 7200, 9000, 7368};
    for (const double turn : {62000.0, 96000.0, 400000.0, 2000000.0}) {
        for (int last = 0; last < 4; ++last) {
            for (const bool learning : {false, true}) {
                Shaft shaft;
                hall_speed_learn(&shaft.hall, learning);
                double at = 1000.0, newest = 0.0;
                int pitch = 0, edges_left = 120 + last;
                while (static_cast<double>(shaft.now) < newest + 4.8e6) {
                    std::vector<uint64_t> edges;
                    for (; edges_left > 0 && at <= static_cast<double>(shaft.now + 16000);
                         --edges_left) {
                        edges.push_back(static_cast<uint64_t>(at));
                        newest = std::floor(at);
                        pitch = (pitch + 1) % 4;
                        at += turn * share[pitch] / 32768.0;
                    }
                    shaft.tick(edges);
                    const double age = static_cast<double>(shaft.now) - newest;
                    if (edges_left < 40) {
                        const double bound = 4 * 480e6 * share[pitch] / 32768.0 / age;
                        ASSERT_LE(shaft.last.rpm_q1, std::min(bound * 1.001, 32767.0))
                            << turn << " " << last << " " << learning;
                    }
                }
                EXPECT_EQ(shaft.last.rpm_q1, 0);
            }
        }
    }
}

// Calibration run, then a restart: the learned shares are correct, the index is identified again,
// and the speed is constant.
TEST(HallSpacing, IsLearnedAndIdentifiedAgain) {
    const double share[4] = {9000, 7600, 8600, 7568};
    for (const bool reverse : {false, true}) {
        Shaft shaft;
        hall_speed_set_reverse(&shaft.hall, reverse);
        hall_speed_learn(&shaft.hall, true);
        double at = 1000.0;
        int pitch = 2;
        // Greatest deviation of the reported speed from 20,000 half rpm, after 40 ticks.
        auto turn = [&](int ticks) {
            double spread = 0.0;
            for (int t = 0; t < ticks; ++t) {
                std::vector<uint64_t> edges;
                for (; at <= static_cast<double>(shaft.now + 16000);
                     pitch = (pitch + (reverse ? 3 : 1)) % 4) {
                    edges.push_back(static_cast<uint64_t>(at));
                    at += 96000.0 * share[pitch] / 32768.0;
                }
                shaft.tick(edges);
                if (t > 40)
                    spread = std::max(spread, std::abs(std::abs(shaft.last.rpm_q1) - 20000.0));
            }
            return spread;
        };
        EXPECT_GT(turn(100), 500.0) << "unknown pitches: the speed ripples";
        turn(400);
        ASSERT_TRUE(shaft.hall.learned);
        int16_t learned[4];
        for (uint8_t k = 0; k < 4; ++k)
            learned[k] = hall_spacing_share(&shaft.hall.spacing, k);
        std::vector<int> sorted(learned, learned + 4);
        std::sort(sorted.begin(), sorted.end());
        EXPECT_NEAR(sorted[0], 7568, 12);
        EXPECT_NEAR(sorted[3], 9000, 12);
        shaft.hall.learned = false;
        shaft.configure(4, 300);
        // Learned in reverse order in reverse, stored for forward rotation.
        for (uint8_t k = 0; k < 4; ++k)
            hall_speed_set_pitch(&shaft.hall, k, static_cast<int16_t>(share[k]));
        EXPECT_LT(turn(200), 30.0);
        EXPECT_TRUE(shaft.hall.index_known);
    }
}

// After learning is cancelled, the index is searched again; after a parameter change, learning
// continues.
TEST(HallSpacing, LearningCanBeCancelledAndContinuesAfterAConfiguration) {
    const double share[4] = {9000, 7600, 8600, 7568};
    for (const bool cancelled : {true, false}) {
        Shaft shaft;
        for (uint8_t k = 0; k < 4; ++k)
            hall_speed_set_pitch(&shaft.hall, k, static_cast<int16_t>(share[k]));
        hall_speed_learn(&shaft.hall, true);
        if (cancelled) {
            hall_speed_learn(&shaft.hall, false);
        } else {
            hall_speed_configure(&shaft.hall, 4, 300);
        }
        double at = 1000.0;
        for (int t = 0, pitch = 0; t < 500; ++t) {
            std::vector<uint64_t> edges;
            for (; at <= static_cast<double>(shaft.now + 16000); pitch = (pitch + 1) % 4) {
                edges.push_back(static_cast<uint64_t>(at));
                at += 96000.0 * share[pitch] / 32768.0;
            }
            shaft.tick(edges);
        }
        EXPECT_EQ(shaft.hall.learned, !cancelled);
        EXPECT_EQ(shaft.hall.index_known, cancelled);
    }
}

}  // namespace
