// Python binding of the drill driver: its parameters by name, a run by any of its solvers, its
// Jacobian for stability limits, the lock-step tool.
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "plant/drill/run.hpp"
#include "plant/lockstep/drill_plant.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

vgroove::DrillParameters parameters_of(const nb::dict &values) {
    vgroove::DrillParameters p;
    for (const auto &[key, value] : values) {
        const std::string name = nb::cast<std::string>(key);
        bool known = false;
        for (const vgroove::DrillParameter &entry : vgroove::DRILL_PARAMETERS)
            if (name == entry.name) {
                p.*entry.member = nb::cast<double>(value);
                known = true;
            }
        if (!known)
            throw std::invalid_argument("drill driver: unknown parameter " + name);
    }
    return p;
}

nb::dict drill_parameters() {
    nb::dict result;
    for (const vgroove::DrillParameter &entry : vgroove::DRILL_PARAMETERS)
        result[entry.name] = vgroove::DrillParameters().*entry.member;
    return result;
}

vgroove::DrillSolver solver_of(const std::string &name) {
    const std::map<std::string, vgroove::DrillSolver> solvers{
        {"reference", vgroove::DrillSolver::REFERENCE},
        {"euler", vgroove::DrillSolver::EULER},
        {"rk4", vgroove::DrillSolver::RK4},
        {"real_time", vgroove::DrillSolver::REAL_TIME}};
    const auto found = solvers.find(name);
    if (found == solvers.end())
        throw std::invalid_argument(
            "simulate_drill: solver is reference, euler, rk4 or real_time, not " + name);
    return found->second;
}

void add_steps(nb::dict &to, const std::string &name,
               const std::vector<vgroove::DrillStep> &steps) {
    nb::dict found;
    nb::list marks;
    for (const vgroove::DrillStep &step : steps)
        marks.append(vgroove::DRILL_MARKS[static_cast<int>(step.mark)]);
    found["time_s"] = vector_of(steps.size(), [&](std::size_t n) { return steps[n].time_s; });
    found["length_s"] = vector_of(steps.size(), [&](std::size_t n) { return steps[n].length_s; });
    found["mark"] = marks;
    to[name.c_str()] = found;
}

nb::dict simulate_drill(const nb::dict &parameters, const std::string &solver, double duration_s,
                        double step_s, double tolerance, double step_max_s, double row_s,
                        bool timed, const std::vector<std::string> &columns) {
    vgroove::DrillRequest request{solver_of(solver), duration_s, step_s, tolerance,
                                  step_max_s,        row_s,      timed,  nullptr};
    const vgroove::DrillParameters p = parameters_of(parameters);
    vgroove::DrillRun run;
    run_cancellable([&](vgroove::Cancellation *cancellation) {
        request.cancellation = cancellation;
        run = vgroove::drill_run(p, request);
    });
    const std::size_t rows = run.rows.size() / vgroove::DRILL_ROW_COUNT;
    nb::dict result;
    for (std::size_t c = 0; c < vgroove::DRILL_ROW_COUNT; ++c)
        if (columns.empty() ||
            std::find(columns.begin(), columns.end(), vgroove::DRILL_ROW_NAMES[c]) != columns.end())
            result[vgroove::DRILL_ROW_NAMES[c]] = vector_of(
                rows, [&](std::size_t n) { return run.rows[n * vgroove::DRILL_ROW_COUNT + c]; });
    add_steps(result, "steps", run.steps);
    add_steps(result, "marks", run.marks);
    result["execution_ns"] =
        vector_of(run.execution_ns.size(), [&](std::size_t n) { return run.execution_ns[n]; });
    result["rejected"] = run.rejected;
    result["diverged_s"] = run.diverged_s > 0.0 ? nb::cast(run.diverged_s) : nb::none();
    return result;
}

// Jacobian of the state of the drill driver with a turning motor, a closed bridge, the clutch
// gripping or slipping, and the load's friction law linearised at chuck_rad_s
nb::object drill_jacobian(const nb::dict &parameters, bool slips, double load_nm,
                          double chuck_rad_s) {
    const vgroove::DrillParameters p = parameters_of(parameters);
    vgroove::drill_check(p);
    vgroove::DrillMode mode;
    mode.slide = 1;
    mode.clutch = slips ? 1 : 0;
    vgroove::DrillVector x = vgroove::DrillVector::Zero();
    x[vgroove::DRILL_CHUCK] = chuck_rad_s;
    const vgroove::DrillSlopes j = vgroove::drill_slopes(p, mode, {0.0, 0.0, load_nm}, x);
    auto *data = new double[16];
    nb::capsule owner(data, [](void *q) noexcept { delete[] static_cast<double *>(q); });
    for (int n = 0; n < 16; ++n)
        data[n] = j.core(n / 4, n % 4);
    return nb::cast(nb::ndarray<nb::numpy, double, nb::ndim<2>>(data, {4, 4}, owner));
}

