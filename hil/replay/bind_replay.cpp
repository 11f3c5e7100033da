// Python binding of the replay of a log: vgroove._replay. It is a module apart from vgroove._core
// because it links the firmware with hal/measured in place of hal/sim.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>
#include <vector>

#include "hal/measured/measured.h"
#include "log_replay.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

constexpr std::size_t ROW_COLUMNS = 6;
using Rows = nb::ndarray<const int, nb::shape<-1, ROW_COLUMNS>, nb::c_contig, nb::device::cpu>;

nb::tuple replay_rows(const nb::bytes &eeprom, const Rows &rows, std::size_t most, int spread,
                      int hall_pulses) {
    if (eeprom.size() != MEASURED_EEPROM_BYTES)
        throw std::invalid_argument("replay: an EEPROM image has 1024 bytes");
    std::vector<replay::Row> given(rows.shape(0));
    for (std::size_t n = 0; n < given.size(); ++n) {
        const int *row = rows.data() + n * ROW_COLUMNS;
        given[n] = {row[0], row[1], row[2], row[3], row[4], row[5]};
    }
    const std::string image(eeprom.c_str(), eeprom.size());
    // With the interpreter's lock: the hardware layer exists once in the process.
    const replay::Result result = replay::replay_log(given, image, {most, spread, hall_pulses});
    return nb::make_tuple(result.row, result.signal.c_str(), result.expected, result.complete);
}

}  // namespace

NB_MODULE(_replay, m) {
    m.doc() = "Replay of a log through the native firmware.";
    m.attr("COAST") = MEASURED_COAST;
    m.attr("UNKNOWN") = replay::UNKNOWN;
    m.def("replay", &replay_rows, "eeprom"_a, "rows"_a, "most"_a = 2048, "spread"_a = 1,
          "hall_pulses"_a = 4,
          "(row, signal, expected, complete) of hil/replay/log_replay.hpp. rows: (n, 6) int32: "
          "compare value (COAST: open), current in A Q9, speed in rpm Q1, bus voltage in mV, "
          "trigger, state (UNKNOWN: no value).");
}
