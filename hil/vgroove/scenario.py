"""Scenarios: TOML files that state the tool, the trigger's motion, the load and the duration of a
run; read and checked, and the parts of a lock-step run made from them.
"""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.gap.catalogue import JOINTS
from vgroove.lockstep import FrontEnds, Profile
from vgroove.rig import SCHEMA as RIG_SCHEMA
from vgroove.rig import Rig, read_joints, read_rig, read_toml, rig_from_dict

SCHEMA = "vgroove.scenario/1"
MIN_DURATION_S, MAX_DURATION_S = 0.01, 3600.0
FULL_TRIGGER_S = 1.0
# docs/spec/model.md, section 7: the drill's reference run, whose load rises between 2 and 3 s
DRILL_FULL_TRIGGER_S = 4.0
BOARD_EFFECTS = ("dead_time", "current_lag")  # in lock-step the board itself causes them
# ADC conversions that the firmware averages into a row of 1 ms: one every 2,040 cycles, that is
# 7.8 a row; of 16 conversions 12 are of the current and 2 of the bus voltage.
CURRENT_SAMPLES_PER_ROW = 5.9
SUPPLY_SAMPLES_PER_ROW = 1.0


@dataclass(frozen=True)
class Command:
    """A frame to be sent to the board at a time: its name in the DBC and its signals."""

    time_s: float
    frame: str
    signals: Mapping[str, float]


