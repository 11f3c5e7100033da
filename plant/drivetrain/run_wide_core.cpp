// Rows of eight parameter sets at once by the solver with error control, core states alone;
// run_wide_full.cpp has all states. Two source files are compiled in parallel.
#define VGROOVE_PARTS_CLONED
#include "drivetrain/run_rows.hpp"

namespace vgroove {

VGROOVE_CLONES static void wide_core(Group<Lanes8, STATE_CORE_COUNT> &g, const LogInput &in,
                                     const LogStarts &starts, const LogOutput &out) {
    run_group(g, in, starts, out);
}

void run_rows(Group<Lanes8, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out) {
    wide_core(g, in, starts, out);
}

}  // namespace vgroove
