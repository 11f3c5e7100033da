// Elementary functions of the plant: close to the library's, and the same bits in every width.
#include <cmath>
#include <gtest/gtest.h>

#include "plant/numeric/lanes.hpp"

using namespace vgroove;

// Irregular arguments of both signs for n from 0 to 399
static double spread(int n) {
    return (n - 200) * 0.173 + 1e-3 * n * n;
}

TEST(Lanes, ExpIsWithinTwoUlp) {
    for (int n = 0; n < 400; ++n) {
        const double x = -spread(n);
        EXPECT_NEAR(exp_of<double>(x) / std::exp(x), 1.0, 5e-16) << x;
    }
}

TEST(Lanes, SinHoldsAtLargeAngles) {
    for (int n = 0; n < 400; ++n) {
        const double x = 5000.0 * spread(n);
        EXPECT_NEAR(sin_of<double>(x), std::sin(x), 1e-15 + 1e-17 * std::fabs(x)) << x;
        EXPECT_NEAR(cos_of<double>(x), std::cos(x), 1e-15 + 2e-16 * std::fabs(x)) << x;
    }
}

TEST(Lanes, TanhAndLogCosh) {
    for (int n = 0; n < 400; ++n) {
        const double x = 0.2 * spread(n);
        EXPECT_NEAR(tanh_of<double>(x), std::tanh(x), 3e-16) << x;
        EXPECT_NEAR(log_two_cosh<double>(x),
                    std::fabs(x) + std::log1p(std::exp(-2.0 * std::fabs(x))), 1e-14)
            << x;
    }
}

TEST(Lanes, VectorHasTheBitsOfTheScalar) {
    Lanes8 x;
    for (int lane = 0; lane < 8; ++lane)
        set(x, lane, spread(40 * lane + 7));
    const Lanes8 e = exp_of<Lanes8>(-x), s = sin_of<Lanes8>(x), t = tanh_of<Lanes8>(x),
                 l = log_two_cosh<Lanes8>(x);
    for (int lane = 0; lane < 8; ++lane) {
        const double one = get(x, lane);
        EXPECT_EQ(get(e, lane), exp_of<double>(-one));
        EXPECT_EQ(get(s, lane), sin_of<double>(one));
        EXPECT_EQ(get(t, lane), tanh_of<double>(one));
        EXPECT_EQ(get(l, lane), log_two_cosh<double>(one));
    }
}
