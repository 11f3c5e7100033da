// Long runs: whoever waits for one may end it, and work that consists of independent parts shares
// the processor's cores.
#ifndef VGROOVE_PLANT_NUMERIC_WATCH_HPP
#define VGROOVE_PLANT_NUMERIC_WATCH_HPP

#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <thread>

namespace vgroove {

// What a run ends with when its caller no longer wants it.
struct Interrupted {};

// Asked by the run every so many steps, by any of its threads; the caller is asked in the thread
// that made the watch, every 50 ms.
class Watch {
public:
    Watch() : thread_(std::this_thread::get_id()), asked_(std::chrono::steady_clock::now()) {}
    virtual ~Watch() = default;
    Watch(const Watch &) = delete;
    Watch &operator=(const Watch &) = delete;

    void look();  // throws Interrupted

private:
    virtual bool wants_end() = 0;  // by the caller, in its own thread

    std::thread::id thread_;
    std::chrono::steady_clock::time_point asked_;
    std::atomic<bool> ended_{false};
};

// work(n) for n from 0 to before `count` on at most `threads` threads, the caller's among them.
// Parts begin in their order; what the lowest that fails throws comes out, the same whatever the
// threads.
void share_work(std::size_t count, int threads, Watch *watch,
                const std::function<void(std::size_t)> &work);

}  // namespace vgroove

#endif
