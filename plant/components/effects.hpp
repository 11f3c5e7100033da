// Which effects a set of parameters switches on: the key by which simulations are put together in
// one vector.
#ifndef VGROOVE_PLANT_COMPONENTS_EFFECTS_HPP
#define VGROOVE_PLANT_COMPONENTS_EFFECTS_HPP

#include <cstdint>
#include <string>

#include "components/parameters.hpp"

namespace vgroove {

enum Effect : std::uint32_t {
    EFFECT_DROOP = 1u << 0,
    EFFECT_DEAD_TIME = 1u << 1,
    EFFECT_HEATING = 1u << 2,
    EFFECT_BRUSH = 1u << 3,
    EFFECT_SATURATION = 1u << 4,
    EFFECT_STRIBECK = 1u << 5,
    EFFECT_DRAG = 1u << 6,
    EFFECT_DIRECTIONAL = 1u << 7,
    EFFECT_COGGING = 1u << 8,
    EFFECT_GREASE = 1u << 9,
    EFFECT_LOAD_FRICTION = 1u << 10,
    EFFECT_ECCENTRICITY = 1u << 11,
    EFFECT_TWO_BODIES = 1u << 12,
    EFFECT_PLAY = 1u << 13,
    EFFECT_CURRENT_LAG = 1u << 14,
    EFFECT_SPEED_LAG = 1u << 15,
    EFFECT_HALL = 1u << 16,
    EFFECT_COMMAND_SHIFT = 1u << 17,
};

// Effects that need states of their own beside current, speed and angle.
constexpr std::uint32_t EFFECTS_WITH_STATES =
    EFFECT_DROOP | EFFECT_HEATING | EFFECT_TWO_BODIES | EFFECT_CURRENT_LAG | EFFECT_SPEED_LAG;

// Coefficient effects (a changed R, L, k, J, Coulomb, viscous torque) are folded into the model's
// constants and have no switch.
std::uint32_t effects_of(const Parameters &p);

// The parameter behind the fastest of the model's rates, with its value: the likely reason why
// steps must be tiny.
std::string fastest_parameter(const Parameters &p);

}  // namespace vgroove

#endif
