// The drivetrain in lock-step with a board: one PWM period a call, Hall edges in CPU cycles
// (docs/architecture.md).
#ifndef VGROOVE_PLANT_LOCKSTEP_DRIVE_PLANT_HPP
#define VGROOVE_PLANT_LOCKSTEP_DRIVE_PLANT_HPP

#include <cstdint>
#include <memory>

#include "components/hall_wheel.hpp"
#include "drivetrain/model.hpp"

namespace vgroove {

class DrivePlant {
public:
    DrivePlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed);
    ~DrivePlant();
    DrivePlant(DrivePlant &&) noexcept;
    DrivePlant(const DrivePlant &);

    // dead: share of the bus that dead time takes, 0 when the bridge does not switch; load_nm: at
    // the end of the period, linear in it.
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
