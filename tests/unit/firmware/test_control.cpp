// Laws of every controller for any sensor values: the output is a duty or a code (CONTROLLER_STOP,
// CONTROLLER_COAST), equal inputs give equal outputs, a stop is final.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <numeric>
#include <random>
#include <vector>

#include "control_modes.hpp"

extern "C" {
#include "app/control.h"
#include "app/param_store.h"
#include "controllers/foldback.h"
#include "hal/native/native.h"
#include "telemetry/telemetry_signals.h"
}

namespace {

using Inputs = std::vector<ControllerInputs>;
constexpr int TICKS = 3000;

struct Parameters {
    ParamStore store{};
    Parameters() {
        native_reset();
        param_load(&store);
    }
};

const int16_t *defaults() {
    static const Parameters parameters;
    return parameters.store.value;
}

// A motor whose speed oscillates as under impacts, as the sensors of the board measure it.
Inputs impacting(unsigned seed) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    Inputs tape;
    const double period = 15 + 25 * unit(rng), level = 4000 + 12000 * unit(rng),
                 swing = 0.7 * unit(rng), noise = 0.05 * unit(rng);
    double turned = 0;  // pitches
    for (int k = 0; k < TICKS; ++k) {
        const double phase = k / period - std::floor(k / period), run_up = std::min(1.0, k / 200.0);
        const double speed = run_up * level * (1 - swing * phase) * (1 + noise * (unit(rng) - 0.5));
        const double current = 512 * (5 + 40 * phase + 4 * (unit(rng) - 0.5));
        ControllerInputs in{};
        in.travel_q15 = in.duty_q15 = static_cast<int16_t>(32767 * run_up);
        in.speed_rpm_q1 = static_cast<int16_t>(2 * speed);
        in.current_a_q9 = static_cast<int16_t>(current);
        in.supply_mv = static_cast<uint16_t>(18500 - 60 * current / 512);
        turned += speed * 4 / 60000;
        in.edges = static_cast<uint8_t>(turned);
        turned -= in.edges;
        tape.push_back(in);
    }
    return tape;
}

// A random value, in 7 of 16 cases at a limit.
int16_t any_i16(std::mt19937 &rng) {
    constexpr int BORDERS[] = {-32768, -32767, -1, 0, 1, 32766, 32767};
    const auto pick = rng() % 16;
    return static_cast<int16_t>(pick < 7 ? BORDERS[pick]
                                         : static_cast<int>(rng() & 0xFFFF) - 32768);
}

Inputs random_inputs(unsigned seed) {
    std::mt19937 rng(seed);
    Inputs tape;
    ControllerInputs in{};
    for (int k = 0; k < TICKS; ++k) {
        if (rng() % 4 == 0)
            in.speed_rpm_q1 = any_i16(rng);
        if (rng() % 4 == 0)
            in.current_a_q9 = any_i16(rng);
        if (rng() % 8 == 0)
            in.supply_mv =
                static_cast<uint16_t>(rng() % 3 == 0 ? (rng() % 2) * 65535u : rng() & 0xFFFFu);
        if (rng() % 8 == 0)
            in.travel_q15 = static_cast<int16_t>(any_i16(rng) & 0x7FFF);
        in.duty_q15 = static_cast<int16_t>(any_i16(rng) & 0x7FFF);
        in.coasted = rng() % 8 == 0;
        in.edges = static_cast<uint8_t>(rng() % 4 == 0 ? rng() & 0xFFu : rng() & 1u);
        tape.push_back(in);
    }
    return tape;
}

enum class Broken {
    NOT,
    SPEED_STUCK,
    SPEED_ZERO,
    SPEED_SATURATED,
    CURRENT_STUCK,
    CURRENT_ZERO,
    CURRENT_SATURATED,
    SUPPLY_ZERO,
    SUPPLY_SATURATED,
    LAST
};

