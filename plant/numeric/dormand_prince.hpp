// The embedded Runge-Kutta method 5(4) of Dormand and Prince (J. Comp. Appl. Math. 6, 1980): its
// coefficients, stages, error estimate and interpolant, for every solver of the plant.
//
// The interpolant is of fourth order: Hairer, Norsett and Wanner, Solving Ordinary Differential
// Equations I, 2nd ed., II.6, program DOPRI5.
#ifndef VGROOVE_PLANT_NUMERIC_DORMAND_PRINCE_HPP
#define VGROOVE_PLANT_NUMERIC_DORMAND_PRINCE_HPP

#include "numeric/lanes.hpp"
#include "numeric/state_vector.hpp"

namespace vgroove {

// Row s of A holds the weights of the earlier slopes in stage s + 2; the last row is the solution
// of fifth order. C: times of the stages. ERROR: solution of fifth less fourth order. DENSE: the
// last term of the interpolant. Weights of the second slope that are 0 are left out of the sums.
struct DormandPrince {
    static constexpr double C[6] = {0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0};
    static constexpr double A[6][6] = {
        {1.0 / 5.0},
        {3.0 / 40.0, 9.0 / 40.0},
        {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
        {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
        {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
        {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0}};
    static constexpr double ERROR[7] = {
        71.0 / 57600.0,      0.0,          -71.0 / 16695.0, 71.0 / 1920.0,
        -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0};
    static constexpr double DENSE[7] = {
        -12715105075.0 / 11282082432.0,  0.0,
        87487479700.0 / 32700410799.0,   -10690763975.0 / 1880347072.0,
        701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0,
        69997945.0 / 29380423.0};
};

// In which order a stage's sum y + h (a1 k1 + a2 k2 + ...) is formed; the results differ by
// rounding only. COMMON_FACTOR multiplies the whole sum by h: fewer operations. LAST_SLOPE_LAST
// adds the slope that was computed last in the last operation, so that the processor can form the
// rest of the sum while that slope is being computed: for one simulation alone, which is bound by
// latency.
enum class StageSum { COMMON_FACTOR, LAST_SLOPE_LAST };

// y + h (early + a last)
template <StageSum SUM, class V> VGROOVE_INLINE V stage_sum(V y, V h, V early, double a, V last) {
    if constexpr (SUM == StageSum::LAST_SLOPE_LAST)
        return (y + h * early) + (a * h) * last;
    return y + h * (early + a * last);
}

// Arguments of stages 2 to 6 and the solution of fifth order, for one component of the state
template <StageSum SUM, class V> VGROOVE_INLINE V stage_2(V y, V h, V k1) {
    constexpr const double(&a)[6] = DormandPrince::A[0];
    if constexpr (SUM == StageSum::LAST_SLOPE_LAST)
        return y + (a[0] * h) * k1;
    return y + h * (a[0] * k1);
}
template <StageSum SUM, class V> VGROOVE_INLINE V stage_3(V y, V h, V k1, V k2) {
    constexpr const double(&a)[6] = DormandPrince::A[1];
    if constexpr (SUM == StageSum::LAST_SLOPE_LAST)
        return (y + (a[0] * h) * k1) + (a[1] * h) * k2;
    return y + h * (a[0] * k1 + a[1] * k2);
}
template <StageSum SUM, class V> VGROOVE_INLINE V stage_4(V y, V h, V k1, V k2, V k3) {
    constexpr const double(&a)[6] = DormandPrince::A[2];
    return stage_sum<SUM, V>(y, h, a[0] * k1 + a[1] * k2, a[2], k3);
}
template <StageSum SUM, class V> VGROOVE_INLINE V stage_5(V y, V h, V k1, V k2, V k3, V k4) {
    constexpr const double(&a)[6] = DormandPrince::A[3];
    if constexpr (SUM == StageSum::LAST_SLOPE_LAST)
        return stage_sum<SUM, V>(y, h, (a[0] * k1 + a[1] * k2) + a[2] * k3, a[3], k4);
    return y + h * ((a[0] * k1 + a[1] * k2) + (a[2] * k3 + a[3] * k4));
}
template <StageSum SUM, class V> VGROOVE_INLINE V stage_6(V y, V h, V k1, V k2, V k3, V k4, V k5) {
    constexpr const double(&a)[6] = DormandPrince::A[4];
    return stage_sum<SUM, V>(y, h, (a[0] * k1 + a[1] * k2) + (a[2] * k3 + a[3] * k4), a[4], k5);
}
template <StageSum SUM, class V>
VGROOVE_INLINE V fifth_order(V y, V h, V k1, V k3, V k4, V k5, V k6) {
    constexpr const double(&a)[6] = DormandPrince::A[5];
    return stage_sum<SUM, V>(y, h, (a[0] * k1 + a[2] * k3) + (a[3] * k4 + a[4] * k5), a[5], k6);
}

// Sum over the slopes k1 and k3 to k7 with the weights of ERROR or DENSE
template <class V>
VGROOVE_INLINE V weighted_slopes(const double (&e)[7], V k1, V k3, V k4, V k5, V k6, V k7) {
    return (e[0] * k1 + e[2] * k3) + (e[3] * k4 + e[4] * k5) + (e[5] * k6 + e[6] * k7);
}

// Slopes of stages 2 to 6; the first slope and that at the step's end are kept by the solver.
template <class V, int N> struct StageSlopes { State<V, N> k2, k3, k4, k5, k6; };

// The stages of a step of length h from y with the slope k1. slope(time into the step, state, to)
// writes the derivative to its last argument.
template <StageSum SUM, class V, int N, class Slope>
VGROOVE_INLINE void dormand_prince_stages(const State<V, N> &y, const State<V, N> &k1, V h,
                                          StageSlopes<V, N> &k, Slope &&slope) {
    using T = DormandPrince;
    State<V, N> s;
    for (int n = 0; n < N; ++n)
        s.x[n] = stage_2<SUM, V>(y.x[n], h, k1.x[n]);
    slope(T::C[0] * h, s, k.k2);
    for (int n = 0; n < N; ++n)
        s.x[n] = stage_3<SUM, V>(y.x[n], h, k1.x[n], k.k2.x[n]);
    slope(T::C[1] * h, s, k.k3);
    for (int n = 0; n < N; ++n)
        s.x[n] = stage_4<SUM, V>(y.x[n], h, k1.x[n], k.k2.x[n], k.k3.x[n]);
    slope(T::C[2] * h, s, k.k4);
    for (int n = 0; n < N; ++n)
        s.x[n] = stage_5<SUM, V>(y.x[n], h, k1.x[n], k.k2.x[n], k.k3.x[n], k.k4.x[n]);
    slope(T::C[3] * h, s, k.k5);
    for (int n = 0; n < N; ++n)
        s.x[n] = stage_6<SUM, V>(y.x[n], h, k1.x[n], k.k2.x[n], k.k3.x[n], k.k4.x[n], k.k5.x[n]);
    slope(T::C[4] * h, s, k.k6);
}

// State at the end of the step
template <StageSum SUM, class V, int N>
VGROOVE_INLINE void dormand_prince_end(const State<V, N> &y, const State<V, N> &k1, V h,
                                       const StageSlopes<V, N> &k, State<V, N> &end) {
    for (int n = 0; n < N; ++n)
        end.x[n] =
            fifth_order<SUM, V>(y.x[n], h, k1.x[n], k.k3.x[n], k.k4.x[n], k.k5.x[n], k.k6.x[n]);
}

// Local error of the step over its length; k7: slope at its end
template <class V, int N>
VGROOVE_INLINE void dormand_prince_error(const State<V, N> &k1, const StageSlopes<V, N> &k,
                                         const State<V, N> &k7, State<V, N> &error) {
    for (int n = 0; n < N; ++n)
        error.x[n] = weighted_slopes<V>(DormandPrince::ERROR, k1.x[n], k.k3.x[n], k.k4.x[n],
                                        k.k5.x[n], k.k6.x[n], k7.x[n]);
}

}  // namespace vgroove

#endif
