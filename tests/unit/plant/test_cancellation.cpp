// Thread pool and cancellation: the exception that a pool rethrows does not depend on the
// number of threads, a run can be cancelled, and a run that needs too many steps ends by itself.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "plant/impact/log.hpp"
#include "plant/numeric/thread_pool.hpp"
#include "reference_tool.hpp"

using namespace vgroove;

// Requests the end from a given call of requested() on, counted from 1.
struct RequestFromCall final : Cancellation {
    int first, calls = 0;
    explicit RequestFromCall(int n) : first(n) {}
    bool requested() override { return ++calls >= first; }
};

TEST(ThreadPool, RunsEveryPieceOnce) {
    for (const int threads : {0, 1, 2, 8}) {
        std::vector<std::atomic<int>> done(100);
        run_parallel(done.size(), threads, nullptr, [&](std::size_t n) { ++done[n]; });
        for (const std::atomic<int> &times : done)
            EXPECT_EQ(times, 1);
    }
    run_parallel(0, 4, nullptr, [](std::size_t) { FAIL(); });
}

TEST(ThreadPool, RethrowsTheExceptionOfTheLowestPiece) {
    for (int round = 0; round < 20; ++round)
        try {
            run_parallel(8, 4, nullptr, [](std::size_t n) {
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

TEST(ThreadPool, IsCancelledInAllThreads) {
    for (const int threads : {1, 3}) {
        RequestFromCall cancellation(1);
        EXPECT_THROW(run_parallel(3, threads, &cancellation,
                                  [&](std::size_t) {
                                      for (;;)
                                          cancellation.check();
                                  }),
                     Cancelled);
        EXPECT_EQ(cancellation.calls, 1);
    }
}

TEST(ThreadPool, IsCancelledByACallerWithoutWork) {
    RequestFromCall cancellation(2);
    EXPECT_THROW(run_parallel(2, 2, &cancellation,
                              [&](std::size_t n) {
                                  while (n == 1)
                                      cancellation.check();
                              }),
                 Cancelled);
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
                     int threads, Cancellation *cancellation) {
    const std::size_t rows = 100;
    std::vector<double> columns(IMPACT_COLUMN_COUNT * tools.size() * rows);
    ImpactOutput out{};
    for (std::size_t n = 0; n < IMPACT_COLUMN_COUNT; ++n)
        out.columns[n] = columns.data() + n * tools.size() * rows;
    out.cancellation = cancellation;
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

TEST(ImpactRun, AnImpossibleToolOfABatchIsNamed) {
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

TEST(ImpactRun, TooManyStepsNameTheParameterBehindThem) {
    std::vector<Parameters> tools(2, reference_tool());
    tools[1].load.damping_nm_s_per_rad = 1e6;  // over the anvil's inertia: a rate of 8e10 per s
    for (const ImpactAccuracy accuracy : {ImpactAccuracy::FAST, ImpactAccuracy::REFERENCE}) {
        const std::string message = refusal(tools, accuracy, 1);
        EXPECT_EQ(message.rfind("parameter set 1: impact mechanism: needs too many steps at 0.", 0),
                  0u)
            << message;
        EXPECT_NE(message.find("load.damping_nm_s_per_rad = 1e+06"), std::string::npos) << message;
    }
}

TEST(ImpactRun, IsCancelled) {
    for (const ImpactAccuracy accuracy :
         {ImpactAccuracy::FAST, ImpactAccuracy::REFERENCE, ImpactAccuracy::FIXED}) {
        RequestFromCall cancellation(2);
        const auto began = std::chrono::steady_clock::now();
        EXPECT_THROW(simulate({reference_tool()}, 1e3, accuracy, 1, &cancellation),
                     Cancelled);  // 100,000 s
        EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(20));
    }
}
