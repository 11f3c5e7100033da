"""A subset of the bench on the ELF, simulated instruction by instruction: every drive must send the
same bytes as the native firmware.
"""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.board import AvrBoard, default_elf
from vgroove.control_bench import drill, screwing, torque
from vgroove.control_bench.runs import Run, RunPlan, pull, reference, run_plan
from vgroove.eeprom_image import AbsentError
from vgroove.errors import VgrooveError
from vgroove.html_page import table_from_dicts
from vgroove.lockstep import Profile
from vgroove.progress import step_bar
from vgroove.result_files import Report
from vgroove.rig import Rig

COLUMNS = [
    ("case", "case"),
    ("s", "seconds"),
    ("rows", "rows"),
    ("rows that differ", "differ"),
    ("control frames", "frames"),
    ("frames that differ", "frames_differ"),
    ("ended by", "reason"),
    ("expected", "expected"),
    ("equal decisions", "equal"),
]
DECISIONS = ("duty", "coast", "state")


@dataclass(frozen=True)
class Case:
    """One drive of the subset, long enough for the controller's decision; `ends` is the expected
    stop reason.
    """

    name: str
    mode: str
    rig: Callable[[], Rig]
    params: Mapping[str, float] = field(default_factory=dict)
    profile: Profile = field(default_factory=pull)
    seconds: float = 1.0
    ends: str = "none"


def tighten(target_nm: float, slope: float, seconds: float, ends: str) -> Case:
    """Torque control on a joint with drawn parameters."""
    name = f"torque, {target_nm:g} N m at {slope:g} N m/rad"
    return Case(
        name,
        "torque",
        lambda: torque.joint(slope, 3),
        {"torque_target_nm": target_nm},
        seconds=seconds,
        ends=ends,
    )


def jam(gear: str) -> Case:
    """A drill driver whose bit locks (jams): within 5 ms the load rises to 1.5 times the stall
    torque.
    """
    jammed_s = drill.LOCK_AT_S + drill.LOCK_S
    jammed_nm = 1.5 * drill.stall_nm(gear, 18.0)
    return Case(
        f"drill, {gear} gear jams",
        "drill",
        lambda: drill.drill_rig(gear, 18.0),
        drill.drill_params(gear),
        replace(pull(), load_nm=((0.0, 0.0), (drill.LOCK_AT_S, 0.0), (jammed_s, jammed_nm))),
        1.2,
        "kickback",
    )


def clutch(gear: str, torque_nm: float, seconds: float) -> Case:
    """A drill driver on a joint that its clutch stops."""
    screw = drill.Screw(rise_nm_per_rad=2.0 * torque_nm, from_rad=5.0)
    return Case(
        f"drill, clutch {torque_nm:g} N m",
        "drill",
        lambda: drill.drill_rig(gear, 18.0, screw),
        drill.drill_params(gear, torque_nm),
        seconds=seconds,
        ends="clutch",
    )


PULSE_LOAD = replace(pull(), load_nm=((0.0, 0.0), (0.7, 0.0), (0.75, 6.0), (1.2, 6.0), (1.25, 0.0)))
CASES = {
    "blows": [Case("duty, locked", "duty", lambda: reference("locked"))],
    "sync": [
        Case(
            f"sync, method {n}",
            "sync",
            lambda: reference("slip_60", supply_v=17.5),
            {"sync_method": n},
            pull(0.8),
        )
        for n in (1, 2)
    ],
    "screwing": [
        Case(
            "screwing, M6",
            "screwing",
            lambda: screwing.screw("m6", 18.5, 1.0, False, 10),
            {},
            pull(1.0),
            5.7,
            "seated",
        )
    ],
    "vibration": [
        Case(
            f"vibration, method {n}",
            "vibration",
            lambda: reference("disc_spring"),
            {"vibration_method": n},
        )
        for n in (1, 2)
    ],
    "torque": [
        tighten(80.0, 120.0, 5.2, "reached"),
        tighten(80.0, 60.0, 5.2, "reached"),
        tighten(40.0, 240.0, 1.3, "missed"),
        Case(
            "torque, 15 V",
            "torque",
            lambda: reference(supply_v=15.0),
            {"torque_target_nm": 120.0},
            seconds=0.6,
            ends="unreachable",
        ),
    ],
    "drill": [
        clutch("low", 5.0, 1.3),
        clutch("high", 2.0, 1.0),
        jam("low"),
        jam("high"),
        Case(
            "drill, pulse mode",
            "drill",
            lambda: drill.drill_rig("low", 18.0),
            drill.drill_params("low", pulse=True),
            PULSE_LOAD,
            1.6,
        ),
    ],
}
SEED = 5


