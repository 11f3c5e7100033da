// The reference tool, rigs/impact_driver.toml without its load, as parameters of the plant.
#ifndef VGROOVE_TESTS_REFERENCE_TOOL_HPP
#define VGROOVE_TESTS_REFERENCE_TOOL_HPP

#include <cstring>
#include <stdexcept>

#include "plant/components/parameters.hpp"
#include "reference_tool_values.hpp"  // generated: generate_reference_tool.py

inline int parameter_position(const char *name) {
    for (int n = 0; n < vgroove::PARAMETER_COUNT; ++n)
        if (std::strcmp(vgroove::parameter_name(n), name) == 0)
            return n;
    throw std::invalid_argument(name);
}

inline vgroove::Parameters reference_tool() {
    const vgroove::Parameters neutral;
    double theta[vgroove::PARAMETER_COUNT];
    std::memcpy(theta, &neutral, sizeof theta);
    for (const ReferenceValue &v : REFERENCE_TOOL_VALUES)
        theta[parameter_position(v.name)] = v.value;
    return vgroove::parameters_from(theta);
}

#endif
