// Whole runs of the firmware in lock-step with a motor model: start, release, faults, direction,
// independence of latency, EEPROM.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <vector>

#include "../telemetry/frames.hpp"
#include "eeprom.hpp"
extern "C" {
#include "app/control.h"
}
#include "telemetry/telemetry_signals.h"

namespace {

constexpr double PERIOD_S = 510.0 / 16e6;

struct Fast {
    uint32_t ms;
    int current_q9, speed_q1, compare, supply;
};
struct State {
    uint32_t ms;
    int trigger, state, reverse, faults, flags;
};

// Motor of docs/spec/model.md, section 4, without the impact mechanism; Euler steps of 1.6 us.
struct Tool {
    double i = 0, w = 0, angle = 0, vs = 18.5, rs = 0.10;  // A, rad/s, rad, V, ohm
    long pitches = 0;
    double friction = 0.012;  // N m
    bool locked = false, hall_works = true;
    double sensor_error_a = 0;  // added to the current that the sensor reports

    double reported_a() const { return i + sensor_error_a; }

    void period(const SimOutputs &o, SimInputs *in) {
        in->edge_count = 0;
        for (int k = 0; k < 20; ++k)
            step(o, in, k);
    }

    void step(const SimOutputs &o, SimInputs *in, int k) {
        const double h = PERIOD_S / 20, duty = o.compare / 255.0;
        double v = duty * (vs - rs * duty * i);
        if (o.coast != 0)
            v = i > 0.2 ? -vs : i < -0.2 ? vs : 0.0109 * w;
        i += h * (v - 0.19 * i - 0.0109 * w) / 1e-4;
        if (o.coast != 0 && std::fabs(i) < 0.3)
            i = 0;
        const double torque = 0.0109 * i - 4.5e-6 * w;
        const double free =
            std::fabs(torque) > friction ? torque - std::copysign(friction, torque) : 0.0;
        const double next =
            w == 0 ? h * free / 1.8e-5 : w + h * (torque - std::copysign(friction, w)) / 1.8e-5;
        w = locked || next * w < 0 ? 0 : next;
        angle += w * h;
        const long now = std::lround(std::floor(angle / (M_PI / 2)));
        if (now != pitches && hall_works && in->edge_count < SIM_EDGES_MAX)
            in->edge_cycle[in->edge_count++] = static_cast<uint16_t>(k * 25);
        pitches = now;
    }
};

struct RunTest : testing::Test {
    SimOutputs out{};
    SimInputs in{};
    Tool tool;
    double now_s = 0;
    std::vector<uint8_t> line;
    std::vector<Fast> fast;
    std::vector<State> states;
    std::map<int, int> frames;

    void SetUp() override { start(SIM_START_DEFAULT); }

    void start(const SimStart &how) {
        *static_cast<SimInputs *>(&in) = SimInputs{};
        tool = Tool{};
        line.clear();
        fast.clear();
        states.clear();
        frames.clear();
        now_s = 0;
        in.adc_counts[SIM_ADC_TEMPERATURE] = 154;
        press(0.0);
        sim_reset(&how, &out);
    }

    void start_with(std::initializer_list<std::pair<int, int>> parameters) {
        const Eeprom eeprom = eeprom_with(parameters);
        SimStart how = SIM_START_DEFAULT;
        how.eeprom = eeprom.data();
        start(how);
    }

    void press(double travel, bool reverse = false) {
        in.adc_counts[SIM_ADC_TRIGGER] = static_cast<uint16_t>(100 + 820 * travel + 0.5);
        in.switches = static_cast<uint8_t>((travel > 0 ? SIM_SWITCH_CONTACT : 0) |
                                           (reverse ? SIM_SWITCH_REVERSE : 0));
    }

    void run(double seconds) {
        for (const double end = now_s + seconds; now_s < end; now_s += PERIOD_S) {
            tool.period(out, &in);
            const double duty = out.coast != 0 ? 0.0 : out.compare / 255.0;
            in.adc_counts[SIM_ADC_CURRENT] = counts(512.0 + tool.reported_a() / 0.125);
            in.adc_counts[SIM_ADC_BUS] = counts((tool.vs - tool.rs * duty * tool.i) / 0.025);
            sim_period(&in, &out);
            in.rx_count = 0;
            line.insert(line.end(), out.tx, out.tx + out.tx_count);
            parse();
        }
    }

