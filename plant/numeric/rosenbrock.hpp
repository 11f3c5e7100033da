// Rosenbrock methods for stiff equations: the coefficients of ROS34PW2 and RODAS, and the step of
// ROS34PW2.
#ifndef VGROOVE_PLANT_NUMERIC_ROSENBROCK_HPP
#define VGROOVE_PLANT_NUMERIC_ROSENBROCK_HPP

#include "numeric/lanes.hpp"
#include "numeric/state_vector.hpp"

namespace vgroove {

// ROS34PW2: Rang and Angermann, BIT 45 (2005). Order 3 with an error estimate of order 2, L-stable,
// for any approximation of the Jacobian. ALPHA: times of the stages. A: weights of the earlier
// slopes in a stage's state. GAMMA_SUM: their weights in the sum that the Jacobian multiplies.
// B: the solution; B_LOW: the embedded one.
struct Ros34pw2 {
    static constexpr double GAMMA = 0.435866521508459;
    static constexpr double ALPHA[4] = {0.0, 0.871733043016918, 0.73157995778885238, 1.0};
    static constexpr double A[4][3] = {
        {}, {0.871733043016918}, {0.84457060015369423, -0.11299064236484185}, {0.0, 0.0, 1.0}};
    static constexpr double GAMMA_SUM[4][3] = {
        {},
        {-0.871733043016918},
        {-0.90338057013044082, 0.054180672388095326},
        {0.24212380706095346, -1.2232505839045147, 0.54526025533510214}};
    static constexpr double B[4] = {0.24212380706095346, -1.2232505839045147, 1.545260255335102,
                                    GAMMA};
    static constexpr double B_LOW[4] = {0.37810903145819369, -0.096042292212423178, 0.5,
                                        0.2179332607542295};
};

// A stage's slope k with a diagonal Jacobian -rate: (1 + h gamma rate) k = f - h rate sum, f the
// right-hand side at the stage and sum the weighted earlier slopes
template <class V> VGROOVE_INLINE V rosenbrock_slope(V f, V h, V rate, V sum) {
    return (f - h * rate * sum) / (1.0 + Ros34pw2::GAMMA * (h * rate));
}

template <class V, int N> struct RosenbrockStep { State<V, N> state, error; };

// One step of length h from y. solve(f, sum) gives a stage's slope; right(time into the step,
// state) the right-hand side; slope: the right-hand side at the start.
template <class V, int N, class Solve, class Right>
VGROOVE_INLINE RosenbrockStep<V, N>
ros34pw2_step(const State<V, N> &y, V h, const State<V, N> &slope, Solve &&solve, Right &&right) {
    using T = Ros34pw2;
    State<V, N> s{}, sum{};
    const State<V, N> k1 = solve(slope, sum);
    for (int n = 0; n < N; ++n) {
        s.x[n] = y.x[n] + h * (T::A[1][0] * k1.x[n]);
        sum.x[n] = T::GAMMA_SUM[1][0] * k1.x[n];
    }
    const State<V, N> k2 = solve(right(T::ALPHA[1] * h, s), sum);
    for (int n = 0; n < N; ++n) {
        s.x[n] = y.x[n] + h * (T::A[2][0] * k1.x[n] + T::A[2][1] * k2.x[n]);
        sum.x[n] = T::GAMMA_SUM[2][0] * k1.x[n] + T::GAMMA_SUM[2][1] * k2.x[n];
    }
    const State<V, N> k3 = solve(right(T::ALPHA[2] * h, s), sum);
    for (int n = 0; n < N; ++n) {
        s.x[n] = y.x[n] + h * k3.x[n];
        sum.x[n] = T::GAMMA_SUM[3][0] * k1.x[n] + T::GAMMA_SUM[3][1] * k2.x[n] +
                   T::GAMMA_SUM[3][2] * k3.x[n];
    }
    const State<V, N> k4 = solve(right(h, s), sum);
    RosenbrockStep<V, N> end;
    for (int n = 0; n < N; ++n) {
        end.state.x[n] = y.x[n] + h * (T::B[0] * k1.x[n] + T::B[1] * k2.x[n] + T::B[2] * k3.x[n] +
                                       T::B[3] * k4.x[n]);
        end.error.x[n] = (T::B[0] - T::B_LOW[0]) * k1.x[n] + (T::B[1] - T::B_LOW[1]) * k2.x[n] +
                         (T::B[2] - T::B_LOW[2]) * k3.x[n] + (T::B[3] - T::B_LOW[3]) * k4.x[n];
    }
    return end;
}

// RODAS: order 4 with an error estimate of order 3, L-stable and stiffly accurate. Hairer and
// Wanner, Solving Ordinary Differential Equations II, 2nd ed., IV.10, in their transformed form.
// ALPHA: times of the stages; D: weights of the derivative by time; A, C: weights of the earlier
// stages in the state and in the right-hand side.
struct Rodas {
    static constexpr int STAGES = 6;
    static constexpr double GAMMA = 0.25;
    static constexpr double ALPHA[6] = {0.0, 0.386, 0.21, 0.63, 1.0, 1.0};
    static constexpr double D[6] = {0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0};
    static constexpr double A[6][5] = {
        {},
        {1.544},
        {0.9466785280815826, 0.2557011698983284},
        {3.314825187068521, 2.896124015972201, 0.9986419139977817},
        {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950},
        {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0}};
    static constexpr double C[6][5] = {
        {},
        {-5.6688},
        {-2.430093356833875, -0.2063599157091915},
        {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
        {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160},
        {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136,
         -6.058818238834054}};
};

}  // namespace vgroove

#endif
