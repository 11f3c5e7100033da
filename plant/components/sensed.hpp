// What the lock-step tools and the impact log read off a state: current, speed and angle as the
// sensors show them.
#ifndef VGROOVE_PLANT_COMPONENTS_SENSED_HPP
#define VGROOVE_PLANT_COMPONENTS_SENSED_HPP

#include "components/sensors.hpp"

namespace vgroove {

// A current as read: gain, offset, clipped at the sensor's end.
inline double sensors_read_current(const Parameters &p, double i) {
    const double read = i * (1.0 + p.current_gain_relative) + p.current_offset_a;
    return read > p.current_limit_a ? p.current_limit_a
                                    : (read < -p.current_limit_a ? -p.current_limit_a : read);
}

// Speed and angle as the sensor shows them: eccentric wheel, lag by a filter (its state), gain. A
// lag in the form of a delay is the caller's.
inline double sensors_seen_speed(const Sensors<double> &s, std::uint32_t effects,
                                 const Parameters &p, double w, double angle, double filtered) {
    const double speed =
        effects & EFFECT_SPEED_LAG ? filtered : sensors_wheel_speed<double>(s, effects, w, angle);
    return speed * (1.0 + p.speed_gain_relative);
}
inline double sensors_seen_angle(const Sensors<double> &s, std::uint32_t effects,
                                 const Parameters &p, double angle, double filtered) {
    const double seen = sensors_wheel_angle<double>(s, effects, angle) -
                        (effects & EFFECT_SPEED_LAG ? p.speed_lag_s * filtered : 0.0);
    return seen * (1.0 + p.speed_gain_relative);
}

}  // namespace vgroove

#endif
