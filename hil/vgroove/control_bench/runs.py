"""One run of the real firmware on the plant: mode and parameters by name in, telemetry and truth
out.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from vgroove import _core, lockstep, telemetry
from vgroove.errors import VgrooveError
from vgroove.lockstep import FrontEnds, Profile
from vgroove.rig import Rig
from vgroove.scenario import CURRENT_SAMPLES_PER_ROW, SUPPLY_SAMPLES_PER_ROW
from vgroove.sil import SilBoard
from vgroove.study.impact_runs import JOINTS, impact_rig, with_joint

PULL_S = 0.25  # the firmware has measured its current offset by then
PULL_RAMP_S = 0.02
NOISE_A, NOISE_V = 0.15, 0.02  # of a row, 1 sigma: rigs/impact_driver_18v.toml
HALL_PULSES = 4
EEPROM_BYTES, SLOT_ADDRESS = 1024, 16  # firmware/app/param_store.h
# bytes that hold the first STATE frame; its flag param_defaults
STATE_WITHIN, FLAG_DEFAULTS = 2000, 256
TURN_RAD = 2 * np.pi
# a blow as the native firmware told it; repeats of each lug
TOLD = ("time_s", "lugs", "repeats", "period_s", "mean_period_s", "spread")


class AbsentError(VgrooveError):
    """This firmware has no such mode or parameter: the controller has not landed."""


def reference(
    joint: str | Mapping[str, Any] = "locked",
    values: Mapping[str, float] | None = None,
    *,
    supply_v: float | None = None,
) -> Rig:
    """The reference tool on a joint of vgroove.study.impact_runs.JOINTS or a [load] of its own,
    other dotted keys with it.
    """
    load = JOINTS[joint] if isinstance(joint, str) else joint
    supply = {} if supply_v is None else {"supply.voltage_v": supply_v}
    return with_joint(impact_rig(None), load, {**supply, **(values or {})})


def pull(trigger: float = 1.0, release_s: float | None = None, at_s: float = PULL_S) -> Profile:
    """The trigger is pulled at at_s to a travel of 0..1, and let go at release_s when given."""
    points = [(0.0, 0.0), (at_s, 0.0), (at_s + PULL_RAMP_S, trigger)]
    if release_s is not None:
        points += [(release_s, trigger), (release_s + PULL_RAMP_S, 0.0)]
    return Profile(travel=points)


def front_ends(noise: bool = True) -> FrontEnds:
    """The bench's sensors: a row's noise, spread over the samples that a row averages."""
    share = 1.0 if noise else 0.0
    return FrontEnds(
        current_noise_a=share * NOISE_A * CURRENT_SAMPLES_PER_ROW**0.5,
        supply_noise_v=share * NOISE_V * SUPPLY_SAMPLES_PER_ROW**0.5,
    )


def mode_number(mode: str | int) -> int:
    """Number of a mode by its name in the signal list."""
    known = {name: number for number, name in telemetry.value_table("STATE", "mode").items()}
    if isinstance(mode, str) and mode not in known:
        raise AbsentError(f"this firmware has no mode {mode}; it has {', '.join(known)}")
    return known[mode] if isinstance(mode, str) else mode


def parameter(name: str) -> telemetry.Parameter:
    """A parameter by its name, in any case, with or without its Q."""
    for entry in telemetry.parameter_list():
        if entry.name in (name.lower(), f"{name.lower()}_q{entry.q}"):
            return entry
    raise AbsentError(f"this firmware has no parameter {name}")


def eeprom_image(params: Mapping[str, float]) -> bytes:
    """An EEPROM whose first slot holds the defaults and these parameters, in their physical units."""
    known = telemetry.parameter_list()
    values = {entry.name: entry.default for entry in known}
    for name, value in params.items():
        entry = parameter(name)
        raw = round(value * 2**entry.q)
        if not entry.minimum <= raw <= entry.maximum:
            low, high = entry.minimum / 2**entry.q, entry.maximum / 2**entry.q
            raise VgrooveError(f"{entry.name} is {low:g} to {high:g} {entry.unit}, not {value:g}")
        values[entry.name] = raw
    slot = struct.pack(
        f"<BBH{len(known)}h", max(entry.version for entry in known), len(known), 1, *values.values()
    )
    slot += struct.pack("<H", telemetry.crc16(slot))
    return (bytes([255]) * SLOT_ADDRESS + slot).ljust(EEPROM_BYTES, bytes([255]))


@dataclass(frozen=True)
class Run:
    """A finished run. Times count from the board's start; `tool` is the plant as the run left it.

    blows: time_s, approach_rad_s, engaged_m, impulse_nm_s, peak_torque_nm, kind (0 blow, 1 repeat,
    2 rebound), lug, skipped. told: (n, len(TOLD)), what the native firmware made of them; none from
    another board.
    """

    rig: Rig
    tool: Any
    sent: bytes
    duration_s: float
    blows: np.ndarray = field(repr=False)
    truth_rows: np.ndarray | None = field(repr=False, default=None)
    told: np.ndarray = field(repr=False, default_factory=lambda: np.zeros((0, len(TOLD))))

    @property
    def hits(self) -> np.ndarray:
        """Blows (kind 0) and repeats (kind 1); rebounds belong to their blow."""
        return self.blows[self.blows["kind"] < 2]

    @cached_property
    def truth(self) -> dict[str, np.ndarray]:
        """Columns of vgroove._core.TRUTH_COLUMNS, (n,) each; duty is NaN where the bridge was open."""
        if self.truth_rows is None:
            raise VgrooveError("this run kept no truth: ask for truth_every")
        return dict(zip(_core.TRUTH_COLUMNS, self.truth_rows.T, strict=True))

    @cached_property
    def frames(self) -> list[telemetry.Frame]:
        """Intact frames in the order of their arrival."""
        return telemetry.Framer().feed(self.sent)

    @cached_property
    def session(self) -> telemetry.Session:
        """Boot, parameters, counters."""
        session = telemetry.Session()
        session.feed(self.frames)
        return session

    @cached_property
    def telemetry(self) -> dict[str, np.ndarray]:
        """time_s and telemetry.COLUMNS, (n,) each."""
        return self.session.take_rows()

    def signals(self, message: str) -> dict[str, np.ndarray]:
        """Every frame of a kind: its signals and time_s, (n,) each; empty arrays where none came or
        the firmware has no such frame.
        """
        known = {m.name: m for m in telemetry.database().messages}
        if message not in known:
            return {"time_s": np.zeros(0)}
        frames = [frame for frame in self.frames if frame.id == known[message].frame_id]
        return {
            "time_s": np.array([frame.time_ms for frame in frames]) / 1000,
            **telemetry.decode_many(message, frames),
        }

    @cached_property
    def control(self) -> dict[str, np.ndarray]:
        """CONTROL frames: state, stop reason, blow count, period, estimate."""
        return self.signals("CONTROL")

    @property
    def faults(self) -> int:
        """Fault bits that were ever set."""
        return int(np.bitwise_or.reduce(self.signals("STATE")["faults"].astype(int)))

    def slip_nm(self, head_rad: np.ndarray | float) -> np.ndarray:
        """Torque at which the joint turns on, at head angles from the run's start."""
        angles = np.atleast_1d(np.asarray(head_rad, float))
        return _core.joint_slip_torques(self.rig.parameters(), self.rig.load["kind"], angles)[0]

    @property
    def tightened_nm(self) -> float:
        """What the joint holds at the end: its slip torque at the head's angle."""
        return float(self.slip_nm(self.tool.head_rad)[0])

    @property
    def seat_rad(self) -> float:
        """Head angle of a wood screw's head contact, from the run's start."""
        return TURN_RAD * (self.rig.load["turns"] - self.rig.load["from_turns"])