    // Sets the duty limit to 0 during a drive with each controller in turn: the duty must fall at
    // the slew rate.
    void lower_the_limit(double travel);

    void limit_duty(int16_t limit_q15) {
        const auto low = static_cast<uint8_t>(limit_q15 & 0xFF);
        const auto high = static_cast<uint8_t>(limit_q15 >> 8);
        for (const uint8_t byte : frame_of(TELEMETRY_SETPOINT_ID, {0, 0, low, high})) {
            in.rx[0] = byte;
            in.rx_count = 1;
            run(2 * PERIOD_S);
        }
    }

    static uint16_t counts(double value) {
        return static_cast<uint16_t>(std::min(1023.0, std::max(0.0, std::round(value))));
    }

    void parse() {
        for (; line.size() >= 19; line.erase(line.begin(), line.begin() + 19)) {
            ASSERT_EQ(line[0], 0xAA);
            ASSERT_EQ(line[18], 0xBB);
            const uint8_t *d = &line[10];
            const uint32_t ms =
                uint32_t{line[1]} | uint32_t{line[2]} << 8u | uint32_t{line[3]} << 16u;
            const int id = line[6] | line[7] << 8;
            ++frames[id];
            if (id == TELEMETRY_FAST_ID) {
                const int packed = d[4] | d[5] << 8 | d[6] << 16;
                fast.push_back({ms, int16_t(d[0] | d[1] << 8), int16_t(d[2] | d[3] << 8),
                                (packed & 1023) > 511 ? (packed & 1023) - 1024 : packed & 1023,
                                packed >> 10 & 1023});
            } else if (id == TELEMETRY_STATE_ID) {
                states.push_back({ms, d[1], d[2] & 15, d[2] >> 7, d[3], d[4] | d[5] << 8});
            }
        }
    }

    // The user presses repeatedly for 8 s with the direction switch in reverse: hundredths of a
    // second in which the tool drives in reverse while the shaft turns forwards.
    int driven_against_the_shaft() {
        int count = 0;
        for (int k = 0; k < 800; ++k) {
            press(k % 100 < 50 ? 0.0 : 0.6, true);
            const bool turns = tool.w > 20.0;
            run(0.01);
            count += turns && out.coast == 0 && out.compare < 0 ? 1 : 0;
        }
        return count;
    }

    // Greatest current in the FAST frames, A.
    double worst_current() const {
        double worst = 0;
        for (const Fast &f : fast)
            worst = std::max(worst, std::fabs(f.current_q9 / 512.0));
        return worst;
    }

    int faults() const { return states.empty() ? 0 : states.back().faults; }
    int state() const { return states.empty() ? -1 : states.back().state; }
};

TEST_F(RunTest, BeginsWithBootAndSendsOneFastFramePerTick) {
    run(1.0);
    EXPECT_EQ(frames[TELEMETRY_BOOT_ID], 1);
    EXPECT_EQ(frames[TELEMETRY_PARAM_TABLE_ID], 1);
    ASSERT_GE(fast.size(), 990u);
    for (size_t k = 1; k < fast.size(); ++k)
        ASSERT_EQ(fast[k].ms, fast[k - 1].ms + 1);
    EXPECT_EQ(state(), TELEMETRY_STATE_IDLE);
    EXPECT_EQ(faults(), 0);
    EXPECT_EQ(fast.back().supply, 740);
    EXPECT_EQ(fast.back().compare, -512);
    EXPECT_NE(out.coast, 0);
}

TEST_F(RunTest, AFullTriggerStartReachesTheNoLoadSpeedWithoutTripping) {
    run(0.5);
    press(1.0);
    run(1.5);
    EXPECT_EQ(faults(), 0);
    EXPECT_EQ(state(), TELEMETRY_STATE_DRIVE);
    EXPECT_LT(worst_current(), 46.0);
    EXPECT_NEAR(fast.back().speed_q1 / 2.0, tool.w * 30 / M_PI, 40.0);
    EXPECT_NEAR(fast.back().current_q9 / 512.0, tool.i, 0.13);
    EXPECT_EQ(fast.back().compare, 255);
}

TEST_F(RunTest, ALockedMotorIsLimitedByTheFoldbackThenStalls) {
    run(0.5);
    tool.locked = true;
    press(1.0);
    run(0.4);
    EXPECT_EQ(faults(), 0);
    EXPECT_NEAR(fast.back().current_q9 / 512.0, 45.0, 1.0);
    EXPECT_LT(worst_current(), 50.0);
    run(0.4);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_STALL);
    EXPECT_NE(out.coast, 0);
}

