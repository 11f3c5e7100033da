// Python binding of the native firmware: vgroove._core.Firmware, one PWM period or a recorded run a
// call.
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "firmware.hpp"

namespace nb = nanobind;
using namespace nb::literals;

// The simulation HAL exists once in a process: the newest Firmware owns it, older ones are refused.
static std::uint32_t owner = 0;
// True while a thread runs it without the interpreter's lock; read and written with that lock only.
static bool held = false;

static void need_free() {
    if (held)
        throw std::runtime_error(
            "Firmware: another thread is running the simulation; only one can run in a process");
}

void need_owner(const Firmware &self) {
    need_free();
    if (self.number != owner)
        throw std::runtime_error("Firmware: a newer instance has taken the simulation over; only "
                                 "one can run in a process");
}

FirmwareHold::FirmwareHold(const Firmware &self) {
    need_owner(self);
    held = true;
}

FirmwareHold::~FirmwareHold() {
    held = false;
}

namespace {

nb::bytes as_bytes(const void *data, std::size_t size) {
    return nb::bytes(static_cast<const char *>(data), size);
}

nb::list reported_blows(const Firmware &self) {
    need_owner(self);
    const SimBlow *blows = nullptr;
    const std::uint16_t count = sim_blows(&blows);
    nb::list reported;
    for (std::uint16_t k = 0; k < count; ++k) {
        const SimBlow &b = blows[k];
        reported.append(nb::make_tuple(b.time_ms / 1e3, b.lugs, b.repeats, b.period_q4 / 16e3,
                                       b.mean_period_q7 / 128e3, b.spread_q15 / 32768.0));
    }
    return reported;
}

nb::bytes tape_of(const Firmware &self) {
    return as_bytes(self.tape.data(), self.tape.size());
}

nb::bytes given_of(const Firmware &self) {
    return as_bytes(self.given.data(), self.given.size());
}

nb::bytes eeprom_image(const Firmware &self) {
    need_owner(self);
    return as_bytes(sim_eeprom(), SIM_EEPROM_BYTES);
}

nb::bytes recorded_ticks(const Firmware &self) {
    need_owner(self);
    const SimTick *ticks = nullptr;
    const std::size_t count = sim_ticks(&ticks);
    return as_bytes(ticks, count * sizeof(SimTick));
}

// A byte string of a fixed size from an object that is bytes or None; false for None.
bool take_image(const nb::object &object, std::size_t size, const char *what, std::string &image) {
    if (object.is_none())
        return false;
    const nb::bytes given = nb::cast<nb::bytes>(object);
    if (given.size() != size)
        throw std::invalid_argument(std::string("Firmware: ") + what + " has " +
                                    std::to_string(size) + " bytes");
    image.assign(given.c_str(), given.size());
    return true;
}

void firmware_init(Firmware *self, const nb::object &eeprom, int reset_cause, int target,
                   int isr_cycles, int tick_cycles, const nb::object &torque_map,
                   std::uint32_t start_ms) {
    if (reset_cause < 0 || reset_cause > 15 || target < 0 || target > 15)
        throw std::invalid_argument("Firmware: reset_cause and target are 0..15");
    if (isr_cycles < 0 || isr_cycles > 300 || tick_cycles < 260 || tick_cycles > 8000)
        throw std::invalid_argument("Firmware: isr_cycles is 0..300, tick_cycles 260..8000");
    SimStart start = SIM_START_DEFAULT;
    std::string image, map_image;
    if (take_image(eeprom, SIM_EEPROM_BYTES, "an EEPROM image", image))
        start.eeprom = reinterpret_cast<const std::uint8_t *>(image.data());
    if (take_image(torque_map, SIM_TORQUE_MAP_BYTES, "a torque map", map_image))
        start.torque_map = reinterpret_cast<const std::uint8_t *>(map_image.data());
    start.reset_cause = static_cast<std::uint8_t>(reset_cause);
    start.target = static_cast<std::uint8_t>(target);
    start.isr_cycles = static_cast<std::uint16_t>(isr_cycles);
    start.tick_cycles = static_cast<std::uint16_t>(tick_cycles);
    start.start_ms = start_ms;
    need_free();
    new (self) Firmware{++owner, {}};
    sim_reset(&start, &self->outputs);
}

SimInputs inputs_of(const std::vector<int> &adc, const std::vector<int> &edges, int switches,
                    const nb::bytes &rx) {
    if (adc.size() != SIM_ADC_CHANNELS || edges.size() > SIM_EDGES_MAX || rx.size() > SIM_BYTES_MAX)
        throw std::invalid_argument("Firmware.period: 4 adc_counts, at most 8 edges and 4 bytes");
    SimInputs in{};
    for (std::size_t k = 0; k < adc.size(); ++k)
        in.adc_counts[k] = static_cast<std::uint16_t>(adc[k] < 0      ? 0
                                                      : adc[k] > 1023 ? 1023
                                                                      : adc[k]);
    int before = -1;
    for (std::size_t k = 0; k < edges.size(); ++k) {
        if (edges[k] <= before || edges[k] >= static_cast<int>(SIM_CYCLES_PER_PERIOD))
            throw std::invalid_argument("Firmware.period: edges are increasing cycles 0..509");
        in.edge_cycle[k] = static_cast<std::uint16_t>(before = edges[k]);
    }
    in.edge_count = static_cast<std::uint8_t>(edges.size());
    in.switches = static_cast<std::uint8_t>(switches & 15);
    in.rx_count = static_cast<std::uint8_t>(rx.size());
    std::memcpy(in.rx, rx.c_str(), rx.size());
    return in;
}

void period(Firmware &self, const std::vector<int> &adc_counts, const std::vector<int> &edges,
            int switches, const nb::bytes &rx) {
    need_owner(self);
    const SimInputs in = inputs_of(adc_counts, edges, switches, rx);
    sim_period(&in, &self.outputs);
}

// The packed structs that vgroove-board reads and writes
nb::bytes exchange(Firmware &self, const nb::bytes &inputs) {
    need_owner(self);
    if (inputs.size() % sizeof(SimInputs) != 0)
        throw std::invalid_argument("Firmware.exchange: whole SimInputs of " +
                                    std::to_string(sizeof(SimInputs)) + " bytes");
    std::vector<SimInputs> in(inputs.size() / sizeof(SimInputs));
    std::vector<SimOutputs> out(in.size());
    if (!in.empty())
        std::memcpy(in.data(), inputs.c_str(), inputs.size());
    for (std::size_t k = 0; k < in.size(); ++k) {
        sim_period(&in[k], &self.outputs);
        out[k] = self.outputs;
    }
    return as_bytes(out.data(), out.size() * sizeof(SimOutputs));
}

}  // namespace