@dataclass(frozen=True)
class Scenario:
    """A validated scenario. `rig` holds the assumed parameters of the tool; `tool` those of the
    simulated one, with the effects of the scenario and without those that the board itself causes.
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
        """Sensors of the run. The rig states the noise of a row; the noise of one of the n samples
        that a row averages is sqrt(n) times larger.
        """
        sensors = self.rig.sensors if self.noise else {}
        return FrontEnds(
            temperature_c=self.temperature_c,
            current_noise_a=sensors.get("current_noise_a", 0.0) * CURRENT_SAMPLES_PER_ROW**0.5,
            supply_noise_v=sensors.get("supply_noise_v", 0.0) * SUPPLY_SAMPLES_PER_ROW**0.5,
        )


def _error(where: str, sentence: str) -> VgrooveError:
    return VgrooveError(f"{where}: {sentence}")


def _no_unknown(values: Mapping[str, Any], known: Mapping[str, Any], where: str) -> None:
    for key in values:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            raise _error(where, f"unknown key {key}; the nearest known one is {near[0]}")


def _number(low: float, high: float) -> Callable[[Any, str], float]:
    def check(value: Any, where: str) -> float:
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not low <= value <= high
        ):
            raise _error(where, f"must be a number from {low:g} to {high:g}, not {value!r}")
        return float(value)

    return check


def _whole(low: int, high: int) -> Callable[[Any, str], int]:
    def check(value: Any, where: str) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise _error(where, f"must be a whole number from {low} to {high}, not {value!r}")
        return value

    return check


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise _error(where, f"must be a text, not {value!r}")
    return value


def _flag(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise _error(where, f"must be true or false, not {value!r}")
    return value


def _points(low: float, high: float) -> Callable[[Any, str], tuple[tuple[float, float], ...]]:
    """A check of a list of [time_s, value] whose times do not decrease."""

    def check(value: Any, where: str) -> tuple[tuple[float, float], ...]:
        if not isinstance(value, list) or not value:
            raise _error(where, "must be a list of points [time_s, value]")
        points: list[tuple[float, float]] = []
        for number, point in enumerate(value, 1):
            if not isinstance(point, list) or len(point) != 2:
                raise _error(f"{where}, point {number}", f"must be [time_s, value], not {point!r}")
            time_s = _number(0.0, MAX_DURATION_S)(point[0], f"{where}, time of point {number}")
            level = (
                float(point[1])
                if isinstance(point[1], bool)
                else _number(low, high)(point[1], f"{where}, value of point {number}")
            )
            if points and (time_s < points[-1][0]):
                raise _error(
                    f"{where}, point {number}",
                    f"its time {time_s:g} s comes before the time of the previous point",
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
    "duration_s": _number(MIN_DURATION_S, MAX_DURATION_S),
    "seed": _whole(0, 2**31 - 1),
    "mode": _whole(0, 3),
    "temperature_c": _number(-40.0, 150.0),
    "noise": _flag,
}
SECTIONS = ("trigger", "load", "effects", "command")
TORQUE_LOADS = ("torque", "chuck")  # of rigs, on which the torque of a scenario acts
LOAD_KEYS: dict[str, Callable[[Any, str], Any]] = {"torque_nm": _points(-1000.0, 1000.0)}


def _section(
    data: Mapping[str, Any], name: str, keys: Mapping[str, Callable[[Any, str], Any]], source: str
) -> dict[str, Any]:
    values = data.get(name, {})
    if not isinstance(values, dict):
        raise _error(source, f"[{name}] is a table")
    _no_unknown(values, keys, f"{source}: [{name}]")
    return {key: keys[key](value, f"{source}: {name}.{key}") for key, value in values.items()}


def _commands(data: Mapping[str, Any], source: str) -> tuple[Command, ...]:
    entries = data.get("command", [])
    if not isinstance(entries, list):
        raise _error(source, "commands are given as [[command]]")
    return tuple(
        _command(entry, f"{source}: [[command]] {number}")
        for number, entry in enumerate(entries, 1)
    )


def _command(entry: Any, where: str) -> Command:
    from vgroove import telemetry

    if not isinstance(entry, dict):
        raise _error(where, "is a table")
    inbound = {m.name: m for m in telemetry.database().messages if "HOST" in m.senders}
    frame = _text(entry.get("frame"), f"{where}.frame")
    if frame not in inbound:
        near = difflib.get_close_matches(frame, inbound, n=1, cutoff=0.0)[0]
        raise _error(
            where, f"the board has no inbound frame {frame}; the nearest known one is {near}"
        )
    signals = {
        s.name: s for s in inbound[frame].signals if not s.name.endswith(("_sequence", "_crc"))
    }
    _no_unknown(entry, {"time_s": 0, "frame": 0, **signals}, where)
    values = {
        name: (_whole if s.scale == 1 and not s.is_float else _number)(s.minimum, s.maximum)(
            entry.get(name), f"{where}.{name}"
        )
        for name, s in signals.items()
    }
    return Command(
        _number(0.0, MAX_DURATION_S)(entry.get("time_s"), f"{where}.time_s"), frame, values
    )


def _needed(data: Mapping[str, Any], key: str, source: str) -> Any:
    if key not in data:
        raise _error(source, f"the key {key} is missing")
    return data[key]


def _check_free_output(tool: Rig, torque_nm: Sequence[Sequence[float]], source: str) -> None:
    """VgrooveError for a tool on whose load the torques (n, 2) in s and N m would not act."""
    kind = tool.load["kind"]
    if kind in JOINTS:
        raise _error(
            source, f"load.torque_nm acts on a free output, but a {kind} makes its own torque"
        )
    if kind not in TORQUE_LOADS and any(torque != 0.0 for _, torque in torque_nm):
        raise _error(
            source,
            f'load.torque_nm needs a rig with [load] kind = "torque": with "{kind}" it would not '
            "act",
        )
    if kind == "chuck" and any(torque < 0.0 for _, torque in torque_nm):
        raise _error(
            source, "load.torque_nm of a chuck opposes its motion: it must be 0 N m or more"
        )


def scenario_from_dict(data: Mapping[str, Any], source: str, folder: Path) -> Scenario:
    """A scenario from its TOML content; the path of the rig is relative to `folder`.

    VgrooveError names the source, the key and the nearest known key.
    """
    if _needed(data, "schema", source) != SCHEMA:
        raise _error(source, f'schema is {data["schema"]!r}; this version reads "{SCHEMA}"')
    _no_unknown(data, {**TOP_KEYS, **dict.fromkeys(SECTIONS)}, source)
    top = {
        key: check(data[key], f"{source}: {key}") for key, check in TOP_KEYS.items() if key in data
    }
    rig_path = folder / _needed(top, "rig", source)
    rig = read_rig(rig_path)
    effects = data.get("effects", {})
    tables = effects.values() if isinstance(effects, Mapping) else [effects]
    if not all(isinstance(one, Mapping) for one in tables):
        raise _error(source, "effects are tables: [effects.NAME] with the parameters of the effect")
    tool = without_board_effects(rig).with_effects(effects)
    trigger = _section(data, "trigger", TRIGGER_KEYS, source)
    load = _section(data, "load", LOAD_KEYS, source)
    if load:
        _check_free_output(tool, load["torque_nm"], source)
    profile = Profile(
        mode=top.pop("mode", 0), **trigger, **({"load_nm": load["torque_nm"]} if load else {})
    )
    options = {key: top[key] for key in ("name", "seed", "temperature_c", "noise") if key in top}
    duration_s, commands = _needed(top, "duration_s", source), _commands(data, source)
    for one in commands:
        if one.time_s >= duration_s:
            raise _error(
                source, f"the command {one.frame} at {one.time_s:g} s is after the end of the run"
            )
    return Scenario(
        rig,
        tool,
        duration_s,
        profile,
        commands=commands,
        source=source,
        rig_path=rig_path,
        **options,
    )


def read_scenario(path: str | Path) -> Scenario:
    """Read and check a scenario; VgrooveError names the file, the key and the nearest known key."""
    return scenario_from_dict(read_toml(path), str(path), Path(path).parent)


def read_scenario_or_rig(path: str | Path) -> Scenario:
    """Read a scenario, or a rig, which is run at full trigger."""
    data = read_toml(path)
    if data.get("schema") == RIG_SCHEMA:
        return full_trigger(rig_from_dict(data, str(path)), str(path))
    return scenario_from_dict(data, str(path), Path(path).parent)


def full_trigger(rig: Rig, source: str) -> Scenario:
    """The scenario for a rig that is given alone: the trigger is pulled fully at t = 0, as fast as
    the rig's slew rate allows.
    """
    is_drill = rig.mechanism["kind"] == "drill_driver"
    duration_s = DRILL_FULL_TRIGGER_S if is_drill else FULL_TRIGGER_S
    slew = rig.input.get("slew_per_s")
    travel = ((0.0, 0.0), (1.0 / slew, 1.0)) if slew else ((0.0, 1.0),)
    return Scenario(rig, rig, duration_s, Profile(travel=travel, contact_travel=0.0), source=source)


def with_duration(scenario: Scenario, seconds: float | None) -> Scenario:
    """The scenario with another length in s (None: unchanged); VgrooveError for one that no
    scenario may have.
    """
    if seconds is None:
        return scenario
    if not MIN_DURATION_S <= seconds <= MAX_DURATION_S:
        raise VgrooveError(
            f"--seconds must be from {MIN_DURATION_S:g} to {MAX_DURATION_S:g}, not {seconds:g}"
        )
    return replace(scenario, duration_s=seconds)


def with_joint(scenario: Scenario, joints: Sequence[Path]) -> Scenario:
    """The scenario with the joint of a file, as read_joints reads it (no file: unchanged);
    VgrooveError for several, and for a joint beside a torque of the scenario.
    """
    if not joints:
        return scenario
    if len(joints) > 1:
        raise VgrooveError(f"--joint: {len(joints)} for one run: without --log give one")
    (tool,) = read_joints(joints, scenario.tool, 1)
    if any(torque_nm for _, torque_nm in scenario.profile.load_nm):
        _check_free_output(tool, scenario.profile.load_nm, scenario.source)
    return replace(scenario, tool=tool)


def command_messages(commands: tuple[Command, ...]) -> list[tuple[float, bytes]]:
    """(time_s, frame bytes) of a scenario's commands, with successive sequence numbers."""
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
    """The rig without the effects that the board itself causes in lock-step: dead time and the lag
    of the current measurement.
    """
    effects = {name: values for name, values in rig.effects.items() if name not in BOARD_EFFECTS}
    return rig_from_dict({**rig.as_dict(), "effects": effects}, "the rig")


def make_plant(tool: Rig, seed: int) -> Any:
    """The plant of a tool for lock-step: vgroove._core.ImpactPlant or DrillPlant by the rig's
    mechanism, else DrivePlant. VgrooveError for values that the plant refuses.
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
    if tool.effects.get("speed_lag", {}).get("form") == "mean":
        raise VgrooveError(
            f'{tool.name or "the rig"}: effects.speed_lag of form "mean" is that of a speed not '
            'made from Hall edges; the board reads edges: use form "filter" or "delay"'
        )
    with refused_by_plant(tool.name or "the rig"):
        if kind == "DrillPlant":  # the board's firmware makes the pulses of pulse mode
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
