// Exchange of a tick's inputs and its bridge command with a host (hal/inject): when a tick runs,
// damaged, repeated and missing frames, commands, the safe state.
#include <gtest/gtest.h>

#include <cstring>
#include <random>
#include <vector>

#define _Static_assert static_assert
extern "C" {
#include "core/crc.h"
#include "hal/hal.h"
#include "hal/inject/inject.h"

// The part of hal.h that inject.c leaves to the hardware.
static std::uint8_t eeprom[1024];
static int woken;
void hal_uart_start(uint8_t) {}
void hal_uart_wake(void) {
    woken++;
}
uint16_t hal_tick_cycles(uint16_t) {
    return 0;
}
uint16_t hal_stack_free(void) {
    return 0;
}
uint8_t hal_reset_cause(void) {
    return 1;
}
uint8_t hal_target(void) {
    return 0;
}
void hal_mark_control(bool) {}
uint8_t hal_lock(void) {
    return 0;
}
void hal_unlock(uint8_t) {}
bool hal_eeprom_ready(void) {
    return true;
}
uint8_t hal_eeprom_read(uint16_t address) {
    return eeprom[address % sizeof eeprom];
}
void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    eeprom[address % sizeof eeprom] = value;
}
}

namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr int FULL_TRIGGER = 920, RELEASED = 102;

// Number of ADC samples that the ticks up to this one have taken (docs/architecture.md, "ADC
// samples of a tick").
int samples_until(int tick) {
    return (16000 * tick - 2241 - 319) / 2040 + 1;
}

Bytes frame(std::uint32_t tick, std::uint16_t id, const Bytes &data) {
    Bytes out = {0xAA};
    for (int k = 0; k < 4; ++k) {
        out.push_back(static_cast<std::uint8_t>(tick >> (8 * k)));
    }
    out.insert(out.end(), {8, static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8)});
    out.insert(out.end(), {0, 0});
    out.insert(out.end(), data.begin(), data.end());
    out.resize(17);
    const std::uint8_t crc = crc8_over(CRC8_INIT, &out[6], 4);
    const std::uint8_t whole = crc8_over(crc8_over(crc, &out[1], 4), &out[10], 7);
    out.insert(out.end(), {static_cast<std::uint8_t>(whole ^ CRC8_FINAL_XOR), 0xBB});
    return out;
}

Bytes packed(const std::vector<int> &samples, std::size_t from, std::uint8_t last,
             std::uint32_t tick) {
    std::uint64_t bits = 0;
    for (std::size_t k = 0; k < 4 && from + k < samples.size(); ++k) {
        bits |= static_cast<std::uint64_t>(samples[from + k]) << (10 * k);
    }
    Bytes out;
    for (int k = 0; k < 5; ++k) {
        out.push_back(static_cast<std::uint8_t>(bits >> (8 * k)));
    }
    out.insert(out.end(), {last, static_cast<std::uint8_t>(tick)});
    return out;
}

Bytes operator+(Bytes a, const Bytes &b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
}

struct Injection : testing::Test {
    App app{};
    Bytes line;  // what the board has sent
    int trigger = RELEASED, current = 512;
    std::uint8_t switches = 0;

    void SetUp() override {
        std::memset(eeprom, 0xFF, sizeof eeprom);
        inject_init(&app, 0);
        begin();
    }

    void begin() {
        put(frame(0, INJECT_ID_SENSE_A, Bytes(7)));
        timer();
        line.clear();
    }

    void put(const Bytes &bytes) {
        for (const std::uint8_t byte : bytes) {
            ring_push_byte(&inject.received, byte);
            inject_decode();
        }
    }

    void timer(std::uint8_t count = 0) {
        inject_decode();
        inject_timer_tick(&app, 0, count);
        while (inject.send_tail != inject.send_head) {
            const std::uint8_t byte = inject.send[inject.send_tail % INJECT_SEND_BYTES];
            inject.send_tail = static_cast<std::uint8_t>(inject.send_tail + 1);
            line.push_back(byte);
        }
    }

    std::vector<int> samples(int tick) const {
        const int channels[16] = {0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 3, 0};
        const int counts[4] = {current, 720, trigger, 154};
        std::vector<int> out;
        for (int n = samples_until(tick - 1); n < samples_until(tick); ++n) {
            out.push_back(counts[channels[n % 16]]);
        }
        return out;
    }

