"""Scenarios: a TOML file that says which tool is driven how, under which load, for how long; read,
checked, and turned into a run.
"""

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.gap.catalogue import JOINTS
from vgroove.lockstep import FrontEnds, Profile
from vgroove.rig import SCHEMA as RIG_SCHEMA
from vgroove.rig import Rig, read_rig, read_toml, rig_from_dict

SCHEMA = "vgroove.scenario/1"
DURATION_MAX_S = 3600.0
DRILL_S = 4.0  # physics.md section 7: the run whose load comes between 2 and 3 s
BOARD_EFFECTS = ("dead_time", "current_lag")  # of a rig: in lock-step the board has them itself
# current and bus conversions that the firmware averages into a row (12 and 2 of 16, every 2,040
# cycles)
SAMPLES_A_ROW = (5.9, 1.0)


@dataclass(frozen=True)
class Command:
    """A frame sent to the board at a time: its name in the DBC and its signals."""

    time_s: float
    frame: str
    signals: Mapping[str, float]


@dataclass(frozen=True)
class Scenario:
    """A validated scenario. `rig` is what the simulation believes; `tool` what turns: effects
    added, the board's own left out.
    """

    rig: Rig
    tool: Rig
    duration_s: float
    profile: Profile
    name: str = ""
    seed: int = 1
    temperature_c: float = 25.0
    noise: bool = True
    commands: tuple[Command, ...] = ()
    source: str = ""
    rig_path: Path = field(default=Path())

    def front_ends(self) -> FrontEnds:
        """The sensors of the run: the rig's noise of a row, spread over the samples that a row
        averages.
        """
        sensors = self.rig.sensors if self.noise else {}
        return FrontEnds(
            temperature_c=self.temperature_c,
            current_noise_a=sensors.get("current_noise_a", 0.0) * SAMPLES_A_ROW[0] ** 0.5,
            supply_noise_v=sensors.get("supply_noise_v", 0.0) * SAMPLES_A_ROW[1] ** 0.5,
        )


def _complain(where: str, sentence: str) -> VgrooveError:
    return VgrooveError(f"{where}: {sentence}")


def _no_unknown(values: Mapping[str, Any], known: Mapping[str, Any], where: str) -> None:
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            raise _complain(where, f"unknown key {key}; the nearest known one is {near[0]}")


def _number(low: float, high: float) -> Callable[[Any, str], float]:
    def check(value: Any, where: str) -> float:
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not low <= value <= high
        ):
            raise _complain(where, f"wants a number from {low:g} to {high:g}, not {value!r}")
        return float(value)

    return check


