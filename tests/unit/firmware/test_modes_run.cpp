// Whole runs in every mode with random pin inputs: a released trigger and every fault open the
// bridge, the mode changes at rest only.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <deque>
#include <map>
#include <random>
#include <vector>

#include "../telemetry/frames.hpp"
#include "control_modes.hpp"
extern "C" {
#include "app/control.h"
#include "app/param_store.h"
}
#include "hal/sim/sim.h"

namespace {

constexpr double PERIODS_PER_MS = 16000.0 / 510;
constexpr int RELEASED_MS =
    12;  // 5 to debounce, 2 until the order acts, conversions of the trigger between
constexpr int HALL_TIMEOUT_MS = 300;

struct ModeTest : testing::TestWithParam<uint8_t> {
    SimOutputs out{};
    SimInputs in{};
    std::deque<uint8_t> to_board;
    Bytes line;
    std::map<int, std::vector<Bytes>> frames;  // by id
    long period = 0;
    double next_edge = 0, edge_gap = 0;  // periods; 0: none
    uint8_t sequence = 0;

    void SetUp() override {
        const SimStart how = SIM_START_DEFAULT;
        in = SimInputs{};
        in.adc_counts[SIM_ADC_CURRENT] = 512;
        in.adc_counts[SIM_ADC_BUS] = 740;
        in.adc_counts[SIM_ADC_TEMPERATURE] = 154;
        release();
        line.clear();
        frames.clear();
        period = 0;
        edge_gap = 0;
        sim_reset(&how, &out);
        run(250);
    }

    void press(int counts = 900) {
        in.adc_counts[SIM_ADC_TRIGGER] = static_cast<uint16_t>(counts);
        in.switches |= SIM_SWITCH_CONTACT;
    }

    void release() {
        in.adc_counts[SIM_ADC_TRIGGER] = 100;
        in.switches &= static_cast<uint8_t>(~SIM_SWITCH_CONTACT);
    }

    void turn(double rpm) {
        edge_gap = rpm > 0 ? 60.0 / (4 * rpm) * 1000 * PERIODS_PER_MS : 0;
        next_edge = static_cast<double>(period) + edge_gap;
    }

    void one_period() {
        in.edge_count = 0;
        if (edge_gap > 0 && static_cast<double>(period) >= next_edge) {
            in.edge_cycle[in.edge_count++] = 200;
            next_edge += edge_gap;
        }
        in.rx_count = 0;
        if (!to_board.empty() && period % 2 == 0) {
            in.rx[in.rx_count++] = to_board.front();
            to_board.pop_front();
        }
        sim_period(&in, &out);
        ++period;
        line.insert(line.end(), out.tx, out.tx + out.tx_count);
        for (; line.size() >= 19; line.erase(line.begin(), line.begin() + 19))
            frames[line[6] | line[7] << 8].emplace_back(line.begin(), line.begin() + 19);
    }

    void run(int ms) {
        for (const long end = period + static_cast<long>(ms * PERIODS_PER_MS); period < end;)
            one_period();
    }

    // Milliseconds until the bridge is open; `most` + 1 if it does not open within `most`.
    int opens_within(int most) {
        for (int ms = 0; ms <= most; ++ms) {
            run(1);
            if (out.coast != 0)
                return ms;
        }
        return most + 1;
    }

    int ask(uint32_t id, std::array<uint8_t, 7> data) {
        data[6] = ++sequence;
        const Bytes frame = frame_of(id, data);
        to_board.insert(to_board.end(), frame.begin(), frame.end());
        run(60);
        const std::vector<Bytes> &acks = frames[TELEMETRY_ACK_ID];
        return !acks.empty() && acks.back()[12] == sequence ? acks.back()[13] : -1;
    }

    int set_mode(uint8_t mode) { return ask(TELEMETRY_SET_MODE_ID, {mode}); }
    static int mode_of(const Bytes &state) { return state[12] >> 4 & 7; }
    // Tick in which the values of a STATE frame were set.
    static size_t since(const Bytes &state) {
        const unsigned ms = state[1] | static_cast<unsigned>(state[2]) << 8;
        return ms - ((ms - state[10]) & 0xFFu);
    }
    int mode() { return mode_of(frames[TELEMETRY_STATE_ID].back()); }
    int state() { return frames[TELEMETRY_STATE_ID].back()[12] & 15; }
    int faults() { return frames[TELEMETRY_STATE_ID].back()[13]; }

