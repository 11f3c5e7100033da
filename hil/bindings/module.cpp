// vgroove._core: the plant and the native firmware as a Python module.
#include <nanobind/nanobind.h>
#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstdlib>
#include <new>

#include "bindings.hpp"

constexpr std::size_t PAGE_BYTES = std::size_t{2} << 20;          // a large page
constexpr std::size_t LARGE_BLOCK_BYTES = std::size_t{16} << 20;  // shorter blocks are reused

ColumnBlock column_block(std::size_t count) {
    const std::size_t bytes = (count * sizeof(double) / PAGE_BYTES + 1) * PAGE_BYTES;
    const bool large = count * sizeof(double) >= LARGE_BLOCK_BYTES;
    void *data = large ? std::aligned_alloc(PAGE_BYTES, bytes)
                       : std::malloc(count * sizeof(double) + sizeof(double));
    if (!data)
        throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
    if (large)
        madvise(data, bytes, MADV_HUGEPAGE);  // where it fails, pages are small
#endif
    return {static_cast<double *>(data),
            nanobind::capsule(data, [](void *p) noexcept { std::free(p); })};
}

NB_MODULE(_core, m) {
    m.doc() = "Plant and native firmware of vgroove.";
    bind_plant(m);
    bind_drill(m);
    bind_joints(m);
#ifdef VGROOVE_WITH_FIRMWARE
    bind_firmware(m);
    bind_lockstep(m);
#endif
}
