// Python face of plant/: LogInput, simulate_log and the parameter vector.
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "bindings.hpp"
#include "plant/plant.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Column = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Cube = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

vgroove::InputKind input_kind(const std::string &kind) {
    if (kind == "duty")
        return vgroove::InputKind::DUTY;
    if (kind == "voltage_v")
        return vgroove::InputKind::VOLTAGE;
    if (kind == "current_a")
        return vgroove::InputKind::CURRENT;
    throw std::invalid_argument("LogInput: kind is duty, voltage_v or current_a, not " + kind);
}

vgroove::LoadKind load_kind(const std::string &kind) {
    if (kind == "none")
        return vgroove::LoadKind::NONE;
    if (kind == "torque")
        return vgroove::LoadKind::TORQUE;
    if (kind == "pendulum")
        return vgroove::LoadKind::PENDULUM;
    throw std::invalid_argument("LogInput: load_kind is none, torque or pendulum, not " + kind);
}

const double *column_of(const std::optional<Column> &column, std::size_t rows, const char *name) {
    if (column->shape(0) != rows)
        throw std::invalid_argument(std::string("LogInput: ") + name + " needs as many rows as time_s");
    return column->data();
}

void log_input_init(vgroove::LogInput *self, Column time_s, const std::string &kind, Column command, std::optional<double> slew_per_s,
                    std::optional<Column> supply_v, std::optional<Column> load_nm, std::optional<Column> coast, const std::string &load,
                    double slew_slack) {
    new (self) vgroove::LogInput();
    const std::size_t rows = time_s.shape(0);
    self->time_s.assign(time_s.data(), time_s.data() + rows);
    self->kind = input_kind(kind);
    self->load_kind = load_kind(load);
    if (self->load_kind == vgroove::LoadKind::TORQUE && !load_nm)
        throw std::invalid_argument("LogInput: load_kind torque needs load_nm");
    const double slew = slew_per_s.value_or(std::numeric_limits<double>::quiet_NaN());
    vgroove::log_input_set_command(*self, column_of(command, rows, "command"), slew, slew_slack);
    if (supply_v)
        self->bus_v = vgroove::hold_missing(column_of(supply_v, rows, "supply_v"), rows, 0.0);
    if (load_nm)
        self->load_nm = vgroove::hold_missing(column_of(load_nm, rows, "load_nm"), rows, 0.0);
    if (coast)
        self->open = vgroove::hold_missing(column_of(coast, rows, "coast"), rows, 0.0);
}

nb::dict simulate_log(const vgroove::LogInput &in, Matrix theta, Rows starts, Cube state0, int threads) {
    const std::size_t batch = theta.shape(0), rows = in.time_s.size(), count = starts.shape(0);
    if (theta.shape(1) != vgroove::PARAMETER_COUNT)
        throw std::invalid_argument("simulate_log: theta is (B, " + std::to_string(vgroove::PARAMETER_COUNT) + ")");
    vgroove::LogStarts from;
    for (std::size_t n = 0; n < count; ++n)
        from.rows.push_back(starts.data()[n] < 0 ? rows : static_cast<std::size_t>(starts.data()[n]));
    from.per_row = state0.ndim() == 3;
    const bool fits = from.per_row ? state0.shape(0) == batch && state0.shape(1) == count && state0.shape(2) == 3
                                   : state0.ndim() == 2 && state0.shape(0) == count && state0.shape(1) == 3;
    if (!fits)
        throw std::invalid_argument("simulate_log: state0 is (S, 3) or (B, S, 3): current_a, speed_rad_s, angle_rad");
    from.state = state0.data();
    double *block = new double[6 * batch * rows + 1];
    nb::capsule owner(block, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    const std::size_t size = batch * rows;
    const vgroove::LogOutput out{block, block + size, block + 2 * size, block + 3 * size, block + 4 * size, block + 5 * size};
    {
        nb::gil_scoped_release unlocked;
        vgroove::simulate_log(in, theta.data(), batch, from, threads, out);
    }
    const std::pair<const char *, double *> columns[] = {{"current_a", out.current_a}, {"supply_v", out.supply_v}, {"speed_rad_s", out.speed_rad_s},
        {"speed_measured_rad_s", out.speed_measured_rad_s}, {"angle_rad", out.angle_rad}, {"angle_measured_rad", out.angle_measured_rad}};
    nb::dict result;
    for (const auto &column : columns)
        result[column.first] = nb::ndarray<nb::numpy, double, nb::ndim<2>>(column.second, {batch, rows}, owner);
    return result;
}

nb::ndarray<nb::numpy, double, nb::ndim<1>> parameter_defaults() {
    auto *p = new vgroove::Parameters();
    nb::capsule owner(p, [](void *q) noexcept { delete static_cast<vgroove::Parameters *>(q); });
    return {reinterpret_cast<double *>(p), {static_cast<std::size_t>(vgroove::PARAMETER_COUNT)}, owner};
}

}  // namespace

void bind_plant(nb::module_ &m) {
    nb::list names;
    for (const char *name : vgroove::PARAMETER_NAMES)
        names.append(name);
    m.attr("PARAMETERS") = names;
    m.def("parameter_defaults", &parameter_defaults, "(P,) neutral parameters in the order of PARAMETERS: every effect off.");
    nb::class_<vgroove::LogInput>(m, "LogInput", "Columns that drive the model; see docs/plant.md for how rows are read.")
        .def("__init__", &log_input_init, "time_s"_a, "kind"_a, "command"_a, "slew_per_s"_a.none() = nb::none(), "supply_v"_a.none() = nb::none(),
             "load_nm"_a.none() = nb::none(), "coast"_a.none() = nb::none(), "load_kind"_a = "none", "slew_slack"_a = 0.0);
    m.def("simulate_log", &simulate_log, "log_input"_a, "theta"_a, "starts"_a, "state0"_a, "threads"_a = 2,
          "theta (B, P), starts (S,) row indices, state0 (S, 3) or (B, S, 3): current_a, speed_rad_s, angle_rad -> dict of (B, n).");
}
