// A chunk of PWM periods of firmware and tool in lock-step, both in this process; the same bytes as
// vgroove.lockstep._run_chunk.
#ifndef VGROOVE_HIL_LOCKSTEP_HPP
#define VGROOVE_HIL_LOCKSTEP_HPP

#include <cstddef>
#include <cstdint>
#include <exception>
#include <string>
#include <vector>

#include "firmware.hpp"
#include "plant/lockstep/drill_plant.hpp"
#include "plant/lockstep/drive_plant.hpp"
#include "plant/lockstep/impact_plant.hpp"

constexpr int COMPARE_TOP = 255;
constexpr double ADC_COUNTS = 1024.0;
constexpr std::int16_t NO_BYTE = -1;

// Stimuli of a chunk of periods, one value a period, and the scales of the front ends
struct LockstepInputs {
    const std::int64_t *trigger, *switches;                  // counts; bits of SimInputs
    const double *load_nm, *current_counts, *supply_counts;  // counts added to current and bus
    const bool *broken;            // the Hall line is interrupted: no edges
    const std::int16_t *received;  // byte to the board or NO_BYTE
    std::size_t periods;
    double per_ampere, per_volt;  // counts per A and V
    int temperature;              // counts
};

struct LockstepGates {
    bool coast;
    int compare, dead_counts;
};

enum TruthColumn {
    TRUTH_TIME,
    TRUTH_CURRENT,
    TRUTH_SPEED,
    TRUTH_HAMMER,
    TRUTH_HEAD,
    TRUTH_JOINT,
    TRUTH_HOUSING,
    TRUTH_DUTY,
    TRUTH_COLUMN_COUNT,
};
constexpr const char *TRUTH_COLUMN_NAMES[TRUTH_COLUMN_COUNT] = {
    "time_s",   "current_a", "speed_rad_s", "hammer_mm",
    "head_rad", "joint_nm",  "housing_nm",  "duty"};

// True values of the tool, a row every `every` periods: values at the row's end, the housing
// reaction as mean over it, NaN for the duty of an open bridge
struct Truth {
    std::size_t every = 1, periods = 0;  // periods per row; periods since the last row
    double housing_sum = 0.0;
    std::vector<double> rows;
};

void truth_note(Truth &truth, const vgroove::ImpactPlant &tool, const LockstepGates &gates);
void truth_note(Truth &truth, const vgroove::DrivePlant &tool, const LockstepGates &gates);
// head_rad is the angle of the chuck, joint_nm the torque of the shaft.
void truth_note(Truth &truth, const vgroove::DrillPlant &tool, const LockstepGates &gates);

// Message to the board for one period
SimInputs lockstep_message(const LockstepInputs &in, std::size_t at,
                           const vgroove::PeriodResult &tool);

double lockstep_dead(const LockstepGates &gates);
LockstepGates lockstep_gates(const SimOutputs &outputs);

// One period of the tool with the gates in force in it
template <class Tool>
vgroove::PeriodResult lockstep_tool_period(Tool &tool, const LockstepGates &gates, double load_nm) {
    return tool.period(gates.coast, gates.compare / static_cast<double>(COMPARE_TOP),
                       lockstep_dead(gates), load_nm);
}

// Messages to the board for `count` periods from period `from` of the chunk on, fewer at its end,
// if the gates stay as they are. A copy of the tool is advanced, the tool itself stays where it is.
// A period that the tool cannot compute ends the messages; if it is the first, its exception is
// passed on.
template <class Tool>
std::vector<SimInputs> lockstep_ahead(const Tool &tool, const LockstepInputs &in,
                                      const LockstepGates &gates, std::size_t from,
                                      std::size_t count) {
    std::vector<SimInputs> messages;
    Tool ahead(tool);
    for (std::size_t at = from; at < in.periods && messages.size() < count; ++at) {
        try {
            messages.push_back(
                lockstep_message(in, at, lockstep_tool_period(ahead, gates, in.load_nm[at])));
        } catch (const std::exception &) {
            if (messages.empty())
                throw;
            break;
        }
    }
    return messages;
}

// Runs the chunk; returns the bytes that the board sent. truth may be null.
template <class Tool>
std::string lockstep_run(Firmware &board, Tool &tool, const LockstepInputs &in, LockstepGates gates,
                         Truth *truth) {
    std::string sent;
    for (std::size_t at = 0; at < in.periods; ++at) {
        const SimInputs message =
            lockstep_message(in, at, lockstep_tool_period(tool, gates, in.load_nm[at]));
        if (truth)
            truth_note(*truth, tool, gates);
        sim_period(&message, &board.outputs);
        if (board.keeps_tape) {
            board.tape.append(reinterpret_cast<const char *>(&message), sizeof message);
            board.given.append(reinterpret_cast<const char *>(&board.outputs),
                               sizeof board.outputs);
        }
        gates = lockstep_gates(board.outputs);
        sent.append(reinterpret_cast<const char *>(board.outputs.tx), board.outputs.tx_count);
    }
    return sent;
}

#endif
