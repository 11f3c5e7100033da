// Scalar types that replace the fixed-point integers of the controllers' C sources: the same code,
// compiled as C++ with this header, computes with floating point (docs/fixed_point.md).
//
// A number keeps the scale of its format (a current in 1/512 A, a duty in 1/32768), but not its
// grid: products, shifts and quotients are exact up to the rounding of `Scalar`, where the fixed
// point cuts off bits. A cast to a type still wraps around at the end of its range, since unsigned
// differences rely on it. uint8_t stays an integer: states, counts and indices.
#ifndef VGROOVE_HIL_FIXED_POINT_REAL_HPP
#define VGROOVE_HIL_FIXED_POINT_REAL_HPP

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

namespace real {

using Scalar = double;  // on the AVR 32 bits wide

using Index = int32_t;  // a whole number, for bit operations and indices

struct Real {
    Scalar v;
    Real() = default;
    constexpr Real(int value) : v(static_cast<Scalar>(value)) {}
    constexpr Real(unsigned value) : v(static_cast<Scalar>(value)) {}
    constexpr Real(long value) : v(static_cast<Scalar>(value)) {}
    constexpr Real(unsigned long value) : v(static_cast<Scalar>(value)) {}
    constexpr Real(Scalar value) : v(value) {}
    constexpr explicit operator Scalar() const { return v; }
    explicit operator uint8_t() const {
        return static_cast<uint8_t>(static_cast<uint32_t>(static_cast<Index>(floor(v))));
    }
    explicit operator int8_t() const { return static_cast<int8_t>(static_cast<Index>(floor(v))); }
    constexpr explicit operator bool() const { return v != Scalar(0); }
};

// Value within [low, low + span): what a cast to an integer type of that range leaves. A value less
// than one step below the range stays: it is 0 but for the cut-off bits.
inline Scalar wrapped(Scalar v, Scalar low, Scalar span) {
#ifdef VGROOVE_REAL_BARE  // the arithmetic alone, for its cycles: values out of range stay
    (void)low;
    (void)span;
    return v;
#endif
    if (v > low - Scalar(1) && v < low + span) {
        return v;
    }
    return v - span * floor((v - low) / span);
}

template <int BITS, bool SIGNED> struct Number : Real {
    static constexpr Scalar SPAN = BITS == 16 ? Scalar(65536.0) : Scalar(4294967296.0);
    static constexpr Scalar LOW = SIGNED ? -SPAN / Scalar(2) : Scalar(0);
    Number() = default;
    constexpr Number(int value) : Real(value) {}
    constexpr Number(unsigned value) : Real(value) {}
    constexpr Number(long value) : Real(value) {}
    constexpr Number(unsigned long value) : Real(value) {}
    Number(Scalar value) : Real(wrapped(value, LOW, SPAN)) {}
    Number(const Real &other) : Real(wrapped(other.v, LOW, SPAN)) {}
    Number &operator+=(const Real &b) { return *this = Number(Real(this->v + b.v)); }
    Number &operator-=(const Real &b) { return *this = Number(Real(this->v - b.v)); }
    Number &operator/=(const Real &b) { return *this = Number(Real(this->v / b.v)); }
    Number &operator++() { return *this += Real(1); }
    Number &operator--() { return *this -= Real(1); }
    Number operator++(int) {
        const Number before = *this;
        ++*this;
        return before;
    }
    Number operator--(int) {
        const Number before = *this;
        --*this;
        return before;
    }
};

using Int16 = Number<16, true>;
using Uint16 = Number<16, false>;
using Int32 = Number<32, true>;
using Uint32 = Number<32, false>;

inline const Real operator+(const Real &a, const Real &b) {
    return a.v + b.v;
}
inline const Real operator-(const Real &a, const Real &b) {
    return a.v - b.v;
}
inline const Real operator*(const Real &a, const Real &b) {
    return a.v * b.v;
}
inline const Real operator/(const Real &a, const Real &b) {
    return a.v / b.v;
}
inline const Real operator-(const Real &a) {
    return -a.v;
}
inline bool operator<(const Real &a, const Real &b) {
    return a.v < b.v;
}
inline bool operator>(const Real &a, const Real &b) {
    return a.v > b.v;
}
inline bool operator<=(const Real &a, const Real &b) {
    return a.v <= b.v;
}
inline bool operator>=(const Real &a, const Real &b) {
    return a.v >= b.v;
}
inline bool operator==(const Real &a, const Real &b) {
    return a.v == b.v;
}
inline bool operator!=(const Real &a, const Real &b) {
    return a.v != b.v;
}

constexpr Scalar power(unsigned n) {
    return n == 0 ? Scalar(1) : Scalar(2) * power(n - 1);
}
inline const Real operator>>(const Real &a, unsigned n) {
    return a.v / power(n);
}
inline const Real operator<<(const Real &a, unsigned n) {
    return a.v * power(n);
}

inline const Real operator~(const Real &a) {
    return ~static_cast<Index>(floor(a.v));
}
inline const Real operator&(const Real &a, const Real &b) {
    return static_cast<Index>(floor(a.v)) & static_cast<Index>(floor(b.v));
}

inline const Real operator|(const Real &a, const Real &b) {
    return static_cast<Index>(floor(a.v)) | static_cast<Index>(floor(b.v));
}

}  // namespace real

