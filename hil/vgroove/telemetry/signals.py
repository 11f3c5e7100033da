"""The firmware's lists as the generator leaves them in data/: frames, log columns, parameters.

`telemetry.json` is made from `vgroove.dbc` (firmware/telemetry/signal_tables.py): reading it takes
no time, while the DBC parser takes a second to load and is loaded where frames are decoded.
"""

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import cantools


@dataclass(frozen=True)
class LogColumn:
    """A log column that the board fills: from `signal` of `frame`, in `unit` (empty for plain
    numbers); `label` is the quantity's name on plots.
    """

    name: str
    unit: str
    label: str
    frame: str
    signal: str


@dataclass(frozen=True)
class Parameter:
    """One line of the firmware's parameter list as parameters.json holds it; physical value =
    raw / 2**q in `unit`. The generator, firmware/telemetry/parameter_list.py, must run without this
    package and has a class of its own.
    """

    name: str
    unit: str
    q: int
    default: int
    minimum: int
    maximum: int
    version: int
    text: str


def _data(name: str) -> str:
    return resources.files("vgroove").joinpath(f"data/{name}").read_text("utf-8")


_TABLES = json.loads(_data("telemetry.json"))
PROTOCOL_VERSION: int = _TABLES["protocol_version"]
FRAME_IDS: dict[str, int] = {entry["name"]: entry["id"] for entry in _TABLES["frames"]}
OUTBOUND = frozenset(entry["id"] for entry in _TABLES["frames"] if not entry["inbound"])
# frames that the decoder treats by their meaning; all others only fill columns
FAST, STATE, BOOT, PARAM, PARAM_TABLE, ACK, HEALTH = (
    FRAME_IDS[name] for name in ("FAST", "STATE", "BOOT", "PARAM", "PARAM_TABLE", "ACK", "HEALTH")
)
SET_MODE, PROFILE = FRAME_IDS["SET_MODE"], FRAME_IDS["PROFILE"]

LOG_COLUMNS = tuple(LogColumn(**entry) for entry in _TABLES["columns"])
COLUMNS = tuple(column.name for column in LOG_COLUMNS)
COLUMN_UNITS = {column.name: column.unit for column in LOG_COLUMNS}
COLUMN_LABELS = {column.name: column.label for column in LOG_COLUMNS}


def columns_of(frame: str) -> tuple[LogColumn, ...]:
    """Log columns that a frame fills."""
    return tuple(column for column in LOG_COLUMNS if column.frame == frame)


@cache
def database() -> "cantools.database.can.Database":
    """The packaged DBC."""
    import cantools

    return cantools.database.load_string(_data("vgroove.dbc"), "dbc", strict=True)


@cache
def value_table(frame: str, signal: str) -> dict[int, str]:
    """Names of a signal's values; empty where it has none."""
    choices = database().get_message_by_name(frame).get_signal_by_name(signal).choices or {}
    return {int(value): str(name) for value, name in choices.items()}


@cache
def parameter_list() -> tuple[Parameter, ...]:
    """The packaged parameter list, by index."""
    return tuple(Parameter(**entry) for entry in json.loads(_data("parameters.json"))["parameters"])


def parameter_name(index: int) -> str:
    """Name of a parameter index; newer firmware may have more than this list."""
    known = parameter_list()
    return known[index].name if index < len(known) else f"parameter_{index}"
