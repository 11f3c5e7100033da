// Counts of the board's front ends, rounded and clipped as a 10-bit converter does.
#include "components/front_ends.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vgroove {

static int to_counts(double x) {
    if (std::isnan(x))
        throw std::invalid_argument("a front end reads numbers, not nan");
    return static_cast<int>(
        std::min(std::max(std::floor(x + 0.5), 0.0), static_cast<double>(COUNTS_MAX)));
}

int current_counts(double current_a, double offset_a, double noise_a) {
    return to_counts(CURRENT_ZERO_COUNTS + (current_a + offset_a + noise_a) / CURRENT_A_PER_COUNT);
}

int bus_counts(double supply_v) {
    return to_counts(supply_v / BUS_V_PER_COUNT);
}

int trigger_counts(double travel) {
    const double share =
        TRIGGER_RELEASED_SHARE + (TRIGGER_PRESSED_SHARE - TRIGGER_RELEASED_SHARE) * travel;
    return to_counts(COUNTS_MAX * share);
}

int temperature_counts(double degc) {
    return to_counts((TEMPERATURE_V_AT_0_DEGC + TEMPERATURE_V_PER_K * degc) / ADC_REFERENCE_V *
                     COUNTS_MAX);
}

}  // namespace vgroove
