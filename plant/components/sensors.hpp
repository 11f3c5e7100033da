// Sensors: what the shaft and the current look like through gain, lag, offset, clipping and an
// eccentric Hall wheel; counts of the board's front ends.
#ifndef VGROOVE_PLANT_COMPONENTS_SENSORS_HPP
#define VGROOVE_PLANT_COMPONENTS_SENSORS_HPP

#include "components/effects.hpp"
#include "components/state.hpp"

namespace vgroove {

template <class V> struct Sensors {
    V current_lag_rate, speed_lag_rate;  // 1 / time constant
    V hall_amplitude, hall_phase;
};

// Speed of the wheel w (1 + A cos(th + phase)), the derivative of th + A sin(th + phase)
template <class V>
VGROOVE_INLINE V sensors_wheel_speed(const Sensors<V> &p, std::uint32_t effects, V w, V angle) {
    if (!(effects & EFFECT_HALL))
        return w;
    return w * (1.0 + p.hall_amplitude * cos_of<V>(angle + p.hall_phase));
}

template <class V>
VGROOVE_INLINE V sensors_wheel_angle(const Sensors<V> &p, std::uint32_t effects, V angle) {
    if (!(effects & EFFECT_HALL))
        return angle;
    return angle + p.hall_amplitude * sin_of<V>(angle + p.hall_phase);
}

// y' = (input - y) / time constant, for current and speed
template <class V, int N>
VGROOVE_INLINE void sensors_derivative(const Sensors<V> &p, std::uint32_t effects, V i,
                                       const State<V, N> &s, State<V, N> &ds) {
    if (effects & EFFECT_CURRENT_LAG)
        ds.x[STATE_CURRENT_FILTER] = (i - s.x[STATE_CURRENT_FILTER]) * p.current_lag_rate;
    if (effects & EFFECT_SPEED_LAG) {
        const V seen = sensors_wheel_speed<V>(p, effects, s.x[STATE_SPEED], s.x[STATE_ANGLE]);
        ds.x[STATE_SPEED_FILTER] = (seen - s.x[STATE_SPEED_FILTER]) * p.speed_lag_rate;
    }
}

}  // namespace vgroove

#endif