    Bytes sense(int tick, const std::vector<int> &edges = {}) const {
        const std::vector<int> all = samples(tick);
        const auto number = static_cast<std::uint32_t>(tick);
        const auto counts = static_cast<std::uint8_t>(switches | all.size() << 4);
        const auto edge_count = static_cast<std::uint8_t>(edges.size());
        Bytes out = frame(number, INJECT_ID_SENSE_A, packed(all, 0, counts, number)) +
                    frame(number, INJECT_ID_SENSE_B, packed(all, 4, edge_count, number));
        if (!edges.empty()) {
            Bytes data;
            for (const int edge : edges) {
                data.insert(data.end(), {static_cast<std::uint8_t>(edge),
                                         static_cast<std::uint8_t>(edge >> 8)});
            }
            data.resize(6);
            data.push_back(static_cast<std::uint8_t>(tick));
            out = out + frame(number, INJECT_ID_SENSE_EDGES, data);
        }
        return out;
    }

    void run(int from, int to) {
        for (int tick = from; tick <= to; ++tick) {
            put(sense(tick));
            timer();
        }
    }

    // Trigger pulled and the bridge driving at tick `to`.
    void drive(int to) {
        run(1, 200);
        trigger = FULL_TRIGGER;
        switches = HAL_SWITCH_CONTACT;
        run(201, to);
        ASSERT_FALSE(inject.drive[to & 1][10] & INJECT_COAST);
    }

    std::vector<Bytes> answers() const {
        std::vector<Bytes> out;
        for (std::size_t at = 0; at + INJECT_FRAME <= line.size(); at += INJECT_FRAME) {
            if (line[at + 6] == INJECT_ID_DRIVE && line[at + 7] == 0) {
                out.emplace_back(line.begin() + static_cast<long>(at),
                                 line.begin() + static_cast<long>(at + INJECT_FRAME));
            }
        }
        return out;
    }
};

TEST_F(Injection, ExecutesATickOnceItsInputsAreComplete) {
    const Bytes inputs = sense(1);
    put(Bytes(inputs.begin(), inputs.begin() + INJECT_FRAME));
    timer();
    EXPECT_EQ(inject.done, 0u);
    put(Bytes(inputs.begin() + INJECT_FRAME, inputs.end()));
    timer();
    EXPECT_EQ(inject.done, 1u);
    ASSERT_EQ(answers().size(), 1u);
    EXPECT_EQ(answers()[0], frame(1, INJECT_ID_DRIVE, {1, 0, 0, 0, 3, 0, 1}));
}

TEST_F(Injection, WaitsForTheEdgesThatAreAnnounced) {
    run(1, 1);
    const Bytes inputs = sense(2, {5, 9000});
    put(Bytes(inputs.begin(), inputs.begin() + 2 * INJECT_FRAME));
    timer();
    EXPECT_EQ(inject.done, 1u);
    put(Bytes(inputs.begin() + 2 * INJECT_FRAME, inputs.end()));
    timer();
    EXPECT_EQ(inject.done, 2u);
    EXPECT_EQ(app.hall.new_edges, 2u);
}

TEST_F(Injection, AnswerComesBeforeTheTelemetryOfItsTick) {
    line.clear();
    run(1, 1);
    ASSERT_GE(line.size(), 2u * INJECT_FRAME);
    EXPECT_EQ(line[6], INJECT_ID_DRIVE);
    EXPECT_EQ(line[INJECT_FRAME], 0xAA);
}

TEST_F(Injection, NoSingleBitErrorIsAccepted) {
    const Bytes inputs = sense(1);
    for (std::size_t bit = 0; bit < 8 * inputs.size(); ++bit) {
        inject_init(&app, 0);
        begin();
        Bytes damaged = inputs;
        damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ (1u << (bit % 8)));
        put(damaged);
        timer();
        EXPECT_EQ(inject.done, 0u) << "bit " << bit;
        put(inputs);
        put(inputs);  // the first bytes may complete the frame that the damage has begun
        timer();
        EXPECT_EQ(inject.done, 1u) << "bit " << bit;
    }
}

TEST_F(Injection, FindsAFrameAfterAnyBytes) {
    std::mt19937 random(1);
    std::uniform_int_distribution<int> byte(0, 255), length(1, 60);
    for (int trial = 0; trial < 2000; ++trial) {
        inject_init(&app, 0);
        begin();
        Bytes noise;
        for (int k = length(random); k > 0; --k) {
            const int value = byte(random);
            noise.push_back(static_cast<std::uint8_t>(value < 64 ? 0xAA : value));
        }
        put(noise);
        put(sense(1));
        put(sense(1));
        timer();
        EXPECT_EQ(inject.done, 1u) << "trial " << trial;
        EXPECT_GT(inject.errors, 0u);
    }
}

