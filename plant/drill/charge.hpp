// Moving average of the motor current, which decides when pulse mode ends.
#ifndef VGROOVE_PLANT_DRILL_CHARGE_HPP
#define VGROOVE_PLANT_DRILL_CHARGE_HPP

#include <cstddef>
#include <vector>

#include "drill/model.hpp"

namespace vgroove {

// Points of the charge over the last pulse_average_s, in a ring buffer that grows when it is full
class DrillCharge {
public:
    explicit DrillCharge(double window_s, double spacing_s, std::size_t capacity)
        : points_(capacity),
          window_s_(window_s),
          spacing_s_(spacing_s) {}
    // Adds a point if spacing_s has passed since the last one, or if `always` is set.
    void push(double time_s, double charge, double current_a, bool always);
    double average(double time_s, double charge) const;

private:
    struct Point {
        double time_s, charge, current_a;
    };
    const Point &at(std::size_t n) const { return points_[(first_ + n) % points_.size()]; }
    std::vector<Point> points_;
    std::size_t first_ = 0, count_ = 0;
    double window_s_, spacing_s_;
};

// Spacing of the points of a fixed-step solver, and the capacity of its ring buffer: 4096 more
// points than the average needs, for events, so that the buffer never grows
constexpr double DRILL_CHARGE_SPACING_S = 50e-6;
inline std::size_t drill_charge_points(const DrillParameters &p) {
    return static_cast<std::size_t>(p.pulse_average_s / DRILL_CHARGE_SPACING_S) + 4096;
}

}  // namespace vgroove

#endif
