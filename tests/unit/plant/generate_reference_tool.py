"""Write reference_tool_values.hpp: the values of rigs/impact_driver.toml without its load, by name.

python tests/unit/plant/generate_reference_tool.py rigs/impact_driver.toml TARGET.hpp
"""

import sys
import tomllib
from pathlib import Path

SECTIONS = ("supply", "bridge", "motor", "gearbox", "mechanism")
TEXT = """\
// Values of {rig} without its load. Written by tests/unit/plant/generate_reference_tool.py.
#ifndef VGROOVE_REFERENCE_TOOL_VALUES_HPP
#define VGROOVE_REFERENCE_TOOL_VALUES_HPP

struct ReferenceValue {{
    const char *name;
    double value;
}};

constexpr ReferenceValue REFERENCE_TOOL_VALUES[] = {{
{rows}}};

#endif
"""


def main(rig: str, target: str) -> None:
    """Write the header."""
    data = tomllib.loads(Path(rig).read_text(encoding="utf-8"))
    values = {f"{s}.{k}": v for s in SECTIONS for k, v in data[s].items() if k != "kind"}
    rows = "".join(f'    {{"{name}", {float(value)!r}}},\n' for name, value in values.items())
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    Path(target).write_text(TEXT.format(rig=f"rigs/{Path(rig).name}", rows=rows), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
