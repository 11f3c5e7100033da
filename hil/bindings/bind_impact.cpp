// Python binding of the impact tool: simulate_impact with rows, blows, trace, energies and step
// history, and the lock-step tool.
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstddef>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "plant/impact/log.hpp"
#include "plant/lockstep/impact_plant.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// A new numpy array with the bytes of a vector
template <class T> nb::object bytes_as(const std::vector<T> &values, const nb::object &dtype) {
    const nb::object numpy = nb::module_::import_("numpy");
    const nb::bytes bytes(reinterpret_cast<const char *>(values.data()), values.size() * sizeof(T));
    return numpy.attr("frombuffer")(bytes, dtype).attr("copy")();
}

nb::object blow_dtype() {
    const nb::object numpy = nb::module_::import_("numpy");
    nb::list fields;
    for (const char *name :
         {"time_s", "approach_rad_s", "engaged_m", "impulse_nm_s", "peak_torque_nm"})
        fields.append(nb::make_tuple(name, "f8"));
    for (const char *name : {"kind", "lug", "skipped"})
        fields.append(nb::make_tuple(name, "i8"));
    return numpy.attr("dtype")(fields);
}

nb::object history_dtype() {
    const nb::object numpy = nb::module_::import_("numpy");
    nb::dict layout;
    nb::list names, formats, offsets;
    const std::size_t at[] = {offsetof(vgroove::StepRecord, time_s),
                              offsetof(vgroove::StepRecord, step_s),
                              offsetof(vgroove::StepRecord, event)};
    const char *const name[] = {"time_s", "step_s", "event"}, *const format[] = {"f8", "f8", "i4"};
    for (int n = 0; n < 3; ++n) {
        names.append(name[n]);
        formats.append(format[n]);
        offsets.append(at[n]);
    }
    layout["names"] = names;
    layout["formats"] = formats;
    layout["offsets"] = offsets;
    layout["itemsize"] = sizeof(vgroove::StepRecord);
    return numpy.attr("dtype")(layout);
}

static_assert(sizeof(vgroove::Blow) == 8 * sizeof(double), "blow_dtype lists the members of Blow");

template <std::size_t N>
nb::dict table_of(const std::vector<double> &rows, const char *const (&names)[N]) {
    nb::dict result;
    const std::size_t count = rows.size() / N;
    for (std::size_t column = 0; column < N; ++column) {
        auto *values = new double[count + 1];
        nb::capsule owner(values, [](void *p) noexcept { delete[] static_cast<double *>(p); });
        for (std::size_t row = 0; row < count; ++row)
            values[row] = rows[row * N + column];
        result[names[column]] = nb::ndarray<nb::numpy, double, nb::ndim<1>>(values, {count}, owner);
    }
    return result;
}

vgroove::ImpactAccuracy accuracy_of(const std::string &mode) {
    if (mode == "reference")
        return vgroove::ImpactAccuracy::REFERENCE;
    if (mode == "fast")
        return vgroove::ImpactAccuracy::FAST;
    if (mode == "fixed")
        return vgroove::ImpactAccuracy::FIXED;
    throw std::invalid_argument("the impact tool's mode is reference, fast or fixed, not " + mode);
}

nb::dict statistics_of(const vgroove::ImpactStats &s) {
    nb::dict one;
    one["steps"] = s.steps;
    one["rejected"] = s.rejected;
    one["events"] = s.events;
    one["derivatives"] = s.derivatives;
    return one;
}

void add_lists(nb::dict &result, const vgroove::ImpactOutput &out) {
    nb::list blows, stats;
    const nb::object dtype = blow_dtype();
    for (const std::vector<vgroove::Blow> &list : out.blows)
        blows.append(bytes_as(list, dtype));
    for (const vgroove::ImpactStats &s : out.stats)
        stats.append(statistics_of(s));
    result["blows"] = blows;
    result["statistics"] = stats;
    if (!out.trace_s.empty())
        result["trace"] = table_of(out.trace, vgroove::TRACE_COLUMN_NAMES);
    if (out.keep_energy)
        result["energy"] = table_of(out.energy, vgroove::IMPACT_ENERGY_NAMES);
    if (out.keep_history)
        result["history"] = bytes_as(out.history, history_dtype());
}