TEST_F(RunTest, AnOverCurrentOpensTheBridgeAtOnceAndIsClearedByRelease) {
    run(0.5);
    press(0.5);
    run(0.5);
    ASSERT_EQ(out.coast, 0);
    tool.i = 63.0;  // a short circuit, faster than the fold-back
    int periods = 0;
    for (; out.coast == 0 && periods < 100; ++periods) {
        tool.i = 63.0;
        run(PERIOD_S / 2);
    }
    EXPECT_LE(periods, 13)
        << "another channel may be converted first, and a conversion takes four periods";
    run(0.05);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_OVER_CURRENT);
    EXPECT_EQ(state(), TELEMETRY_STATE_FAULT);
    run(0.3);
    EXPECT_NE(out.coast, 0) << "latched while the trigger is pressed";
    press(0.0);
    run(0.1);
    EXPECT_EQ(faults(), 0);
    press(0.5);
    run(0.1);
    EXPECT_EQ(out.coast, 0);
}

// From the ADC counts of the temperature sensor through faults and state machine to the bridge.
TEST_F(RunTest, OverTemperatureStopsTheDriveUntilCooledAndReleased) {
    constexpr uint16_t AT_90_C = 287, AT_91_C = 289;  // (T + 50) / 0.48828
    run(0.5);
    press(0.5);
    run(0.3);
    in.adc_counts[SIM_ADC_TEMPERATURE] = AT_90_C - 1;
    run(0.5);
    EXPECT_EQ(faults(), 0) << "at the limit";
    in.adc_counts[SIM_ADC_TEMPERATURE] = AT_91_C;
    run(0.09);
    EXPECT_EQ(out.coast, 0) << "less than 100 ms";
    run(0.03);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_OVER_TEMPERATURE);
    EXPECT_NE(out.coast, 0);
    press(0.0);
    run(0.2);
    EXPECT_EQ(state(), TELEMETRY_STATE_FAULT) << "released, still hot";
    press(0.5);
    run(0.1);
    in.adc_counts[SIM_ADC_TEMPERATURE] = 154;
    run(0.3);
    EXPECT_NE(out.coast, 0) << "cool, not released";
    press(0.0);
    run(0.1);
    EXPECT_EQ(faults(), 0);
    press(0.5);
    run(0.1);
    EXPECT_EQ(out.coast, 0);
}

TEST_F(RunTest, ALostHallSensorIsReported) {
    run(0.5);
    tool.hall_works = false;
    press(0.6);
    run(1.0);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_SENSOR_LOST);
    EXPECT_NE(out.coast, 0);
}

TEST_F(RunTest, UnderVoltageOpensTheBridge) {
    run(0.5);
    press(0.5);
    run(0.5);
    tool.vs = 11.5;
    run(0.05);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_UNDER_VOLTAGE);
    EXPECT_NE(out.coast, 0);
}

TEST_F(RunTest, ReleaseCoastsAndAResumedDriveDoesNotBrakeHardInAnyMode) {
    for (int mode = 0; mode <= static_cast<int>(TELEMETRY_MODE_MAX); ++mode) {
        if (!control_has(static_cast<uint8_t>(mode)))
            continue;
        start_with({{PARAM_MODE, mode}});
        run(0.5);
        press(1.0);
        run(1.0);
        press(0.0);
        run(0.2);
        EXPECT_NE(out.coast, 0) << mode;
        press(1.0);
        fast.clear();
        run(0.3);
        EXPECT_EQ(faults(), 0) << mode;
        double least = 0;
        for (const Fast &f : fast)
            least = std::min(least, f.current_q9 / 512.0);
        EXPECT_GT(least, -10.0) << mode;
    }
}

