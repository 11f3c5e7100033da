// Cancellation of long runs: the caller of a run may ask for its end while the run is in progress.
#ifndef VGROOVE_PLANT_NUMERIC_CANCELLATION_HPP
#define VGROOVE_PLANT_NUMERIC_CANCELLATION_HPP

#include <atomic>
#include <chrono>
#include <thread>

namespace vgroove {

// Thrown out of a run whose end has been requested.
struct Cancelled {};

// A run calls check() every so many steps, from any of its threads. The caller's requested() is
// called only in the thread that made this object, every 50 ms; a Python signal handler needs that.
class Cancellation {
public:
    Cancellation()
        : thread_(std::this_thread::get_id()),
          asked_(std::chrono::steady_clock::now()) {}
    virtual ~Cancellation() = default;
    Cancellation(const Cancellation &) = delete;
    Cancellation &operator=(const Cancellation &) = delete;

    void check();  // throws Cancelled once the end has been requested

private:
    virtual bool requested() = 0;

    std::thread::id thread_;
    std::chrono::steady_clock::time_point asked_;
    std::atomic<bool> ended_{false};
};

}  // namespace vgroove

#endif
