// Cancellation of a run: its caller is asked at intervals, and a flag ends all its threads.
#include "numeric/cancellation.hpp"

namespace vgroove {

constexpr std::chrono::milliseconds REQUEST_INTERVAL{50};

void Cancellation::check() {
    if (std::this_thread::get_id() == thread_ && !ended_.load(std::memory_order_relaxed)) {
        const auto now = std::chrono::steady_clock::now();
        if (now - asked_ >= REQUEST_INTERVAL) {
            asked_ = now;
            ended_ = requested();
        }
    }
    if (ended_.load(std::memory_order_relaxed))
        throw Cancelled{};
}

}  // namespace vgroove
