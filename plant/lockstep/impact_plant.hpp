// The impact tool in lock-step: with a board, one PWM period a call; with any other controller, one
// interval a call.
#ifndef VGROOVE_PLANT_LOCKSTEP_IMPACT_PLANT_HPP
#define VGROOVE_PLANT_LOCKSTEP_IMPACT_PLANT_HPP

#include <cstdint>
#include <memory>
#include <vector>

#include "components/hall_wheel.hpp"
#include "impact/blows.hpp"
#include "impact/log.hpp"

namespace vgroove {

// An interval: current, bus and housing reaction as means over it, the others at its end
struct AdvanceResult {
    double current_a, supply_v, speed_rad_s, angle_rad, anvil_torque_nm, anvil_angle_rad, head_rad,
        hammer_mm, housing_nm, arm_rad;
};

struct ImpactBody;  // impact_plant.cpp: the solver for an accuracy and a state layout

class ImpactPlant {
public:
    // fixed_s: step of accuracy FIXED.
    ImpactPlant(const Parameters &p, LoadKind load, HallWheel wheel, std::uint64_t seed,
                ImpactAccuracy accuracy, double fixed_s);
    ~ImpactPlant();
    ImpactPlant(ImpactPlant &&) noexcept;
    ImpactPlant(const ImpactPlant &);

    // As DrivePlant::period: duty and dead time hold over the period, load_nm is the value at its
    // end.
    PeriodResult period(bool coast, double duty, double dead, double load_nm);

    // An interval of any length with one command; dead time as the dead_time effect has it.
    AdvanceResult advance(double seconds, double duty, bool coast, double load_nm);

    // True values at the end of the last period; the housing reaction as its mean over the period.
    AdvanceResult period_end() const;

    AdvanceResult now() const;  // true values of the present instant
    double time_s() const;
    double winding_kelvin() const;

    ImpactStats statistics() const;  // since the start
    // Blows since the last call whose contact is over and whose torque has passed its peak
    std::vector<Blow> take_blows();

private:
    std::unique_ptr<ImpactBody> body_;
};

}  // namespace vgroove

#endif
