// Rows of one parameter set by exact affine maps.
#define VGROOVE_PARTS_CLONED
#include "drivetrain/exact_rows.hpp"
#include "drivetrain/run_rows.hpp"

namespace vgroove {

VGROOVE_CLONES static void run_blocks(Group<double, STATE_CORE_COUNT> &g, const LogInput &in,
                                      const LogStarts &starts, const LogOutput &out) {
    run_exact_rows(g, in, starts, out);
}

void run_exact(Group<double, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &starts,
               const LogOutput &out) {
    run_blocks(g, in, starts, out);
}

}  // namespace vgroove
