// Taylor series of a contact: the motor's rates, with and without effects, and the states of the
// effects.
//
// With effects the current's slope and the motor's torque are functions that are not linear, or
// that the components alone know. They change little within a step: their rates are differences
// at its start. What that leaves out appears in the error estimate.
#ifndef VGROOVE_PLANT_IMPACT_SERIES_EFFECTS_HPP
#define VGROOVE_PLANT_IMPACT_SERIES_EFFECTS_HPP

#include "impact/interpolant.hpp"

namespace vgroove {

// Differences of current and speed, over their scales
constexpr double SERIES_DIFFERENCE = 1e-4;

// Slopes of the states of effects: by current or wheel speed, and by the state itself; 0 where the
// effect is off
struct SeriesEffects {
    bool lags;                                     // the sensor shows the filtered current
    double charge_i;                               // supply
    double polarisation_i, polarisation_rate;      // V/s/A, 1/s
    double heat_i, heat_rate;                      // K/s/A, 1/s
    double current_rate, wheel_share, wheel_rate;  // filters, 1/s
};

// Derivatives of the linear quantities: name_x is the derivative of the quantity by x; i and w are
// motor current and speed, the others belong to hammer, anvil and joint.
struct SeriesRates {
    double current_i, current_w, bus_i;  // A/s, and V of the bus
    double drive_i, drive_w;             // N m on the spindle
    double lug_angle, lug_speed;         // N m, by hammer less anvil
    double lug_ramp;  // N m, by penetration times its rate, while the damping ramps up
    double joint_twist, joint_speed, joint_head;   // N m
    double twist_speed, twist_joint, twist_twist;  // rad/s
    SeriesEffects effects;
};

// Whether the series can take the effects of a model: one body, no friction of flanks and balls,
// and a torque that does not change with the angle of the shaft within a step
VGROOVE_INLINE bool series_takes_effects(const Impact &m) {
    return !(m.two_bodies || m.second_output || m.flank_friction || m.ball_friction ||
             m.drive.input == InputKind::CURRENT || (m.drive.effects & EFFECT_COGGING_TORQUE));
}

// i' = (duty bus - dead bus sign(i) - (R + Rb) i - k w) / L with bus = Voc - Rs duty i
template <class L> VGROOVE_INLINE void series_motor(const ImpactSolver<L> &self, SeriesRates &a) {
    const Drivetrain<double> &d = self.model.drive;
    const Drive<double> &in = self.drive;
    const bool open = in.open > 0.0;
    const double diode = self.mode.drive.diode, duty = open ? -diode : in.command;
    a.bus_i = -d.supply.resistance_ohm * duty;
    double share = duty;
    if (d.effects & EFFECT_DEAD_TIME)
        share -= self.state.x[STATE_CURRENT] > 0.0 ? in.dead : -in.dead;
    const bool blocked = open && diode == 0.0;
    a.current_i = blocked ? 0.0
                          : (share * a.bus_i - d.bridge.resistance_ohm - d.motor.resistance_ohm) *
                                d.motor.inductance_inverse;
    a.current_w = blocked ? 0.0 : -d.motor.constant * d.motor.inductance_inverse;
    a.drive_i = self.model.ratio * d.motor.constant;
    a.drive_w = -self.model.ratio * d.friction.viscous;
}

// Current slope, bus voltage and torque of the motor
struct SeriesMotor {
    double current_slope, bus_v, torque_nm, resistance_ohm;
};
template <class L>
VGROOVE_INLINE SeriesMotor series_motor_at(const ImpactSolver<L> &self, double i, double w) {
    const Drivetrain<double> &d = self.model.drive;
    const Drive<double> &in = self.drive;
    ImpactState<L> s = self.state;
    s.x[STATE_CURRENT] = i;
    const Electrical<double> e =
        drivetrain_electrical<double, L::COUNT>(d, in, self.mode.drive, 0.0, s);
    const double friction = friction_sliding<double>(d.friction, d.effects, self.mode.drive.slide,
                                                     w, e.k * i, in.time_s);
    const bool blocked = in.open > 0.0 && self.mode.drive.diode == 0.0;
    return {blocked ? 0.0
                    : motor_current_slope<double>(d.motor, e.terminal_v, e.r, i, e.k, w, e.brush_v),
            e.bus_v, e.k * i - friction, e.r};
}

template <class L>
VGROOVE_INLINE void series_motor_effects(const ImpactSolver<L> &self, SeriesRates &a) {
    const Impact &m = self.model;
    const Drivetrain<double> &d = m.drive;
    const double i = self.state.x[STATE_CURRENT], w = self.state.x[STATE_SPEED];
    const double di = SERIES_DIFFERENCE * d.current_scale, dw = SERIES_DIFFERENCE * d.speed_scale;
    const SeriesMotor at = series_motor_at<L>(self, i, w),
                      by_i = series_motor_at<L>(self, i + di, w),
                      by_w = series_motor_at<L>(self, i, w + dw);
    a.current_i = (by_i.current_slope - at.current_slope) / di;
    a.current_w = (by_w.current_slope - at.current_slope) / dw;
    a.bus_i = (by_i.bus_v - at.bus_v) / di;
    a.drive_i = m.ratio * (by_i.torque_nm - at.torque_nm) / di;
    a.drive_w = m.ratio * (by_w.torque_nm - at.torque_nm) / dw;
    SeriesEffects &f = a.effects;
    const double duty = self.drive.open > 0.0 ? -self.mode.drive.diode : self.drive.command;
    if (d.effects & EFFECT_SUPPLY_DROOP) {
        f.charge_i = d.input == InputKind::DUTY ? duty : 0.0;
        f.polarisation_rate = d.supply.polarisation_rate;
        f.polarisation_i = d.supply.polarisation_ohm * f.charge_i * f.polarisation_rate;
    }
    if (d.effects & EFFECT_WINDING_HEATING) {
        f.heat_i = 2.0 * d.motor.kelvin_per_joule * i * at.resistance_ohm;
        f.heat_rate = d.motor.cooling_rate;
    }
    f.lags = (d.effects & EFFECT_CURRENT_LAG) != 0u;
    f.current_rate = f.lags ? d.sensors.current_lag_rate : 0.0;
    if (d.effects & EFFECT_SPEED_LAG) {
        f.wheel_rate = d.sensors.speed_lag_rate;
        f.wheel_share =
            sensors_wheel_speed<double>(d.sensors, d.effects, 1.0, self.state.x[STATE_ANGLE]);
    }
}

// Next coefficients c of the states of effects from the last ones, of the current and of the speed
template <class L>
VGROOVE_INLINE void series_store_effects(const SeriesEffects &f, double i, double w, double part,
                                         const double *last, double *c) {
    c[STATE_CHARGE] = part * f.charge_i * i;
    c[STATE_POLARISATION] =
        part * (f.polarisation_i * i - f.polarisation_rate * last[STATE_POLARISATION]);
    c[STATE_HEAT] = part * (f.heat_i * i - f.heat_rate * last[STATE_HEAT]);
    c[STATE_CURRENT_FILTER] = part * f.current_rate * (i - last[STATE_CURRENT_FILTER]);
    c[STATE_SPEED_FILTER] = part * f.wheel_rate * (f.wheel_share * w - last[STATE_SPEED_FILTER]);
    if (f.lags)
        c[STATE_CURRENT_TIME] = part * last[STATE_CURRENT_FILTER];
    c[STATE_OUTPUT_SPEED] = c[STATE_TWIST] = c[L::OUTPUT_SPEED] = c[L::COUPLER_TWIST] = 0.0;
}

}  // namespace vgroove

#endif
