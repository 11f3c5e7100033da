// The impact tool in lock-step: with a board a PWM period at a time, or with any controller an
// interval at a time.
#ifndef VGROOVE_PLANT_LOCKSTEP_IMPACT_PLANT_HPP
#define VGROOVE_PLANT_LOCKSTEP_IMPACT_PLANT_HPP

#include <cstdint>
#include <memory>
#include <vector>

#include "components/hall_wheel.hpp"
#include "impact/blows.hpp"
#include "impact/log.hpp"

namespace vgroove {

// What an interval came to: means over it, the rest at its end.
struct AdvanceResult {
    double current_a, supply_v, speed_rad_s, angle_rad, anvil_torque_nm, anvil_angle_rad, head_rad,
        hammer_mm, housing_nm, arm_rad;
};

struct ImpactBody;  // impact_plant.cpp: solver of the accuracy and effects asked for

class ImpactPlant {
public:
    // fixed_s: step of accuracy FIXED.
    ImpactPlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed,
                ImpactAccuracy accuracy, double fixed_s);
    ~ImpactPlant();
    ImpactPlant(ImpactPlant &&) noexcept;

    // As DrivePlant::period: duty and dead time hold over the period, load_nm is the value at its
    // end.
    PeriodResult period(bool coast, double duty, double dead, double load_nm);

    // Any interval with one command; dead time as the dead_time effect has it.
    AdvanceResult advance(double seconds, double duty, bool coast, double load_nm);

    // True values at the end of the last period, the housing reaction as its mean over it.
    AdvanceResult period_end() const;

    double current_a() const;
    double speed_rad_s() const;
    double angle_rad() const;
    double time_s() const;
    double winding_kelvin() const;
    double hammer_mm() const;
    double anvil_torque_nm() const;
    double anvil_angle_rad() const;
    double head_rad() const;
    double housing_nm() const;
    double arm_rad() const;

    ImpactStats statistics() const;  // since the start
    std::vector<Blow>
    take_blows();  // since the last call; the last of them may still gain torque and impulse

private:
    std::unique_ptr<ImpactBody> body_;
};

}  // namespace vgroove

#endif
