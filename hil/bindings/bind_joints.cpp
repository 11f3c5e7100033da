// Python binding of the joints: slip torques over the head angle, disc springs and bolts
// (docs/spec/model.md, section 6).
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <stdexcept>
#include <string>

#include "bindings.hpp"
#include "plant/components/joints/disc.hpp"
#include "plant/components/joints/joint.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

nb::tuple joint_slip_torques(Column parameters, const std::string &load, Column head_rad) {
    if (parameters.shape(0) != static_cast<std::size_t>(vgroove::PARAMETER_COUNT))
        throw std::invalid_argument("joint_slip_torques: parameters is (" +
                                    std::to_string(vgroove::PARAMETER_COUNT) + ",)");
    const vgroove::Joint joint =
        vgroove::joint_from(vgroove::parameters_from(parameters.data()), load_kind(load));
    const auto slip = [&](std::size_t n) {
        const double at = head_rad.data()[n];
        return vgroove::joint_slip(joint, vgroove::joint_segment_at(joint, at), at, 0.0);
    };
    const std::size_t count = head_rad.shape(0);
    return nb::make_tuple(vector_of(count, [&](std::size_t n) { return slip(n).forward_nm; }),
                          vector_of(count, [&](std::size_t n) { return slip(n).backward_nm; }));
}

Vector disc_stack_force(Column deflection_m, double parallel, double series, double outer_m,
                        double inner_m, double thickness_m, double cone_m) {
    const vgroove::DiscSpring disc{outer_m, inner_m, thickness_m, cone_m};
    return vector_of(deflection_m.shape(0), [&](std::size_t n) {
        return vgroove::disc_stack_force(disc, parallel, series, deflection_m.data()[n]);
    });
}

double bolt_preload(double thread_friction) {
    return vgroove::bolt_preload(vgroove::Bolt{}, thread_friction);
}

double bolt_torque(double force_n, double thread_friction, double head_friction) {
    return vgroove::bolt_torque(vgroove::Bolt{}, force_n, thread_friction, head_friction);
}

}  // namespace

void bind_joints(nb::module_ &m) {
    m.def("joint_slip_torques", &joint_slip_torques, "parameters"_a, "load_kind"_a, "head_rad"_a,
          "(n,) forwards and (n,) backwards in N m at head angles in rad from the start of a log.");
    m.def("disc_stack_force", &disc_stack_force, "deflection_m"_a, "parallel"_a, "series"_a,
          "outer_m"_a = 40e-3, "inner_m"_a = 20.4e-3, "thickness_m"_a = 1.5e-3,
          "cone_m"_a = 1.15e-3,
          "Force in N (n,) of a stack of disc springs at deflections of the stack.");
    m.def("bolt_preload", &bolt_preload, "thread_friction"_a,
          "Assembly preload in N of the M16 12.9 bolt at 90 % of yield.");
    m.def("bolt_torque", &bolt_torque, "force_n"_a, "thread_friction"_a, "head_friction"_a,
          "Tightening torque in N m of that bolt.");
}
