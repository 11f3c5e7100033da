// Location of the instant at which a function of time changes its sign: the Illinois variant of the
// false-position method (Dowell and Jarratt, BIT 11, 1971).
#ifndef VGROOVE_PLANT_NUMERIC_EVENT_LOCATION_HPP
#define VGROOVE_PLANT_NUMERIC_EVENT_LOCATION_HPP

#include "numeric/lanes.hpp"

namespace vgroove {

// The function is not negative at `low` and negative at `high`.
struct EventBracket {
    int repeats = 0;
    double low_s = 0.0, high_s = 0.0, value_low = 0.0, value_high = 0.0;
};

// Every so many trials bisect, because the false-position method may move one end of the bracket
// only.
constexpr int BISECT_EVERY = 8;

// Length of the next trial step within the bracket; the middle where the method's trial is too
// close to an end of it
VGROOVE_INLINE double illinois_trial(const EventBracket &at) {
    const double width = at.high_s - at.low_s;
    const double guess = at.low_s + width * (at.value_low / (at.value_low - at.value_high));
    const bool inside = guess > at.low_s + 1e-3 * width && guess < at.high_s - 1e-6 * width &&
                        at.repeats % BISECT_EVERY != BISECT_EVERY - 1;
    return inside ? guess : at.low_s + 0.5 * width;
}

// A point of a step, as share of its length, at which the function is negative, and its value there
struct EventPoint {
    double share, value;
};

constexpr int LOCATE_REPEATS_MAX = 40;

// Share of a step of length h just past the sign change: within width_s of it, on the negative
// side. value(share) is the function, value_start its value at the start of the step.
template <class Value>
VGROOVE_INLINE double locate_sign_change(double value_start, const EventPoint &negative, double h,
                                         double width_s, Value &&value) {
    double low = 0.0, high = negative.share, g_low = value_start, g_high = negative.value;
    int side = 0;  // end that the last trial replaced: -1 high, 1 low
    for (int n = 0; n < LOCATE_REPEATS_MAX && (high - low) * h > width_s; ++n) {
        const double middle = low + (high - low) * (g_low / (g_low - g_high));
        const double nudge = 0.4 * width_s / h;  // towards the end that has not moved
        double share = n % 4 == 3 ? 0.5 * (low + high) : middle + (side >= 0 ? nudge : -nudge);
        share = share <= low || share >= high ? 0.5 * (low + high) : share;
        const double g = value(share);
        if (g < 0.0) {
            high = share;
            g_high = g;
            g_low = side < 0 ? 0.5 * g_low : g_low;
            side = -1;
        } else {
            low = share;
            g_low = g;
            g_high = side > 0 ? 0.5 * g_high : g_high;
            side = 1;
        }
    }
    return high;
}

}  // namespace vgroove

#endif
