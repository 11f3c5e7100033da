// Contact and friction laws of lug flanks, lug tops and the end stop (docs/spec/model.md, section
// 5, in the symbols of the Simscape Multibody contact force library, 2015).
#ifndef VGROOVE_PLANT_COMPONENTS_CONTACT_HPP
#define VGROOVE_PLANT_COMPONENTS_CONTACT_HPP

#include <cmath>

#include "numeric/lanes.hpp"

namespace vgroove {

struct Contact {
    double stiffness, damping;  // N/m^exponent, N s/m
    double ramp_m;
    double exponent;
    double mu_static, mu_kinetic;  // coefficients of friction
    double threshold_m_per_s;      // v_th
};

// Force of the contact spring, k x^e, N
VGROOVE_INLINE double contact_spring(const Contact &p, double pen_m) {
    if (p.exponent == 1.0)
        return p.stiffness * pen_m;
    return pen_m > 0.0 ? p.stiffness * std::pow(pen_m, p.exponent) : 0.0;
}

// k x^e + b x' ramp while approaching, k x^e while separating; the ramp rises from 0 to 1 over
// ramp_m. `approaching` and `ramped` (the ramp has reached 1) are modes of the solver.
VGROOVE_INLINE double contact_force(const Contact &p, double pen_m, double rate_m_per_s,
                                    bool approaching, bool ramped) {
    const double spring = contact_spring(p, pen_m);
    if (!approaching)
        return spring;
    return spring + p.damping * rate_m_per_s * (ramped ? 1.0 : pen_m / p.ramp_m);
}

// Energy of the spring: k x^(e + 1) / (e + 1)
VGROOVE_INLINE double contact_energy(const Contact &p, double pen_m) {
    return pen_m > 0.0 ? contact_spring(p, pen_m) * pen_m / (p.exponent + 1.0) : 0.0;
}

// Coefficient of friction at the sliding speed v: mu_s v / v_th below v_th; mu_s - (v - v_th)(mu_s
// - mu_k) / (0.5 v_th) up to 1.5 v_th; mu_k above; odd in v
VGROOVE_INLINE double contact_friction(const Contact &p, double v) {
    const double speed = std::fabs(v);
    double mu = p.mu_kinetic;
    const double threshold = p.threshold_m_per_s;
    if (speed < threshold)
        mu = p.mu_static * speed / threshold;
    else if (speed < 1.5 * threshold)
        mu = p.mu_static - (speed - threshold) * (p.mu_static - p.mu_kinetic) / (0.5 * threshold);
    return v < 0.0 ? -mu : mu;
}

}  // namespace vgroove

#endif
