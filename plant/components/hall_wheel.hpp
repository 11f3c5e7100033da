// The Hall wheel: edges at given angles of a turn, and the CPU cycles at which a shaft passes them
// within a PWM period.
#ifndef VGROOVE_PLANT_COMPONENTS_HALL_WHEEL_HPP
#define VGROOVE_PLANT_COMPONENTS_HALL_WHEEL_HPP

#include <cstdint>
#include <deque>
#include <vector>

#include "components/front_ends.hpp"

namespace vgroove {

constexpr int PERIOD_CYCLES = 510;  // phase-correct PWM, TOP 255
constexpr double CPU_HZ = 16e6;
constexpr double PERIOD_S = PERIOD_CYCLES / CPU_HZ;
constexpr int PERIOD_EDGES_MAX = 8;  // as many as the lock-step message holds

struct HallWheel {
    std::vector<double> edge_rad;  // angles of the edges in one turn, increasing, within 0..2 pi
};

// Equal spacing for shares empty, else shares of a turn from edge to edge, which add to 1. The
// first edge lies at offset_rad.
HallWheel hall_wheel(int pulses_per_rev, double offset_rad, const std::vector<double> &shares);

// Angle of the wheel within the period: a straight change of speed between both ends.
struct Sweep {
    double angle, speed, end_angle, end_speed;
};

// Appends the edges passed in the period, in the order of time, as cycles since start; `from` is
// the period's first cycle.
void hall_wheel_edges(const HallWheel &wheel, const Sweep &w, double dropout, Noise &noise,
                      std::int64_t from, std::deque<std::int64_t> &edges);

struct PeriodResult {
    double current_a;  // at the end, through lag, gain, offset and clipping of the current effects
    double supply_v;   // mean, with supply_gain
    int edge_count;
    int edge_cycle[PERIOD_EDGES_MAX];
};

// Moves the edges that are due before the end of the period into the result.
void hall_wheel_take(std::deque<std::int64_t> &edges, std::int64_t from, PeriodResult &r);

}  // namespace vgroove

#endif
