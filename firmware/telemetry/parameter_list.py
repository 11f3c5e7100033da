"""The parameter list param_table.h: reads it and writes its JSON file and its page."""

import json
import re
from dataclasses import dataclass

from signal_list import NOTE, ROOT, value_table

PARAM_TABLE = ROOT / "firmware/app/param_table.h"


@dataclass(frozen=True)
class Parameter:
    """One entry of the parameter list; value = raw / 2**q in `unit`.

    The Python package has a class of the same fields without `index`
    (hil/vgroove/telemetry/signals.py): the generator runs in builds of the firmware that have no
    package, and passes the list on as parameters.json.
    """

    index: int
    name: str
    unit: str
    q: int
    default: int
    minimum: int
    maximum: int
    version: int
    text: str


def greatest_of(text: str) -> int:
    """Greatest value of a parameter: a number, or TELEMETRY_<SIGNAL>_LAST, the last value of a
    signal's value table.
    """
    match = re.fullmatch(r"TELEMETRY_(\w+)_LAST", text)
    return max(value_table(match.group(1).lower())) if match else int(text)


def explained(text: str) -> str:
    """A parameter's text with each {signal} replaced by the values and names of its value table."""

    def names(match: re.Match[str]) -> str:
        return ", ".join(f"{value} {name}" for value, name in value_table(match.group(1)).items())

    return re.sub(r"\{(\w+)\}", names, text)


def read_parameters(text: str) -> tuple[int, list[Parameter]]:
    """Version and entries of the X-macro list in param_table.h."""
    version = int(re.search(r"#define PARAM_VERSION (\d+)u", text).group(1))
    pattern = (
        r'X\((\w+),\s*"([^"]*)",\s*(-?\d+),\s*(-?\d+),\s*(-?\d+|TELEMETRY_\w+),\s*(\d+)\)'
        r"[\s\\]*/\*\s*(.*?)\s*\*/"
    )
    found = [
        Parameter(
            index,
            name.lower(),
            unit,
            q_of(name),
            int(default),
            int(least),
            greatest_of(greatest),
            int(since),
            explained(note),
        )
        for index, (name, unit, default, least, greatest, since, note) in enumerate(
            re.findall(pattern, text)
        )
    ]
    check_parameters(version, found, text)
    return version, found


def q_of(name: str) -> int:
    """Binary places n of a name that ends in _Qn, otherwise 0."""
    match = re.search(r"_Q(\d+)$", name)
    return int(match.group(1)) if match else 0


def check_parameters(version: int, parameters: list[Parameter], text: str) -> None:
    """Exit with a message if the firmware could not store or migrate the list."""
    lines = sum(1 for line in text.splitlines() if re.match(r"\s*X\(", line))
    if lines != len(parameters):
        raise SystemExit(
            f"{PARAM_TABLE.name}: {lines} lines begin with X( but {len(parameters)} could be read"
        )
    for earlier, later in zip(parameters, parameters[1:], strict=False):
        if later.version < earlier.version:
            raise SystemExit(
                f"{PARAM_TABLE.name}: {later.name} must stand before parameters of a newer version"
            )
    for p in parameters:
        if not -32768 <= p.minimum <= p.default <= p.maximum <= 32767:
            raise SystemExit(
                f"{PARAM_TABLE.name}: {p.name} needs "
                "-32768 <= least <= default <= greatest <= 32767"
            )
    if parameters[-1].version != version:
        raise SystemExit(
            f"{PARAM_TABLE.name}: PARAM_VERSION is {version}, "
            f"the newest parameter is of version {parameters[-1].version}"
        )


def parameters_json(version: int, parameters: list[Parameter]) -> str:
    """Text of parameters.json, the list for the Python package."""
    entries = [{key: value for key, value in vars(p).items() if key != "index"} for p in parameters]
    rows = ",\n".join("    " + json.dumps(entry, ensure_ascii=False) for entry in entries)
    comment = NOTE.format(source=PARAM_TABLE.name)
    return (
        f'{{\n  "comment": {json.dumps(comment)},\n  "version": {version},\n'
        f'  "parameters": [\n{rows}\n  ]\n}}\n'
    )


def physical(raw: int, p: Parameter) -> str:
    """A raw value in the parameter's unit, 6 significant digits."""
    return f"{raw / 2**p.q:.6g}"


def parameters_page(version: int, parameters: list[Parameter]) -> str:
    """Text of docs/parameters.md."""
    lines = [
        "# Parameters",
        "",
        "<!-- "
        + NOTE.format(source="firmware/app/param_table.h").replace(" from", "\n     from")
        + " -->",
        "",
        f"Version {version} of the list. Each parameter is an int16 in RAM and in the EEPROM (two "
        "slots, CRC-16,",
        "version) and an int32 in a PARAM frame; where the name ends in `_qN`, the integer is the",
        "quantity times 2^N. The firmware checks each write against the range and refuses it while",
        "the tool is driven. `since` is the first list version with the parameter: from an EEPROM",
        "slot of an older version it takes its default.",
        "",
        "| index | name | unit | default | range | default, raw | range, raw | since | meaning |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for p in parameters:
        values = f"{physical(p.default, p)} | {physical(p.minimum, p)} .. {physical(p.maximum, p)}"
        raw = f"{p.default} | {p.minimum} .. {p.maximum}"
        lines.append(
            f"| {p.index} | `{p.name}` | {p.unit} | {values} | {raw} | {p.version} | {p.text} |"
        )
    return "\n".join([*lines, ""])
