// Replay of a log: the native firmware is run on the measured inputs in the rows of the log, from
// the start of the board on, and its outputs are compared with the logged ones. The result is the
// first row at which they differ, if any.
//
// A row contains current, speed and bus voltage of its tick exactly, but not three further inputs:
// the trigger between two STATE frames, the contact of the trigger, and the number of Hall edges in
// the tick. The replay follows all possible values of these: it keeps every firmware state that
// they can lead to, and drops those whose outputs differ from the row (set-membership estimation).
#ifndef VGROOVE_HIL_LOG_REPLAY_HPP
#define VGROOVE_HIL_LOG_REPLAY_HPP

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace replay {

constexpr int UNKNOWN = -1;

// A row of the log, one tick. Trigger and state are UNKNOWN where the log has no value.
struct Row {
    int compare;  // applied in the tick; MEASURED_COAST: bridge open
    int current_a_q9;
    int speed_rpm_q1;
    int supply_mv;
    int trigger;
    int state;
};

struct Options {
    std::size_t most = 2048;  // states that are kept
    int spread = 1;           // of the trigger about an even motion between two frames, 1/255
    int hall_pulses = 4;      // edges a turn
};

struct Result {
    int row;             // first row that no state gives; the number of rows: none
    std::string signal;  // that differs there: duty or state; empty: none
    int expected;        // value of the firmware that agreed longest
    bool complete;       // no state was left out for `most`
};

Result replay_log(const std::vector<Row> &rows, const std::string &eeprom, const Options &options);

}  // namespace replay

#endif
