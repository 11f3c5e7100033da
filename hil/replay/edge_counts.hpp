// Number of Hall edges in each tick, from the speed column of a log.
//
// At a tick with an edge the firmware computes the speed from the time since the edge before (the
// period). Until the next edge the speed stays, and then falls with the time since the last edge
// (its age). Each row therefore bounds period and age by intervals. The numbers of edges that agree
// with the intervals of all rows remain, in a pass over the rows forward and one backward.
#ifndef VGROOVE_HIL_EDGE_COUNTS_HPP
#define VGROOVE_HIL_EDGE_COUNTS_HPP

#include <cstdint>
#include <vector>

namespace replay {

struct SpeedRow {
    int speed_rpm_q1;
    bool driven;  // the bridge drives in the tick: a resting shaft may begin to turn
};

// Possible numbers of edges of each row, with `pulses` edges a turn at equal pitches. The shaft
// stands before the first row.
std::vector<std::vector<std::uint8_t>> edge_counts(const std::vector<SpeedRow> &rows, int pulses);

}  // namespace replay

#endif
