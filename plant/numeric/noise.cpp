// Random numbers by splitmix64 and by Box and Muller's method.
#include "numeric/noise.hpp"

#include <cmath>

namespace vgroove {

static std::uint64_t noise_bits(Noise &noise) {
    noise.state += 0x9e3779b97f4a7c15u;
    std::uint64_t z = noise.state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

double noise_uniform(Noise &noise) {
    return static_cast<double>(noise_bits(noise) >> 11) * 0x1p-53;
}

double noise_normal(Noise &noise) {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - noise_uniform(noise)));
    return radius * std::cos(6.283185307179586 * noise_uniform(noise));
}

}  // namespace vgroove
