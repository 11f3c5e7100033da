"""A named subset of the bench on the ELF, simulated instruction by instruction: the same drives must send the same bytes as in SIL."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vgroove import telemetry
from vgroove.board import AvrBoard, default_elf
from vgroove.control_bench import drill, screwing, torque
from vgroove.control_bench.goals import table_of
from vgroove.control_bench.runs import AbsentError, Run, pull, reference, sil_run
from vgroove.rig import Rig
from vgroove.study.command import progress
from vgroove.study.report import Study

SECONDS = 1.0
COLUMNS = [
    ("case", "case"),
    ("rows", "rows"),
    ("rows that differ", "differ"),
    ("control frames", "frames"),
    ("frames that differ", "frames_differ"),
    ("equal decisions", "equal"),
]
DECISIONS = ("duty", "coast", "state")


@dataclass(frozen=True)
class Case:
    """One drive of the subset."""

    name: str
    mode: str
    rig: Callable[[], Rig]
    params: Mapping[str, float] = field(default_factory=dict)
    trigger: float = 1.0


CASES = {
    "sync": [Case(f"sync, method {n}", "sync", lambda: reference("slip_60", supply_v=17.5), {"sync_method": n}, 0.8) for n in (1, 2)],
    "screwing": [Case("screwing, M6", "screwing", lambda: screwing.screw("m6", 18.5, 1.0, False, 3))],
    "vibration": [Case(f"vibration, method {n}", "vibration", lambda: reference("disc_spring"), {"vibration_method": n}) for n in (1, 2)],
    "torque": [Case("torque, 80 N m at 120 N m/rad", "torque", lambda: torque.joint(120.0, 3), {"torque_target_nm": 80.0})],
    "drill": [Case("drill, clutch 5 N m", "drill", lambda: drill.drill_rig("low", 18.0, 10.0, 5.0), drill.drill_params("low", 5.0))],
    "blows": [Case("duty, locked", "duty", lambda: reference("locked"))],
}
SEED = 5


def avr_board(image: bytes, folder: Path) -> AvrBoard:
    """The Uno's ELF with an EEPROM."""
    path = folder / "eeprom.bin"
    path.write_bytes(image)
    return AvrBoard(default_elf(), eeprom=path, seed=SEED)


def both(case: Case) -> tuple[Run, Run]:
    """The drive on the native firmware and on the ELF."""
    options: dict[str, Any] = {"mode": case.mode, "params": case.params, "profile": pull(case.trigger), "duration_s": SECONDS, "seed": SEED}
    native = sil_run(case.rig(), **options)
    with tempfile.TemporaryDirectory() as folder:
        return native, sil_run(case.rig(), board=lambda image: avr_board(image, Path(folder)), **options)


def differing(case: Case) -> dict[str, Any]:
    """Rows and CONTROL frames of both runs that differ."""
    native, avr = both(case)
    a, b = native.telemetry, avr.telemetry
    _, at_a, at_b = np.intersect1d(a["time_s"], b["time_s"], return_indices=True)
    same = [(a[name][at_a] == b[name][at_b]) | (np.isnan(a[name][at_a]) & np.isnan(b[name][at_b])) for name in DECISIONS]
    end_s = min(a["time_s"][-1], b["time_s"][-1])  # the last row of one may still be on the line
    count, alone = len(at_a), sum(int((rows["time_s"] <= end_s).sum()) for rows in (a, b)) - 2 * len(at_a)
    differ = count - int(np.all(same, axis=0).sum()) + alone
    controls = [[f for f in run.frames if f.id == telemetry.database().get_message_by_name("CONTROL").frame_id] for run in (native, avr)]
    frames = sum(x != y for x, y in zip(*controls, strict=False)) + abs(len(controls[0]) - len(controls[1]))
    return {
        "case": case.name,
        "rows": count,
        "differ": differ,
        "frames": len(controls[0]),
        "frames_differ": frames,
        "equal": differ + frames == 0,
    }


def avr_bench(parts: Sequence[str]) -> Study:
    """The subset of the named parts; controllers that are not there are listed as absent."""
    cases = [case for part in parts for case in CASES[part]]
    rows, lines = [], []
    with progress(len(cases)) as tick:
        for case in cases:
            try:
                rows.append(differing(case))
            except AbsentError as error:
                lines.append(f"{case.name}: absent ({error}).")
            tick(case.name)
    equal = sum(row["equal"] for row in rows)
    lines.insert(0, f"{equal} of {len(rows)} drives of {SECONDS:g} s decide alike on the native firmware and on the ATmega328P's ELF.")
    return Study(
        "control_avr",
        "Controllers on the ELF",
        lines,
        [table_of("avr", "Native firmware against the ELF", COLUMNS, rows)],
        [],
        {"avr": rows},
    )