// A step of the duty would brake the turning shaft with the current of its whole back-EMF, which
// trips at 18.5 V.
void RunTest::lower_the_limit(double travel) {
    for (int mode = 0; mode <= static_cast<int>(TELEMETRY_MODE_MAX); ++mode) {
        if (!control_has(static_cast<uint8_t>(mode)))
            continue;
        start_with({{PARAM_MODE, mode}});
        run(0.5);
        press(travel);
        run(0.8);
        limit_duty(0);
        fast.clear();
        run(0.4);
        EXPECT_EQ(faults(), 0) << mode;
        EXPECT_LE(fast.back().compare, 0) << mode;
        for (size_t k = 1; k < fast.size(); ++k) {
            const bool open = fast[k].compare < 0;  // a controller may end the drive
            ASSERT_TRUE(open || fast[k].compare >= fast[k - 1].compare - 3 ||
                        fast[k - 1].compare <= 1)
                << mode << ' ' << travel << ' ' << k;
            ASSERT_GT(fast[k].current_q9, -20 * 512) << mode << ' ' << travel << ' ' << k;
        }
    }
}

TEST_F(RunTest, ADutyLimitLoweredInADriveActsAtTheSlewRateInAnyMode) {
    for (const double travel : {1.0, 0.5, 0.35})
        lower_the_limit(travel);
}

// The ramp starts at the last duty, within the fold-back, in every mode; the duty never rises.
TEST_F(RunTest, ARampedReleaseStartsAtTheDutyOfTheControllerInAnyMode) {
    for (int mode = 0; mode <= static_cast<int>(TELEMETRY_MODE_MAX); ++mode) {
        if (!control_has(static_cast<uint8_t>(mode)))
            continue;
        start_with({{PARAM_MODE, mode}, {PARAM_RELEASE_MODE, 1}});
        run(0.5);
        press(1.0);
        run(0.8);
        press(0.0);
        fast.clear();
        run(0.03);
        const int released = fast[8].compare;
        fast.clear();
        run(0.3);
        EXPECT_EQ(faults(), 0) << mode;
        for (size_t k = 1; k < fast.size(); ++k) {
            const bool braked = fast[k].current_q9 < -30 * 512;  // the fold-back may raise the duty
            ASSERT_TRUE(fast[k].compare <= std::max(fast[k - 1].compare, 0) || braked)
                << mode << ' ' << k;
            ASSERT_LE(fast[k].compare, std::max(released, 0)) << mode;
        }
        EXPECT_LT(fast.back().compare, 60) << mode;
    }
}

// For every accepted value of the rates and in every mode: after the release no duty above that of
// the release, none after 300 ms, and an open bridge from then on.
TEST_F(RunTest, ARampedReleaseEndsWithin300MsWhateverTheParameters) {
    for (int mode = 0; mode <= static_cast<int>(TELEMETRY_MODE_MAX); ++mode) {
        if (!control_has(static_cast<uint8_t>(mode)))
            continue;
        for (const auto &[press_rate, run_down] :
             {std::pair{1, 110}, {1, 32767}, {197, 110}, {197, 197}, {32767, 110}}) {
            start_with({{PARAM_MODE, mode},
                        {PARAM_RELEASE_MODE, 1},
                        {PARAM_SLEW_PER_MS_Q15, press_rate},
                        {PARAM_RUN_DOWN_PER_MS_Q15, run_down},
                        {PARAM_FOLDBACK_A_Q9, 5120}});
            run(0.5);
            press(1.0);
            run(0.8);
            const int released = std::max(fast.back().compare, 0);
            press(0.0);
            fast.clear();
            run(0.305);
            for (const Fast &f : fast)
                ASSERT_LE(f.compare, released) << mode << ' ' << press_rate << ' ' << run_down;
            for (const double end = now_s + 0.5; now_s < end;) {
                ASSERT_NE(out.coast, 0) << mode << ' ' << press_rate << ' ' << run_down;
                run(0.01);
            }
        }
    }
}

