// Rows of eight parameter sets at once by the solver with error control, all states. A separate
// source file, so that both variants can be compiled at the same time.
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
