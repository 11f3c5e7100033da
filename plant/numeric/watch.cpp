// The plant's one pool of threads, and the question whether a run is still wanted.
#include "numeric/watch.hpp"

#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <vector>

namespace vgroove {

constexpr std::chrono::milliseconds ASKED_EVERY{50};

void Watch::look() {
    if (std::this_thread::get_id() == thread_ && !ended_.load(std::memory_order_relaxed)) {
        const auto now = std::chrono::steady_clock::now();
        if (now - asked_ >= ASKED_EVERY) {
            asked_ = now;
            ended_ = wants_end();
        }
    }
    if (ended_.load(std::memory_order_relaxed))
        throw Interrupted{};
}

namespace {

struct Pool {
    std::size_t count;
    const std::function<void(std::size_t)> &work;
    std::mutex lock;
    std::condition_variable finished;
    std::size_t next = 0, failed;  // parts taken; the lowest that failed
    std::exception_ptr failure;
    int running = 0;

    bool take(std::size_t &part) {
        const std::lock_guard<std::mutex> held(lock);
        part = next;
        return next < count && ++next;
    }

    void fail(std::size_t part) {
        const std::lock_guard<std::mutex> held(lock);
        next = count;
        if (!failure || part < failed) {
            failure = std::current_exception();
            failed = part;
        }
    }

    void run() {
        for (std::size_t part = 0; take(part);) {
            try {
                work(part);
            } catch (...) {
                fail(part);
            }
        }
    }

    void help() {
        run();
        const std::lock_guard<std::mutex> held(lock);
        --running;
        finished.notify_all();
    }
};

// Until all helpers have ended; the caller may still end the run, the helpers hear of it at their
// next look.
void await(Pool &pool, Watch *watch) {
    std::unique_lock<std::mutex> held(pool.lock);
    while (!pool.finished.wait_for(held, ASKED_EVERY, [&] { return pool.running == 0; })) {
        held.unlock();
        try {
            if (watch)
                watch->look();
        } catch (...) {
            pool.fail(pool.count);
        }
        held.lock();
    }
}

}  // namespace

void share_work(std::size_t count, int threads, Watch *watch,
                const std::function<void(std::size_t)> &work) {
    Pool pool{count, work, {}, {}, 0, count, nullptr, 0};
    std::vector<std::thread> helpers;
    for (int n = 1; n < threads && static_cast<std::size_t>(n) < count; ++n) {
        try {
            const std::lock_guard<std::mutex> held(pool.lock);
            helpers.emplace_back([&] { pool.help(); });
            ++pool.running;
        } catch (const std::system_error &) {  // no more threads: the others do it
            break;
        }
    }
    pool.run();
    await(pool, watch);
    for (std::thread &helper : helpers)
        helper.join();
    if (pool.failure)
        std::rethrow_exception(pool.failure);
}

}  // namespace vgroove
