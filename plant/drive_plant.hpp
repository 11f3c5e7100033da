// The tool in lock-step with a board: one PWM period at a time, Hall edges in CPU cycles (docs/architecture.md).
#ifndef VGROOVE_PLANT_DRIVE_PLANT_HPP
#define VGROOVE_PLANT_DRIVE_PLANT_HPP

#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "drivetrain.hpp"
#include "front_ends.hpp"

namespace vgroove {

constexpr int PERIOD_CYCLES = 510;      // phase-correct PWM, TOP 255
constexpr double CPU_HZ = 16e6;
constexpr double PERIOD_S = PERIOD_CYCLES / CPU_HZ;
constexpr int PERIOD_EDGES_MAX = 8;     // as many as the lock-step message holds

struct HallWheel {
    std::vector<double> edge_rad;  // angles of the edges in one turn, increasing, within 0..2 pi
};

// Equal spacing for shares empty, else shares of a turn from edge to edge, which add to 1. The first edge lies at offset_rad.
HallWheel hall_wheel(int pulses_per_rev, double offset_rad, const std::vector<double> &shares);

struct PeriodResult {
    double current_a;  // at the end, through lag, gain, offset and clipping of the current effects
    double supply_v;   // mean, with supply_gain
    int edge_count;
    int edge_cycle[PERIOD_EDGES_MAX];
};

class DrivePlant {
public:
    DrivePlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed);
    ~DrivePlant();
    DrivePlant(DrivePlant &&) noexcept;

    // dead: share of the bus that dead time takes, 0 when the bridge does not switch; load_nm: at the end of the period, linear in it.
    PeriodResult period(bool coast, double duty, double dead, double load_nm);
    void reset(double current_a, double speed_rad_s, double angle_rad);

    double current_a() const;
    double speed_rad_s() const;
    double angle_rad() const;
    double time_s() const;
    double winding_kelvin() const;

private:
    struct Body;
    std::unique_ptr<Body> body_;
};

}  // namespace vgroove

#endif
