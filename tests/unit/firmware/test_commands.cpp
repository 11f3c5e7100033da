// Whole runs with a host: calibrations by command, refused parameters, the slow line (115,200 Bd),
// duty profiles.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <map>

#include "../telemetry/frames.hpp"
extern "C" {
#include "app/param_store.h"
}
#include "hal/sim/sim.h"

namespace {

constexpr int TRIGGER_LOW_INDEX = 15, TRIGGER_HIGH_INDEX = 16, MODE_INDEX = 17, BAUD_INDEX = 18,
              OFFSET_INDEX = 6;
constexpr double PERIODS_PER_MS = 16000.0 / 510;

struct HostTest : testing::Test {
    SimOutputs out{};
    SimInputs in{};
    std::deque<std::uint8_t> to_board;
    Bytes line;
    std::map<int, std::vector<Bytes>> frames;  // by id
    std::uint8_t sequence = 0;

    void SetUp() override { start(nullptr); }

    void start(const std::uint8_t *eeprom) {
        SimStart how = SIM_START_DEFAULT;
        how.eeprom = eeprom;
        in = SimInputs{};
        in.adc_counts[SIM_ADC_CURRENT] = 512;
        in.adc_counts[SIM_ADC_BUS] = 740;
        in.adc_counts[SIM_ADC_TRIGGER] = 100;
        in.adc_counts[SIM_ADC_TEMPERATURE] = 154;
        line.clear();
        frames.clear();
        sim_reset(&how, &out);
    }

    void run(int ms) {
        for (int k = 0; k < static_cast<int>(ms * PERIODS_PER_MS); ++k) {
            in.rx_count = 0;
            if (!to_board.empty() && k % 2 == 0) {
                in.rx[in.rx_count++] = to_board.front();
                to_board.pop_front();
            }
            sim_period(&in, &out);
            line.insert(line.end(), out.tx, out.tx + out.tx_count);
            for (; line.size() >= 19; line.erase(line.begin(), line.begin() + 19)) {
                ASSERT_EQ(line[0], 0xAA);
                ASSERT_EQ(line[17], frame_crc(line));
                frames[line[6] | line[7] << 8].emplace_back(line.begin(), line.begin() + 19);
            }
        }
    }

    // Result in the command's ACK.
    int ask(std::uint32_t id, std::array<std::uint8_t, 7> data) {
        data[6] = ++sequence;
        const Bytes frame = frame_of(id, data);
        to_board.insert(to_board.end(), frame.begin(), frame.end());
        const std::size_t before = frames[TELEMETRY_ACK_ID].size();
        run(60);
        const std::vector<Bytes> &acks = frames[TELEMETRY_ACK_ID];
        return acks.size() == before + 1 && acks.back()[12] == sequence ? acks.back()[13] : -1;
    }

    int write(int index, int value) {
        return ask(TELEMETRY_PARAM_WRITE_ID,
                   {static_cast<std::uint8_t>(index), 0, static_cast<std::uint8_t>(value),
                    static_cast<std::uint8_t>(value >> 8), 0, 0});
    }

    int read(int index) {
        EXPECT_EQ(ask(TELEMETRY_PARAM_READ_ID, {static_cast<std::uint8_t>(index)}),
                  TELEMETRY_ACK_RESULT_OK);
        const Bytes &frame = frames[TELEMETRY_PARAM_ID].back();
        EXPECT_EQ(frame[10], index);
        return frame[12] | frame[13] << 8;
    }