nb::dict simulate_impact(const vgroove::LogInput &in, Matrix theta, const std::string &mode,
                         int threads, std::optional<Column> trace_s, bool history, bool energy,
                         double tolerance, double step_s) {
    const std::size_t batch = theta.shape(0), rows = in.time_s.size(), size = batch * rows;
    if (theta.shape(1) != vgroove::PARAMETER_COUNT)
        throw std::invalid_argument("simulate_impact: theta is (B, " +
                                    std::to_string(vgroove::PARAMETER_COUNT) + ")");
    const vgroove::ImpactAccuracy accuracy = accuracy_of(mode);
    if (energy && accuracy != vgroove::ImpactAccuracy::REFERENCE)
        throw std::invalid_argument("simulate_impact: energy needs mode reference");
    const ColumnBlock block = column_block(vgroove::IMPACT_COLUMN_COUNT * size);
    vgroove::ImpactOutput out{};
    for (std::size_t n = 0; n < vgroove::IMPACT_COLUMN_COUNT; ++n)
        out.columns[n] = block.data + n * size;
    if (trace_s)
        out.trace_s.assign(trace_s->data(), trace_s->data() + trace_s->shape(0));
    out.keep_history = history;
    out.keep_energy = energy;
    out.tolerance = tolerance;
    out.fixed_s = step_s;
    run_cancellable([&](vgroove::Cancellation *cancellation) {
        out.cancellation = cancellation;
        vgroove::simulate_impact(in, theta.data(), batch, accuracy, threads, out);
    });
    nb::dict result;
    for (std::size_t n = 0; n < vgroove::IMPACT_COLUMN_COUNT; ++n)
        result[vgroove::IMPACT_COLUMN_NAMES[n]] =
            nb::ndarray<nb::numpy, double, nb::ndim<2>>(out.columns[n], {batch, rows}, block.owner);
    add_lists(result, out);
    return result;
}

vgroove::ImpactPlant make_impact_plant(Column parameters, const std::string &load, int pulses,
                                       double offset_rad, const std::vector<double> &spacing,
                                       std::uint64_t seed, const std::string &mode, double step_s) {
    if (parameters.shape(0) != static_cast<std::size_t>(vgroove::PARAMETER_COUNT))
        throw std::invalid_argument("ImpactPlant: parameters is (" +
                                    std::to_string(vgroove::PARAMETER_COUNT) + ",)");
    return vgroove::ImpactPlant(vgroove::parameters_from(parameters.data()), load_kind(load),
                                vgroove::hall_wheel(pulses, offset_rad, spacing), seed,
                                accuracy_of(mode), step_s);
}

void check_impact_tool(Column parameters, const std::string &load) {
    if (parameters.shape(0) != static_cast<std::size_t>(vgroove::PARAMETER_COUNT))
        throw std::invalid_argument("check_impact_tool: parameters is (" +
                                    std::to_string(vgroove::PARAMETER_COUNT) + ",)");
    vgroove::impact_from(vgroove::parameters_from(parameters.data()), load_kind(load),
                         vgroove::InputKind::DUTY, false, 1.0);
}

double governed(vgroove::ImpactPlant &plant, int rows, double row_s, double duty,
                double overspeed_rad_s) {
    double now = duty;
    for (int row = 0; row < rows; ++row)
        now = plant.advance(row_s, now, false, 0.0).speed_rad_s > overspeed_rad_s ? 0.0 : duty;
    return plant.now().head_rad;
}

