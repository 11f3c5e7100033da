// Edges of the Hall wheel from angle and speed of the shaft at both ends of a period.
#include "components/hall_wheel.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vgroove {

constexpr double TURN_RAD = 6.283185307179586;

HallWheel hall_wheel(int pulses_per_rev, double offset_rad, const std::vector<double> &shares) {
    HallWheel wheel;
    if (!shares.empty() && shares.size() != static_cast<std::size_t>(pulses_per_rev))
        throw std::invalid_argument("hall spacing needs one share of the turn per pulse");
    double angle = offset_rad - TURN_RAD * std::floor(offset_rad / TURN_RAD);
    for (int n = 0; n < pulses_per_rev; ++n) {
        wheel.edge_rad.push_back(angle < TURN_RAD ? angle : angle - TURN_RAD);
        angle += TURN_RAD *
                 (shares.empty() ? 1.0 / pulses_per_rev : shares[static_cast<std::size_t>(n)]);
    }
    std::sort(wheel.edge_rad.begin(), wheel.edge_rad.end());
    return wheel;
}

// Share of the period at which the wheel reaches an angle: Newton's method on the parabola of a
// linear speed, started on the chord
static double crossing_share(const WheelMotion &w, double angle) {
    const double rise = w.end_angle - w.angle;
    const double bend = 0.5 * (w.end_speed - w.speed) * PERIOD_S;
    double u = (angle - w.angle) / rise;
    for (int n = 0; n < 3; ++n) {
        const double slope = rise + bend * (2.0 * u - 1.0);
        if (slope * rise <= 0.0)
            break;
        u -= (w.angle + rise * u + bend * u * (u - 1.0) - angle) / slope;
    }
    return std::min(std::max(u, 0.0), 1.0);
}

static bool dropped(double probability, Noise &noise) {
    return probability > 0.0 && noise_uniform(noise) < probability;
}

void hall_wheel_edges(const HallWheel &wheel, const WheelMotion &w, double dropout, Noise &noise,
                      std::int64_t first_cycle, std::deque<std::int64_t> &edges) {
    const double low = std::min(w.angle, w.end_angle), high = std::max(w.angle, w.end_angle);
    std::int64_t found[PERIOD_EDGES_MAX];
    int count = 0;
    for (double turn = std::floor(low / TURN_RAD); turn <= std::floor(high / TURN_RAD); turn += 1.0)
        for (const double edge : wheel.edge_rad) {
            const double angle = turn * TURN_RAD + edge;
            const bool passed =
                w.end_angle > w.angle ? angle > low && angle <= high : angle >= low && angle < high;
            if (passed && count < PERIOD_EDGES_MAX && !dropped(dropout, noise))
                found[count++] =
                    first_cycle +
                    std::min<std::int64_t>(
                        static_cast<std::int64_t>(crossing_share(w, angle) * PERIOD_CYCLES),
                        PERIOD_CYCLES - 1);
        }
    if (w.end_angle < w.angle)
        std::reverse(found, found + count);
    edges.insert(edges.end(), found, found + count);
}

void hall_wheel_take(std::deque<std::int64_t> &edges, std::int64_t first_cycle, PeriodResult &r) {
    while (!edges.empty() && edges.front() < first_cycle + PERIOD_CYCLES &&
           r.edge_count < PERIOD_EDGES_MAX) {
        r.edge_cycle[r.edge_count++] = static_cast<int>(edges.front() - first_cycle);
        edges.pop_front();
    }
}

}  // namespace vgroove
