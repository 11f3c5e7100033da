// Rows of a run of the drill driver: at the ends of its steps, or interpolated at equal intervals.
#ifndef VGROOVE_PLANT_DRILL_RECORDER_HPP
#define VGROOVE_PLANT_DRILL_RECORDER_HPP

#include <Eigen/Core>
#include <algorithm>

#include "drill/run.hpp"

namespace vgroove {

constexpr double DRILL_LOCATE_S = 1e-12;  // accuracy of located instants

// State and slopes at one end of a step
struct DrillPoint {
    double time_s;
    DrillVector x, slope;
    DrillSums sums, sums_slope;
};

inline DrillPoint drill_point(const DrillSystem &s, const DrillInput &in) {
    const DrillRates r = drill_rates(s.p, s.mode, in, s.x);
    return {s.time_s, s.x, r.core, s.sums, r.sums};
}

// Cubic through values and slopes at both ends of a step of length h, at its share u
template <class Vector>
Vector between(const Vector &a, const Vector &a_slope, const Vector &b, const Vector &b_slope,
               double h, double u) {
    const Vector rise = b - a;
    return a + u * rise +
           u * (1.0 - u) * ((1.0 - u) * (h * a_slope - rise) + u * (rise - h * b_slope));
}

struct Recorder {
    DrillRun &run;
    double row_s;
    std::size_t next = 0;  // row of the grid that is written next

    void write(const DrillSystem &s, double time_s, const DrillVector &x, const DrillSums &sums) {
        const std::size_t at = run.rows.size();
        run.rows.resize(at + DRILL_ROW_COUNT);
        double *row = run.rows.data() + at;
        row[DRILL_ROW_TIME] = time_s;
        Eigen::Map<DrillVector>(row + DRILL_ROW_CORE) = x;
        row[DRILL_ROW_SHAFT] = drill_shaft_torque(s.p, s.mode, x);
        row[DRILL_ROW_DUTY] = drill_duty(s.p, s.mode, time_s);
        row[DRILL_ROW_CONTROL] = static_cast<double>(s.mode.control);
        row[DRILL_ROW_STORED] = drill_stored_energy(s.p, x);
        Eigen::Map<DrillSums>(row + DRILL_ROW_SUMS) = sums;
        ++next;
    }

    // Writes the rows of the grid within a step, before the modes change at its end.
    void fill(const DrillSystem &s, const DrillPoint &a, const DrillPoint &b) {
        const double h = b.time_s - a.time_s;
        for (double t = static_cast<double>(next) * row_s; t <= b.time_s + DRILL_LOCATE_S;
             t = static_cast<double>(next) * row_s) {
            const double u = h > 0.0 ? std::min((t - a.time_s) / h, 1.0) : 1.0;
            write(s, t, between<DrillVector>(a.x, a.slope, b.x, b.slope, h, u),
                  between<DrillSums>(a.sums, a.sums_slope, b.sums, b.sums_slope, h, u));
        }
    }
};

}  // namespace vgroove

#endif
