"""Memory of a run of the plant: what a process takes for runs of different lengths, against the
columns that go in and come out.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgroove import _core
from vgroove.bench.impact_tool import SLIPPING
from vgroove.bench.own import impact_log, impact_parameters, parameters

LENGTHS_S = (10, 60, 120)
ROWS_A_SECOND = 1000
RUNS = ("impact", "drivetrain")
DRIVE_VALUES = {
    "supply.voltage_v": 18.5,
    "supply.resistance_ohm": 0.1,
    "motor.resistance_ohm": 0.19,
    "motor.inductance_h": 1e-4,
    "motor.torque_constant_nm_per_a": 0.0109,
    "motor.inertia_kg_m2": 1.6e-5,
    "motor.viscous_nm_s_per_rad": 4.5e-6,
    "motor.coulomb_nm": 0.012,
    "gearbox.ratio": 5.6,
    "gearbox.output_inertia_kg_m2": 6e-5,
}
KIB, MIB = 1024, 1 << 20


@dataclass(frozen=True)
class Memory:
    """One run in a process of its own: how far its peak rose during the run, and the bytes of its
    log (columns in and out, blows).
    """

    of: str
    seconds: int
    log_mib: float
    peak_mib: float


def run(of: str, seconds: int) -> int:
    """Bytes of the log of one run, rows of 1 ms."""
    rows = seconds * ROWS_A_SECOND
    given = 2 * 8 * (rows + 1)  # time and command
    if of == "impact":
        out = _core.simulate_impact(
            impact_log(1.0, rows), impact_parameters(SLIPPING["slip_60"])[None, :], mode="fast"
        )
        return (
            given
            + out["blows"][0].nbytes
            + sum(column.nbytes for column in out.values() if isinstance(column, np.ndarray))
        )
    drive = _core.LogInput(np.arange(rows + 1) * 1e-3, "duty", np.full(rows + 1, 1.0))
    out = _core.simulate_log(
        drive, parameters(DRIVE_VALUES)[None, :], np.array([0]), np.zeros((1, 3)), threads=1
    )
    return given + sum(column.nbytes for column in out.values())


def peak_bytes() -> int:
    """Largest resident size of this program so far (getrusage's would be that of the process it was
    forked from, too).
    """
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return (
        int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:")))
        * KIB
    )


def measure_here(of: str, seconds: int) -> Memory:
    """After a short run that loads all code; only the first measurement of a process means
    anything, since a peak never falls.
    """
    run(of, 1)
    before = peak_bytes()
    log = run(of, seconds)
    return Memory(of, seconds, log / MIB, (peak_bytes() - before) / MIB)


def measure_memory(
    runs: tuple[str, ...] = RUNS, lengths_s: tuple[int, ...] = LENGTHS_S
) -> list[Memory]:
    """Each run in a process of its own, lengths in rising order."""
    found = []
    for of in runs:
        for seconds in lengths_s:
            command = [sys.executable, "-m", "vgroove.bench.memory", of, str(seconds)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found.append(Memory(**json.loads(done.stdout)))
    return found


def growth_over_log(found: list[Memory], of: str) -> float:
    """What a longer run takes more, over what its log has more: a few copies of the log, nothing
    else.
    """
    mine = [m for m in found if m.of == of]
    return (mine[-1].peak_mib - mine[0].peak_mib) / (mine[-1].log_mib - mine[0].log_mib)


if __name__ == "__main__":
    sys.stdout.write(json.dumps(vars(measure_here(sys.argv[1], int(sys.argv[2])))))
