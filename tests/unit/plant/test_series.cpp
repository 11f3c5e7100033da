// Power series and exact oscillation, of which the steps of the impact tool's fast mode are made.
#include <gtest/gtest.h>

#include <cmath>

#include "plant/impact/flight.hpp"
#include "plant/numeric/power_series.hpp"

using namespace vgroove;

constexpr double WIDTH_S = 1e-9;

// Just past the first zero: within the width, and negative unless rounding decides.
static void expect_zero(const Polynomial<4> &p, double high, double zero) {
    const double t = polynomial_zero(p, high, polynomial_at(p, high).value, WIDTH_S);
    EXPECT_NEAR(t, zero, WIDTH_S);
    EXPECT_GE(t, zero - 1e-12);
    EXPECT_LE(t, high);
}

TEST(PowerSeries, ZeroIsTheFirstWithinTheWidth) {
    expect_zero({{1.0, -2.0, 0.0, 0.0, 0.0}}, 1.0, 0.5);
    expect_zero({{0.0625, 0.0, 0.0, 0.0, -1.0}}, 1.0, 0.5);  // flat at the start
    expect_zero({{1e-6, 1.0, -2.0, 0.0, 0.0}}, 1.0,          // rises before it falls
                0.25 + std::sqrt(0.0625 + 0.5e-6));
}

TEST(PowerSeries, ZeroAtTheBordersOfTheInterval) {
    expect_zero({{1e-12, -1.0, 0.0, 0.0, 0.0}}, 1.0, 1e-12);
    expect_zero({{1.0, -1.0 - 1e-12, 0.0, 0.0, 0.0}}, 1.0, 1.0);
    const Polynomial<4> start{{0.0, -1.0, 0.0, 0.0, 0.0}};
    EXPECT_LE(polynomial_zero(start, 1e-12, -1e-12, WIDTH_S), 1e-12);  // shorter than the width
}

// Also where the first guess is the minimum itself, as for every parabola
TEST(PowerSeries, MinimumIsLocatedWithinItsShareOfTheInterval) {
    for (const double at : {0.0, 1e-3, 0.25, 0.5, 0.999, 1.0}) {
        const Polynomial<4> parabola{{1.0, -2.0 * at, 1.0, 0.0, 0.0}};
        EXPECT_NEAR(polynomial_minimum(parabola, 1.0), at, MINIMUM_SHARE);
        const Polynomial<4> both{{0.0, -2.0 * at - 4.0 * at * at * at, 1.0, 0.0, 1.0}};
        EXPECT_NEAR(polynomial_minimum(both, 1.0), at, MINIMUM_SHARE);
    }
}

TEST(PowerSeries, InverseRoots) {
    for (double x = 1e-30; x < 1e30; x *= 7.3) {
        for (const unsigned n : {7u, 11u, 12u})
            EXPECT_NEAR(rough_inverse_root(x, n) * std::pow(x, 1.0 / n), 1.0, 0.07);
        EXPECT_NEAR(fifth_inverse_root(x) * std::pow(x, 0.2), 1.0, 2e-4);
    }
}

// Solution of q'' = -w^2 q + b + c t, q(0) = 1, q'(0) = v: exact to rounding for w t up to 1; for
// larger w t exact to the terms that the series of the weights leaves out
TEST(Flight, OscillationUnderALinearForceIsExact) {
    const double w = 300.0, square = w * w, v = -40.0, b = 5e4, c = -3e6;
    for (const double angle : {0.0, 1e-6, 0.5, 1.0, 2.0}) {
        const double t = angle / w, within = angle <= 1.0 ? 1e-12 : 1e-8, swing = 1.0 - b / square,
                     rate = v - c / square;
        const double q =
            b / square + c / square * t + swing * std::cos(angle) + rate / w * std::sin(angle);
        const double q_rate = c / square - swing * w * std::sin(angle) + rate * std::cos(angle);
        const GrooveMotion start{1.0, v}, slope{v, b - square};
        const GrooveMotion end =
            swing_on(swing_weights(square * t * t), t, square, start, slope, c * t);
        EXPECT_NEAR(end.q, q, within);
        EXPECT_NEAR(end.rate, q_rate, 2.0 * within * w);
        // The end of a step, whose stages see the force at its start, middle and end
        const GrooveMotion step = swing_end(swing_weights(square * t * t), t, square, start, slope,
                                            {b, 2.0 * b + c * t, b + c * t});
        EXPECT_NEAR(step.q, q, within);
        EXPECT_NEAR(step.rate, q_rate, 2.0 * within * w);
    }
}