// A potentiometer that is broken on its ground side reads 1023 counts: a fault before the contact
// closes, and no drive afterwards.
TEST_F(RunTest, ABrokenPotentiometerIsAFaultAndDoesNotDrive) {
    run(0.3);
    in.adc_counts[SIM_ADC_TRIGGER] = 1023;
    run(0.2);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_SENSOR_LOST);
    in.switches = SIM_SWITCH_CONTACT;
    for (int n = 0; n < 50; ++n) {
        run(0.01);
        ASSERT_NE(out.coast, 0) << n;
    }
    EXPECT_EQ(state(), TELEMETRY_STATE_FAULT);
}

TEST_F(RunTest, ACurrentSensorThatGoesOffRefusesTheNextDrive) {
    start(SIM_START_DEFAULT);
    run(0.5);
    press(1.0);
    run(0.3);
    tool.sensor_error_a = -8.0;
    run(0.3);
    EXPECT_EQ(faults(), 0) << "nothing in the drive contradicts it";
    EXPECT_EQ(out.coast, 0);
    press(0.0);
    run(0.5);
    EXPECT_EQ(faults(), TELEMETRY_FAULTS_SENSOR_LOST);
    press(1.0);
    run(0.3);
    EXPECT_NE(out.coast, 0);
    press(0.0);
    tool.sensor_error_a = 0.0;
    run(0.5);
    EXPECT_EQ(faults(), 0);
    press(1.0);
    run(0.3);
    EXPECT_EQ(out.coast, 0) << "the sensor works again";
}

TEST_F(RunTest, TheDirectionChangesAtStandstillOnly) {
    run(0.5);
    press(0.6);
    run(0.6);
    press(0.6, true);
    run(0.2);
    EXPECT_NE(out.coast, 0) << "switched while turning: release";
    EXPECT_GT(tool.w, 0);
    press(0.0, true);
    run(3.0);
    EXPECT_EQ(tool.w, 0);
    press(0.6, true);
    run(0.5);
    EXPECT_LT(tool.w, 0);
    EXPECT_LT(fast.back().speed_q1, 0);
    EXPECT_LT(fast.back().current_q9, 0);
    EXPECT_LT(fast.back().compare, 0);
    EXPECT_EQ(states.back().reverse, 1);
}

// After the sensor's failure the tool never drives against a turning shaft.
TEST_F(RunTest, ALostSensorDelaysTheDirectionChangeWhileTheShaftTurns) {
    for (const double driven_s :
         {0.7, 0.4, 0.1}) {  // fault detected; timeout in the drive; timeout while coasting
        start(SIM_START_DEFAULT);
        tool.friction = 0.006;
        run(0.5);
        press(1.0);
        run(0.5);
        tool.hall_works = false;
        run(driven_s);
        EXPECT_EQ(faults(), driven_s > 0.6 ? TELEMETRY_FAULTS_SENSOR_LOST : 0);
        press(0.0, true);
        run(0.5);
        EXPECT_EQ(driven_against_the_shaft(), 0) << driven_s;
        EXPECT_EQ(states.back().reverse, 1) << "the direction changes after the run-down";
    }
}

// A full battery without load, above 16,450 rpm: with the gain of the drive without edges the speed
// exceeds the range of 16 bits.
TEST_F(RunTest, ASensorLostAboveFullSpeedDelaysTheDirectionChange) {
    for (const double driven_s : {0.05, 0.1, 0.2}) {
        start(SIM_START_DEFAULT);
        tool.vs = 20.5;
        tool.friction = 0.006;
        run(0.5);
        press(1.0);
        run(2.0);
        ASSERT_GT(tool.w * 30 / M_PI, 16450.0);
        tool.hall_works = false;
        run(driven_s);
        press(0.0, true);
        EXPECT_EQ(driven_against_the_shaft(), 0) << driven_s;
        EXPECT_EQ(states.back().reverse, 1) << "the direction changes after the run-down";
    }
}

