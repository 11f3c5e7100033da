// Disc springs (DIN EN 16984), and the bolt that compresses them (VDI 2230): docs/spec/model.md,
// section 6.
#ifndef VGROOVE_PLANT_COMPONENTS_JOINTS_DISC_HPP
#define VGROOVE_PLANT_COMPONENTS_JOINTS_DISC_HPP

namespace vgroove {

constexpr double YOUNG_PA = 206e9;  // DIN EN 16984
constexpr double POISSON = 0.3;

// F = 4 E / (1 - nu^2) t^4 / (K1 De^2) (s / t) [(h0 / t - s / t)(h0 / t - s / 2t) + 1],
// K1 = (1 / pi) ((d - 1) / d)^2 / ((d + 1) / (d - 1) - 2 / ln d), d = De / Di
struct DiscSpring {
    double outer_m, inner_m, thickness_m, cone_m;  // De, Di, t, h0 (height of the unloaded cone)
};
double disc_spring_force(const DiscSpring &p, double deflection_m);

// F = disc_spring_scale s [(h0 - s)(h0 - s / 2) + t^2], N / m^3
double disc_spring_scale(const DiscSpring &p);

// Stack of n parallel, i series: F_T = n F, s_T = i s, L0 = i (l0 + (n - 1) t), l0 = t + h0
double disc_stack_force(const DiscSpring &p, double parallel, double series, double deflection_m);
double disc_stack_length(const DiscSpring &p, double parallel, double series);

// Bolt of VDI 2230, by default M16 of property class 12.9: pitch P, flank diameter d2, core
// diameter d3 (dS = (d2 + d3) / 2), diameter of the head's friction D_Km, yield stress Rp
struct Bolt {
    double pitch_m = 2e-3, flank_m = 14.701e-3, core_m = 13.546e-3, head_m = 20e-3,
           yield_pa = 1100e6;
};

// Preload at 90 % of yield: F_M = 0.9 Rp A / sqrt(1 + 3 (1.5 d2 / dS (P / (pi d2) + 1.155 mu))^2),
// N
double bolt_preload(const Bolt &p, double thread_friction);

// M_A = F_M (0.16 P + 0.58 d2 mu + D_Km / 2 mu_K), N m
double bolt_torque(const Bolt &p, double force_n, double thread_friction, double head_friction);

}  // namespace vgroove

#endif