    void drive() {
        ASSERT_EQ(set_mode(GetParam()), TELEMETRY_ACK_RESULT_OK);
        ASSERT_EQ(mode(), GetParam());
        turn(6000);
        press();
        run(100);
        ASSERT_EQ(state(), TELEMETRY_STATE_DRIVE);
        ASSERT_EQ(out.coast, 0);
    }
};

INSTANTIATE_TEST_SUITE_P(Every, ModeTest, testing::ValuesIn(modes()));

TEST_P(ModeTest, AReleasedTriggerOpensTheBridge) {
    drive();
    release();
    EXPECT_LE(opens_within(100), RELEASED_MS);
    run(50);
    EXPECT_NE(out.coast, 0);
}

TEST_P(ModeTest, EveryFaultOpensTheBridgeAndHoldsItOpenUntilTheRelease) {
    struct Cause {
        unsigned fault;
        int channel, counts, within_ms;
    };
    const Cause causes[] = {{TELEMETRY_FAULTS_OVER_CURRENT, SIM_ADC_CURRENT, 512 + 8 * 56, 3},
                            {TELEMETRY_FAULTS_UNDER_VOLTAGE, SIM_ADC_BUS, 470, 20},
                            {TELEMETRY_FAULTS_OVER_TEMPERATURE, SIM_ADC_TEMPERATURE, 300, 110},
                            {TELEMETRY_FAULTS_SENSOR_LOST, SIM_ADC_TEMPERATURE, 10, 110}};
    for (const Cause &cause : causes) {
        SetUp();
        drive();
        in.adc_counts[cause.channel] = static_cast<uint16_t>(cause.counts);
        EXPECT_LE(opens_within(500), cause.within_ms) << cause.fault;
        run(150);
        EXPECT_EQ(faults() & static_cast<int>(cause.fault), static_cast<int>(cause.fault));
        EXPECT_EQ(state(), TELEMETRY_STATE_FAULT);
        in.adc_counts[SIM_ADC_TEMPERATURE] = 154;
        in.adc_counts[SIM_ADC_BUS] = 740;
        in.adc_counts[SIM_ADC_CURRENT] = 512;
        run(200);
        EXPECT_NE(out.coast, 0) << "held until the release";
        release();
        run(200);
        EXPECT_EQ(faults(), 0);
    }
}

// The speed and the current of impacts under load, at which controllers raise the duty above that
// of the trigger. The run ends before the firmware reports that these inputs contradict each other.
TEST_P(ModeTest, NoDutyExceedsItsLimit) {
    constexpr int LIMIT_Q15 = 6554, LIMIT_COMPARE = 51;  // 0.2
    ASSERT_EQ(ask(TELEMETRY_SETPOINT_ID, {0, 0, LIMIT_Q15 & 0xFF, LIMIT_Q15 >> 8}),
              TELEMETRY_ACK_RESULT_OK);
    ASSERT_EQ(ask(TELEMETRY_PARAM_WRITE_ID, {PARAM_DRILL_PULSE, 0, 1}), TELEMETRY_ACK_RESULT_OK);
    drive();
    int most = 0;
    for (int blow = 0; blow < 6; ++blow) {
        for (const double rpm : {7000.0, 4500.0}) {
            turn(rpm);
            for (int ms = 0; ms < 12; ++ms) {
                in.adc_counts[SIM_ADC_CURRENT] =
                    static_cast<uint16_t>(out.coast != 0 ? 512 : 512 + 150 + ms);
                run(1);
                most = std::max<int>(most, out.coast == 0 ? out.compare : 0);
            }
        }
    }
    EXPECT_EQ(faults(), 0);
    EXPECT_GT(most, 20);
    EXPECT_LE(most, LIMIT_COMPARE);
}

// No edges and the current of a shaft at rest: the bridge opens with every controller.
TEST_P(ModeTest, AStallOpensTheBridge) {
    drive();
    turn(0);
    for (int ms = 0; ms < 3000 && state() == TELEMETRY_STATE_DRIVE; ++ms) {
        in.adc_counts[SIM_ADC_CURRENT] =
            static_cast<uint16_t>(out.coast != 0 ? 512 : 512 + std::min(360, out.compare * 3));
        run(1);
    }
    run(20);
    EXPECT_NE(out.coast, 0);
    EXPECT_TRUE(faults() == TELEMETRY_FAULTS_STALL || state() == TELEMETRY_STATE_STOPPED)
        << faults() << ' ' << state();
}

TEST_P(ModeTest, TheModeIsRefusedWhileDrivenTurningOrPressed) {
    drive();
    const auto other = static_cast<uint8_t>(GetParam() == 0 ? modes().back() : 0);
    EXPECT_EQ(set_mode(other), TELEMETRY_ACK_RESULT_NOT_NOW) << "driven";
    release();
    run(20);
    EXPECT_EQ(set_mode(other), TELEMETRY_ACK_RESULT_NOT_NOW) << "turning";
    turn(100);
    run(500);
    turn(0);
    run(1500);
    EXPECT_EQ(mode(), GetParam());
    EXPECT_EQ(set_mode(other), TELEMETRY_ACK_RESULT_OK);
    EXPECT_EQ(mode(), other);
    in.switches |= SIM_SWITCH_CONTACT;
    run(50);
    EXPECT_EQ(set_mode(GetParam()), TELEMETRY_ACK_RESULT_NOT_NOW) << "contact closed";
}

TEST_P(ModeTest, TheModeSwitchHasPriorityOverTheHost) {
    const auto index = static_cast<uint8_t>(PARAM_MODE_SWITCH_2);
    ASSERT_EQ(ask(TELEMETRY_PARAM_WRITE_ID, {index, 0, GetParam(), 0, 0, 0}),
              TELEMETRY_ACK_RESULT_OK);
    ASSERT_EQ(set_mode(0), TELEMETRY_ACK_RESULT_OK);
    in.switches = SIM_SWITCH_MODE_1;
    run(50);
    EXPECT_EQ(mode(), GetParam());
    EXPECT_EQ(set_mode(0), TELEMETRY_ACK_RESULT_NOT_NOW);
    in.switches = 0;
    run(50);
    EXPECT_EQ(mode(), 0);
}

// Random pin inputs for 400 steps, with the laws checked in every period: bridge open when
// released, mode changes at a released trigger and at rest only.
struct RandomPins : ModeTest {
    std::mt19937 rng;
    std::vector<char> closed = std::vector<char>(60000);  // contact, by the tick that follows
    std::vector<char> edges = std::vector<char>(60000);   // any edge, by the tick that follows
    long released_at = 0;
    size_t states = 0;
    int last_mode = 0, changes = 0;