void bind_firmware(nb::module_ &module) {
    nb::class_<Firmware>(
        module, "Firmware",
        "The firmware built for this machine, in lock-step: period k begins at TOP k of the PWM. "
        "One at a time in a process.\n"
        "eeprom: image of 1,024 bytes or None (erased); reset_cause and target as BOOT reports "
        "them; start_ms: the telemetry's time at the start; isr_cycles and\n"
        "tick_cycles delay interrupts and the tick; the bytes sent must not depend on them; "
        "torque_map: image of a TorqueMap (406 bytes) or None (the one in the source).")
        .def("__init__", &firmware_init, "eeprom"_a.none() = nb::none(), "reset_cause"_a = 1,
             "target"_a = 0, "isr_cycles"_a = SIM_ISR_CYCLES, "tick_cycles"_a = SIM_TICK_CYCLES,
             "torque_map"_a.none() = nb::none(), "start_ms"_a = 0)
        .def("period", &period, "adc_counts"_a, "edges"_a = std::vector<int>(), "switches"_a = 0,
             "rx"_a = nb::bytes("", 0),
             "One period: counts of current, bus, trigger, temperature at its end; Hall edges as "
             "cycles 0..509; switches of SimInputs; bytes\n"
             "received in it. coast, compare, dead_counts and tx then hold the answer.")
        .def("exchange", &exchange, "inputs"_a,
             "Any number of packed SimInputs in, as many packed SimOutputs out "
             "(firmware/hal/sim/sim_io.h).")
        .def_prop_ro(
            "coast", [](const Firmware &self) { return self.outputs.coast != 0; },
            "bridge open in the next period")
        .def_prop_ro(
            "compare", [](const Firmware &self) { return static_cast<int>(self.outputs.compare); },
            "-255..255, in force in the next period")
        .def_prop_ro(
            "dead_counts",
            [](const Firmware &self) { return static_cast<int>(self.outputs.dead_counts); })
        .def_prop_ro(
            "tx",
            [](const Firmware &self) { return as_bytes(self.outputs.tx, self.outputs.tx_count); },
            "bytes sent in the last period")
        .def_prop_ro("eeprom", &eeprom_image)
        .def_prop_ro(
            "blows", &reported_blows,
            "Blows that the firmware has reported since its start: (time_s, lugs, repeats of "
            "each lug, period_s, running period_s before it, its spread)")
        .def_rw("keeps_tape", &Firmware::keeps_tape, "whether run_lockstep records the next two")
        .def_prop_ro("tape", &tape_of)
        .def_prop_ro("given", &given_of)
        .def_prop_ro("ticks", &recorded_ticks,
                     "What filters and controller have taken and given in each tick: SimTick of "
                     "firmware/hal/sim/sim.h, one after the other")
        .def_prop_ro("periods",
                     [](const Firmware &self) {
                         need_owner(self);
                         return sim_periods();
                     })
        .def_prop_ro(
            "cycles",
            [](const Firmware &self) {
                need_owner(self);
                return sim_cycles();
            },
            "CPU cycles from the timers' start to the begin of the next period");
    module.attr("SIM_INPUTS_BYTES") = sizeof(SimInputs);
    module.attr("SIM_OUTPUTS_BYTES") = sizeof(SimOutputs);
}
