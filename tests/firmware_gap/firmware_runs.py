"""Runs of the native firmware on the generator's impact tool, with deviations between the firmware
that is assumed to run and the one that runs.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

TRUTH = Path(__file__).resolve().parents[1] / "truth"
if str(TRUTH) not in sys.path:
    sys.path.insert(0, str(TRUTH))

from impact_cases import hidden_state  # noqa: E402
from impact_effects import split  # noqa: E402
from impact_joints import slip_torque  # noqa: E402
from impact_rigs import ImpactRig, impact_params  # noqa: E402
from impact_tool import ImpactTruthTool  # noqa: E402

from vgroove import telemetry  # noqa: E402
from vgroove.board import PERIOD_S, BoardInputs, BoardOutputs  # noqa: E402
from vgroove.control_bench.runs import front_ends  # noqa: E402
from vgroove.eeprom_image import eeprom_image, mode_number  # noqa: E402
from vgroove.lockstep import COMPARE_TOP, LockstepOptions, Profile, steps  # noqa: E402
from vgroove.sil import SilBoard  # noqa: E402

ROW_S = 1e-3
COLUMNS = (
    "time_s",
    "duty",
    "coast",
    "supply_v",
    "current_a",
    "speed_rpm",
    "trigger",
    "state",
    "mode",
    "control_state",
    "stop_reason",
    "blow_count",
)


@dataclass(frozen=True)
class Deviation:
    """How the firmware that runs differs from the assumed one.

    params: EEPROM parameters. late_s: time by which the bridge acts later than the board commands.
    ceiling: largest duty of another build, 1 for none. trigger_late: rows by which the board sees
    the trigger later than it is logged.
    """

    params: Mapping[str, float] = field(default_factory=dict)
    late_s: float = 0.0
    ceiling: float = 1.0
    trigger_late: int = 0


class DeviatingBoard:
    """The native firmware with a deviation; it keeps the inputs of all periods."""

    def __init__(self, board: SilBoard, deviation: Deviation) -> None:
        self.board, self.deviation = board, deviation
        self.inputs: list[BoardInputs] = []

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """One period, with the duty of another build."""
        self.inputs.append(inputs)
        coast, compare, dead, sent = self.board.period(inputs)
        most = round(self.deviation.ceiling * COMPARE_TOP)
        return BoardOutputs(coast, max(-most, min(most, compare)), dead, sent)


@dataclass(frozen=True)
class FirmwareRun:
    """Telemetry rows of a run by column, (n,) each, and the inputs of the board by period."""

    rows: dict[str, np.ndarray]
    inputs: list[BoardInputs]


def rows_of(sent: bytes) -> dict[str, np.ndarray]:
    """The telemetry rows of all bytes that a board has sent."""
    session = telemetry.Session()
    session.feed(telemetry.Framer().feed(sent))
    return session.take_rows()


@dataclass(frozen=True)
class FirmwarePlan:
    """Mode and assumed EEPROM parameters, the trigger's profile, and the length of the run."""

    mode: str
    params: Mapping[str, float]
    profile: Profile
    seconds: float
    seed: int

    def image(self, deviation: Deviation) -> bytes:
        """The EEPROM with the parameters of a deviation."""
        return eeprom_image({**self.params, **deviation.params, "mode": mode_number(self.mode)})


def firmware_run(
    tool: ImpactRig, effect: dict[str, float], plan: FirmwarePlan, deviation: Deviation
) -> FirmwareRun:
    """Run the firmware on the tool with the parameters of its effects."""
    changed, joint, _ = split(effect)
    angles, roughness = hidden_state(tool, plan.seed)
    params = impact_params(tool) | angles | {"seed": plan.seed + 1.0} | changed
    params["transport_delay_s"] = params.get("transport_delay_s", 0.0) + deviation.late_s
    driven = ImpactTruthTool(slip_torque(tool, joint, roughness), **params)
    options = LockstepOptions(front=front_ends(), seed=plan.seed)
    sent = b""
    with SilBoard(eeprom=plan.image(deviation)) as native:
        board = DeviatingBoard(native, deviation)
        for progress in steps(board, driven, plan.profile, plan.seconds, options):
            sent = bytes(progress.sent)
    rows = {name: values for name, values in rows_of(sent).items() if name in COLUMNS}
    ceiling = round(deviation.ceiling * COMPARE_TOP) / COMPARE_TOP
    rows["duty"] = np.clip(rows["duty"], -ceiling, ceiling)
    if deviation.trigger_late:
        early = np.append(rows["trigger"], np.full(deviation.trigger_late, rows["trigger"][-1]))
        rows["trigger"] = early[deviation.trigger_late :]
    return FirmwareRun(rows, board.inputs)


def assumed_rows(run: FirmwareRun, plan: FirmwarePlan) -> dict[str, np.ndarray]:
    """Telemetry of the assumed firmware for the inputs of a run."""
    sent = bytearray()
    with SilBoard(eeprom=plan.image(Deviation())) as board:
        for inputs in run.inputs:
            sent += board.period(inputs).tx
    return rows_of(bytes(sent))


def first_difference(run: FirmwareRun, plan: FirmwarePlan, deviation: Deviation) -> float | None:
    """Time of the first row whose duty, state or trigger the assumed firmware would not give;
    where only the bridge is late, the first row with a duty. None where there is none.
    """
    if deviation.late_s > 0.0:
        driven = np.flatnonzero(run.rows["duty"] != 0.0)
        return float(run.rows["time_s"][driven[0]]) if len(driven) else None
    assumed = assumed_rows(run, plan)
    count = min(len(assumed["time_s"]), len(run.rows["time_s"]))
    apart = np.zeros(count, bool)
    for name in ("duty", "state", "trigger"):
        apart |= np.abs(run.rows[name][:count] - assumed[name][:count]) > 1e-9
    where = np.flatnonzero(apart)
    return float(run.rows["time_s"][where[0]]) if len(where) else None


def periods(seconds: float) -> int:
    """PWM periods in a time."""
    return round(seconds / PERIOD_S)
