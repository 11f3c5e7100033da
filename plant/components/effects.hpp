// Which effects a set of parameters switches on: simulations with the same effects share a vector.
#ifndef VGROOVE_PLANT_COMPONENTS_EFFECTS_HPP
#define VGROOVE_PLANT_COMPONENTS_EFFECTS_HPP

#include <cstdint>
#include <string>

#include "components/parameters.hpp"

namespace vgroove {

// Parameter lag_form of the effect speed_lag
constexpr double LAG_FILTER = 0.0, LAG_DELAY = 1.0, LAG_MEAN = 2.0;

// Switches that depend on more than one effect or on the rig; the others are generated.
// TWO_BODIES: motor and output side move separately. PLAY: with a play between them. SPEED_LAG: by
// a filter, not as a delay. COMMAND_SHIFT: the command column is shifted against the rows.
constexpr std::uint32_t EFFECT_TWO_BODIES = 1u << 28, EFFECT_PLAY = 1u << 29,
                        EFFECT_SPEED_LAG = 1u << 30, EFFECT_COMMAND_SHIFT = 1u << 31;

// Effects that have states of their own
constexpr std::uint32_t EFFECTS_WITH_STATES = EFFECT_SUPPLY_DROOP | EFFECT_WINDING_HEATING |
                                              EFFECT_TWO_BODIES | EFFECT_CURRENT_LAG |
                                              EFFECT_SPEED_LAG;

// Effects whose voltage or torque is not linear in the current
constexpr std::uint32_t EFFECTS_NOT_LINEAR_IN_CURRENT =
    EFFECT_BRUSH_DROP | EFFECT_DEAD_TIME | EFFECT_MAGNETIC_SATURATION;

// An effect that changes a coefficient (R, L, k, J, Coulomb or viscous torque, ...) is part of the
// model's constants and has no switch. load_inertia_kg_m2: of the load, at the output.
std::uint32_t effects_of(const Parameters &p, double load_inertia_kg_m2);

// A sentence that names the parameter behind the fastest rate of the model, with its value: the
// likely reason why a run needs too many steps
std::string fastest_parameter(const Parameters &p);

}  // namespace vgroove

#endif