def _whole(low: int, high: int) -> Callable[[Any, str], int]:
    def check(value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise _complain(where, f"wants a whole number from {low} to {high}, not {value!r}")
        return value

    return check


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise _complain(where, f"wants a text, not {value!r}")
    return value


def _flag(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise _complain(where, f"wants true or false, not {value!r}")
    return value


def _points(
    low: float, high: float, strict: bool = False
) -> Callable[[Any, str], tuple[tuple[float, float], ...]]:
    """Checks a list of [time_s, value]; times do not decrease."""

    def check(value: Any, where: str) -> tuple[tuple[float, float], ...]:
        if not isinstance(value, list) or not value:
            raise _complain(where, "wants a list of points [time_s, value]")
        points: list[tuple[float, float]] = []
        for number, point in enumerate(value, 1):
            if not isinstance(point, list) or len(point) != 2:
                raise _complain(f"{where}, point {number}", f"wants [time_s, value], not {point!r}")
            time_s = _number(0.0, DURATION_MAX_S)(point[0], f"{where}, time of point {number}")
            level = (
                float(point[1])
                if isinstance(point[1], bool)
                else _number(low, high)(point[1], f"{where}, value of point {number}")
            )
            if points and (time_s < points[-1][0] or (strict and time_s <= points[-1][0])):
                raise _complain(
                    f"{where}, point {number}",
                    f"its time {time_s:g} s comes before that of the point before it",
                )
            points.append((time_s, level))
        return tuple(points)

    return check


TRIGGER_KEYS: dict[str, Callable[[Any, str], Any]] = {
    "travel": _points(0.0, 1.0),
    "reverse": _points(0.0, 1.0),
    "contact_travel": _number(0.0, 1.0),
    "bounce_s": _number(0.0, 0.1),
}
TOP_KEYS: dict[str, Callable[[Any, str], Any]] = {
    "schema": _text,
    "name": _text,
    "rig": _text,
    "duration_s": _number(0.01, DURATION_MAX_S),
    "seed": _whole(0, 2**31 - 1),
    "mode": _whole(0, 3),
    "temperature_c": _number(-40.0, 150.0),
    "noise": _flag,
}
SECTIONS = ("trigger", "load", "effects", "command")
LOAD_KEYS: dict[str, Callable[[Any, str], Any]] = {"torque_nm": _points(-1000.0, 1000.0)}


def _section(
    data: Mapping[str, Any], name: str, keys: Mapping[str, Callable[[Any, str], Any]], source: str
) -> dict[str, Any]:
    values = data.get(name, {})
    if not isinstance(values, dict):
        raise _complain(source, f"[{name}] is a table")
    _no_unknown(values, keys, f"{source}: [{name}]")
    return {key: keys[key](value, f"{source}: {name}.{key}") for key, value in values.items()}


def _commands(data: Mapping[str, Any], source: str) -> tuple[Command, ...]:
    entries = data.get("command", [])
    if not isinstance(entries, list):
        raise _complain(source, "commands are given as [[command]]")
    return tuple(
        _command(entry, f"{source}: [[command]] {number}")
        for number, entry in enumerate(entries, 1)
    )


def _command(entry: Any, where: str) -> Command:
    from vgroove import telemetry

    if not isinstance(entry, dict):
        raise _complain(where, "is a table")
    inbound = {m.name: m for m in telemetry.database().messages if "HOST" in m.senders}
    frame = _text(entry.get("frame"), f"{where}.frame")
    if frame not in inbound:
        near = difflib.get_close_matches(frame, inbound, n=1, cutoff=0.0)[0]
        raise _complain(where, f"the board takes no frame {frame}; the nearest known one is {near}")
    signals = {
        s.name: s for s in inbound[frame].signals if not s.name.endswith(("_sequence", "_crc"))
    }
    _no_unknown(entry, {"time_s": 0, "frame": 0, **signals}, where)
    values = {
        name: _number(s.minimum, s.maximum)(entry.get(name), f"{where}.{name}")
        for name, s in signals.items()
    }
    return Command(
        _number(0.0, DURATION_MAX_S)(entry.get("time_s"), f"{where}.time_s"), frame, values
    )


def _needed(data: Mapping[str, Any], key: str, source: str) -> Any:
    if key not in data:
        raise _complain(source, f"the key {key} is missing")
    return data[key]


def scenario_from_dict(data: Mapping[str, Any], source: str, folder: Path) -> Scenario:
    """A scenario from its TOML content; the rig's path is relative to `folder`."""
    if _needed(data, "schema", source) != SCHEMA:
        raise _complain(source, f'schema is {data["schema"]!r}; this version reads "{SCHEMA}"')
    _no_unknown(data, {**TOP_KEYS, **dict.fromkeys(SECTIONS)}, source)
    top = {
        key: check(data[key], f"{source}: {key}") for key, check in TOP_KEYS.items() if key in data
    }
    rig_path = folder / _needed(top, "rig", source)
    rig = read_rig(rig_path)
    tool = without_board_effects(rig).with_effects(data.get("effects", {}))
    trigger = _section(data, "trigger", TRIGGER_KEYS, source)
    load = _section(data, "load", LOAD_KEYS, source)
    if load and tool.load["kind"] in JOINTS:
        raise _complain(
            source,
            f"load.torque_nm acts on a free output, but a {tool.load['kind']} makes its own torque",
        )
    profile = Profile(
        mode=top.pop("mode", 0), **trigger, **({"load_nm": load["torque_nm"]} if load else {})
    )
    options = {key: top[key] for key in ("name", "seed", "temperature_c", "noise") if key in top}
    duration_s = _needed(top, "duration_s", source)
    return Scenario(
        rig,
        tool,
        duration_s,
        profile,
        commands=_commands(data, source),
        source=source,
        rig_path=rig_path,
        **options,
    )


def read_scenario(path: str | Path) -> Scenario:
    """Read and check a scenario; VgrooveError names file, key and the nearest known key."""
    return scenario_from_dict(read_toml(path), str(path), Path(path).parent)


def read_scenario_or_rig(path: str | Path) -> Scenario:
    """A scenario, or a rig at full trigger."""
    data = read_toml(path)
    if data.get("schema") == RIG_SCHEMA:
        return full_trigger(rig_from_dict(data, str(path)), str(path))
    return scenario_from_dict(data, str(path), Path(path).parent)


def full_trigger(rig: Rig, source: str) -> Scenario:
    """The scenario of a rig alone: the trigger pulled fully at t = 0, as fast as the slew allows,
    for 1 s; a drill driver's for 4 s.
    """
    duration_s = DRILL_S if rig.mechanism["kind"] == "drill_driver" else 1.0
    slew = rig.input.get("slew_per_s")
    travel = ((0.0, 0.0), (1.0 / slew, 1.0)) if slew else ((0.0, 1.0),)
    return Scenario(rig, rig, duration_s, Profile(travel=travel, contact_travel=0.0), source=source)


def command_messages(commands: tuple[Command, ...]) -> list[tuple[float, bytes]]:
    """(time_s, frame bytes) of a scenario's commands, numbered in order."""
    from vgroove import telemetry

    messages = []
    for number, command in enumerate(commands):
        definition = telemetry.database().get_message_by_name(command.frame)
        sequence = {
            s.name: number & 0xFF for s in definition.signals if s.name.endswith("_sequence")
        }
        frame = telemetry.frame_of_signals(
            command.frame, round(command.time_s * 1000), **command.signals, **sequence
        )
        messages.append((command.time_s, telemetry.frame_bytes(frame)))
    return messages


def without_board_effects(rig: Rig) -> Rig:
    """The rig without what the board does by itself in lock-step (dead time, lag of the current
    channel).
    """
    effects = {name: values for name, values in rig.effects.items() if name not in BOARD_EFFECTS}
    return rig_from_dict({**rig.as_dict(), "effects": effects}, "the rig")


def make_plant(tool: Rig, seed: int) -> Any:
    """A tool as a lock-step plant: vgroove._core.DrivePlant, or ImpactPlant or DrillPlant where the
    rig has that mechanism.
    """
    from vgroove import _core

    kind = {"none": "DrivePlant", "impact": "ImpactPlant", "drill_driver": "DrillPlant"}[
        tool.mechanism["kind"]
    ]
    if not hasattr(_core, kind):
        raise VgrooveError(
            "this build of vgroove has no lock-step plant: run `pip install -e .` in the tree again"
        )
    pulses = int(tool.sensors.get("hall_pulses_per_rev", 0))
    with refused_by_plant(tool.name or "the rig"):
        if kind == "DrillPlant":  # pulse mode is the board's
            parameters = tool.drill_parameters() | {"mechanism.pulse": 0.0}
            return _core.DrillPlant(
                parameters, tool.value("supply.resistance_ohm"), hall_pulses_per_rev=pulses
            )
        return getattr(_core, kind)(
            tool.parameters(),
            load_kind=tool.load.get("kind", "none"),
            hall_pulses_per_rev=pulses,
            seed=seed,
        )
