// Record of the contacts of hammer lugs with anvil lugs: blows, repeats and rebounds
// (docs/spec/model.md, section 4).
#ifndef VGROOVE_PLANT_IMPACT_BLOWS_HPP
#define VGROOVE_PLANT_IMPACT_BLOWS_HPP

#include <cmath>
#include <vector>

#include "numeric/lanes.hpp"

namespace vgroove {

// A later contact with the same lug is a repeat if it comes after REPEAT_AFTER_S with at least this
// share of the first one's approach speed, else a rebound.
constexpr double REPEAT_AFTER_S = 3e-3;
constexpr double REPEAT_SPEED_SHARE = 0.25;

enum BlowKind { BLOW_FIRST, BLOW_REPEAT, BLOW_REBOUND };

struct Blow {
    double time_s;
    double approach_rad_s;  // hammer against anvil, positive when it closes the gap
    double engaged_m;       // lug height that is in contact
    double impulse_nm_s;    // of the lug torque over this contact
    double peak_torque_nm;  // of the joint, largest magnitude until the next contact
    long kind;
    long lug;      // number of the anvil lug
    long skipped;  // lugs passed without contact since the last blow; for blows only
};

struct BlowRecorder {
    std::vector<Blow> blows;
    bool any = false, open = false;
    double first_s = 0.0, first_speed = 0.0;
    double impulse_before = 0.0;
};

VGROOVE_INLINE void blows_begin(BlowRecorder &r, double time_s, long lug, double approach,
                                double engaged_m, double impulse) {
    const long last = r.any ? r.blows.back().lug : lug;
    const bool reached = !r.any || lug != last;
    Blow b{time_s, approach, engaged_m, 0.0, 0.0, BLOW_REBOUND, lug, 0};
    if (reached) {
        b.kind = BLOW_FIRST;
        const long between = lug > last ? lug - last : last - lug;
        b.skipped = between > 1 ? between - 1 : 0;
        r.first_s = time_s;
        r.first_speed = approach;
    } else if (time_s - r.first_s > REPEAT_AFTER_S &&
               approach >= REPEAT_SPEED_SHARE * r.first_speed) {
        b.kind = BLOW_REPEAT;
    }
    r.any = r.open = true;
    r.impulse_before = impulse;
    r.blows.push_back(b);
}

VGROOVE_INLINE void blows_end(BlowRecorder &r, double impulse) {
    if (r.open)
        r.blows.back().impulse_nm_s = impulse - r.impulse_before;
    r.open = false;
}

// Updates the peak of the joint torque with a step: cubic through values and slopes at both ends.
VGROOVE_INLINE void blows_torque(BlowRecorder &r, double h, double from, double from_rate,
                                 double to, double to_rate) {
    Blow &b = r.blows.back();
    const double a = std::fabs(to);
    b.peak_torque_nm = a > b.peak_torque_nm ? a : b.peak_torque_nm;
    if (from_rate * to_rate >= 0.0)
        return;
    const double u = from_rate / (from_rate - to_rate), v = 1.0 - u;  // near the slope's zero
    const double top = v * v * (1.0 + 2.0 * u) * from + u * u * (3.0 - 2.0 * u) * to +
                       h * u * v * (v * from_rate - u * to_rate);
    b.peak_torque_nm = std::fabs(top) > b.peak_torque_nm ? std::fabs(top) : b.peak_torque_nm;
}

}  // namespace vgroove

#endif
