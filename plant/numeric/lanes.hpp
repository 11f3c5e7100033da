// The number type of the plant: one double, or a vector of eight doubles with one simulation in
// each lane, and elementary functions whose results have the same bits in both.
#ifndef VGROOVE_PLANT_NUMERIC_LANES_HPP
#define VGROOVE_PLANT_NUMERIC_LANES_HPP

#include <cstddef>
#include <cstdint>
#include <cstring>

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored                                                                     \
    "-Wpsabi"  // no vector is passed by value: functions that take one are inlined
#endif

namespace vgroove {

typedef double Lanes8 __attribute__((vector_size(64)));
typedef std::uint64_t Words8 __attribute__((vector_size(64)));

#define VGROOVE_INLINE inline __attribute__((always_inline))

// The compiler emits a function for each of three vector widths and the program picks one when it
// is loaded; the results are the same to the last bit. APART: a function that stays apart from its
// callers, with scalars and short vectors, which need no more than two instruction sets.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(VGROOVE_NO_CLONES)
#define VGROOVE_CLONES __attribute__((flatten, target_clones("avx512f", "avx2", "default")))
#define VGROOVE_CLONES_APART __attribute__((noinline, target_clones("avx2", "default")))
#else
#define VGROOVE_CLONES __attribute__((flatten))
#define VGROOVE_CLONES_APART __attribute__((noinline))
#endif

// VGROOVE_PART: a function that is not inlined, although its callers are flattened. Inlined at
// every call it would make them so large that they take several times as long to compile. A source
// file that contains a function with VGROOVE_CLONES defines VGROOVE_PARTS_CLONED before its
// includes: its parts are then compiled for the same instruction sets, and each clone calls the
// parts that are compiled for its own instruction set. The parts are static: each source file has
// its copies, and only its static or always inlined functions may call them.
#ifdef VGROOVE_PARTS_CLONED
#define VGROOVE_PART static __attribute__((noinline)) VGROOVE_CLONES
#else
#define VGROOVE_PART static __attribute__((noinline, flatten))
#endif

// Number of simulations from which it is faster to run them together, one in each lane of a vector,
// than one after the other. With AVX-512 a register holds all eight lanes. Without it a step of the
// vector takes as long as about seven steps of single simulations, even if few lanes are in use.
inline std::size_t least_lanes() {
#if defined(__x86_64__) && defined(__GNUC__)
    return __builtin_cpu_supports("avx512f") != 0 ? 2 : 7;
#else
    return 7;
#endif
}

template <class V> struct LaneTraits;
template <> struct LaneTraits<double> {
    using Word = std::uint64_t;
    static constexpr int COUNT = 1;
};
template <> struct LaneTraits<Lanes8> {
    using Word = Words8;
    static constexpr int COUNT = 8;
};

// get, set: the number in one lane. splat: the same number in every lane.
VGROOVE_INLINE double get(const double &v, int) {
    return v;
}
VGROOVE_INLINE double get(const Lanes8 &v, int lane) {
    return v[lane];
}
VGROOVE_INLINE void set(double &v, int, double x) {
    v = x;
}
VGROOVE_INLINE void set(Lanes8 &v, int lane, double x) {
    v[lane] = x;
}

template <class V> VGROOVE_INLINE V splat(double x) {
    return V{} + x;
}
template <class V> VGROOVE_INLINE typename LaneTraits<V>::Word bits_of(V x) {
    typename LaneTraits<V>::Word w;
    std::memcpy(&w, &x, sizeof w);
    return w;
}
template <class V> VGROOVE_INLINE V from_bits(typename LaneTraits<V>::Word w) {
    V x;
    std::memcpy(&x, &w, sizeof x);
    return x;
}

template <class V> VGROOVE_INLINE V abs_of(V x) {
    return x < 0.0 ? -x : x;
}
template <class V> VGROOVE_INLINE V sqrt_of(V x) {
    for (int lane = 0; lane < LaneTraits<V>::COUNT; ++lane)
        set(x, lane, __builtin_sqrt(get(x, lane)));
    return x;
}
template <class V> VGROOVE_INLINE V max_of(V a, V b) {
    return a > b ? a : b;
}
template <class V> VGROOVE_INLINE V min_of(V a, V b) {
    return a < b ? a : b;
}

// Adding 1.5 * 2^52 leaves the nearest integer in the low bits of the significand.
constexpr double ROUND_MAGIC = 6755399441055744.0;

// e^x = 2^n e^r, |r| <= ln2 / 2, Taylor to r^13 (remainder below 1 ulp); x is clipped to +-700.
template <class V> VGROOVE_INLINE V exp_of(V x) {
    x = x < -700.0 ? splat<V>(-700.0) : x;
    x = x > 700.0 ? splat<V>(700.0) : x;
    const V shifted = x * 1.4426950408889634 + ROUND_MAGIC;
    const V n = shifted - ROUND_MAGIC;
    const V r = (x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
    V y = splat<V>(1.0 / 6227020800.0);
    y = y * r + 1.0 / 479001600.0;
    y = y * r + 1.0 / 39916800.0;
    y = y * r + 1.0 / 3628800.0;
    y = y * r + 1.0 / 362880.0;
    y = y * r + 1.0 / 40320.0;
    y = y * r + 1.0 / 5040.0;
    y = y * r + 1.0 / 720.0;
    y = y * r + 1.0 / 120.0;
    y = y * r + 1.0 / 24.0;
    y = y * r + 1.0 / 6.0;
    y = y * r + 0.5;
    y = y * r + 1.0;
    y = y * r + 1.0;
    return from_bits<V>(bits_of(y) + (bits_of(shifted) << 52));
}

// sin x = (-1)^n sin r, r = x - n pi, |r| <= pi / 2, Taylor to r^21; Cody and Waite's three parts
// of pi, good to |x| of 1e7.
template <class V> VGROOVE_INLINE V sin_of(V x) {
    const V shifted = x * 0.31830988618379067 + ROUND_MAGIC;
    const V n = shifted - ROUND_MAGIC;
    const V r =
        ((x - n * 3.141592651605606) - n * 1.9841871583270443e-09) - n * 1.034036596358821e-18;
    const V s = r * r;
    V y = splat<V>(1.0 / 51090942171709440000.0);
    y = y * s - 1.0 / 121645100408832000.0;
    y = y * s + 1.0 / 355687428096000.0;
    y = y * s - 1.0 / 1307674368000.0;
    y = y * s + 1.0 / 6227020800.0;
    y = y * s - 1.0 / 39916800.0;
    y = y * s + 1.0 / 362880.0;
    y = y * s - 1.0 / 5040.0;
    y = y * s + 1.0 / 120.0;
    y = y * s - 1.0 / 6.0;
    y = r + r * s * y;
    return from_bits<V>(bits_of(y) ^ (bits_of(shifted) << 63));
}

template <class V> VGROOVE_INLINE V cos_of(V x) {
    return sin_of<V>(x + 1.5707963267948966);
}

// tanh x = (1 - e^-2|x|) / (1 + e^-2|x|) with the sign of x.
template <class V> VGROOVE_INLINE V tanh_of(V x) {
    const V e = exp_of<V>(-2.0 * abs_of<V>(x));
    const V y = (1.0 - e) / (1.0 + e);
    return x < 0.0 ? -y : y;
}

// ln cosh x + ln 2 = |x| + log1p(e^-2|x|), log1p(y) = 2 artanh(y / (2 + y)) as a series in at most
// 1/9.
template <class V> VGROOVE_INLINE V log_two_cosh(V x) {
    const V magnitude = abs_of<V>(x);
    const V e = exp_of<V>(-2.0 * magnitude);
    const V z = e / (2.0 + e);
    const V s = z * z;
    V y = splat<V>(1.0 / 31.0);
    for (int n = 29; n >= 1; n -= 2)
        y = y * s + 1.0 / n;
    return magnitude + 2.0 * z * y;
}

}  // namespace vgroove

#endif