def sil_run(
    rig: Rig,
    *,
    profile: Profile | None = None,
    mode: str | int = "duty",
    params: Mapping[str, float] | None = None,
    duration_s: float = 1.5,
    seed: int = 1,
    truth_every: int = 0,
    noise: bool = True,
    stop_when: Any = None,
    board: Any = None,
) -> Run:
    """The native firmware on a rig, from switching on; by default the trigger is pulled fully at
    0.25 s.

    mode: a name of STATE.mode in the signal list. params: physical values by name, put into the
    EEPROM before the start. seed: of the sensors' noise and of the Hall sensor's place on the
    shaft. truth_every: keep what the tool did every so many PWM periods. stop_when: called with
    (tool, Progress) after each 16 ms; True ends the run early. board: instead of the native
    firmware. Raises AbsentError for a mode or a parameter that this firmware does not have.
    """
    number = mode_number(mode)
    image = eeprom_image({**(params or {}), "mode": number})
    tool = make_tool(rig, seed)
    truth = _core.Truth(truth_every) if truth_every else None
    with board(image) if board else SilBoard(eeprom=image) as machine:
        steps = lockstep.steps(
            machine,
            tool,
            profile or pull(),
            duration_s,
            front=front_ends(noise),
            seed=seed,
            truth=truth,
        )
        for progress in steps:
            if stop_when is not None and stop_when(tool, progress):
                break
        told = np.array(getattr(getattr(machine, "machine", None), "blows", []), float).reshape(
            -1, len(TOLD)
        )
    check_start(bytes(progress.sent), mode, number)
    blows = tool.blows() if hasattr(tool, "blows") else np.zeros(0)
    return Run(
        rig, tool, bytes(progress.sent), progress.time_s, blows, truth.rows if truth else None, told
    )


def check_start(sent: bytes, mode: str | int, number: int) -> None:
    """The board took the EEPROM and has the mode; AbsentError or VgrooveError otherwise."""
    states = [
        frame
        for frame in telemetry.Framer().feed(sent[:STATE_WITHIN])
        if frame.id == telemetry.STATE
    ]
    if not states:
        raise VgrooveError("the board said nothing of its state")
    state = telemetry.decode(states[0])
    if int(state["flags"]) & FLAG_DEFAULTS:
        raise VgrooveError(
            "the firmware did not take the parameters: its list is another one than Python's; run `pip install -e .` again"
        )
    if int(state["mode"]) != number:
        raise AbsentError(f"this firmware does not have mode {mode} yet")


def make_tool(rig: Rig, seed: int) -> Any:
    """The rig as a lock-step plant, its Hall sensor anywhere on the shaft."""
    offset = float(np.random.default_rng(seed).uniform(0.0, TURN_RAD))
    if rig.mechanism["kind"] == "drill_driver":
        parameters, pack_ohm = rig.drill_parameters(), rig.value("supply.resistance_ohm")
        return _core.DrillPlant(
            parameters, pack_ohm, hall_pulses_per_rev=HALL_PULSES, hall_offset_rad=offset
        )
    kind = {"none": _core.DrivePlant, "impact": _core.ImpactPlant}[rig.mechanism["kind"]]
    return kind(
        rig.parameters(),
        load_kind=rig.load["kind"],
        hall_pulses_per_rev=HALL_PULSES,
        hall_offset_rad=offset,
        seed=seed,
    )