// The inputs with a sensor that fails after a third of the time.
Inputs with_broken(Inputs tape, Broken what) {
    for (size_t k = tape.size() / 3; k < tape.size(); ++k) {
        ControllerInputs &in = tape[k];
        switch (what) {
        case Broken::SPEED_STUCK:
            in.speed_rpm_q1 = tape[k - 1].speed_rpm_q1;
            break;
        case Broken::SPEED_ZERO:
            in.speed_rpm_q1 = 0;
            break;
        case Broken::SPEED_SATURATED:
            in.speed_rpm_q1 = INT16_MAX;
            break;
        case Broken::CURRENT_STUCK:
            in.current_a_q9 = tape[k - 1].current_a_q9;
            break;
        case Broken::CURRENT_ZERO:
            in.current_a_q9 = 0;
            break;
        case Broken::CURRENT_SATURATED:
            in.current_a_q9 = static_cast<int16_t>(k % 2 == 0 ? INT16_MAX : INT16_MIN);
            break;
        case Broken::SUPPLY_ZERO:
            in.supply_mv = 0;
            break;
        case Broken::SUPPLY_SATURATED:
            in.supply_mv = UINT16_MAX;
            break;
        case Broken::NOT:
        case Broken::LAST:
            break;
        }
    }
    return tape;
}

std::vector<Inputs> tapes() {
    std::vector<Inputs> all;
    for (unsigned seed = 1; seed <= 12; ++seed) {
        all.push_back(random_inputs(seed));
        all.push_back(with_broken(impacting(seed),
                                  static_cast<Broken>(seed % static_cast<unsigned>(Broken::LAST))));
    }
    return all;
}

std::vector<int16_t> replay(Control *control, uint8_t mode, const Inputs &tape,
                            const int16_t *value) {
    std::vector<int16_t> out;
    control_prepare(control, mode, value);
    control_start(control, mode, false);
    for (const ControllerInputs &in : tape)
        out.push_back(control_step(control, &in));
    return out;
}

struct EveryMode : testing::TestWithParam<uint8_t> {};
INSTANTIATE_TEST_SUITE_P(Control, EveryMode, testing::ValuesIn(modes()));

TEST_P(EveryMode, GivesADutyOrACodeAndAStopIsFinal) {
    for (const Inputs &tape : tapes()) {
        Control control{};
        bool stopped = false;
        for (const int16_t requested : replay(&control, GetParam(), tape, defaults())) {
            ASSERT_GE(requested, CONTROLLER_COAST);
            ASSERT_TRUE(!stopped || requested == CONTROLLER_STOP);
            stopped = requested == CONTROLLER_STOP;
        }
        ASSERT_EQ(stopped, control.stopped);
        TelemetryControl report{};
        control_report(&control, &report);
        ASSERT_LE(report.stop_reason, CONTROLLER_REASON_TIMEOUT);
        ASSERT_EQ(stopped, report.stop_reason != CONTROLLER_REASON_NONE)
            << "a stop has a reason, and nothing else has";
    }
}

TEST_P(EveryMode, AStopHoldsWhateverTheControllerReturns) {
    Control control{};
    control_prepare(&control, GetParam(), defaults());
    control_start(&control, GetParam(), false);
    control.stopped = true;
    for (const ControllerInputs &in : impacting(1))
        ASSERT_EQ(control_step(&control, &in), CONTROLLER_STOP);
    ASSERT_TRUE(control.stopped);
}

TEST_P(EveryMode, ADriveDoesNotDependOnThePreviousOne) {
    const std::vector<Inputs> all = tapes();
    for (size_t k = 0; k + 1 < all.size(); ++k) {
        Control fresh{}, used;
        std::memset(&used, 0xA5, sizeof used);
        used.profile = Profile{};  // of the host: it persists across drives
        replay(&used, GetParam(), all[k], defaults());
        ASSERT_EQ(replay(&used, GetParam(), all[k + 1], defaults()),
                  replay(&fresh, GetParam(), all[k + 1], defaults()));
    }
}

