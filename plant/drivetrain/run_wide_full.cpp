// Rows of eight parameter sets at once by the solver with error control, all states;
// run_wide_core.cpp has the core states alone. Two source files are compiled in parallel.
#define VGROOVE_PARTS_CLONED
#include "drivetrain/run_rows.hpp"

namespace vgroove {

VGROOVE_CLONES static void wide_full(Group<Lanes8, STATE_FULL_COUNT> &g, const LogInput &in,
                                     const LogStarts &starts, const LogOutput &out) {
    run_group(g, in, starts, out);
}

void run_rows(Group<Lanes8, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out) {
    wide_full(g, in, starts, out);
}

}  // namespace vgroove
