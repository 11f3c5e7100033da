"""Memory of a run of the plant: peak memory of the process over the length of the run, against the
size of the columns that go in and come out.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vgroove import _core
from vgroove.bench.impact_tool import SLIPPING
from vgroove.bench.own import ROW_S, drive_values, impact_log, impact_parameters, parameters
from vgroove.units import BYTES_PER_KIB, BYTES_PER_MIB

LENGTHS_S = (10, 60, 120)
ROWS_PER_S = 1000
RUNS = ("impact", "drivetrain")


@dataclass(frozen=True)
class Memory:
    """One run in a process of its own: the rise of its peak memory during the run, and the size of
    its log (columns in and out, blows).
    """

    of: str
    seconds: int
    log_mib: float
    peak_mib: float


def run(of: str, seconds: int) -> int:
    """Bytes of the log of one run, rows of 1 ms."""
    rows = seconds * ROWS_PER_S
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
    drive = _core.LogInput(np.arange(rows + 1) * ROW_S, "duty", np.full(rows + 1, 1.0))
    theta = parameters(drive_values())[None, :]
    out = _core.simulate_log(drive, theta, np.array([0]), np.zeros((1, 3)), threads=1)
    return given + sum(column.nbytes for column in out.values())


def peak_bytes() -> int:
    """Largest resident size of this process; getrusage would include the process that forked it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    peak = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(peak) * BYTES_PER_KIB


def measure_here(of: str, seconds: int) -> Memory:
    """Measure in this process, after a short run that loads all code.

    Only the first measurement of a process is valid, since a peak never falls.
    """
    run(of, 1)
    before = peak_bytes()
    log = run(of, seconds)
    return Memory(of, seconds, log / BYTES_PER_MIB, (peak_bytes() - before) / BYTES_PER_MIB)


def measure_memory(
    runs: tuple[str, ...] = RUNS, lengths_s: tuple[int, ...] = LENGTHS_S
) -> list[Memory]:
    """Measure each run in a process of its own, the lengths in ascending order."""
    found = []
    for of in runs:
        for seconds in lengths_s:
            command = [sys.executable, "-m", "vgroove.bench.memory", of, str(seconds)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found.append(Memory(**json.loads(done.stdout)))
    return found


def growth_over_log(found: list[Memory], of: str) -> float:
    """Increase of the peak memory divided by the increase of the log's size, from the shortest run
    to the longest: the number of copies of the log in memory.
    """
    mine = [m for m in found if m.of == of]
    return (mine[-1].peak_mib - mine[0].peak_mib) / (mine[-1].log_mib - mine[0].log_mib)


if __name__ == "__main__":
    sys.stdout.write(json.dumps(vars(measure_here(sys.argv[1], int(sys.argv[2])))))
