// Front ends for controllers in Python: physical values to counts of a 10-bit converter. The full
// scales are defined here and listed in docs/plant.md; the board's bus divider is another one
// (docs/architecture.md).
#ifndef VGROOVE_PLANT_COMPONENTS_FRONT_ENDS_HPP
#define VGROOVE_PLANT_COMPONENTS_FRONT_ENDS_HPP

namespace vgroove {

constexpr int COUNTS_MAX = 1023;
constexpr int CURRENT_ZERO_COUNTS = 512;
constexpr double CURRENT_A_PER_COUNT = 0.125;           // +-64 A: docs/spec/model.md, section 8
constexpr double BUS_V_PER_COUNT = 40.96 / COUNTS_MAX;  // divider to 40.96 V full scale
constexpr double TRIGGER_RELEASED_SHARE = 0.1;          // of the reference voltage
constexpr double TRIGGER_PRESSED_SHARE = 0.9;
constexpr double TEMPERATURE_V_AT_0_DEGC = 0.5;  // 10 mV/K sensor, TMP36 class (estimate)
constexpr double TEMPERATURE_V_PER_K = 0.01;
constexpr double ADC_REFERENCE_V = 5.0;

int current_counts(double current_a, double offset_a, double noise_a);
int bus_counts(double supply_v);
int trigger_counts(double travel);
int temperature_counts(double degc);

}  // namespace vgroove

#endif
