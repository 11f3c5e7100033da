// Equations of single components, with effects on and off.
#include <cmath>
#include <gtest/gtest.h>

#include "plant/components/friction_law.hpp"
#include "plant/drivetrain/model.hpp"

using namespace vgroove;

TEST(Bridge, RippleHasItsFloorAndPeak) {
    const Bridge<double> p{0.0, 1.0 / (2.0 * 1e-4 * 20000.0), 0.0, 0.0};
    EXPECT_DOUBLE_EQ(bridge_ripple<double>(p, 0.0, 18.0), 0.2);
    EXPECT_DOUBLE_EQ(bridge_ripple<double>(p, -0.5, 18.0), 0.25 * 18.0 / 4.0);
    EXPECT_DOUBLE_EQ(bridge_sign<double>(p, 0.5, 1.0), 0.5);
    EXPECT_DOUBLE_EQ(bridge_sign<double>(p, -3.0, 1.0), -1.0);
}

TEST(Motor, BrushDropIsOddAndSettlesAtItsVoltage) {
    Motor<double> p{};
    p.brush_v = 0.6;
    EXPECT_NEAR(motor_brush_voltage<double>(p, EFFECT_BRUSH_DROP, 20.0, 1.0), 0.6, 1e-12);
    EXPECT_NEAR(motor_brush_voltage<double>(p, EFFECT_BRUSH_DROP, 0.3, 1e-4), 0.6 * std::tanh(1.0),
                1e-7);
    EXPECT_DOUBLE_EQ(motor_brush_voltage<double>(p, EFFECT_BRUSH_DROP, -0.4, 0.7),
                     -motor_brush_voltage<double>(p, EFFECT_BRUSH_DROP, 0.4, 0.7));
    EXPECT_EQ(motor_brush_voltage<double>(p, 0u, 20.0, 1.0), 0.0);
}

TEST(Friction, HoldIsTheLimitOfSliding) {
    Friction<double> p{};
    p.coulomb_nm = 0.012;
    p.forward_nm = 0.004;
    p.backward_nm = -0.002;
    p.breakaway_nm = 0.01;
    p.stribeck_inverse = 1.0 / 30.0;
    p.load_relative = 0.1;
    const std::uint32_t on = EFFECT_STRIBECK_FRICTION | EFFECT_LOAD_DEPENDENT_FRICTION;
    const HoldLimits<double> hold = friction_hold<double>(p, on, 0.2);
    EXPECT_NEAR(friction_sliding<double>(p, on, 1.0, 1e-12, 0.2, 0.0), hold.forward_nm, 1e-12);
    EXPECT_NEAR(friction_sliding<double>(p, on, -1.0, -1e-12, 0.2, 0.0), -hold.backward_nm, 1e-12);
}

TEST(Gear, FlanksPushAndNeverPull) {
    Gear<double> p{};
    p.stiffness = 100.0;
    p.damping = 0.5;
    p.half_play = 0.01;
    EXPECT_EQ(gear_coupler_torque<double>(p, EFFECT_PLAY, 0.0099, 5.0), 0.0);
    EXPECT_GT(gear_coupler_torque<double>(p, EFFECT_PLAY, 0.0101, 0.0), 0.0);
    EXPECT_EQ(gear_coupler_torque<double>(p, EFFECT_PLAY, 0.0101, -50.0), 0.0);
    EXPECT_LT(gear_coupler_torque<double>(p, EFFECT_PLAY, -0.0101, 0.0), 0.0);
    EXPECT_NEAR(gear_coupler_energy<double>(p, 0.03), 0.5 * 100.0 * 0.02 * 0.02, 1e-15);
}

// docs/spec/model.md, section 3: the law is the break-away torque at w_brk, the Coulomb torque far
// above it, 0 at rest, and odd in the speed.
TEST(FrictionLaw, BothFormsHaveTheirBreakAwayAndCoulombTorques) {
    FrictionLaw<double> law{};
    law.breakaway_nm = 7.2;
    law.coulomb_nm = 6.0;
    law.viscous = 0.0;
    law.breakaway_rad_s = 0.1;
    law.decay_s_per_rad = 40.0;
    law.threshold_rad_s = 0.02;
    EXPECT_EQ(friction_law_stribeck<double>(law, 0.0), 0.0);
    EXPECT_NEAR(friction_law_stribeck<double>(law, 0.1), 7.2, 0.01);
    EXPECT_NEAR(friction_law_stribeck<double>(law, 5.0), 6.0, 1e-9);
    EXPECT_DOUBLE_EQ(friction_law_stribeck<double>(law, -0.05),
                     -friction_law_stribeck<double>(law, 0.05));
    EXPECT_NEAR(friction_law_exponential<double>(law, 0.01),
                0.5 * friction_law_exponential<double>(law, 0.02), 1e-12);
    EXPECT_NEAR(friction_law_exponential<double>(law, 0.02), 6.0 + 1.2 * std::exp(-0.8), 1e-12);
    EXPECT_NEAR(friction_law_exponential<double>(law, -5.0), -6.0, 1e-9);
}
