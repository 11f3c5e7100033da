// Energy and angular momentum of the impact tool, for audits of a run.
#ifndef VGROOVE_PLANT_IMPACT_ENERGY_HPP
#define VGROOVE_PLANT_IMPACT_ENERGY_HPP

#include "impact/derivative.hpp"

namespace vgroove {

// Stored energy: inductance, turning and sliding masses, hammer spring, contact, joint and coupler
// twist, pendulum, cogging, play.
double impact_stored(const Impact &m, const ImpactMode &mode, const ImpactState<AuditLayout> &s);

// Joint torque plus the rate of change of the angular momentum of everything that rotates: equals
// the housing reaction.
double impact_reaction_by_momentum(const Impact &m, const ImpactPoint &at,
                                   const ImpactState<AuditLayout> &ds);

}  // namespace vgroove

#endif