// The sensor fails at low speed or at rest, and the drive lasts less than any timeout: the firmware
// waits for the speed that the drive may have given the shaft.
TEST_F(RunTest, AccelerationWithoutEdgesDelaysTheDirectionChange) {
    for (const bool from_rest : {true, false}) {
        for (const double driven_s : {0.08, 0.15, 0.25}) {
            start(SIM_START_DEFAULT);
            tool.friction = 0.006;
            run(0.5);
            if (!from_rest) {
                press(0.08);
                run(0.6);
                ASSERT_GT(tool.w, 20.0);
            }
            tool.hall_works = false;
            press(1.0);
            run(driven_s);
            press(0.0, true);
            EXPECT_EQ(driven_against_the_shaft(), 0) << from_rest << ' ' << driven_s;
        }
    }
}

// A seated screw: the load stops the shaft within some turns, the user releases and reverses.
TEST_F(RunTest, AShaftStoppedByTheLoadReversesWithoutDelay) {
    run(0.5);
    press(1.0);
    run(0.4);
    tool.friction = 0.65;
    run(0.45);
    ASSERT_EQ(tool.w, 0);
    press(0.0, true);
    run(0.9);
    tool.friction = 0.012;
    press(0.5, true);
    run(0.1);
    EXPECT_EQ(faults(), 0);
    EXPECT_EQ(states.back().reverse, 1);
    EXPECT_LT(tool.w, 0);
}

TEST_F(RunTest, ATriggerPressedAtTheStartDoesNotDrive) {
    press(1.0);
    run(1.0);
    EXPECT_NE(out.coast, 0);
    EXPECT_EQ(tool.w, 0);
}

// The sent bytes depend on edges and counts alone: condition for equal telemetry of native firmware
// and AVR.
TEST_F(RunTest, TelemetryDoesNotDependOnLatency) {
    std::vector<uint8_t> first;
    std::vector<SimInputs> tape;
    for (const auto &[isr, tick] : {std::pair{40, 400}, {0, 260}, {300, 3500}}) {
        SimStart how = SIM_START_DEFAULT;
        how.isr_cycles = static_cast<uint16_t>(isr);
        how.tick_cycles = static_cast<uint16_t>(tick);
        start(how);
        std::vector<uint8_t> sent;
        for (long k = 0; k < 60000; ++k) {
            press(k > 20000 && k < 50000 ? 0.8 : 0.0);
            if (tape.size() <= static_cast<size_t>(k)) {
                tool.period(out, &in);
                in.adc_counts[SIM_ADC_CURRENT] = counts(512.0 + tool.reported_a() / 0.125);
                in.adc_counts[SIM_ADC_BUS] = counts(18.5 / 0.025);
                tape.push_back(in);
            }
            sim_period(&tape[static_cast<size_t>(k)], &out);
            sent.insert(sent.end(), out.tx, out.tx + out.tx_count);
        }
        if (first.empty())
            first = sent;
        const size_t size = std::min(first.size(), sent.size());
        ASSERT_GT(size, 36000u);
        for (size_t k = 0; k < size; ++k)
            ASSERT_EQ(sent[k], first[k]) << "byte " << k << " at latency " << isr << "/" << tick;
    }
}

TEST_F(RunTest, ResetStartsFromANewState) {
    auto record = [this] {
        start(SIM_START_DEFAULT);
        std::vector<uint8_t> sent;
        for (long k = 0; k < 20000; ++k) {
            press(k > 12000 ? 0.5 : 0.0);
            tool.period(out, &in);
            in.adc_counts[SIM_ADC_CURRENT] = counts(512.0 + tool.reported_a() / 0.125);
            in.adc_counts[SIM_ADC_BUS] = 740;
            sim_period(&in, &out);
            sent.insert(sent.end(), out.tx, out.tx + out.tx_count);
        }
        return sent;
    };
    const auto first = record();
    EXPECT_EQ(first, record());
}

}  // namespace
