// Constants of the drivetrain from the flat parameters, component by component, and the scales of
// its errors.
#include "drivetrain/model.hpp"

#include <algorithm>
#include <cmath>

namespace vgroove {

// Lower limits, so that no scale is 0 for a tool without voltage or torque constant
constexpr double VOLTAGE_LEAST_V = 1e-3, CURRENT_LEAST_A = 1e-6, RESISTANCE_LEAST_OHM = 1e-3,
                 CONSTANT_LEAST = 1e-9, SCALE_LEAST = 1e-12;
// The free speed counts as scale up to this multiple of the speed gained in one row.
constexpr double SPEED_GAIN_MAX = 1e3;

// Errors are relative to the stall current and the free speed at the largest voltage of the run;
// or, with the current as input, to the speed gained in one row at the largest current.
template <class V>
static void set_scales(Drivetrain<V> &m, int lane, const Parameters &p, double command_peak,
                       double mean_interval_s) {
    const double k = std::fabs(motor_torque_constant(p));
    const double volts =
        std::max(m.input == InputKind::DUTY ? p.supply_voltage_v : command_peak, VOLTAGE_LEAST_V);
    const double amperes =
        m.input == InputKind::CURRENT
            ? std::max(command_peak, CURRENT_LEAST_A)
            : volts / std::max(get(m.motor.resistance_ohm, lane), RESISTANCE_LEAST_OHM);
    const double gained = k * amperes * get(m.gear.inertia_inverse, lane) * mean_interval_s;
    const double free =
        m.input == InputKind::CURRENT
            ? gained
            : std::min(volts / std::max(k, CONSTANT_LEAST), SPEED_GAIN_MAX * gained);
    set(m.current_scale, lane, amperes);
    set(m.speed_scale, lane, std::max(free, SCALE_LEAST));
    set(m.torque_scale, lane, std::max(k * amperes, SCALE_LEAST));
}

template <class V>
void drivetrain_set_lane(Drivetrain<V> &m, int lane, const Parameters &p, double command_peak,
                         double mean_interval_s) {
    supply_set_lane(m.supply, lane, p);
    bridge_set_lane(m.bridge, lane, p, motor_inductance(p));
    motor_set_lane(m.motor, lane, p);
    friction_set_lane(m.friction, lane, p);
    gear_set_lane(m.gear, lane, p, m.effects, load_inertia(p, m.load.kind));
    load_set_lane(m.load, lane, p);
    sensors_set_lane(m.sensors, lane, p);
    set_scales(m, lane, p, command_peak, mean_interval_s);
}

template void drivetrain_set_lane<double>(Drivetrain<double> &, int, const Parameters &, double,
                                          double);
template void drivetrain_set_lane<Lanes8>(Drivetrain<Lanes8> &, int, const Parameters &, double,
                                          double);

}  // namespace vgroove
