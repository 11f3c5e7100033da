// Distribution of independent pieces of work over threads.
#ifndef VGROOVE_PLANT_NUMERIC_THREAD_POOL_HPP
#define VGROOVE_PLANT_NUMERIC_THREAD_POOL_HPP

#include <cstddef>
#include <functional>

#include "numeric/cancellation.hpp"

namespace vgroove {

// Calls work(n) once for each n from 0 to count - 1, on at most `threads` threads including the
// caller's. Pieces are started in increasing order. When pieces throw, the exception of the lowest
// one is rethrown, so that the outcome does not depend on the number of threads. cancellation may
// be null.
void run_parallel(std::size_t count, int threads, Cancellation *cancellation,
                  const std::function<void(std::size_t)> &work);

}  // namespace vgroove

#endif
