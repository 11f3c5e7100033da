// Python binding of the lock-step in C++: a chunk of stimuli, run_lockstep with the native
// firmware, look_ahead and advance_tool with a board in another process, and Truth, the record of
// the tool's true values.
#include "lockstep.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "bindings.hpp"

namespace nb = nanobind;
using namespace nb::literals;

double lockstep_dead(const LockstepGates &gates) {
    const int share = gates.compare < 0 ? -gates.compare : gates.compare;
    return share > 0 && share < COMPARE_TOP
               ? gates.dead_counts / static_cast<double>(2 * COMPARE_TOP)
               : 0.0;
}

LockstepGates lockstep_gates(const SimOutputs &outputs) {
    return {outputs.coast != 0, outputs.compare, outputs.dead_counts};
}

static std::uint16_t counts_of(double value) {
    if (!(value >= 0.0))
        return 0;
    return static_cast<std::uint16_t>(value >= ADC_COUNTS ? ADC_COUNTS - 1.0 : value);
}

SimInputs lockstep_message(const LockstepInputs &in, std::size_t at,
                           const vgroove::PeriodResult &tool) {
    SimInputs message{};
    message.adc_counts[SIM_ADC_CURRENT] =
        counts_of(tool.current_a * in.per_ampere + in.current_counts[at]);
    message.adc_counts[SIM_ADC_BUS] = counts_of(tool.supply_v * in.per_volt + in.supply_counts[at]);
    message.adc_counts[SIM_ADC_TRIGGER] = static_cast<std::uint16_t>(in.trigger[at]);
    message.adc_counts[SIM_ADC_TEMPERATURE] = static_cast<std::uint16_t>(in.temperature);
    message.edge_count = static_cast<std::uint8_t>(in.broken[at] ? 0 : tool.edge_count);
    for (int n = 0; n < message.edge_count; ++n)
        message.edge_cycle[n] = static_cast<std::uint16_t>(tool.edge_cycle[n]);
    message.switches = static_cast<std::uint8_t>(in.switches[at]);
    if (in.received[at] != NO_BYTE) {
        message.rx[0] = static_cast<std::uint8_t>(in.received[at]);
        message.rx_count = 1;
    }
    return message;
}

static void truth_row(Truth &truth, const LockstepGates &gates, double time_s, double current_a,
                      double speed_rad_s, const vgroove::AdvanceResult &mechanism) {
    truth.housing_sum += mechanism.housing_nm;
    if (++truth.periods < truth.every)
        return;
    const double duty = gates.coast ? std::numeric_limits<double>::quiet_NaN()
                                    : gates.compare / static_cast<double>(COMPARE_TOP);
    const double row[TRUTH_COLUMN_COUNT] = {time_s,
                                            current_a,
                                            speed_rad_s,
                                            mechanism.hammer_mm,
                                            mechanism.head_rad,
                                            mechanism.anvil_torque_nm,
                                            truth.housing_sum / static_cast<double>(truth.periods),
                                            duty};
    truth.rows.insert(truth.rows.end(), row, row + TRUTH_COLUMN_COUNT);
    truth.periods = 0;
    truth.housing_sum = 0.0;
}

void truth_note(Truth &truth, const vgroove::ImpactPlant &tool, const LockstepGates &gates) {
    const vgroove::AdvanceResult now = tool.period_end();
    truth_row(truth, gates, tool.time_s(), now.current_a, now.speed_rad_s, now);
}

void truth_note(Truth &truth, const vgroove::DrivePlant &tool, const LockstepGates &gates) {
    truth_row(truth, gates, tool.time_s(), tool.current_a(), tool.speed_rad_s(), {});
}

void truth_note(Truth &truth, const vgroove::DrillPlant &tool, const LockstepGates &gates) {
    const vgroove::DrillSystem &s = tool.system();
    vgroove::AdvanceResult chuck{};
    chuck.head_rad = s.sums[vgroove::DRILL_CHUCK_ANGLE];
    chuck.anvil_torque_nm = tool.shaft_nm();
    truth_row(truth, gates, tool.time_s(), s.x[vgroove::DRILL_CURRENT], s.x[vgroove::DRILL_SPEED],
              chuck);
}

namespace {

template <class T>
using PeriodColumn = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T> const T *values_of(const PeriodColumn<T> &column, std::size_t periods) {
    if (column.shape(0) != periods)
        throw std::invalid_argument("Stimuli: every column has one value a period");
    return column.data();
}

using Front = std::tuple<double, double, int>;  // counts per A and V, temperature counts
using Gates = std::tuple<bool, int, int>;       // coast, compare, dead_counts

LockstepGates gates_of(const Gates &gates) {
    return {std::get<0>(gates), std::get<1>(gates), std::get<2>(gates)};
}

// The stimuli of a chunk; keeps the arrays of its columns alive.
struct Stimuli {
    PeriodColumn<std::int64_t> trigger, switches;
    PeriodColumn<double> load_nm, current_counts, supply_counts;
    PeriodColumn<bool> broken;
    PeriodColumn<std::int16_t> received;
    Front front;