TEST_P(EveryMode, AllStateIsInTheStruct) {
    const Inputs one = impacting(1), other = random_inputs(2);
    Control a{}, b{}, alone{};
    const std::vector<int16_t> expected = replay(&alone, GetParam(), one, defaults());
    control_prepare(&a, GetParam(), defaults());
    control_start(&a, GetParam(), false);
    control_prepare(&b, GetParam(), defaults());
    control_start(&b, GetParam(), false);
    for (size_t k = 0; k < one.size(); ++k) {
        ASSERT_EQ(control_step(&a, &one[k]), expected[k]) << k;
        control_step(&b, &other[k]);
    }
}

// Every parameter at its limits and between them, alone and in combination.
TEST_P(EveryMode, AnyAllowedParametersGiveADutyOrACode) {
    struct Limits {
        int32_t least, greatest;
    };
#define LIMITS(name, unit, initial, least, greatest, version) {least, greatest},
    const Limits limits[] = {PARAM_LIST(LIMITS)};
#undef LIMITS
    std::mt19937 rng(7);
    const std::vector<Inputs> all = tapes();
    for (int k = 0; k < 40; ++k) {
        int16_t value[PARAM_COUNT];
        for (int n = 0; n < PARAM_COUNT; ++n) {
            const auto span = static_cast<uint32_t>(limits[n].greatest - limits[n].least) + 1;
            const auto inside = limits[n].least + static_cast<int32_t>(rng() % span);
            const auto pick = rng() % 4;
            value[n] = static_cast<int16_t>(pick == 0   ? limits[n].least
                                            : pick == 1 ? limits[n].greatest
                                                        : inside);
        }
        Control control{};
        for (const int16_t requested :
             replay(&control, GetParam(), all[static_cast<size_t>(k) % all.size()], value))
            ASSERT_GE(requested, CONTROLLER_COAST) << k;
    }
}

// A different value for each parameter: 100 + index.
std::array<int16_t, PARAM_COUNT> numbered() {
    std::array<int16_t, PARAM_COUNT> value{};
    std::iota(value.begin(), value.end(), int16_t{100});
    return value;
}

TEST(Control, SetpointsAreTheParametersOfTheSameName) {
    const auto value = numbered();
    Control control{};
    control_prepare(&control, TELEMETRY_MODE_SYNC, value.data());
    EXPECT_EQ(control.blow_set.turn_q8, 100 + PARAM_BLOW_TURN_Q8);
    EXPECT_EQ(control.blow_set.source, BLOW_SOURCE_CURRENT) << "any method but speed";
    EXPECT_EQ(control.blow_set.motor_mohm, 100 + PARAM_MOTOR_MOHM);
    EXPECT_EQ(control.blow_set.motor_rpm_per_v, 100 + PARAM_MOTOR_RPM_PER_V);
    EXPECT_EQ(control.set.sync.method, 100 + PARAM_SYNC_METHOD);
    EXPECT_EQ(control.set.sync.low_mv, 100 + PARAM_SYNC_LOW_MV);
    EXPECT_EQ(control.set.sync.high_mv, 100 + PARAM_SYNC_HIGH_MV);
    EXPECT_EQ(control.set.sync.depth_min_q15, 100 + PARAM_SYNC_DEPTH_MIN_Q15);
    EXPECT_EQ(control.set.sync.depth_max_q15, 100 + PARAM_SYNC_DEPTH_MAX_Q15);
    EXPECT_EQ(control.set.sync.current_a_q9, 100 + PARAM_SYNC_CURRENT_A_Q9);
    control_prepare(&control, TELEMETRY_MODE_SCREWING, value.data());
    EXPECT_EQ(control.blow_set.source, 100 + PARAM_BLOW_SOURCE);
    EXPECT_EQ(control.set.screwing.pulses, 100 + PARAM_HALL_PULSES);
    EXPECT_EQ(control.set.screwing.turn_q8, 100 + PARAM_BLOW_TURN_Q8);
    EXPECT_EQ(control.set.screwing.share_q15, 100 + PARAM_SCREWING_SHARE_Q15);
    EXPECT_EQ(control.set.screwing.rise_q8, 100 + PARAM_SCREWING_RISE_Q8);
    control_prepare(&control, TELEMETRY_MODE_TORQUE, value.data());
    EXPECT_EQ(control.set.torque.target_nm, 100 + PARAM_TORQUE_TARGET_NM);
    control_prepare(&control, TELEMETRY_MODE_DRILL, value.data());
    EXPECT_EQ(control.set.drill.clutch_dnm, 100 + PARAM_DRILL_CLUTCH_DNM);
    EXPECT_EQ(control.set.drill.ratio_q8, 100 + PARAM_DRILL_RATIO_Q8);
    EXPECT_EQ(control.set.drill.motor_mohm, 100 + PARAM_MOTOR_MOHM);
    EXPECT_EQ(control.set.drill.rpm_per_v, 100 + PARAM_MOTOR_RPM_PER_V);
    EXPECT_EQ(control.set.drill.pulse, 100 + PARAM_DRILL_PULSE);
    EXPECT_EQ(control.set.drill.kickback, 100 + PARAM_DRILL_KICKBACK);
}

