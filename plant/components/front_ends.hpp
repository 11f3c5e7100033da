// Front ends of the board: physical values to 10-bit counts. The full scales stand here and in
// docs/plant.md, nowhere else.
#ifndef VGROOVE_PLANT_COMPONENTS_FRONT_ENDS_HPP
#define VGROOVE_PLANT_COMPONENTS_FRONT_ENDS_HPP

#include <cstdint>

namespace vgroove {

constexpr int COUNTS_MAX = 1023;
constexpr int CURRENT_ZERO_COUNTS = 512;
constexpr double CURRENT_A_PER_COUNT = 0.125;           // +-64 A, physics.md section 8
constexpr double BUS_V_PER_COUNT = 40.96 / COUNTS_MAX;  // divider to 40.96 V full scale
constexpr double TRIGGER_RELEASED_SHARE = 0.1;          // of the reference voltage
constexpr double TRIGGER_PRESSED_SHARE = 0.9;
constexpr double TEMPERATURE_V_AT_0_DEGC = 0.5;  // 10 mV/K sensor, E (TMP36 class)
constexpr double TEMPERATURE_V_PER_K = 0.01;
constexpr double ADC_REFERENCE_V = 5.0;

int current_counts(double current_a, double offset_a, double noise_a);
int bus_counts(double supply_v);
int trigger_counts(double travel);
int temperature_counts(double degc);

// Seeded noise with the same numbers on every machine: splitmix64 (Steele, Lea, Flood 2014) and
// Box-Muller.
struct Noise {
    std::uint64_t state;
};
double noise_uniform(Noise &noise);  // 0 <= u < 1
double noise_normal(Noise &noise);   // mean 0, sigma 1

}  // namespace vgroove

#endif
