"""Write effect_parameters.hpp from the catalogue hil/vgroove/gap/catalogue: the plant's parameters
of effects and loads, the switch of each effect and the checks of its ranges.

    python plant/generate_effects.py build/plant/effect_parameters.hpp [folder of the catalogue]

Standard library only, because the build runs it before any package is installed. The catalogue is
imported as a package of its own, so that vgroove and its dependencies are not imported.
"""

import importlib
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

CATALOGUE = Path(__file__).resolve().parents[1] / "hil/vgroove/gap/catalogue"
SWITCHES_MAX = 28  # bits of a 32-bit word less those that components/effects.hpp adds by hand

HEADER = """\
// Parameters, switches and range checks of effects and loads. Written by plant/generate_effects.py
// from the catalogue hil/vgroove/gap/catalogue; changes belong there.
#ifndef VGROOVE_EFFECT_PARAMETERS_HPP
#define VGROOVE_EFFECT_PARAMETERS_HPP

#include <cstdint>
#include <limits>

namespace vgroove {

constexpr double OFF_AT_INFINITY = std::numeric_limits<double>::infinity();
"""
FOOTER = """
}  // namespace vgroove

#endif
"""


def import_catalogue(folder: Path) -> ModuleType:
    """The catalogue package in a folder, without the packages that contain it."""
    sys.path.insert(0, str(folder.parent))
    sys.dont_write_bytecode = True
    return importlib.import_module(folder.name)


def literal(value: float) -> str:
    """A C++ literal of a double."""
    return "OFF_AT_INFINITY" if math.isinf(value) else repr(float(value))


def members(values: dict[str, float], indent: str) -> str:
    """Members of a struct with their default values."""
    return "".join(f"{indent}double {name} = {literal(v)};\n" for name, v in values.items())


def structs(catalogue: ModuleType) -> str:
    """LoadParameters and EffectParameters, named as the keys of a rig."""
    effects = "".join(
        f"    struct {{\n{members(effect.flat, ' ' * 8)}    }} {effect.id};\n"
        for effect in catalogue.CATALOGUE
    )
    return (
        "\n// Keys of [load] in a rig\n"
        f"struct LoadParameters {{\n{members(catalogue.load_parameters(), '    ')}}};\n"
        "\n// Keys of [effects.<id>] in a rig; with the defaults every effect is off.\n"
        f"struct EffectParameters {{\n{effects}}};\n"
    )


def names(catalogue: ModuleType) -> str:
    """Names of the parameters in the order of the structs' members."""
    loads = [f"load.{name}" for name in catalogue.load_parameters()]
    effects = [f"effects.{e.id}.{name}" for e in catalogue.CATALOGUE for name in e.flat]
    lines = "".join(f'    "{name}",\n' for name in loads + effects)
    return f"\nconstexpr const char *LOAD_AND_EFFECT_NAMES[] = {{\n{lines}}};\n"


def is_on(effect: Any) -> str:
    """C++ condition under which the plant computes an effect."""
    return " || ".join(
        f"e.{effect.id}.{name} != {literal(effect.flat[name])}" for name in effect.switch
    )


def switches(catalogue: ModuleType) -> str:
    """The bits EFFECT_<ID>, and the function that sets them."""
    switched = [effect for effect in catalogue.CATALOGUE if effect.switch]
    if len(switched) > SWITCHES_MAX:
        raise SystemExit(f"generate_effects.py: more than {SWITCHES_MAX} effects with a switch")
    bits = "".join(f"    EFFECT_{e.id.upper()} = 1u << {n},\n" for n, e in enumerate(switched))
    tests = "".join(
        f"    on |= {is_on(e)} ? std::uint32_t{{EFFECT_{e.id.upper()}}} : 0u;\n" for e in switched
    )
    return (
        f"\nenum Effect : std::uint32_t {{\n{bits}}};\n"
        "\n// The bits of the effects that are on\n"
        "inline std::uint32_t effect_switches(const EffectParameters &e) {\n"
        f"    std::uint32_t on = 0u;\n{tests}    return on;\n}}\n"
    )


def condition(catalogue: ModuleType, parameter: Any) -> tuple[str, str] | None:
    """C++ comparison and sentence of a parameter whose sign the plant needs: it divides by positive
    ones, and a time cannot be negative. Other ranges are checked where a rig is read.
    """
    keys = importlib.import_module(f"{catalogue.__name__}.keys")
    if parameter.key.words == keys.POSITIVE.words:
        return "> 0.0", "must be positive"
    if parameter.key.words == keys.NOT_NEGATIVE.words and parameter.unit == "s":
        return ">= 0.0", "must not be negative"
    return None


def checks(catalogue: ModuleType) -> str:
    """The function that checks the ranges; require(holds, message) throws."""
    lines = ""
    for effect in catalogue.CATALOGUE:
        for parameter in effect.own_parameters:
            if found := condition(catalogue, parameter):
                name = f"{effect.id}.{parameter.name}"
                lines += (
                    f'    require(e.{name} {found[0]},\n            "effects.{name} {found[1]}");\n'
                )
    return (
        "\ntemplate <class Require>\n"
        f"void check_effects(const EffectParameters &e, Require &&require) {{\n{lines}}}\n"
    )


def header(catalogue: ModuleType) -> str:
    """The whole header."""
    parts = (structs, names, switches, checks)
    return HEADER + "".join(part(catalogue) for part in parts) + FOOTER


def main(target: str, folder: str = str(CATALOGUE)) -> None:
    """Write the header. An unchanged header keeps its modification time, so that nothing is
    compiled again.
    """
    path, text = Path(target), header(import_catalogue(Path(folder)))
    if path.exists() and path.read_text(encoding="utf-8") == text:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
