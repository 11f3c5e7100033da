// Loops over the rows of a log, each compiled for one number of lanes and states.
#ifndef VGROOVE_PLANT_DRIVETRAIN_RUN_ROWS_HPP
#define VGROOVE_PLANT_DRIVETRAIN_RUN_ROWS_HPP

#include "drivetrain/rows.hpp"

namespace vgroove {

void run_rows(Group<Lanes8, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out);
void run_rows(Group<Lanes8, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out);
void run_rows(Group<double, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out);
void run_rows(Group<double, STATE_FULL_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out);
void run_rows(Group<double, STATE_AUDIT_COUNT> &g, const LogInput &in, const LogStarts &starts,
              const LogOutput &out);
void run_exact(Group<double, STATE_CORE_COUNT> &g, const LogInput &in, const LogStarts &starts,
               const LogOutput &out);

}  // namespace vgroove

#endif