vgroove::DrillPlant make_drill_plant(const nb::dict &parameters, double supply_ohm, int pulses,
                                     double offset_rad, const std::vector<double> &spacing,
                                     double step_s) {
    return vgroove::DrillPlant(parameters_of(parameters), supply_ohm,
                               vgroove::hall_wheel(pulses, offset_rad, spacing), step_s);
}

vgroove::DrillInterval advance(vgroove::DrillPlant &self, double seconds, double duty, bool coast,
                               double load_nm, std::optional<double> duty_from) {
    return self.advance(seconds, duty_from.value_or(duty), duty, coast, load_nm);
}

void bind_drill_plant(nb::module_ &m) {
    using vgroove::DrillInterval;
    using vgroove::DrillPlant;
    nb::class_<DrillInterval>(m, "DrillInterval",
                              "An interval of the drill driver: means of current and bus, peak of "
                              "the shaft, the others at its end.")
        .def_ro("current_a", &DrillInterval::current_a)
        .def_ro("supply_v", &DrillInterval::supply_v)
        .def_ro("shaft_peak_nm", &DrillInterval::shaft_peak_nm)
        .def_ro("speed_rad_s", &DrillInterval::speed_rad_s)
        .def_ro("angle_rad", &DrillInterval::angle_rad)
        .def_ro("chuck_rad_s", &DrillInterval::chuck_rad_s)
        .def_ro("chuck_angle_rad", &DrillInterval::chuck_angle_rad)
        .def_ro("shaft_nm", &DrillInterval::shaft_nm)
        .def_ro("load_nm", &DrillInterval::load_nm)
        .def_ro("slipped_s", &DrillInterval::slipped_s);
    nb::class_<DrillPlant>(m, "DrillPlant",
                           "The drill driver in lock-step: period() as DrivePlant's, advance() for "
                           "whole steps of step_s.")
        .def(nb::new_(&make_drill_plant), "parameters"_a, "supply_ohm"_a = 0.0,
             "hall_pulses_per_rev"_a = 4, "hall_offset_rad"_a = 0.0,
             "hall_spacing"_a = std::vector<double>(), "step_s"_a = vgroove::PERIOD_S)
        .def("period", &lockstep_period<DrillPlant>, "coast"_a, "duty"_a, "dead"_a,
             "load_nm"_a = 0.0, PERIOD_DOC)
        .def("advance", &advance, "seconds"_a, "duty"_a, "coast"_a = false, "load_nm"_a = 0.0,
             "duty_from"_a.none() = nb::none(),
             "duty_from: duty at the start, from which it runs linearly to `duty`; absent: "
             "constant.")
        .def_prop_ro("current_a",
                     [](const DrillPlant &self) { return self.system().x[vgroove::DRILL_CURRENT]; })
        .def_prop_ro("speed_rad_s",
                     [](const DrillPlant &self) { return self.system().x[vgroove::DRILL_SPEED]; })
        .def_prop_ro(
            "angle_rad",
            [](const DrillPlant &self) { return self.system().sums[vgroove::DRILL_ANGLE]; })
        .def_prop_ro("chuck_rad_s",
                     [](const DrillPlant &self) { return self.system().x[vgroove::DRILL_CHUCK]; })
        .def_prop_ro(
            "chuck_angle_rad",
            [](const DrillPlant &self) { return self.system().sums[vgroove::DRILL_CHUCK_ANGLE]; })
        .def_prop_ro("clutch_slips",
                     [](const DrillPlant &self) { return self.system().mode.clutch != 0; })
        .def_prop_ro("shaft_nm", &DrillPlant::shaft_nm)
        .def_prop_ro("load_nm", &DrillPlant::load_nm)
        .def_prop_ro("time_s", &DrillPlant::time_s);
}

}  // namespace

void bind_drill(nb::module_ &m) {
    bind_drill_plant(m);
    m.def("drill_parameters", &drill_parameters,
          "Names and defaults of the drill driver: docs/spec/model.md, section 7, low gear, normal "
          "mode, "
          "parameter step 1.");
    m.def("simulate_drill", &simulate_drill, "parameters"_a, "solver"_a = "reference",
          "duration_s"_a = 4.0, "step_s"_a = 0.0, "tolerance"_a = 1e-8, "step_max_s"_a = 0.0,
          "row_s"_a = 0.0, "timed"_a = false, "columns"_a = std::vector<std::string>(),
          "parameters {name: value} -> dict of (n,) columns; steps and marks: {time_s, length_s, "
          "mark}; execution_ns; rejected; diverged_s or None.");
    m.def("drill_jacobian", &drill_jacobian, "parameters"_a, "slips"_a = false, "load_nm"_a = 0.0,
          "chuck_rad_s"_a = 1e9,
          "Jacobian (4, 4) of current, motor speed, twist, chuck speed while the motor turns; the "
          "default chuck_rad_s is beyond the steep part of the friction law.");
}
