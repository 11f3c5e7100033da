// Hall wheel: edges at given angles of a turn, and the CPU cycles at which the shaft passes them
// within a PWM period (docs/spec/model.md, section 8).
#ifndef VGROOVE_PLANT_COMPONENTS_HALL_WHEEL_HPP
#define VGROOVE_PLANT_COMPONENTS_HALL_WHEEL_HPP

#include <cstdint>
#include <deque>
#include <vector>

#include "numeric/noise.hpp"

namespace vgroove {

constexpr int PERIOD_CYCLES = 510;  // of phase-correct PWM with TOP 255
constexpr double CPU_HZ = 16e6;
constexpr double PERIOD_S = PERIOD_CYCLES / CPU_HZ;
constexpr int PERIOD_EDGES_MAX = 8;  // room in the lock-step message

struct HallWheel {
    std::vector<double> edge_rad;  // angles of the edges in one turn, increasing, in [0, 2 pi)
};

// shares: parts of a turn from edge to edge, which add to 1; empty: equal spacing. The first edge
// lies at offset_rad. Throws std::invalid_argument for a wrong number of shares.
HallWheel hall_wheel(int pulses_per_rev, double offset_rad, const std::vector<double> &shares);

// Motion of the wheel in a period: angle in rad and speed in rad/s at both ends; the speed changes
// linearly.
struct WheelMotion {
    double angle, speed, end_angle, end_speed;
};

// Appends the edges passed in the period, in the order of time, as CPU cycles since the start of
// the run; first_cycle: of the period. Each edge is lost with the probability `dropout`.
void hall_wheel_edges(const HallWheel &wheel, const WheelMotion &w, double dropout, Noise &noise,
                      std::int64_t first_cycle, std::deque<std::int64_t> &edges);

// A PWM period as the board measures it
struct PeriodResult {
    double current_a;  // at the end, as measured
    double supply_v;   // mean, as measured
    int edge_count;
    int edge_cycle[PERIOD_EDGES_MAX];  // CPU cycles of the Hall edges since the period's start
};

// Moves the edges that occur before the end of the period into the result.
void hall_wheel_take(std::deque<std::int64_t> &edges, std::int64_t first_cycle, PeriodResult &r);

}  // namespace vgroove

#endif