def avr_board(image: bytes, folder: Path, tool: str) -> AvrBoard:
    """The Uno's ELF for a tool, impact or drill, with an EEPROM."""
    path = folder / "eeprom.bin"
    path.write_bytes(image)
    return AvrBoard(default_elf("uno", tool), eeprom=path, seed=SEED)


def run_on_both_boards(case: Case) -> tuple[Run, Run]:
    """The drive on the native firmware and on the ELF."""
    plan = RunPlan(case.profile, case.mode, case.params, case.seconds, SEED)
    native = run_plan(case.rig(), plan)
    with tempfile.TemporaryDirectory() as folder:
        tool = "drill" if case.mode == "drill" else "impact"
        avr = replace(plan, board=lambda image: avr_board(image, Path(folder), tool))
        return native, run_plan(case.rig(), avr)


def row_differences(a: Mapping[str, np.ndarray], b: Mapping[str, np.ndarray]) -> tuple[int, int]:
    """Rows of two telemetries at equal times, and rows whose DECISIONS differ or that one lacks.

    Rows after the end of the shorter telemetry are not compared: the run may end while one is sent.
    """
    _, at_a, at_b = np.intersect1d(a["time_s"], b["time_s"], return_indices=True)
    same = [
        (a[name][at_a] == b[name][at_b]) | (np.isnan(a[name][at_a]) & np.isnan(b[name][at_b]))
        for name in DECISIONS
    ]
    end_s = min(a["time_s"][-1], b["time_s"][-1])
    rows = sum(int((part["time_s"] <= end_s).sum()) for part in (a, b))
    common = len(at_a)
    return common, common - int(np.all(same, axis=0).sum()) + rows - 2 * common


def frame_differences(a: Sequence[Any], b: Sequence[Any]) -> int:
    """Number of places at which the two lists have different frames; a frame without a partner
    beyond the end of the shorter list counts as well.
    """
    return sum(x != y for x, y in zip(a, b, strict=False)) + abs(len(a) - len(b))


def differing(case: Case) -> dict[str, Any]:
    """Rows and CONTROL frames that differ between the two runs, and whether the drive ended as
    expected.
    """
    native, avr = run_on_both_boards(case)
    rows, differ = row_differences(native.telemetry, avr.telemetry)
    control = telemetry.database().get_message_by_name("CONTROL").frame_id
    controls = [[f for f in run.frames if f.id == control] for run in (native, avr)]
    frames = frame_differences(*controls)
    reason = torque.reason_of(avr)
    return {
        "case": case.name,
        "mode": case.mode,
        "seconds": case.seconds,
        "rows": rows,
        "differ": differ,
        "frames": len(controls[0]),
        "frames_differ": frames,
        "reason": reason,
        "expected": case.ends,
        "equal": differ + frames == 0 and reason == case.ends,
    }


def avr_bench(parts: Sequence[str]) -> Report:
    """The subset of the named parts; controllers that the firmware lacks are listed as absent."""
    cases = [case for part in parts for case in CASES.get(part, ())]
    if not cases:
        raise VgrooveError(
            f"on the ELF there are drives of {', '.join(CASES)}, none of these parts"
        )
    rows, lines = [], []
    with step_bar(len(cases)) as tick:
        for case in cases:
            try:
                rows.append(differing(case))
            except AbsentError as error:
                lines.append(f"{case.name}: absent ({error}).")
            tick(case.name)
    equal = sum(row["equal"] for row in rows)
    lines.insert(
        0,
        f"{equal} of {len(rows)} drives make the same decisions, as expected, on the native "
        "firmware and on the ATmega328P's ELF.",
    )
    return Report(
        "control_avr",
        "Controllers on the ELF",
        lines,
        [table_from_dicts("avr", "Native firmware against the ELF", COLUMNS, rows)],
        [],
        {"avr": rows},
    )