// Constants: real numbers, not rounded to the format.
#define VGROOVE_CORE_FIXED_H
#define Q(value, n) (static_cast<const real::Real>((value)*real::power(n)))
#define FIXED_HIDE(value) ((void)(value))
#define FIXED_ROUND_SHIFT(value, n) ((value) >> (n))

#define int16_t real::Int16
#define uint16_t real::Uint16
#define int32_t real::Int32
#define uint32_t real::Uint32

inline int16_t fixed_saturate_i16(int32_t value, bool *saturated) {
    *saturated = *saturated || value > INT16_MAX || value < INT16_MIN;
    return value > INT16_MAX   ? int16_t(INT16_MAX)
           : value < INT16_MIN ? int16_t(INT16_MIN)
                               : int16_t(value);
}

inline int32_t fixed_clamp_i32(int32_t value, int32_t least, int32_t greatest) {
    if (value < least) {
        return least;
    }
    return value > greatest ? greatest : value;
}

inline uint32_t fixed_byte_down(uint32_t value) {
    return value >> 8;
}
inline uint16_t fixed_sixteenth(uint16_t value) {
    return uint16_t(value >> 4);
}
inline int32_t fixed_quarter_i32(int32_t value) {
    return value >> 2;
}
inline uint32_t fixed_quarter_u32(uint32_t value) {
    return value >> 2;
}
inline int32_t fixed_add_product_q8(int32_t value, int16_t by, uint8_t gain) {
    return value + by * real::Real(gain) * 256;
}
inline int16_t fixed_byte_part(int16_t a, uint8_t b) {
    return a * real::Real(b) / 256;
}

// A struct of numbers is larger than one of integers.
#define VGROOVE_CORE_CLEAR_H
#define CLEAR(self) ((void)memset((self), 0, sizeof *(self)))

// Tables are plain constants.
#define VGROOVE_CORE_FLASH_H
#define FLASH_TABLE
#define FLASH_CONST const
#define FLASH_PAGE
#define FLASH_U8(place) (*(place))
#define FLASH_I16(place) (*(place))

// Quotients without the remainder's loss.
#define VGROOVE_CORE_DIVIDE_H

inline uint16_t divide_u16(uint32_t dividend, uint32_t divisor) {
    const real::Real quotient = divisor == 0 ? real::Real(UINT16_MAX) : dividend / divisor;
    return quotient > UINT16_MAX ? uint16_t(UINT16_MAX) : uint16_t(quotient);
}

inline uint16_t divide_by_u16(uint32_t dividend, uint16_t divisor) {
    return divide_u16(dividend, uint32_t(divisor));
}

inline uint32_t divide_u32(uint32_t dividend, uint16_t divisor) {
    return dividend / divisor;
}

#endif