TEST(Control, SetpointsOfLowVibrationAreTheParametersOfTheSameName) {
    const auto value = numbered();
    Control control{};
    control_prepare(&control, TELEMETRY_MODE_VIBRATION, value.data());
    const VibrationSetpoints &set = control.set.vibration;
    EXPECT_EQ(set.method, 100 + PARAM_VIBRATION_METHOD);
    EXPECT_EQ(set.approach_q15, 100 + PARAM_VIBRATION_APPROACH_Q15);
    EXPECT_EQ(set.climb_q15, 100 + PARAM_VIBRATION_CLIMB_Q15);
    EXPECT_EQ(set.climb_per_ms_q15, 100 + PARAM_VIBRATION_CLIMB_PER_MS_Q15);
    EXPECT_EQ(set.climb_turn_q8, 100 + PARAM_VIBRATION_CLIMB_TURN_Q8);
    EXPECT_EQ(set.surge_a_q9, 100 + PARAM_VIBRATION_SURGE_A_Q9);
    EXPECT_EQ(set.hard_share_q15, 100 + PARAM_VIBRATION_HARD_SHARE_Q15);
    EXPECT_EQ(set.hard_mv, 100 + PARAM_VIBRATION_HARD_MV);
    EXPECT_EQ(set.motor_mohm, 100 + PARAM_MOTOR_MOHM);
    EXPECT_EQ(set.motor_rpm_per_v, 100 + PARAM_MOTOR_RPM_PER_V);
}

// Start and step are expensive: never in one tick.
TEST(Control, AControllerIsStartedInTheTickAfterAChange) {
    std::vector<int16_t> value(defaults(), defaults() + PARAM_COUNT);
    Control control{};
    const auto ready = [&](uint8_t mode, bool reverse) {
        control_ready(&control, mode, reverse, value.data());
        return control.start_due;
    };
    const auto settle = [&](uint8_t mode, bool reverse) {
        EXPECT_TRUE(ready(mode, reverse));
        EXPECT_FALSE(ready(mode, reverse));
        EXPECT_FALSE(ready(mode, reverse)) << "nothing has changed";
    };
    settle(TELEMETRY_MODE_TORQUE, false);
    EXPECT_EQ(control.mode, TELEMETRY_MODE_TORQUE);
    settle(TELEMETRY_MODE_TORQUE, true);
    EXPECT_EQ(control.mode, TELEMETRY_MODE_DUTY);
    settle(TELEMETRY_MODE_SYNC, false);
    value[PARAM_SYNC_LOW_MV] = static_cast<int16_t>(value[PARAM_SYNC_LOW_MV] + 1);
    settle(TELEMETRY_MODE_SYNC, false);
    const ControllerInputs in = impacting(1)[0];
    control_step(&control, &in);
    EXPECT_TRUE(control_has_stepped(&control));
    settle(TELEMETRY_MODE_SYNC, false);
    EXPECT_FALSE(control_has_stepped(&control));
}

