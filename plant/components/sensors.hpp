// Sensors: current, speed and angle as measured, with gain, lag, offset, clipping and an eccentric
// Hall wheel (docs/spec/gap.md, section 3).
#ifndef VGROOVE_PLANT_COMPONENTS_SENSORS_HPP
#define VGROOVE_PLANT_COMPONENTS_SENSORS_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

template <class V> struct Sensors {
    V current_lag_rate, speed_lag_rate;  // 1 / time constant
    V hall_amplitude, hall_phase;
};

template <class V> void sensors_set_lane(Sensors<V> &s, int lane, const Parameters &p) {
    set(s.current_lag_rate, lane,
        p.effects.current_lag.time_constant_s > 0.0 ? 1.0 / p.effects.current_lag.time_constant_s
                                                    : 0.0);
    set(s.speed_lag_rate, lane,
        p.effects.speed_lag.time_constant_s > 0.0 ? 1.0 / p.effects.speed_lag.time_constant_s
                                                  : 0.0);
    set(s.hall_amplitude, lane, p.effects.hall_eccentricity.amplitude_rad);
    set(s.hall_phase, lane, p.effects.hall_eccentricity.phase_rad);
}

// Speed of the eccentric wheel: w (1 + A cos(th + phase)), the derivative of th + A sin(th + phase)
template <class V>
VGROOVE_INLINE V sensors_wheel_speed(const Sensors<V> &p, std::uint32_t effects, V w, V angle) {
    if (!(effects & EFFECT_HALL_ECCENTRICITY))
        return w;
    return w * (1.0 + p.hall_amplitude * cos_of<V>(angle + p.hall_phase));
}

template <class V>
VGROOVE_INLINE V sensors_wheel_angle(const Sensors<V> &p, std::uint32_t effects, V angle) {
    if (!(effects & EFFECT_HALL_ECCENTRICITY))
        return angle;
    return angle + p.hall_amplitude * sin_of<V>(angle + p.hall_phase);
}

// First-order lags y' = (input - y) / time constant of measured current and speed
template <class V, int N>
VGROOVE_INLINE void sensors_derivative(const Sensors<V> &p, std::uint32_t effects, V i,
                                       const State<V, N> &s, State<V, N> &ds) {
    if (effects & EFFECT_CURRENT_LAG)
        ds.x[STATE_CURRENT_FILTER] = (i - s.x[STATE_CURRENT_FILTER]) * p.current_lag_rate;
    if (effects & EFFECT_SPEED_LAG) {
        const V wheel = sensors_wheel_speed<V>(p, effects, s.x[STATE_SPEED], s.x[STATE_ANGLE]);
        ds.x[STATE_SPEED_FILTER] = (wheel - s.x[STATE_SPEED_FILTER]) * p.speed_lag_rate;
    }
}

// Current as measured: gain, offset, clipped at the sensor's limits
inline double sensors_measured_current(const Parameters &p, double i) {
    const double read =
        i * (1.0 + p.effects.current_gain.relative) + p.effects.current_offset.offset_a;
    return read > p.effects.current_saturation.limit_a
               ? p.effects.current_saturation.limit_a
               : (read < -p.effects.current_saturation.limit_a
                      ? -p.effects.current_saturation.limit_a
                      : read);
}

// Motor shaft and the state of the speed sensor's filter
struct ShaftMotion {
    double speed, angle, filtered_speed;
};

// Speed and angle as measured: eccentric wheel, lag by the filter (th_f' = w_f = (th - th_f) / T),
// gain. A lag in the form of a delay is applied by the caller.
inline double sensors_measured_speed(const Sensors<double> &s, std::uint32_t effects,
                                     const Parameters &p, const ShaftMotion &shaft) {
    const double speed = effects & EFFECT_SPEED_LAG
                             ? shaft.filtered_speed
                             : sensors_wheel_speed<double>(s, effects, shaft.speed, shaft.angle);
    return speed * (1.0 + p.effects.speed_gain.relative);
}
inline double sensors_measured_angle(const Sensors<double> &s, std::uint32_t effects,
                                     const Parameters &p, const ShaftMotion &shaft) {
    const double lagged =
        sensors_wheel_angle<double>(s, effects, shaft.angle) -
        (effects & EFFECT_SPEED_LAG ? p.effects.speed_lag.time_constant_s * shaft.filtered_speed
                                    : 0.0);
    return lagged * (1.0 + p.effects.speed_gain.relative);
}

}  // namespace vgroove

#endif
