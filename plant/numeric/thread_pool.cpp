// The thread pool of the plant: pieces of work in increasing order, the first exception kept.
#include "numeric/thread_pool.hpp"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace vgroove {

constexpr std::chrono::milliseconds CHECK_INTERVAL{50};

namespace {

struct Pool {
    std::size_t count;
    const std::function<void(std::size_t)> &work;
    std::mutex lock;
    std::condition_variable finished;
    std::size_t next = 0, failed;  // first piece not yet started; lowest piece that threw
    std::exception_ptr failure;
    int running = 0;  // threads beside the caller's

    bool take(std::size_t &piece) {
        const std::lock_guard<std::mutex> held(lock);
        piece = next;
        return next < count && ++next;
    }

    void fail(std::size_t piece) {
        const std::lock_guard<std::mutex> held(lock);
        next = count;
        if (!failure || piece < failed) {
            failure = std::current_exception();
            failed = piece;
        }
    }

    void run() {
        for (std::size_t piece = 0; take(piece);) {
            try {
                work(piece);
            } catch (...) {
                fail(piece);
            }
        }
    }

    void run_in_thread() {
        run();
        const std::lock_guard<std::mutex> held(lock);
        --running;
        finished.notify_all();
    }
};

// Waits for the other threads. Meanwhile the caller's thread keeps checking for cancellation; the
// other threads end at their own next check.
void wait_for_threads(Pool &pool, Cancellation *cancellation) {
    std::unique_lock<std::mutex> held(pool.lock);
    while (!pool.finished.wait_for(held, CHECK_INTERVAL, [&] { return pool.running == 0; })) {
        held.unlock();
        try {
            if (cancellation)
                cancellation->check();
        } catch (...) {
            pool.fail(pool.count);
        }
        held.lock();
    }
}

}  // namespace

void run_parallel(std::size_t count, int threads, Cancellation *cancellation,
                  const std::function<void(std::size_t)> &work) {
    Pool pool{count, work, {}, {}, 0, count, nullptr, 0};
    std::vector<std::thread> others;
    for (int n = 1; n < threads && static_cast<std::size_t>(n) < count; ++n) {
        try {
            const std::lock_guard<std::mutex> held(pool.lock);
            others.emplace_back([&] { pool.run_in_thread(); });
            ++pool.running;
        } catch (const std::system_error &) {  // the system has no more threads: go on with these
            break;
        }
    }
    pool.run();
    wait_for_threads(pool, cancellation);
    for (std::thread &other : others)
        other.join();
    if (pool.failure)
        std::rethrow_exception(pool.failure);
}

}  // namespace vgroove
