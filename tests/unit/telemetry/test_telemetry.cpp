// Outbound frames: framing, values at the limits of their signals, schedule of slow frames, and
// order at the start.
#include <gtest/gtest.h>

#include "frames.hpp"

extern "C" {
#include "telemetry/telemetry.h"
}

namespace {

struct Line {
    Telemetry telemetry{};
    TelemetryInputs in{};
    TelemetryFast fast{};
    std::vector<std::int16_t> values = std::vector<std::int16_t>(3, -2);
    std::vector<Bytes> frames;  // of the last tick

    explicit Line(std::uint8_t baud = TELEMETRY_BAUD_250000) {
        TelemetryBoot boot{};
        boot.fast_divider = 1;
        telemetry_init(&telemetry, &boot, baud);
        in.params.value = values.data();
        in.params.count = static_cast<std::uint8_t>(values.size());
    }

    void tick() {
        std::uint8_t out[TELEMETRY_TICK_BYTES_MAX];
        ++in.now_ms;
        const std::uint8_t bytes = telemetry_tick(&telemetry, &in, &fast, out);
        frames.clear();
        for (std::uint8_t at = 0; at < bytes;
             at = static_cast<std::uint8_t>(at + TELEMETRY_FRAME_BYTES))
            frames.emplace_back(out + at, out + at + TELEMETRY_FRAME_BYTES);
    }
};

int id_of(const Bytes &frame) {
    return frame[6] | frame[7] << 8;
}

TEST(Telemetry, BeginsWithBootAndAFastFrameInTheFirstTick) {
    Line line;
    line.tick();
    ASSERT_EQ(line.frames.size(), 2u);
    EXPECT_EQ(id_of(line.frames[0]), TELEMETRY_BOOT_ID);
    EXPECT_EQ(id_of(line.frames[1]), TELEMETRY_FAST_ID);
}

TEST(Telemetry, EveryFrameHasItsFramingAndCrc) {
    Line line;
    line.in.now_ms = 0x01FFFFF0u;  // the increment carries through all bytes of the time
    int slow = 0;
    for (int k = 0; k < 200; ++k) {
        line.tick();
        for (const Bytes &frame : line.frames) {
            ASSERT_EQ(frame[0], 0xAA);
            ASSERT_EQ(frame[5], 8);
            ASSERT_EQ(frame[8] | frame[9], 0);
            ASSERT_EQ(frame[17], frame_crc(frame));
            ASSERT_EQ(frame[18], 0xBB);
            ASSERT_EQ(static_cast<std::uint32_t>(frame[1] | frame[2] << 8 | frame[3] << 16) |
                          static_cast<std::uint32_t>(frame[4]) << 24,
                      line.in.now_ms);
            slow += id_of(frame) != TELEMETRY_FAST_ID ? 1 : 0;
        }
    }
    EXPECT_GE(slow, 1 + 3 + 1 + 2) << "BOOT, parameters, their table, STATE, HEALTH";
}

TEST(Telemetry, FastHoldsItsSignalsAtTheirLimits) {
    struct Case {
        int current, speed, duty, supply;
    };
    for (const Case &c : {Case{-32768, 32767, -512, 0}, Case{32767, -32768, 255, 1023},
                          Case{-1, -1, -1, 1}, Case{0, 0, -255, 512}}) {
        Line line;
        line.fast.current_a = static_cast<std::int16_t>(c.current);
        line.fast.speed_rpm = static_cast<std::int16_t>(c.speed);
        line.fast.duty_compare = static_cast<std::int16_t>(c.duty);
        line.fast.supply_v = static_cast<std::uint16_t>(c.supply);
        line.tick();
        const std::uint8_t *d = &line.frames.back()[10];
        const int packed = d[4] | d[5] << 8 | d[6] << 16;
        EXPECT_EQ(static_cast<std::int16_t>(d[0] | d[1] << 8), c.current);
        EXPECT_EQ(static_cast<std::int16_t>(d[2] | d[3] << 8), c.speed);
        EXPECT_EQ(packed & 1023, c.duty & 1023);
        EXPECT_EQ(packed >> 10 & 1023, c.supply);
        EXPECT_EQ(packed >> 20, 0);
    }
}

TEST(Telemetry, ASlowFrameTakesTwoTicksAndIsHeldOnRequest) {
    Line line;
    for (int k = 0; k < 500; ++k)
        line.tick();
    ASSERT_FALSE(telemetry_packs(&line.telemetry));
    const TelemetryAck ack{};
    telemetry_ack(&line.telemetry, &ack);
    EXPECT_TRUE(telemetry_packs(&line.telemetry));
    line.in.hold_slow = true;
    line.tick();
    EXPECT_TRUE(telemetry_ack_pending(&line.telemetry));
    line.in.hold_slow = false;
    line.tick();
    EXPECT_EQ(line.frames.size(), 1u) << "packed";
    line.in.hold_slow = true;
    line.tick();
    EXPECT_EQ(line.frames.size(), 1u) << "held";
    line.in.hold_slow = false;
    line.tick();
    ASSERT_EQ(line.frames.size(), 2u);
    EXPECT_EQ(id_of(line.frames[0]), TELEMETRY_ACK_ID);
}

TEST(Telemetry, TheSlowLineSendsMeansOfTwoTicks) {
    Line line(TELEMETRY_BAUD_115200);
    int fast = 0;
    double bytes = 0;
    for (int k = 1; k <= 400; ++k) {
        line.fast.current_a = static_cast<std::int16_t>(k % 2 == 0 ? -101 : -103);
        line.tick();
        bytes += 19.0 * static_cast<double>(line.frames.size());
        ASSERT_LE(bytes, 57 + 11.52 * k) << "within the capacity of queue and line";
        if (line.frames.empty() || id_of(line.frames.back()) != TELEMETRY_FAST_ID)
            continue;
        EXPECT_EQ(k % 2, 0);
        EXPECT_EQ(line.frames.back()[16] >> 4, fast % 16) << "consecutive counters";
        EXPECT_EQ(static_cast<std::int16_t>(line.frames.back()[10] | line.frames.back()[11] << 8),
                  -102);
        ++fast;
    }
    EXPECT_EQ(fast, 200);
}

}  // namespace
