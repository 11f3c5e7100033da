// Declarations of the parts of vgroove._core, one source file each, and what they share.
#ifndef VGROOVE_HIL_BINDINGS_HPP
#define VGROOVE_HIL_BINDINGS_HPP

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>

#include "plant/components/hall_wheel.hpp"
#include "plant/components/loads.hpp"
#include "plant/numeric/cancellation.hpp"

using Column = nanobind::ndarray<const double, nanobind::ndim<1>, nanobind::c_contig,
                                 nanobind::device::cpu>;                       // in
using Vector = nanobind::ndarray<nanobind::numpy, double, nanobind::ndim<1>>;  // out

// Uninitialised doubles for the columns of a run. A large block asks the system for large pages:
// at the first access to a page the system stops the run, which costs 5 % of a large batch.
struct ColumnBlock {
    double *data;
    nanobind::capsule owner;
};
ColumnBlock column_block(std::size_t count);

// Array (count,) of get(0) to get(count - 1)
template <class Get> Vector vector_of(std::size_t count, Get get) {
    auto *data = new double[count + 1];
    nanobind::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    for (std::size_t n = 0; n < count; ++n)
        data[n] = get(n);
    return Vector(data, {count}, owner);
}

// period() of every lock-step tool as a method in Python
constexpr const char *PERIOD_DOC =
    "-> (current_a as sensed at the end, supply_v mean, edges: CPU cycles 0..509 of Hall edges)";
template <class Plant>
nanobind::tuple lockstep_period(Plant &self, bool coast, double duty, double dead, double load_nm) {
    if (!(std::fabs(duty) <= 1.0 && std::fabs(dead) <= 1.0 && std::isfinite(load_nm)))
        throw std::invalid_argument("duty and dead must be within +-1, load_nm must be finite");
    const vgroove::PeriodResult r = self.period(coast, duty, dead, load_nm);
    nanobind::list edges;
    for (int n = 0; n < r.edge_count; ++n)
        edges.append(r.edge_cycle[n]);
    return nanobind::make_tuple(r.current_a, r.supply_v, edges);
}

// Lets Ctrl-C cancel a run that does not hold the interpreter's lock.
class PythonCancellation final : public vgroove::Cancellation {
    bool requested() override {
        const nanobind::gil_scoped_acquire held;
        return PyErr_CheckSignals() != 0;
    }
};

// Calls work(cancellation) without the interpreter's lock; a Ctrl-C becomes KeyboardInterrupt.
template <class Work> void run_cancellable(const Work &work) {
    PythonCancellation cancellation;
    try {
        const nanobind::gil_scoped_release unlocked;
        work(&cancellation);
    } catch (...) {
        if (PyErr_Occurred())
            throw nanobind::python_error();
        throw;
    }
}

vgroove::LoadKind load_kind(const std::string &kind);  // bind_plant.cpp
void bind_plant(nanobind::module_ &m);
void bind_drill(nanobind::module_ &m);     // bind_drill.cpp
void bind_joints(nanobind::module_ &m);    // bind_joints.cpp
void bind_impact(nanobind::module_ &m);    // bind_impact.cpp, called by bind_plant
void bind_firmware(nanobind::module_ &m);  // bind_firmware.cpp
void bind_lockstep(nanobind::module_ &m);  // bind_lockstep.cpp: firmware and tool

#endif
