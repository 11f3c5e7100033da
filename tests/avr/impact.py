"""Tapes of the tool in each mode: impacts that take each controller through its expensive states,
and random sensor values.
"""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from equality import TapeBoard
from exercise import SettledSwitches

from vgroove import lockstep, telemetry
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, pack_inputs
from vgroove.control_bench.drill import Screw, drill_rig
from vgroove.control_bench.runs import front_ends, make_tool, reference
from vgroove.eeprom_image import mode_number
from vgroove.lockstep import Profile
from vgroove.log import Log
from vgroove.scenario import make_plant
from vgroove.sil import SilBoard

DURATION_S = 1.9
COMMAND_S = 0.2  # time of the first command, after the calibration of the current offset
PULLS = Profile(
    travel=(
        (0, 0),
        (0.35, 0),
        (0.37, 1.0),
        (1.45, 1.0),
        (1.47, 0),
        (1.55, 0),
        (1.57, 0.7),
        (1.8, 0.7),
        (1.82, 0),
    )
)


@dataclass(frozen=True)
class Case:
    """A mode on a joint; `params`: raw parameter values, written before the trigger is pulled."""

    mode: str
    joint: str = "locked"
    values: dict[str, float] = field(default_factory=dict)
    params: dict[str, int] = field(default_factory=dict)


CASES = {
    "duty": Case("duty", "slip_60"),
    "sync": Case("sync", "locked", {"supply.voltage_v": 20.5}),
    "sync_current": Case("sync", "slip_6", {"supply.voltage_v": 18.5}, {"sync_method": 2}),
    "vibration": Case("vibration", "hard_joint", {}, {"vibration_method": 1}),
    "vibration_current": Case("vibration", "m8", {}, {"vibration_method": 2}),
    "screwing": Case("screwing", "m6"),
    "torque": Case("torque", "hard_joint", {}, {"torque_target_nm": 80}),
    "drill": Case("drill", params={"drill_clutch_dnm": 100, "drill_pulse": 1}),
}


def _frames(case: Case) -> list[tuple[float, bytes]]:
    """Commands that set the mode and its parameters."""
    names = [parameter.name for parameter in telemetry.parameter_list()]
    asked = [("SET_MODE", {"mode_request": mode_number(case.mode)})]
    asked += [
        ("PARAM_WRITE", {"write_index": names.index(name), "write_value": value})
        for name, value in case.params.items()
    ]
    frames = []
    for k, (name, signals) in enumerate(asked):
        time_s = COMMAND_S + 0.02 * k
        sequence = f"{name.split('_')[-1].lower()}_sequence"
        frame = telemetry.frame_of_signals(
            name, round(time_s * 1000), **signals, **{sequence: k + 1}
        )
        frames.append((time_s, telemetry.frame_bytes(frame)))
    return frames


@cache
def impact_tape(name: str) -> bytes:
    """Tape of a native run of the case."""
    case = CASES[name]
    board = TapeBoard(SilBoard(target=1))
    tool = (
        make_plant(drill_rig("low", 18.0, Screw(1.5, 5.0)), 3)
        if case.mode == "drill"
        else make_tool(reference(case.joint, case.values), 3)
    )
    lockstep.run(
        SettledSwitches(board),
        tool,
        PULLS,
        DURATION_S,
        lockstep.LockstepOptions(front=front_ends(), line=lockstep.Script(_frames(case)), seed=3),
    )
    return bytes(board.tape)


def acted(name: str, log: Log) -> bool:
    """Whether the drives of the log are in the case's mode and its controller acts: above 20 A in
    mode drill, after ten blows in the others.
    """
    driven = log["state"] == 1
    at_work = log["current_a"] > 20 if CASES[name].mode == "drill" else log["blow_count"] > 10
    return bool(
        (log["mode"][driven] == mode_number(CASES[name].mode)).all() and at_work[driven].any()
    )


class _RandomEdges:
    """Edges at a pitch that changes abruptly, 2 % of them missed or doubled."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._next = 0.0

    def of(self, begin: int, pitch_s: float) -> list[int]:
        """Cycles of the edges in the PWM period that begins at cycle `begin`."""
        self._next = min(max(self._next, begin), begin + 16e6 * pitch_s)
        edges: list[int] = []
        while self._next < begin + CYCLES_PER_PERIOD:
            kind = self._rng.integers(0, 100)
            edges += [] if kind == 0 else [int(self._next) - begin]
            self._next += 450 if kind == 1 else 16e6 * pitch_s
        return edges


@cache
def random_tape(name: str, seed: int = 11) -> bytes:
    """Tape of the case's mode, driven for a second while speed, current and supply change
    abruptly, saturate, or stay constant.
    """
    rng = np.random.default_rng(seed)
    times_s = (0.3004, 1.3004, 1.35)  # not at a tick, where the switches are read
    pulled, released, end = (round(time_s * 16e6 / CYCLES_PER_PERIOD) for time_s in times_s)
    starts = [
        (round(time_s * 16e6 / CYCLES_PER_PERIOD), frame) for time_s, frame in _frames(CASES[name])
    ]
    received = {at + 2 * n: frame[n : n + 1] for at, frame in starts for n in range(len(frame))}
    current, bus, pitch_s, inputs, hall = 520, 740, 1e-3, [], _RandomEdges(rng)
    for k in range(end):
        if k % 63 == 0 and rng.random() < 0.3:
            current, bus = (
                int(rng.choice([180, 512, 516, 600, 700, 800, 890])),
                int(rng.choice([640, 700, 740, 800, 820, 1023])),
            )
        if k % 313 == 0:
            pitch_s = rng.choice([1.0, 4e-3, 2e-3, 1.2e-3, 1e-3, 0.95e-3])
        driven = pulled <= k < released
        counts = (
            current + int(rng.integers(-6, 7)) if driven else 512,
            bus,
            900 if driven else 100,
            154,
        )
        edges = hall.of(k * CYCLES_PER_PERIOD, pitch_s) if driven else []
        inputs.append(
            pack_inputs(BoardInputs(counts, edges, 1 if driven else 0, received.get(k, b"")))
        )
    return b"".join(inputs)