TEST_F(Injection, RefusesInputsOfOtherTicksAndImpossibleCounts) {
    run(1, 3);
    put(sense(6));
    EXPECT_EQ(inject.errors, 2u);  // both frames: only ticks 4 and 5 can be next
    put(frame(4, INJECT_ID_SENSE_A, {0, 0, 0, 0, 0, 9 << 4, 4}));
    put(frame(4, INJECT_ID_SENSE_B, {0, 0, 0, 0, 0, 0, 4}));
    timer();
    EXPECT_EQ(inject.done, 3u);
    put(frame(4, INJECT_ID_SENSE_A, {0, 0, 0, 0, 0, 8 << 4, 4}));
    put(frame(4, INJECT_ID_SENSE_EDGES, {1, 0, 2, 0, 3, 0, 4}));
    put(frame(4, INJECT_ID_SENSE_B, {0, 0, 0, 0, 0, 4, 4}));
    timer();
    EXPECT_EQ(inject.done, 3u);
    put(sense(4));
    timer();
    EXPECT_EQ(inject.done, 4u);
}

TEST_F(Injection, ALateHostChangesNothing) {
    drive(260);
    const App before = app;
    for (std::uint8_t late = 1; late < INJECT_SAFE_TICKS; ++late) {
        timer();
    }
    EXPECT_EQ(inject.done, 260u);
    EXPECT_TRUE(inject.enabled);
    EXPECT_EQ(std::memcmp(&app, &before, sizeof app), 0);
    run(261, 261);
    EXPECT_EQ(app.faults.latched, 0u);
    EXPECT_EQ(app.overruns, 0u);
}

TEST_F(Injection, OpensTheBridgeAfterFiveTicksWithoutInputs) {
    drive(260);
    line.clear();
    for (std::uint8_t late = 1; late < INJECT_SAFE_TICKS; ++late) {
        timer();
        EXPECT_TRUE(answers().empty());
    }
    timer();
    ASSERT_EQ(answers().size(), 1u);
    EXPECT_EQ(answers()[0][10] & (INJECT_COAST | INJECT_SAFE), INJECT_COAST | INJECT_SAFE);
    EXPECT_FALSE(inject.enabled);
    run(261, 270);
    EXPECT_EQ(app.faults.latched, TELEMETRY_FAULTS_OVERRUN);
    for (const Bytes &answer : answers()) {
        EXPECT_TRUE(answer[10] & INJECT_COAST);
    }
}

TEST_F(Injection, BeforeTheFirstTickItWaitsForTheHost) {
    for (int k = 0; k < 50; ++k) {
        timer();
    }
    run(1, 3);
    EXPECT_EQ(app.faults.latched, 0u);
}

TEST_F(Injection, AnswersAgainWhenAskedAgain) {
    run(1, 4);
    const std::vector<Bytes> first = answers();
    line.clear();
    put(sense(3));  // of both the older goes first
    put(sense(4));
    timer();
    put(sense(4));
    timer();
    EXPECT_EQ(answers(), (std::vector<Bytes>{first[2], first[3]}));
    line.clear();
    put(sense(2));
    timer();
    EXPECT_TRUE(answers().empty());
}

TEST_F(Injection, RepeatsItselfTenTimesASecondWithoutAHost) {
    run(1, 1);
    line.clear();
    for (int k = 0; k < 1000; ++k) {
        timer();
    }
    EXPECT_EQ(answers().size(), 10u);
    EXPECT_TRUE(answers()[0][10] & INJECT_SAFE);
}

TEST_F(Injection, ReportsThatNoRunHasBegun) {
    inject_init(&app, 0);
    put(sense(1));
    for (unsigned k = 0; k < INJECT_HELLO_TICKS; ++k) {
        timer();
    }
    EXPECT_EQ(inject.done, 0u);
    ASSERT_EQ(answers().size(), 1u);
    EXPECT_TRUE(answers()[0][10] & INJECT_IDLE);
}

TEST_F(Injection, ARunBeginsWithAFreshApplication) {
    drive(260);
    begin();
    EXPECT_EQ(inject.done, 0u);
    EXPECT_EQ(app.report.now_ms, 0u);
    EXPECT_FALSE(inject.enabled);
    trigger = RELEASED;
    switches = 0;
    run(1, 2);
    EXPECT_EQ(app.report.now_ms, 2u);
}

TEST_F(Injection, ACommandReachesTheApplicationWithTheInputsThatFollowIt) {
    run(1, 10);
    put(sense(11));
    put(frame(0, 515, Bytes(7)));  // DUMP
    timer();
    EXPECT_EQ(app.uart.receive.head, 0u);
    put(sense(12));
    timer();
    EXPECT_EQ(app.uart.receive.head, INJECT_FRAME);
}

TEST_F(Injection, StampsOfEdgesFollowFromTheTicksNumber) {
    run(1, 9);
    put(sense(10, {16000}));
    timer();
    EXPECT_EQ(app.hall.edge_cycles, 160000u);
    EXPECT_EQ(app.hall.now_cycles, 160000u);
}

}  // namespace