    int calibrate(unsigned what) {
        return ask(TELEMETRY_CALIBRATE_ID, {static_cast<std::uint8_t>(what)});
    }
    int state() { return frames[TELEMETRY_STATE_ID].back()[12] & 15; }
    unsigned flags() {
        return static_cast<unsigned>(frames[TELEMETRY_STATE_ID].back()[14] |
                                     frames[TELEMETRY_STATE_ID].back()[15] << 8);
    }
};

constexpr int IDLE = 0, DRIVE = 1, CALIBRATE = 4;

TEST_F(HostTest, CalibrateOffsetBecomesAParameter) {
    run(400);
    ASSERT_EQ(read(OFFSET_INDEX), 512 * 16);
    in.adc_counts[SIM_ADC_CURRENT] = 517;
    ASSERT_EQ(calibrate(TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET), TELEMETRY_ACK_RESULT_OK);
    run(400);
    EXPECT_EQ(state(), IDLE);
    EXPECT_NE(flags() & TELEMETRY_FLAGS_CALIBRATED, 0u);
    EXPECT_EQ(read(OFFSET_INDEX), 517 * 16);
}

// A host that sends without waiting for the ACKs: the board's queue holds three commands. The board
// discards further bytes until it has emptied the queue.
TEST_F(HostTest, AFullReceiveQueueLosesWholeCommandsAndTakesTheNext) {
    run(400);
    const std::size_t before = frames[TELEMETRY_ACK_ID].size();
    for (int n = 0; n < 400; ++n) {
        const Bytes frame =
            frame_of(TELEMETRY_PARAM_READ_ID, {0, 0, 0, 0, 0, 0, static_cast<std::uint8_t>(n)});
        to_board.insert(to_board.end(), frame.begin(), frame.end());
    }
    run(500);
    EXPECT_GE(frames[TELEMETRY_ACK_ID].size() - before, 20u);
    to_board.clear();
    run(200);
    EXPECT_EQ(read(OFFSET_INDEX), 512 * 16) << "the line works as before";
}

TEST_F(HostTest, CalibrateTriggerLearnsItsEnds) {
    run(400);
    ASSERT_EQ(calibrate(TELEMETRY_CALIBRATE_WHAT_TRIGGER), TELEMETRY_ACK_RESULT_OK);
    EXPECT_EQ(state(), CALIBRATE);
    in.adc_counts[SIM_ADC_TRIGGER] = 880;
    in.switches = SIM_SWITCH_CONTACT;
    run(1000);
    EXPECT_NE(out.coast, 0) << "the drive stays off while the trigger is moved";
    in.adc_counts[SIM_ADC_TRIGGER] = 112;
    in.switches = 0;
    run(4500);
    EXPECT_EQ(state(), IDLE);
    EXPECT_NE(flags() & TELEMETRY_FLAGS_CALIBRATED, 0u);
    EXPECT_EQ(read(TRIGGER_LOW_INDEX), 100 + (880 - 100) / 32);
    EXPECT_EQ(read(TRIGGER_HIGH_INDEX), 880 - (880 - 100) / 32);
}

TEST_F(HostTest, CalibratingATriggerThatIsNotMovedChangesNothing) {
    run(400);
    ASSERT_EQ(calibrate(TELEMETRY_CALIBRATE_WHAT_TRIGGER), TELEMETRY_ACK_RESULT_OK);
    run(5200);
    EXPECT_EQ(state(), IDLE);
    EXPECT_EQ(flags() & TELEMETRY_FLAGS_CALIBRATED, 0u);
    EXPECT_EQ(read(TRIGGER_LOW_INDEX), 100);
}

TEST_F(HostTest, CalibrateIsCancelled) {
    run(400);
    for (const unsigned what :
         {TELEMETRY_CALIBRATE_WHAT_TRIGGER, TELEMETRY_CALIBRATE_WHAT_HALL_PITCH}) {
        ASSERT_EQ(calibrate(what), TELEMETRY_ACK_RESULT_OK);
        EXPECT_EQ(calibrate(TELEMETRY_CALIBRATE_WHAT_CANCEL), TELEMETRY_ACK_RESULT_OK);
        run(20);
        EXPECT_EQ(state(), IDLE);
    }
    EXPECT_EQ(flags() & TELEMETRY_FLAGS_CALIBRATED, 0u);
    EXPECT_EQ(calibrate(TELEMETRY_CALIBRATE_WHAT_MAX + 1), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
}

TEST_F(HostTest, NothingIsCalibratedOrWrittenWhileDriving) {
    run(400);
    in.adc_counts[SIM_ADC_TRIGGER] = 600;
    in.switches = SIM_SWITCH_CONTACT;
    run(60);
    ASSERT_EQ(state(), DRIVE);
    EXPECT_EQ(calibrate(TELEMETRY_CALIBRATE_WHAT_CURRENT_OFFSET), TELEMETRY_ACK_RESULT_NOT_NOW);
    EXPECT_EQ(write(TRIGGER_LOW_INDEX, 120), TELEMETRY_ACK_RESULT_NOT_NOW);
}

TEST_F(HostTest, AModeThatDoesNotExistIsRefused) {
    run(400);
    EXPECT_EQ(write(MODE_INDEX, 6), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
    EXPECT_EQ(write(MODE_INDEX, 0), TELEMETRY_ACK_RESULT_OK);
    EXPECT_EQ(read(MODE_INDEX), 0);
    EXPECT_EQ(ask(TELEMETRY_SET_MODE_ID, {6}), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
}

// The parameter is saved, and the next start uses the slow line: a row every second tick,
// consecutive counters, and all slow frames.
TEST_F(HostTest, TheSlowLineSendsEverySecondRowAndLosesNothing) {
    run(400);
    ASSERT_EQ(write(BAUD_INDEX, 1), TELEMETRY_ACK_RESULT_OK);
    run(1500);
    std::array<std::uint8_t, SIM_EEPROM_BYTES> eeprom{};
    std::copy_n(sim_eeprom(), eeprom.size(), eeprom.begin());
    start(eeprom.data());
    run(4000);
    const std::vector<Bytes> &fast = frames[TELEMETRY_FAST_ID];
    ASSERT_NEAR(static_cast<double>(fast.size()), 2000.0, 5.0);
    for (std::size_t k = 1; k < fast.size(); ++k) {
        ASSERT_EQ((fast[k][1] | fast[k][2] << 8) - (fast[k - 1][1] | fast[k - 1][2] << 8), 2) << k;
        ASSERT_EQ(fast[k][16] >> 4, ((fast[k - 1][16] >> 4) + 1) % 16) << k;
    }
    EXPECT_EQ(frames[TELEMETRY_BOOT_ID].size(), 1u);
    EXPECT_EQ(frames[TELEMETRY_PARAM_ID].size(), static_cast<std::size_t>(PARAM_COUNT));
    EXPECT_EQ(frames[TELEMETRY_PARAM_TABLE_ID].size(), 1u);
    EXPECT_GE(frames[TELEMETRY_HEALTH_ID].size(), 3u);
    EXPECT_EQ(read(BAUD_INDEX), 1);
}

// Host and user together: the trigger held at `counts`, a duty commanded every 20 ms.
struct ProfileTest : HostTest {
    void SetUp() override {
        HostTest::SetUp();
        run(400);
    }

    void command(int16_t duty_q15, int ms) {
        for (int k = 0; k < ms; k += 20) {
            const auto raw = static_cast<std::uint16_t>(duty_q15);
            const Bytes frame = frame_of(TELEMETRY_PROFILE_ID, {static_cast<std::uint8_t>(raw),
                                                                static_cast<std::uint8_t>(raw >> 8),
                                                                0, 0, 0, 0, ++sequence});
            to_board.insert(to_board.end(), frame.begin(), frame.end());
            run(20);
        }
    }

    void press(int counts = 900) {
        in.adc_counts[SIM_ADC_TRIGGER] = static_cast<std::uint16_t>(counts);
        in.switches |= SIM_SWITCH_CONTACT;
    }

    void release() {
        in.adc_counts[SIM_ADC_TRIGGER] = 100;
        in.switches &= static_cast<std::uint8_t>(~SIM_SWITCH_CONTACT);
    }

    int stop_reason() { return frames[TELEMETRY_CONTROL_ID].back()[11] >> 4; }
};

constexpr int STOPPED = 5;
constexpr int16_t QUARTER_Q15 = 8192;  // 64 counts of the bridge

TEST_F(ProfileTest, SetsTheDutyWhileTheTriggerIsPressed) {
    command(QUARTER_Q15, 100);
    EXPECT_NE(out.coast, 0) << "before the first frame";
    press();
    command(QUARTER_Q15, 300);
    EXPECT_EQ(out.compare, 64);
    command(2 * QUARTER_Q15, 100);
    EXPECT_EQ(out.compare, 128);
    command(-1, 100);
    EXPECT_NE(out.coast, 0);
    EXPECT_EQ(state(), DRIVE);
    command(QUARTER_Q15, 100);
    EXPECT_EQ(out.compare, 64);
    release();
    command(QUARTER_Q15, 100);
    EXPECT_NE(out.coast, 0) << "after the release";
}

TEST_F(ProfileTest, IsLimitedByTheTrigger) {
    press(240);  // 140 of 820 counts: 44 of 255
    command(INT16_MAX, 400);
    EXPECT_EQ(out.coast, 0);
    EXPECT_NEAR(out.compare, 255 * 140 / 820, 1);
}

TEST_F(ProfileTest, EndsFiftyMillisecondsAfterTheLastFrameUntilTheRelease) {
    press();
    command(QUARTER_Q15, 300);
    ASSERT_EQ(out.compare, 64);
    run(40);
    EXPECT_EQ(out.compare, 64) << "last frame 60 ms ago, at most 12 ms to read it, valid for 50 ms";
    run(10);
    EXPECT_NE(out.coast, 0);
    run(100);
    EXPECT_EQ(state(), STOPPED);
    EXPECT_EQ(stop_reason(), static_cast<int>(TELEMETRY_STOP_REASON_TIMEOUT));
    command(QUARTER_Q15, 200);
    EXPECT_NE(out.coast, 0) << "a later frame does not restart the drive";
    release();
    run(400);
    press();
    run(300);
    EXPECT_GT(out.compare, 200) << "the duty of the trigger again";
}

TEST_F(ProfileTest, IsRefusedInOtherModesAndOutOfRange) {
    EXPECT_EQ(ask(TELEMETRY_PROFILE_ID, {0xFE, 0xFF}), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
    EXPECT_EQ(ask(TELEMETRY_PROFILE_ID, {0xFF, 0xFF}), TELEMETRY_ACK_RESULT_OK);
    ASSERT_EQ(ask(TELEMETRY_SET_MODE_ID, {TELEMETRY_MODE_SYNC}), TELEMETRY_ACK_RESULT_OK);
    EXPECT_EQ(ask(TELEMETRY_PROFILE_ID, {0, 16}), TELEMETRY_ACK_RESULT_NOT_NOW);
}

TEST_F(ProfileTest, AFaultHasPriority) {
    press();
    command(QUARTER_Q15, 300);
    ASSERT_EQ(out.compare, 64);
    in.adc_counts[SIM_ADC_BUS] = 300;  // 7.5 V
    command(QUARTER_Q15, 60);
    EXPECT_NE(out.coast, 0);
    in.adc_counts[SIM_ADC_BUS] = 740;
    command(QUARTER_Q15, 200);
    EXPECT_NE(out.coast, 0);
}

TEST_F(HostTest, TheTorqueTargetIsASetpoint) {
    constexpr int TORQUE_INDEX = PARAM_TORQUE_TARGET_NM;
    run(400);
    ASSERT_EQ(read(TORQUE_INDEX), 80);
    EXPECT_EQ(ask(TELEMETRY_SETPOINT_ID, {1, 0, 95}), TELEMETRY_ACK_RESULT_OK);
    EXPECT_EQ(read(TORQUE_INDEX), 95);
    EXPECT_EQ(flags() & TELEMETRY_FLAGS_PARAM_SAVING, 0u) << "not saved";
    EXPECT_EQ(ask(TELEMETRY_SETPOINT_ID, {1, 0, 121}), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
    EXPECT_EQ(ask(TELEMETRY_SETPOINT_ID, {1, 0, 39}), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
    EXPECT_EQ(ask(TELEMETRY_SETPOINT_ID, {2, 0, 95}), TELEMETRY_ACK_RESULT_OUT_OF_RANGE);
    in.adc_counts[SIM_ADC_TRIGGER] = 900;
    in.switches = SIM_SWITCH_CONTACT;
    run(100);
    EXPECT_EQ(ask(TELEMETRY_SETPOINT_ID, {1, 0, 60}), TELEMETRY_ACK_RESULT_NOT_NOW);
    EXPECT_EQ(read(TORQUE_INDEX), 95);
}

}  // namespace
