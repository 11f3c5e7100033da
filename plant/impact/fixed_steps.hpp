// Steps of a fixed length with bounded work.
#ifndef VGROOVE_PLANT_IMPACT_FIXED_STEPS_HPP
#define VGROOVE_PLANT_IMPACT_FIXED_STEPS_HPP

#include "impact/accept.hpp"

namespace vgroove {

// Longest piece of a stiff step: the contact of the reference tool oscillates at 27,000 rad/s,
// sqrt(contact stiffness x lug radius^2 x (1 / JS + 1 / JA)).
constexpr double IMPACT_PIECE_S = 6e-6;
constexpr int IMPACT_EVENTS_LOCATED_MAX = 2;  // in one piece
constexpr double EVENT_WIDTH_FIXED_S = 1e-8;  // events are located within this

// Once anvil and joint are at rest, their motion is left out until the next contact.
template <class L> VGROOVE_INLINE void impact_freeze(ImpactSolver<L> &self) {
    const bool struck =
        self.mode.place == ContactPlace::FORWARD || self.mode.place == ContactPlace::BACKWARD;
    if (self.mode.frozen || struck || self.mode.slip != 0 || self.model.second_output)
        return;
    if (std::fabs(self.state.x[L::ANVIL_SPEED]) > FROZEN_SPEED_RAD_S ||
        std::fabs(self.state.x[L::TWIST]) > FROZEN_TWIST_RAD)
        return;
    self.mode.frozen = true;
    self.state.x[L::ANVIL_SPEED] = 0.0;
    self.slope_stale = true;
}

// Whether the next stretch of length h is stiff: a flank is touched or within reach, or the anvil
// rings.
template <class L> VGROOVE_INLINE bool impact_is_stiff(const ImpactSolver<L> &self, double h) {
    const ImpactMode &mode = self.mode;
    if (mode.place != ContactPlace::NONE || !mode.frozen)
        return true;
    if (mode.above)
        return false;
    const double relative = impact_relative<L>(self.model, self.state);
    const double reach =
        1.5 * h * std::fabs(self.state.x[L::HAMMER_SPEED] - self.state.x[L::ANVIL_SPEED]);
    return mode.forward_rad - relative < reach || relative - mode.backward_rad < reach;
}

// One step without error control. At most IMPACT_EVENTS_LOCATED_MAX events are located in it; later
// ones are applied at its end.
template <class L> VGROOVE_INLINE void impact_fixed_piece(ImpactSolver<L> &self, double h) {
    for (int cut = 0; cut <= IMPACT_EVENTS_LOCATED_MAX; ++cut) {
        if (self.slope_stale)
            impact_refresh(self);
        impact_attempt(self, h);
        const unsigned possible = impact_events_possible(self.model, self.mode, self.drive);
        const unsigned met = impact_events_met<L>(self.model, self.mode, possible, self.step.end,
                                                  self.step.end_point);
        double share = 1.0;
        const int event = met != 0u && cut < IMPACT_EVENTS_LOCATED_MAX
                              ? impact_earliest_event(self, h, met, 0u, EVENT_WIDTH_FIXED_S, share)
                              : -1;
        self.slope_stale = met != 0u;
        impact_accept(self, share, event);
        if (event < 0)
            break;
        h *= 1.0 - share;
    }
    impact_freeze(self);
}

// Steps of fixed_s: undivided in flight, in pieces of at most IMPACT_PIECE_S where they are stiff
template <class L>
VGROOVE_CLONES_APART void impact_run_fixed(ImpactSolver<L> &self, double length_s) {
    const double steps = std::ceil(length_s / self.fixed_s - 1e-6);
    const double h = length_s / steps;
    const int pieces = static_cast<int>(std::ceil(h / IMPACT_PIECE_S - 1e-6));
    for (double step = 0.0; step < steps; step += 1.0) {
        const int count = impact_is_stiff(self, h) ? pieces : 1;
        for (int n = 0; n < count; ++n)
            impact_fixed_piece(self, h / count);
    }
    if (!std::isfinite(self.state.x[STATE_SPEED] + self.state.x[L::HAMMER_ANGLE] +
                       self.state.x[L::ANVIL_ANGLE]))
        throw std::runtime_error("impact mechanism: the fixed step is too long for this tool");
}

}  // namespace vgroove

#endif
