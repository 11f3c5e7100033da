// Moving average of the motor current from stored points of the charge.
#include "drill/charge.hpp"

#include <algorithm>

namespace vgroove {

void DrillCharge::push(double time_s, double charge, double current_a, bool always) {
    if (!always && count_ > 0 && time_s - at(count_ - 1).time_s < spacing_s_)
        return;
    while (count_ > 2 && at(1).time_s <= time_s - window_s_) {
        first_ = (first_ + 1) % points_.size();
        --count_;
    }
    if (count_ == points_.size()) {
        std::rotate(points_.begin(), points_.begin() + static_cast<std::ptrdiff_t>(first_),
                    points_.end());
        first_ = 0;
        points_.resize(2 * count_);
    }
    points_[(first_ + count_++) % points_.size()] = {time_s, charge, current_a};
}

// (q(t) - q(t - window)) / window; between two points q is the cubic through both charges and
// currents
double DrillCharge::average(double time_s, double charge) const {
    const double then_s = time_s - window_s_;
    std::size_t low = 0, high = count_ - 1;
    if (then_s <= at(low).time_s)
        return (charge - at(low).charge) / window_s_;
    while (high - low > 1) {
        const std::size_t middle = (low + high) / 2;
        (at(middle).time_s < then_s ? low : high) = middle;
    }
    const Point &a = at(low), &b = at(high);
    const double h = b.time_s - a.time_s;
    const double u = h > 0.0 ? std::min((then_s - a.time_s) / h, 1.0) : 1.0;
    const double rise = b.charge - a.charge;
    const double then =
        a.charge + rise * u +
        u * (1.0 - u) * ((1.0 - u) * (a.current_a * h - rise) + u * (rise - b.current_a * h));
    return (charge - then) / window_s_;
}

}  // namespace vgroove
