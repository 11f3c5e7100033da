// Parser of inbound frames: an intact frame is executed once; truncated, damaged, too long or
// unknown frames are not executed, and the frames after them are not lost.
#include <gtest/gtest.h>

#include "frames.hpp"

extern "C" {
#include "telemetry/command.h"
}

namespace {

const Bytes READ = frame_of(TELEMETRY_PARAM_READ_ID, {7, 0, 0, 0, 0, 0, 41});

struct Parsed {
    std::vector<int> results, ids, sequences;
    int fresh = 0, errors = 0;
};

Parsed parse(const Bytes &stream) {
    CommandParser parser{};
    Parsed out;
    for (const std::uint8_t byte : stream) {
        Command command{};
        if (!command_next(&parser, byte, &command))
            continue;
        out.results.push_back(command.result);
        out.ids.push_back(command.id);
        out.sequences.push_back(command.sequence);
        out.fresh += command.fresh ? 1 : 0;
    }
    out.errors = parser.errors;
    return out;
}

Bytes joined(std::initializer_list<Bytes> parts) {
    Bytes all;
    for (const Bytes &part : parts)
        all.insert(all.end(), part.begin(), part.end());
    return all;
}

TEST(CommandParser, ReturnsACompleteFrame) {
    CommandParser parser{};
    Command command{};
    for (std::size_t k = 0; k + 1 < READ.size(); ++k)
        ASSERT_FALSE(command_next(&parser, READ[k], &command)) << k;
    ASSERT_TRUE(command_next(&parser, READ.back(), &command));
    EXPECT_TRUE(command.fresh);
    EXPECT_EQ(command.result, TELEMETRY_ACK_RESULT_OK);
    EXPECT_EQ(command.id, TELEMETRY_PARAM_READ_ID);
    EXPECT_EQ(command.sequence, 41);
    EXPECT_EQ(command.data[0], 7);
    EXPECT_EQ(parser.errors, 0);
}

TEST(CommandParser, ATruncatedFrameLosesOnlyItself) {
    for (std::size_t length = 1; length < READ.size(); ++length) {
        const Parsed got =
            parse(joined({Bytes(READ.begin(), READ.begin() + static_cast<long>(length)), READ}));
        ASSERT_EQ(got.fresh, 1) << length;
        ASSERT_EQ(got.errors, static_cast<int>(length));
    }
}

TEST(CommandParser, EveryDamagedByteIsDetectedAndTheNextFrameIsFound) {
    for (std::size_t at = 0; at < READ.size(); ++at) {
        Bytes damaged = READ;
        damaged[at] ^= 0x40;
        const Parsed got = parse(joined({damaged, READ}));
        ASSERT_EQ(got.fresh, 1) << at;
        ASSERT_GT(got.errors, 0) << at;
        ASSERT_EQ(got.sequences.back(), 41) << at;
    }
}

TEST(CommandParser, AFrameOfAnotherLengthIsRejected) {
    Bytes longer = READ;
    longer[5] = 9;
    longer.insert(longer.begin() + 10, 0);
    const Parsed got = parse(joined({longer, READ}));
    EXPECT_EQ(got.fresh, 1);
    EXPECT_EQ(got.errors, static_cast<int>(longer.size()));
}

TEST(CommandParser, AnUnknownIdIsAcknowledgedButNotExecuted) {
    for (const std::uint32_t id :
         {0x10000u + TELEMETRY_PARAM_READ_ID, 0x01000000u + TELEMETRY_PARAM_READ_ID}) {
        const Parsed got = parse(frame_of(id, {7, 0, 0, 0, 0, 0, 41}));
        ASSERT_EQ(got.results, std::vector<int>{TELEMETRY_ACK_RESULT_UNKNOWN_ID}) << id;
        EXPECT_EQ(got.fresh, 0);
    }
}

TEST(CommandParser, ABadCrcIsAcknowledgedWithItsSequence) {
    Bytes damaged = READ;
    damaged[17] ^= 1;
    const Parsed got = parse(damaged);
    EXPECT_EQ(got.results, std::vector<int>{TELEMETRY_ACK_RESULT_BAD_CRC});
    EXPECT_EQ(got.sequences, std::vector<int>{41});
}

TEST(CommandParser, AStepExaminesFewBytes) {
    CommandParser parser{};
    Command command{};
    Bytes starts(18, 0xAA);  // each may start a frame until its length byte
    starts[5] = 8;
    starts.push_back(0);  // wrong end byte
    for (const std::uint8_t byte : starts)
        command_byte(&parser, byte);
    int steps = 0, last = parser.count;
    for (; !command_reading(&parser); ++steps, last = parser.count) {
        EXPECT_FALSE(command_step(&parser, &command));
        ASSERT_LE(last - parser.count, 4);
    }
    EXPECT_GT(steps, 1);
}

}  // namespace
