// Truncated power series of time: products, values, the first zero and the minimum, and the length
// up to which a series converges.
#ifndef VGROOVE_PLANT_NUMERIC_POWER_SERIES_HPP
#define VGROOVE_PLANT_NUMERIC_POWER_SERIES_HPP

#include <cmath>

#include "numeric/lanes.hpp"

namespace vgroove {

// 1 / n for the integration of a series' n-th coefficient
template <int ORDER> struct Reciprocals { double of[static_cast<unsigned>(ORDER) + 2]; };
template <int ORDER> constexpr Reciprocals<ORDER> reciprocals() {
    Reciprocals<ORDER> r{};
    for (int n = 1; n < ORDER + 2; ++n)
        r.of[n] = 1.0 / n;
    return r;
}

// Terms a[j] b[n - j] of the n-th coefficient of a product, j from `from` to `to`
VGROOVE_INLINE double series_product(const double *a, const double *b, int from, int to, int n) {
    double sum = 0.0;
    for (int j = from; j <= to; ++j)
        sum += a[j] * b[n - j];
    return sum;
}

template <int ORDER> struct Polynomial { double c[static_cast<unsigned>(ORDER) + 1]; };
struct PolynomialPoint {
    double value, slope, bend;  // bend: half of the second derivative
};

// Horner's scheme
template <int ORDER>
VGROOVE_INLINE PolynomialPoint polynomial_at(const Polynomial<ORDER> &p, double t) {
    double value = p.c[ORDER], slope = 0.0, bend = 0.0;
    for (int k = ORDER - 1; k >= 0; --k) {
        bend = bend * t + slope;
        slope = slope * t + value;
        value = value * t + p.c[k];
    }
    return {value, slope, bend};
}

constexpr int ZERO_REPEATS_MAX = 40;
constexpr int MINIMUM_REPEATS_MAX = 12;
constexpr double MINIMUM_SHARE = 1e-3;  // of the interval: a shorter step of Newton's is the last

// Zero of the parabola through value and slope at 0 and the value at `high`
template <int ORDER>
VGROOVE_INLINE double parabola_zero(const Polynomial<ORDER> &p, double high, double high_value) {
    const double value = p.c[0], slope = p.c[1];
    const double bend = (high_value - value - slope * high) / (high * high);
    return 2.0 * value / (std::sqrt(max_of(slope * slope - 4.0 * bend * value, 0.0)) - slope);
}

// Instant just past the first zero between 0, where the polynomial is positive, and `high`, where
// it is negative: Halley's method within a bracket. What it adds to Newton's step, squared over the
// step, estimates the error that is left.
template <int ORDER>
VGROOVE_INLINE double polynomial_zero(const Polynomial<ORDER> &p, double high, double high_value,
                                      double width_s) {
    const double end = high;
    double low = 0.0, t = parabola_zero(p, high, high_value);
    t = t > low && t < high ? t : 0.5 * high;
    for (int n = 0; n < ZERO_REPEATS_MAX && high - low > width_s; ++n) {
        const PolynomialPoint g = polynomial_at(p, t);
        (g.value < 0.0 ? high : low) = t;
        const double newton = g.value / g.slope, share = g.bend * newton / g.slope;
        const double step = newton / (1.0 - share);
        const double left = std::fabs(step * share * share);
        const double next = t - step;
        if (g.slope < 0.0 && std::fabs(share) < 0.5 && left < 0.25 * width_s)
            return min_of(next + 0.5 * width_s, end);
        t = next > low && next < high ? next : 0.5 * (low + high);
    }
    for (double past = 0.5 * width_s; t < end; past *= 2.0) {
        t = min_of(t + past, end);
        if (polynomial_at(p, t).value < 0.0)
            break;
    }
    return t;
}

// Instant of the minimum of a polynomial that falls at 0 and rises at h: Newton's method for its
// slope within a bracket
template <int ORDER>
VGROOVE_INLINE double polynomial_minimum(const Polynomial<ORDER> &p, double h) {
    double low = 0.0, high = h, t = h * (p.c[1] / (p.c[1] - polynomial_at(p, h).slope));
    for (int n = 0; n < MINIMUM_REPEATS_MAX; ++n) {
        const PolynomialPoint g = polynomial_at(p, t);
        (g.slope < 0.0 ? low : high) = t;
        const double step = 0.5 * g.slope / g.bend, next = t - step;
        if (std::fabs(step) < MINIMUM_SHARE * h)
            return max_of(min_of(next, high), low);
        t = next > low && next < high ? next : 0.5 * (low + high);
    }
    return t;
}

// x^(-1/n) within a few per cent, with the same bits on every machine: the exponent divided by n
VGROOVE_INLINE double rough_inverse_root(double x, unsigned n) {
    constexpr std::uint64_t ONE = 0x3FF0000000000000u;  // bits of 1.0
    return from_bits<double>(ONE + ONE / n - bits_of(x) / n);
}

// x^(-1/5) with a relative error of at most 2e-4, with the same bits on every machine: an estimate
// from the exponent, then two Newton steps
inline double fifth_inverse_root(double x) {
    double y = from_bits<double>(0x4CB8E91F5C28F5C2u - bits_of(x) / 5u);
    for (int n = 0; n < 2; ++n) {
        const double y2 = y * y;
        y *= 1.2 - 0.2 * x * (y2 * y2 * y);
    }
    return y;
}

}  // namespace vgroove

#endif
