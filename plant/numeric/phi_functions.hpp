// The functions phi_k of exponential integrators, of a number and of a 2 x 2 matrix: phi_0(z) =
// e^z, phi_k(z) = (phi_(k-1)(z) - 1 / (k - 1)!) / z.
//
// Every function of a 2 x 2 matrix Z is a I + b Z (Cayley and Hamilton), whatever its eigenvalues,
// and follows from its trace and determinant. phi_3 is a Taylor sum of a halved Z; the doubling
// formula phi_k(2 z) = 2^-k (e^z phi_k(z) + sum phi_j(z) / (k - j)!) of Skaflestad and Wright
// (Appl. Numer. Math. 59, 2009) leads back.
#ifndef VGROOVE_PLANT_NUMERIC_PHI_FUNCTIONS_HPP
#define VGROOVE_PLANT_NUMERIC_PHI_FUNCTIONS_HPP

#include <cmath>

#include "numeric/lanes.hpp"

namespace vgroove {

// a I + b Z
template <class V> struct MatrixFunction { V a, b; };

template <class V> struct PhiFunctions { MatrixFunction<V> e, p1, p2, p3; };

// Largest size of an eigenvalue of the halved Z. The terms after the 13th of phi_3 are then about
// 6 / 16! of it.
constexpr double PHI_TAYLOR_RADIUS = 1.0;

template <class V>
VGROOVE_INLINE MatrixFunction<V> matrix_product(const MatrixFunction<V> &p,
                                                const MatrixFunction<V> &q, V trace, V det) {
    const V bb = p.b * q.b;
    return {p.a * q.a - bb * det, p.a * q.b + p.b * q.a + bb * trace};
}

// Halvings after which the Taylor sum holds. Largest size of an eigenvalue: |T| / 2 + sqrt(T^2 / 4
// + |D|), at most |T| + sqrt|D|.
VGROOVE_INLINE int phi_halvings(double trace, double det) {
    const double radius = std::fabs(trace) + std::sqrt(std::fabs(det));
    return radius > PHI_TAYLOR_RADIUS && radius < 1e300 ? std::ilogb(radius) + 1 : 0;
}

// Sum of Z^n / (first + n)! up to 1 / last!; factorial: last!
template <class V>
VGROOVE_INLINE MatrixFunction<V> phi_sum(V trace, V det, int first, int last, double factorial) {
    V a = splat<V>(1.0 / factorial), b{};
    for (int n = last; n > first; --n) {
        factorial /= n;
        const V next = 1.0 / factorial - b * det;
        b = a + b * trace;
        a = next;
    }
    return {a, b};
}

// c I + Z f, which leads from phi_k to phi_(k-1) with c = 1 / (k - 1)!
template <class V>
VGROOVE_INLINE MatrixFunction<V> phi_lower(double c, const MatrixFunction<V> &f, V trace, V det) {
    return {c - f.b * det, f.a + f.b * trace};
}

template <class V>
VGROOVE_INLINE PhiFunctions<V> phi_from_p3(const MatrixFunction<V> &p3, V trace, V det) {
    PhiFunctions<V> f;
    f.p3 = p3;
    f.p2 = phi_lower<V>(0.5, f.p3, trace, det);
    f.p1 = phi_lower<V>(1.0, f.p2, trace, det);
    f.e = phi_lower<V>(1.0, f.p1, trace, det);
    return f;
}

template <class V> VGROOVE_INLINE PhiFunctions<V> phi_taylor(V trace, V det) {
    return phi_from_p3<V>(phi_sum<V>(trace, det, 3, 15, 1307674368000.0), trace, det);
}

// phi_0 to phi_4
template <class V> struct PhiFunctions4 {
    PhiFunctions<V> low;
    MatrixFunction<V> p4;
};

template <class V> VGROOVE_INLINE PhiFunctions4<V> phi_taylor_4(V trace, V det) {
    const MatrixFunction<V> p4 = phi_sum<V>(trace, det, 4, 16, 20922789888000.0);
    return {phi_from_p3<V>(phi_lower<V>(1.0 / 6.0, p4, trace, det), trace, det), p4};
}

// phi_0 to phi_3 of the matrix 2 Z, from those of Z (f). trace, det: of Z
template <class V>
VGROOVE_INLINE PhiFunctions<V> phi_doubled(const PhiFunctions<V> &f, V trace, V det) {
    const MatrixFunction<V> q1 = matrix_product<V>(f.e, f.p1, trace, det),
                            q2 = matrix_product<V>(f.e, f.p2, trace, det);
    const MatrixFunction<V> q3 = matrix_product<V>(f.e, f.p3, trace, det),
                            q0 = matrix_product<V>(f.e, f.e, trace, det);
    PhiFunctions<V> g;
    g.p3 = {0.125 * (q3.a + 0.5 * f.p1.a + f.p2.a + f.p3.a),
            0.0625 * (q3.b + 0.5 * f.p1.b + f.p2.b + f.p3.b)};
    g.p2 = {0.25 * (q2.a + f.p1.a + f.p2.a), 0.125 * (q2.b + f.p1.b + f.p2.b)};
    g.p1 = {0.5 * (q1.a + f.p1.a), 0.25 * (q1.b + f.p1.b)};
    g.e = {q0.a, 0.5 * q0.b};
    return g;
}

template <class V>
VGROOVE_INLINE PhiFunctions4<V> phi_doubled(const PhiFunctions4<V> &f, V trace, V det) {
    const MatrixFunction<V> q = matrix_product<V>(f.low.e, f.p4, trace, det);
    constexpr double SIXTH = 1.0 / 6.0;
    PhiFunctions4<V> g;
    g.low = phi_doubled<V>(f.low, trace, det);
    g.p4 = {0.0625 * (q.a + SIXTH * f.low.p1.a + 0.5 * f.low.p2.a + f.low.p3.a + f.p4.a),
            0.03125 * (q.b + SIXTH * f.low.p1.b + 0.5 * f.low.p2.b + f.low.p3.b + f.p4.b)};
    return g;
}

// e^Z, phi_1, phi_2 and phi_3 of Z from its trace and determinant; halvings: enough for every lane
template <class V> VGROOVE_INLINE PhiFunctions<V> phi_functions(V trace, V det, int halvings) {
    const double scale = std::ldexp(1.0, -halvings);
    V t = trace * scale, d = det * (scale * scale);
    PhiFunctions<V> f = phi_taylor<V>(t, d);
    for (int n = 0; n < halvings; ++n) {
        f = phi_doubled<V>(f, t, d);
        t = 2.0 * t;
        d = 4.0 * d;
    }
    return f;
}

// Lane by lane `two` where takes_two is 1, else `one`
template <class V>
VGROOVE_INLINE PhiFunctions4<V> phi_chosen(const PhiFunctions4<V> &one, const PhiFunctions4<V> &two,
                                           const V &takes_two) {
    PhiFunctions4<V> f;
    const V *a = &one.low.e.a, *b = &two.low.e.a;
    V *to = &f.low.e.a;
    for (unsigned n = 0; n < sizeof f / sizeof(V); ++n)
        to[n] = takes_two > 0.0 ? b[n] : a[n];
    return f;
}

// phi_0 to phi_4 of Z from its trace and determinant. Every lane is halved as often as it needs by
// itself, so that its result does not depend on the other lanes.
template <class V> VGROOVE_INLINE PhiFunctions4<V> phi_functions_4(V trace, V det) {
    int most = 0, needs[LaneTraits<V>::COUNT];
    V scale{};
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane) {
        needs[lane] = phi_halvings(get(trace, lane), get(det, lane));
        most = needs[lane] > most ? needs[lane] : most;
        set(scale, lane, std::ldexp(1.0, -needs[lane]));
    }
    V t = trace * scale, d = det * scale * scale;
    PhiFunctions4<V> f = phi_taylor_4<V>(t, d);
    for (int n = 0; n < most; ++n) {
        V doubles{};
        for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
            set(doubles, lane, n < needs[lane] ? 1.0 : 0.0);
        f = phi_chosen<V>(f, phi_doubled<V>(f, t, d), doubles);
        t = (1.0 + doubles) * t;
        d = (1.0 + 3.0 * doubles) * d;
    }
    return f;
}

// phi_0 to phi_3 of a number z <= 0
struct Phi {
    double p0, p1, p2, p3;
};
VGROOVE_INLINE Phi phi_of(double z) {
    Phi f;
    if (z > -1.0) {
        f.p3 = 1.0 / 479001600.0;
        double factorial = 39916800.0;  // Taylor: sum of z^k / (k + 3)!
        for (int n = 11; n >= 3; --n) {
            f.p3 = f.p3 * z + 1.0 / factorial;
            factorial /= n;
        }
        f.p2 = 0.5 + z * f.p3;
        f.p1 = 1.0 + z * f.p2;
        f.p0 = 1.0 + z * f.p1;
    } else {
        f.p0 = exp_of<double>(z);
        f.p1 = (f.p0 - 1.0) / z;
        f.p2 = (f.p1 - 1.0) / z;
        f.p3 = (f.p2 - 0.5) / z;
    }
    return f;
}

}  // namespace vgroove

#endif
