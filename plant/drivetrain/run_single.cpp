// Rows of one parameter set by the solver with error control.
#include "drivetrain/run_rows.hpp"

namespace vgroove {

__attribute__((flatten)) void run_rows(Group<double, STATE_CORE_COUNT> &g, const LogInput &in,
                                       const LogStarts &starts, const LogOutput &out) {
    g.solver.exact ? run_exact(g, in, starts, out) : run_group(g, in, starts, out);
}

__attribute__((flatten)) void run_rows(Group<double, STATE_FULL_COUNT> &g, const LogInput &in,
                                       const LogStarts &starts, const LogOutput &out) {
    run_group(g, in, starts, out);
}

__attribute__((flatten)) void run_rows(Group<double, STATE_AUDIT_COUNT> &g, const LogInput &in,
                                       const LogStarts &starts, const LogOutput &out) {
    run_group(g, in, starts, out);
}

}  // namespace vgroove