    LockstepInputs inputs() const {
        const std::size_t periods = trigger.shape(0);
        return {trigger.data(),
                values_of(switches, periods),
                values_of(load_nm, periods),
                values_of(current_counts, periods),
                values_of(supply_counts, periods),
                values_of(broken, periods),
                values_of(received, periods),
                periods,
                std::get<0>(front),
                std::get<1>(front),
                std::get<2>(front)};
    }
};

template <class Tool>
nb::bytes run(Firmware &board, Tool &tool, const Stimuli &stimuli, const Gates &gates,
              Truth *truth) {
    need_owner(board);
    const LockstepInputs in = stimuli.inputs();
    std::string sent;
    {
        const FirmwareHold hold(board);
        nb::gil_scoped_release unlocked;
        sent = lockstep_run(board, tool, in, gates_of(gates), truth);
    }
    return nb::bytes(sent.data(), sent.size());
}

template <class Tool>
nb::bytes look_ahead(const Tool &tool, const Stimuli &stimuli, const Gates &gates, std::size_t from,
                     std::size_t count) {
    const std::vector<SimInputs> messages =
        lockstep_ahead(tool, stimuli.inputs(), gates_of(gates), from, count);
    return nb::bytes(reinterpret_cast<const char *>(messages.data()),
                     messages.size() * sizeof(SimInputs));
}

template <class Tool>
void advance_tool(Tool &tool, const Stimuli &stimuli, const Gates &gates, std::size_t from,
                  std::size_t count, Truth *truth) {
    const LockstepInputs in = stimuli.inputs();
    const LockstepGates in_force = gates_of(gates);
    for (std::size_t at = from; at < in.periods && at < from + count; ++at) {
        lockstep_tool_period(tool, in_force, in.load_nm[at]);
        if (truth)
            truth_note(*truth, tool, in_force);
    }
}

template <class Tool> void bind_run(nb::module_ &m) {
    m.def("run_lockstep", &run<Tool>, "firmware"_a, "tool"_a, "stimuli"_a, "gates"_a,
          "truth"_a.none() = nb::none(),
          "Runs a chunk of lock-step. gates: coast, compare, dead_counts in force in the first "
          "period. Returns the bytes sent;\nthe firmware holds the gates of the next period.");
    m.def("look_ahead", &look_ahead<Tool>, "tool"_a, "stimuli"_a, "gates"_a, "first"_a, "count"_a,
          "Messages to a board for at most `count` periods from period `first` of the stimuli on, "
          "with these gates throughout;\nthe tool itself does not move.");
    m.def("advance_tool", &advance_tool<Tool>, "tool"_a, "stimuli"_a, "gates"_a, "first"_a,
          "count"_a, "truth"_a.none() = nb::none(),
          "Advances the tool by `count` periods from period `first` of the stimuli on, with these "
          "gates throughout.");
}

// Rows (n, 8) and their columns' names.
nb::object truth_rows(const Truth &self) {
    const std::size_t count = self.rows.size() / TRUTH_COLUMN_COUNT;
    auto *data = new double[self.rows.size() + 1];
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    std::copy(self.rows.begin(), self.rows.end(), data);
    return nb::cast(nb::ndarray<nb::numpy, double, nb::ndim<2>>(
        data, {count, static_cast<std::size_t>(TRUTH_COLUMN_COUNT)}, owner));
}

template <class Tool> void note(Truth &self, const Tool &tool, bool coast, int compare) {
    truth_note(self, tool, {coast, compare, 0});
}

}  // namespace

void bind_lockstep(nb::module_ &m) {
    nb::class_<Truth>(m, "Truth",
                      "True values of a tool in lock-step, a row every `every` PWM periods.")
        .def(
            "__init__",
            [](Truth *self, int every) {
                if (every < 1)
                    throw std::invalid_argument("Truth: every is at least 1");
                new (self) Truth();
                self->every = static_cast<std::size_t>(every);
            },
            "every"_a = 1)
        .def("note", &note<vgroove::ImpactPlant>, "tool"_a, "coast"_a, "compare"_a,
             "Adds a period of a lock-step loop in Python.")
        .def("note", &note<vgroove::DrivePlant>, "tool"_a, "coast"_a, "compare"_a)
        .def("note", &note<vgroove::DrillPlant>, "tool"_a, "coast"_a, "compare"_a)
        .def_prop_ro("rows", &truth_rows, "(n, columns) in the order of TRUTH_COLUMNS");
    nb::list names;
    for (const char *name : TRUTH_COLUMN_NAMES)
        names.append(name);
    m.attr("TRUTH_COLUMNS") = names;
    nb::class_<Stimuli>(m, "Stimuli",
                        "Stimuli of a chunk of PWM periods, one value a period in each column.")
        .def(
            "__init__",
            [](Stimuli *self, PeriodColumn<std::int64_t> trigger,
               PeriodColumn<std::int64_t> switches, PeriodColumn<double> load_nm,
               PeriodColumn<double> current_counts, PeriodColumn<double> supply_counts,
               PeriodColumn<bool> broken, PeriodColumn<std::int16_t> received, const Front &front) {
                Stimuli stimuli{trigger,       switches, load_nm,  current_counts,
                                supply_counts, broken,   received, front};
                stimuli.inputs();
                new (self) Stimuli(std::move(stimuli));
            },
            "trigger"_a, "switches"_a, "load_nm"_a, "current_counts"_a, "supply_counts"_a,
            "broken"_a, "received"_a, "front"_a,
            "Columns as in lockstep.StimulusChunk; received: a byte to the board or -1; front: "
            "counts per A and V, temperature counts.");
    bind_run<vgroove::DrivePlant>(m);
    bind_run<vgroove::ImpactPlant>(m);
    bind_run<vgroove::DrillPlant>(m);
}
