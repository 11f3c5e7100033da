// Python binding of the drivetrain: the parameter vector, LogInput, simulate_log, the lock-step
// tool, and the front ends.
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "bindings.hpp"
#include "plant/components/front_ends.hpp"
#include "plant/drivetrain/log.hpp"
#include "plant/lockstep/drive_plant.hpp"

namespace nb = nanobind;
using namespace nb::literals;

// "none, torque, ... or wood_screw"
static std::string all_load_names() {
    constexpr std::size_t count = std::size(vgroove::LOAD_NAMES);
    std::string names;
    for (std::size_t n = 0; n < count; ++n)
        names +=
            std::string(n == 0 ? "" : (n + 1 < count ? ", " : " or ")) + vgroove::LOAD_NAMES[n];
    return names;
}

vgroove::LoadKind load_kind(const std::string &kind) {
    for (std::size_t n = 0; n < std::size(vgroove::LOAD_NAMES); ++n)
        if (kind == vgroove::LOAD_NAMES[n])
            return static_cast<vgroove::LoadKind>(n);
    throw std::invalid_argument("load_kind is " + all_load_names() + ", not " + kind);
}

namespace {

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

void require_drivetrain_load(vgroove::LoadKind kind) {
    if (vgroove::load_is_joint(kind))
        throw std::invalid_argument("a joint needs an impact mechanism: without one load_kind is "
                                    "none, torque, pendulum or free");
}

const double *column_of(const std::optional<Column> &column, std::size_t rows, const char *name) {
    if (column->shape(0) != rows)
        throw std::invalid_argument(std::string("LogInput: ") + name +
                                    " needs as many rows as time_s");
    return column->data();
}

void log_input_init(vgroove::LogInput *self, Column time_s, const std::string &kind, Column command,
                    std::optional<double> slew_per_s, std::optional<Column> supply_v,
                    std::optional<Column> load_nm, std::optional<Column> coast,
                    const std::string &load, double slew_slack, std::optional<Column> skipped_a2,
                    std::optional<Column> skipped_bus_a) {
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
    if (skipped_a2.has_value() != skipped_bus_a.has_value())
        throw std::invalid_argument("LogInput: skipped_a2 needs skipped_bus_a, and the reverse");
    if (!skipped_a2)
        return;
    const double *square = column_of(skipped_a2, rows, "skipped_a2");
    const double *bus = column_of(skipped_bus_a, rows, "skipped_bus_a");
    self->skipped_a2.assign(square, square + rows);
    self->skipped_bus_a.assign(bus, bus + rows);
}

vgroove::SimulateOptions options_of(int threads, const std::string &solver, double tolerance,
                                    const std::string &unfinished) {
    if (solver != "exact" && solver != "adaptive")
        throw std::invalid_argument("simulate_log: solver is exact or adaptive, not " + solver);
    if (unfinished != "raise" && unfinished != "nan")
        throw std::invalid_argument("simulate_log: unfinished is raise or nan, not " + unfinished);
    vgroove::SimulateOptions options;
    options.threads = threads;
    options.adaptive = solver == "adaptive";
    options.tolerance = tolerance;
    options.keep_unfinished = unfinished == "nan";
    return options;
}

nb::dict simulate_log(const vgroove::LogInput &in, Matrix theta, Rows starts, Cube state0,
                      int threads, const std::string &solver, double tolerance,
                      const std::string &unfinished, int least_lanes) {
    vgroove::SimulateOptions options = options_of(threads, solver, tolerance, unfinished);
    if (least_lanes != 0)
        options.least_lanes = static_cast<std::size_t>(std::clamp(least_lanes, 2, 8));
    const std::size_t batch = theta.shape(0), rows = in.time_s.size(), count = starts.shape(0);
    require_drivetrain_load(in.load_kind);
    if (theta.shape(1) != vgroove::PARAMETER_COUNT)
        throw std::invalid_argument("simulate_log: theta is (B, " +
                                    std::to_string(vgroove::PARAMETER_COUNT) + ")");
    vgroove::LogStarts from;
    for (std::size_t n = 0; n < count; ++n)
        from.rows.push_back(starts.data()[n] < 0 ? rows
                                                 : static_cast<std::size_t>(starts.data()[n]));
    from.per_row = state0.ndim() == 3;
    const bool fits =
        from.per_row ? state0.shape(0) == batch && state0.shape(1) == count && state0.shape(2) == 3
                     : state0.ndim() == 2 && state0.shape(0) == count && state0.shape(1) == 3;
    if (!fits)
        throw std::invalid_argument(
            "simulate_log: state0 is (S, 3) or (B, S, 3): current_a, speed_rad_s, angle_rad");
    from.state = state0.data();
    double *block = new double[6 * batch * rows + 1];
    nb::capsule owner(block, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    const std::size_t size = batch * rows;
    const vgroove::LogOutput out{
        block,           block + size, block + 2 * size, block + 3 * size, block + 4 * size,
        block + 5 * size};
    run_cancellable([&](vgroove::Cancellation *cancellation) {
        options.cancellation = cancellation;
        vgroove::simulate_log(in, theta.data(), batch, from, options, out);
    });
    const std::pair<const char *, double *> columns[] = {
        {"current_a", out.current_a},     {"supply_v", out.supply_v},
        {"speed_rad_s", out.speed_rad_s}, {"speed_measured_rad_s", out.speed_measured_rad_s},
        {"angle_rad", out.angle_rad},     {"angle_measured_rad", out.angle_measured_rad}};
    nb::dict result;
    for (const auto &column : columns)
        result[column.first] =
            nb::ndarray<nb::numpy, double, nb::ndim<2>>(column.second, {batch, rows}, owner);
    return result;
}

nb::dict audit_log(const vgroove::LogInput &in, Column theta, Rows starts, Matrix state0) {
    const std::size_t rows = in.time_s.size(), count = starts.shape(0);
    require_drivetrain_load(in.load_kind);
    if (theta.shape(0) != static_cast<std::size_t>(vgroove::PARAMETER_COUNT) ||
        state0.shape(0) != count || state0.shape(1) != 3)
        throw std::invalid_argument("audit_log: theta is (P,), state0 (S, 3)");
    vgroove::LogStarts from;
    for (std::size_t n = 0; n < count; ++n)
        from.rows.push_back(starts.data()[n] < 0 ? rows
                                                 : static_cast<std::size_t>(starts.data()[n]));
    from.state = state0.data();
    std::vector<double> block(6 * rows), energy(rows * vgroove::ENERGY_COLUMNS);
    double *b = block.data();
    vgroove::audit_log(
        in, theta.data(), from,
        {b, b + rows, b + 2 * rows, b + 3 * rows, b + 4 * rows, b + 5 * rows, energy.data()});
    nb::dict result;
    for (int n = 0; n < vgroove::ENERGY_COLUMNS; ++n) {
        auto *column = new double[rows];
        nb::capsule owner(column, [](void *p) noexcept { delete[] static_cast<double *>(p); });
        for (std::size_t row = 0; row < rows; ++row)
            column[row] = energy[row * vgroove::ENERGY_COLUMNS + static_cast<std::size_t>(n)];
        result[vgroove::ENERGY_NAMES[n]] =
            nb::ndarray<nb::numpy, double, nb::ndim<1>>(column, {rows}, owner);
    }
    return result;
}

nb::ndarray<nb::numpy, double, nb::ndim<1>> parameter_defaults() {
    auto *p = new vgroove::Parameters();
    nb::capsule owner(p, [](void *q) noexcept { delete static_cast<vgroove::Parameters *>(q); });
    return {
        reinterpret_cast<double *>(p), {static_cast<std::size_t>(vgroove::PARAMETER_COUNT)}, owner};
}

vgroove::DrivePlant make_drive_plant(Column parameters, const std::string &load, int pulses,
                                     double offset_rad, const std::vector<double> &spacing,
                                     std::uint64_t seed) {
    if (parameters.shape(0) != static_cast<std::size_t>(vgroove::PARAMETER_COUNT))
        throw std::invalid_argument("DrivePlant: parameters is (" +
                                    std::to_string(vgroove::PARAMETER_COUNT) + ",)");
    require_drivetrain_load(load_kind(load));
    return vgroove::DrivePlant(vgroove::parameters_from(parameters.data()), load_kind(load),
                               vgroove::hall_wheel(pulses, offset_rad, spacing), seed);
}

struct FrontEnds {
    vgroove::Noise noise;
    double current_offset_a, current_noise_a;
};

nb::tuple front_end_counts(FrontEnds &self, double current_a, double supply_v, double travel,
                           double degc) {
    const double noise =
        self.current_noise_a > 0.0 ? self.current_noise_a * vgroove::noise_normal(self.noise) : 0.0;
    return nb::make_tuple(vgroove::current_counts(current_a, self.current_offset_a, noise),
                          vgroove::bus_counts(supply_v), vgroove::trigger_counts(travel),
                          vgroove::temperature_counts(degc));
}

void bind_drive_plant(nb::module_ &m) {
    nb::class_<vgroove::DrivePlant>(
        m, "DrivePlant",
        "The tool in lock-step with a board, one PWM period of 510 CPU cycles a call.")
        .def(nb::new_(&make_drive_plant), "parameters"_a, "load_kind"_a = "none",
             "hall_pulses_per_rev"_a = 4, "hall_offset_rad"_a = 0.0,
             "hall_spacing"_a = std::vector<double>(), "seed"_a = 0)
        .def("period", &lockstep_period<vgroove::DrivePlant>, "coast"_a, "duty"_a, "dead"_a,
             "load_nm"_a = 0.0, PERIOD_DOC)
        .def("reset", &vgroove::DrivePlant::reset, "current_a"_a, "speed_rad_s"_a, "angle_rad"_a)
        .def_prop_ro("current_a", &vgroove::DrivePlant::current_a)
        .def_prop_ro("speed_rad_s", &vgroove::DrivePlant::speed_rad_s)
        .def_prop_ro("angle_rad", &vgroove::DrivePlant::angle_rad)
        .def_prop_ro("time_s", &vgroove::DrivePlant::time_s)
        .def_prop_ro("winding_kelvin", &vgroove::DrivePlant::winding_kelvin);
    m.attr("PERIOD_S") = vgroove::PERIOD_S;
    m.def("current_counts", &vgroove::current_counts, "current_a"_a, "offset_a"_a = 0.0,
          "noise_a"_a = 0.0, "noise_a: noise added to this sample, A");
    m.def("bus_counts", &vgroove::bus_counts, "supply_v"_a);
    m.def("trigger_counts", &vgroove::trigger_counts, "travel"_a);
    m.def("temperature_counts", &vgroove::temperature_counts, "degc"_a);
    nb::class_<FrontEnds>(
        m, "FrontEnds",
        "All four front ends of the board; current_noise_a: standard deviation in A, seeded.")
        .def(
            "__init__",
            [](FrontEnds *self, std::uint64_t seed, double offset_a, double noise_a) {
                new (self) FrontEnds{{seed}, offset_a, noise_a};
            },
            "seed"_a = 0, "current_offset_a"_a = 0.0, "current_noise_a"_a = 0.0)
        .def("counts", &front_end_counts, "current_a"_a, "supply_v"_a, "trigger"_a,
             "temperature_degc"_a = 25.0,
             "-> (current, bus, trigger, temperature) in the order of the lock-step message");
}

}  // namespace

void bind_plant(nb::module_ &m) {
    nb::list names;
    for (int n = 0; n < vgroove::PARAMETER_COUNT; ++n)
        names.append(vgroove::parameter_name(n));
    m.attr("PARAMETERS") = names;
    m.def("parameter_defaults", &parameter_defaults,
          "(P,) neutral parameters in the order of PARAMETERS: every effect off.");
    nb::class_<vgroove::LogInput>(
        m, "LogInput", "Columns that drive the model; see docs/plant.md for how rows are read.")
        .def("__init__", &log_input_init, "time_s"_a, "kind"_a, "command"_a,
             "slew_per_s"_a.none() = nb::none(), "supply_v"_a.none() = nb::none(),
             "load_nm"_a.none() = nb::none(), "coast"_a.none() = nb::none(), "load_kind"_a = "none",
             "slew_slack"_a = 0.0, "skipped_a2"_a.none() = nb::none(),
             "skipped_bus_a"_a.none() = nb::none());
    m.def("simulate_log", &simulate_log, "log_input"_a, "theta"_a, "starts"_a, "state0"_a,
          "threads"_a = 2, "solver"_a = "exact", "tolerance"_a = 0.0, "unfinished"_a = "raise",
          "least_lanes"_a = 0,
          "theta (B, P), starts (S,) row indices, state0 (S, 3) or (B, S, 3): current_a, "
          "speed_rad_s, angle_rad -> dict of (B, n). A current of nan: the steady-state current of "
          "the interval that follows the start.\n"
          "solver: exact (where the drivetrain is linear between events, else Runge-Kutta, and "
          "exponential steps behind a fast winding) or adaptive (Runge-Kutta everywhere, to "
          "`tolerance`).\n"
          "unfinished: for a run whose step budget is used up before its end: raise "
          "(RuntimeError naming row, time and parameter) or nan.\n"
          "least_lanes: smallest number of parameter sets with the same effects, 2 to 8, that are "
          "simulated together in one vector; 0: by the processor. The results are the same.");
    m.def("audit_log", &audit_log, "log_input"_a, "theta"_a, "starts"_a, "state0"_a,
          "theta (P,) -> dict of (n,) energies in J since the first start: work_in = losses + "
          "work_load + change of stored.");
    bind_drive_plant(m);
    bind_impact(m);
}