void bind_impact_plant(nb::module_ &m) {
    using vgroove::AdvanceResult;
    using vgroove::ImpactPlant;
    nb::class_<AdvanceResult>(m, "ImpactInterval",
                              "An interval of the impact tool: means of current, bus and housing "
                              "reaction, the others at its end.")
        .def_ro("current_a", &AdvanceResult::current_a)
        .def_ro("supply_v", &AdvanceResult::supply_v)
        .def_ro("speed_rad_s", &AdvanceResult::speed_rad_s)
        .def_ro("angle_rad", &AdvanceResult::angle_rad)
        .def_ro("anvil_torque_nm", &AdvanceResult::anvil_torque_nm)
        .def_ro("anvil_angle_rad", &AdvanceResult::anvil_angle_rad)
        .def_ro("head_rad", &AdvanceResult::head_rad)
        .def_ro("hammer_mm", &AdvanceResult::hammer_mm)
        .def_ro("housing_nm", &AdvanceResult::housing_nm)
        .def_ro("arm_rad", &AdvanceResult::arm_rad);
    nb::class_<ImpactPlant>(
        m, "ImpactPlant",
        "The impact tool in lock-step: period() as DrivePlant's, advance() for any interval.")
        .def(nb::new_(&make_impact_plant), "parameters"_a, "load_kind"_a = "none",
             "hall_pulses_per_rev"_a = 4, "hall_offset_rad"_a = 0.0,
             "hall_spacing"_a = std::vector<double>(), "seed"_a = 0, "mode"_a = "fast",
             "step_s"_a = vgroove::IMPACT_STEP_FIXED_S)
        .def("period", &lockstep_period<ImpactPlant>, "coast"_a, "duty"_a, "dead"_a,
             "load_nm"_a = 0.0, PERIOD_DOC)
        .def("advance", &ImpactPlant::advance, "seconds"_a, "duty"_a, "coast"_a = false,
             "load_nm"_a = 0.0)
        .def("governed", &governed, "rows"_a, "row_s"_a, "duty"_a, "overspeed_rad_s"_a,
             "advance() row by row with a controller in C++: duty 0 after a row that ends above "
             "overspeed_rad_s, else `duty`. Returns the head angle, rad.")
        .def(
            "statistics", [](ImpactPlant &self) { return statistics_of(self.statistics()); },
            "Numbers of steps, rejected steps, events and derivatives since the start.")
        .def(
            "blows", [](ImpactPlant &self) { return bytes_as(self.take_blows(), blow_dtype()); },
            "Blows since the last call.")
        .def_prop_ro("current_a", [](const ImpactPlant &self) { return self.now().current_a; })
        .def_prop_ro("speed_rad_s", [](const ImpactPlant &self) { return self.now().speed_rad_s; })
        .def_prop_ro("angle_rad", [](const ImpactPlant &self) { return self.now().angle_rad; })
        .def_prop_ro("time_s", &ImpactPlant::time_s)
        .def_prop_ro("winding_kelvin", &ImpactPlant::winding_kelvin)
        .def_prop_ro("hammer_mm", [](const ImpactPlant &self) { return self.now().hammer_mm; })
        .def_prop_ro("anvil_torque_nm",
                     [](const ImpactPlant &self) { return self.now().anvil_torque_nm; })
        .def_prop_ro("anvil_angle_rad",
                     [](const ImpactPlant &self) { return self.now().anvil_angle_rad; })
        .def_prop_ro("head_rad", [](const ImpactPlant &self) { return self.now().head_rad; })
        .def_prop_ro("housing_nm", [](const ImpactPlant &self) { return self.now().housing_nm; })
        .def_prop_ro("arm_rad", [](const ImpactPlant &self) { return self.now().arm_rad; });
}

}  // namespace

void bind_impact(nb::module_ &m) {
    bind_impact_plant(m);
    nb::list events;
    for (const char *name : vgroove::IMPACT_EVENT_NAMES)
        events.append(name);
    m.attr("IMPACT_EVENTS") = events;
    m.def("check_impact_tool", &check_impact_tool, "parameters"_a, "load_kind"_a,
          "Raises ValueError, which names the reason, for parameters that no tool can have.");
    m.def("simulate_impact", &simulate_impact, "log_input"_a, "theta"_a, "mode"_a = "reference",
          "threads"_a = 1, "trace_s"_a.none() = nb::none(), "history"_a = false, "energy"_a = false,
          "tolerance"_a = 0.0, "step_s"_a = vgroove::IMPACT_STEP_FIXED_S,
          "theta (B, P) -> dict of rows (B, n), 'blows' and 'statistics' per batch row; of the "
          "first batch row 'trace' at trace_s, step 'history', "
          "'energy'.");
}
