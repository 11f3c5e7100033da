// Number of Hall edges in each tick from the column of the speed.
//
// The speed of a tick with an edge is one pitch over the last period, so that it states the time
// between two edges; while no edge follows, the speed falls with the age of the last edge. Both
// bound the age of the last edge at each tick. All numbers of edges whose ages agree with the
// speeds of all rows remain (interval filter, forward and backward).
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
