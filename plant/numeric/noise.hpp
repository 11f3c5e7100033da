// Seeded random numbers, the same on every machine.
#ifndef VGROOVE_PLANT_NUMERIC_NOISE_HPP
#define VGROOVE_PLANT_NUMERIC_NOISE_HPP

#include <cstdint>

namespace vgroove {

// Generator splitmix64 (Steele, Lea and Flood, OOPSLA 2014); the normal distribution by Box and
// Muller's method.
struct Noise {
    std::uint64_t state;
};
double noise_uniform(Noise &noise);  // 0 <= u < 1
double noise_normal(Noise &noise);   // mean 0, standard deviation 1

}  // namespace vgroove

#endif