    unsigned any(unsigned below) { return static_cast<unsigned>(rng() % below); }

    void change_one_input() {
        const unsigned pick = any(10);
        if (pick < 3) {
            release();
        } else if (pick < 7) {
            press(static_cast<int>(100 + any(924)));
        } else if (pick == 7) {
            in.switches ^= static_cast<uint8_t>((any(4) == 0 ? SIM_SWITCH_REVERSE : 0) |
                                                (any(4) == 0 ? SIM_SWITCH_MODE_0 : 0) |
                                                (any(4) == 0 ? SIM_SWITCH_MODE_1 : 0));
        } else if (pick == 8) {
            turn(any(3) == 0 ? 0.0 : 100.0 + any(17000));
        } else {
            in.adc_counts[SIM_ADC_CURRENT] =
                static_cast<uint16_t>(any(8) == 0 ? any(1024) : 512 + any(300));
            in.adc_counts[SIM_ADC_BUS] =
                static_cast<uint16_t>(any(16) == 0 ? any(1024) : 640 + any(180));
        }
    }

    // Every 20 steps: run-down, then rest with the mode switch in any position.
    void run_down_or_rest(int step) {
        if (step % 20 == 18) {
            release();
            turn(150);
        } else if (step % 20 == 19) {
            release();
            turn(0);
            in.switches ^=
                static_cast<uint8_t>(any(2) * SIM_SWITCH_MODE_0 + any(2) * SIM_SWITCH_MODE_1);
        }
    }

    void check_period() {
        const bool contact = (in.switches & SIM_SWITCH_CONTACT) != 0;
        released_at = contact ? period : released_at;
        one_period();
        const auto tick = static_cast<size_t>((255 + 510 * period) / 16000 + 1);
        closed[tick] = contact;
        edges[tick] = edges[tick] != 0 || in.edge_count > 0;
        if (period - released_at > static_cast<long>(RELEASED_MS * PERIODS_PER_MS)) {
            ASSERT_NE(out.coast, 0) << period;
        }
    }

    void check_mode_changes() {
        const std::vector<Bytes> &sent = frames[TELEMETRY_STATE_ID];
        for (; states < sent.size(); ++states) {
            if (mode_of(sent[states]) == last_mode)
                continue;
            last_mode = mode_of(sent[states]);
            const size_t at = since(sent[states]);
            const auto set = [](char c) { return c != 0; };
            ASSERT_FALSE(std::all_of(&closed[at - 6], &closed[at], set)) << "pressed at " << at;
            ASSERT_FALSE(std::any_of(&edges[at - HALL_TIMEOUT_MS + 2], &edges[at], set))
                << "turning at " << at;
            ++changes;
        }
    }
};
INSTANTIATE_TEST_SUITE_P(Every, RandomPins, testing::ValuesIn(modes()));

TEST_P(RandomPins, KeepTheLawsOfReleaseAndModeChange) {
    rng.seed(GetParam() + 1u);
    ASSERT_EQ(set_mode(GetParam()), TELEMETRY_ACK_RESULT_OK);
    released_at = period;
    states = frames[TELEMETRY_STATE_ID].size();
    last_mode = GetParam();
    for (int step = 0; step < 400; ++step) {
        change_one_input();
        run_down_or_rest(step);
        const long end =
            period + static_cast<long>(step % 20 < 18 ? any(600) + 1 : 600 * PERIODS_PER_MS);
        while (period < end) {
            ASSERT_NO_FATAL_FAILURE(check_period());
            ASSERT_NO_FATAL_FAILURE(check_mode_changes());
        }
    }
    EXPECT_GT(changes, 0);
}

}  // namespace
