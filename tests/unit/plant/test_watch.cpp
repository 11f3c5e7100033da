// Long runs: what a pool's parts throw comes out the same whatever the threads, a run may be ended,
// and one that does not come forward ends itself.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "plant/impact/log.hpp"
#include "plant/numeric/watch.hpp"
#include "reference_tool.hpp"

using namespace vgroove;

// Wants the end from the `after`-th question on.
struct Impatient final : Watch {
    int after, asked = 0;
    explicit Impatient(int n) : after(n) {}
    bool wants_end() override { return ++asked >= after; }
};

TEST(SharedWork, DoesEveryPartOnce) {
    for (const int threads : {0, 1, 2, 8}) {
        std::vector<std::atomic<int>> done(100);
        share_work(done.size(), threads, nullptr, [&](std::size_t n) { ++done[n]; });
        for (const std::atomic<int> &times : done)
            EXPECT_EQ(times, 1);
    }
    share_work(0, 4, nullptr, [](std::size_t) { FAIL(); });
}

TEST(SharedWork, TheLowestPartThatFailsIsHeard) {
    for (int round = 0; round < 20; ++round)
        try {
            share_work(8, 4, nullptr, [](std::size_t n) {
                if (n == 2)
                    std::this_thread::sleep_for(std::chrono::milliseconds(2));
                if (n >= 2)
                    throw std::runtime_error(std::to_string(n));
            });
            FAIL();
        } catch (const std::runtime_error &error) {
            EXPECT_STREQ(error.what(), "2");
        }
}

TEST(SharedWork, EndsInAllThreadsWhenTheCallerWantsIt) {
    for (const int threads : {1, 3}) {
        Impatient watch(1);
        EXPECT_THROW(share_work(3, threads, &watch,
                                [&](std::size_t) {
                                    for (;;)
                                        watch.look();
                                }),
                     Interrupted);
        EXPECT_EQ(watch.asked, 1);
    }
}

TEST(SharedWork, ACallerWithNothingLeftToDoStillEndsIt) {
    Impatient watch(2);
    EXPECT_THROW(share_work(2, 2, &watch,
                            [&](std::size_t n) {
                                while (n == 1)
                                    watch.look();
                            }),
                 Interrupted);
}

static LogInput full_trigger(std::size_t rows, double row_s) {
    LogInput in;
    for (std::size_t row = 0; row < rows; ++row)
        in.time_s.push_back(row_s * static_cast<double>(row));
    const std::vector<double> duty(rows, 1.0);
    log_input_set_command(in, duty.data(), std::nan(""), 0.0);
    in.load_kind = LoadKind::LOCKED;
    return in;
}

static void simulate(const std::vector<Parameters> &tools, double row_s, ImpactAccuracy accuracy,
                     int threads, Watch *watch) {
    const std::size_t rows = 100;
    std::vector<double> columns(IMPACT_COLUMN_COUNT * tools.size() * rows);
    ImpactOutput out{};
    for (std::size_t n = 0; n < IMPACT_COLUMN_COUNT; ++n)
        out.columns[n] = columns.data() + n * tools.size() * rows;
    out.watch = watch;
    simulate_impact(full_trigger(rows, row_s), reinterpret_cast<const double *>(tools.data()),
                    tools.size(), accuracy, threads, out);
}

static std::string refusal(const std::vector<Parameters> &tools, ImpactAccuracy accuracy,
                           int threads) {
    try {
        simulate(tools, 1e-3, accuracy, threads, nullptr);
    } catch (const std::exception &error) {
        return error.what();
    }
    return "";
}

TEST(ImpactRun, ABatchNamesItsImpossibleTool) {
    std::vector<Parameters> tools(5, reference_tool());
    tools[3].lug_overlap_rad = 3.2;
    tools[4].hammer_mass_kg = 0.0;
    for (const int threads : {1, 3}) {
        EXPECT_EQ(refusal(tools, ImpactAccuracy::FAST, threads)
                      .rfind("parameter set 3: mechanism.lug_overlap_rad 3.2 leaves no gap", 0),
                  0u);
        EXPECT_EQ(refusal({tools[3]}, ImpactAccuracy::FAST, threads)
                      .rfind("mechanism.lug_overlap_rad 3.2", 0),
                  0u);
    }
}

TEST(ImpactRun, OneThatDoesNotComeForwardEndsWithTheParameterBehindIt) {
    std::vector<Parameters> tools(2, reference_tool());
    tools[1].joint_damping = 1e6;  // 8e10 per s
    for (const ImpactAccuracy accuracy : {ImpactAccuracy::FAST, ImpactAccuracy::REFERENCE}) {
        const std::string words = refusal(tools, accuracy, 1);
        EXPECT_EQ(words.rfind("parameter set 1: impact mechanism: needs too many steps at 0.", 0),
                  0u)
            << words;
        EXPECT_NE(words.find("load.damping_nm_s_per_rad = 1e+06"), std::string::npos) << words;
    }
}

TEST(ImpactRun, EndsWhenTheCallerWantsIt) {
    for (const ImpactAccuracy accuracy :
         {ImpactAccuracy::FAST, ImpactAccuracy::REFERENCE, ImpactAccuracy::FIXED}) {
        Impatient watch(2);
        const auto began = std::chrono::steady_clock::now();
        EXPECT_THROW(simulate({reference_tool()}, 1e3, accuracy, 1, &watch),
                     Interrupted);  // 100,000 s
        EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(20));
    }
}