TEST(Control, ThePlainModeReturnsTheTrigger) {
    Control control{};
    const Inputs tape = random_inputs(3);
    const std::vector<int16_t> out = replay(&control, TELEMETRY_MODE_DUTY, tape, defaults());
    for (size_t k = 0; k < tape.size(); ++k)
        ASSERT_EQ(out[k], tape[k].travel_q15);
}

TEST(Control, AModeThatDoesNotExistIsThePlainOne) {
    Control control{};
    control_start(&control, TELEMETRY_MODE_MAX, false);
    EXPECT_FALSE(control_has(TELEMETRY_MODE_MAX));
    EXPECT_EQ(control.mode, TELEMETRY_MODE_DUTY);
}

TEST(Control, ControllersThatTightenLeaveReverseToThePlainMode) {
    for (const unsigned mode : {TELEMETRY_MODE_SCREWING, TELEMETRY_MODE_TORQUE}) {
        Control control{};
        control_prepare(&control, static_cast<uint8_t>(mode), defaults());
        control_start(&control, static_cast<uint8_t>(mode), true);
        EXPECT_EQ(control.mode, TELEMETRY_MODE_DUTY);
    }
}

TEST(Control, TheDrillDetectsJamsInReverseWithoutClutchAndPulseMode) {
    std::vector<int16_t> value(defaults(), defaults() + PARAM_COUNT);
    value[PARAM_DRILL_CLUTCH_DNM] = 50;
    value[PARAM_DRILL_PULSE] = 1;
    for (const bool reverse : {false, true}) {
        Control control{};
        control_prepare(&control, TELEMETRY_MODE_DRILL, value.data());
        control_start(&control, TELEMETRY_MODE_DRILL, reverse);
        EXPECT_EQ(control.mode, TELEMETRY_MODE_DRILL);
        EXPECT_TRUE(control.set.drill.kickback);
        EXPECT_EQ(control.set.drill.clutch_dnm, reverse ? 0 : 50);
        EXPECT_EQ(control.set.drill.pulse, !reverse);
    }
}

TEST(Control, TheParametersAllowTheModesOfTheListAndNoOthers) {
#define GREATEST(name, unit, initial, least, greatest, version) greatest,
    const int32_t greatest[] = {PARAM_LIST(GREATEST)};
#undef GREATEST
    for (const int index :
         {PARAM_MODE, PARAM_MODE_SWITCH_1, PARAM_MODE_SWITCH_2, PARAM_MODE_SWITCH_3})
        EXPECT_EQ(greatest[index], modes().back()) << index;
    EXPECT_EQ(modes().size(), modes().back() + 1u);
}

TEST(Control, StopReasonsEqualTheValuesOfTheSignal) {
    EXPECT_EQ(int{CONTROLLER_REASON_NONE}, int{TELEMETRY_STOP_REASON_NONE});
    EXPECT_EQ(int{CONTROLLER_REASON_SEATED}, int{TELEMETRY_STOP_REASON_SEATED});
    EXPECT_EQ(int{CONTROLLER_REASON_REACHED}, int{TELEMETRY_STOP_REASON_REACHED});
    EXPECT_EQ(int{CONTROLLER_REASON_UNREACHABLE}, int{TELEMETRY_STOP_REASON_UNREACHABLE});
    EXPECT_EQ(int{CONTROLLER_REASON_MISSED}, int{TELEMETRY_STOP_REASON_MISSED});
    EXPECT_EQ(int{CONTROLLER_REASON_CLUTCH}, int{TELEMETRY_STOP_REASON_CLUTCH});
    EXPECT_EQ(int{CONTROLLER_REASON_KICKBACK}, int{TELEMETRY_STOP_REASON_KICKBACK});
    EXPECT_EQ(int{CONTROLLER_REASON_SENSOR}, int{TELEMETRY_STOP_REASON_SENSOR});
    EXPECT_EQ(int{CONTROLLER_REASON_TIMEOUT}, int{TELEMETRY_STOP_REASON_TIMEOUT});
}

}  // namespace
