"""Simulates a hammering log for many parameter sets, each from several start angles of the hammer,
and computes the statistics of its windows.

The start angle of the hammer is not logged. The motion settles on a limit cycle, so the start
matters in the first windows only, and the start angle that follows the log best there is used.
Where several limit cycles exist, different starts may reach different ones, and all are used.
"""

from dataclasses import dataclass

import numpy as np

from vgroove import _core
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.impact.hall_reading import mean_hall_speed
from vgroove.gap.residual.impact.impact_run import ImpactRun
from vgroove.units import RPM_PER_RAD_S, TURN_RAD


@dataclass(frozen=True)
class StartRules:
    """How many start angles of the hammer are simulated; chosen on simulated runs."""

    tried: int = 24  # over the free angle between two lugs
    # of these, besides the best one, where the last half of the run depends on the start
    spread: tuple[int, ...] = (2, 10, 18)
    # RMS difference between the starts, in standard deviations, up to which it does not
    max_spread: float = 1.0


STARTS = StartRules()
PARAMETERS = list(_core.PARAMETERS)
START, LUGS, OVERLAP = (
    "mechanism.hammer_start_rad",
    "mechanism.lug_count",
    "mechanism.lug_overlap_rad",
)
COLUMNS = (
    "current_a",
    "supply_v",
    "angle_rad",
    "angle_measured_rad",
    "speed_measured_rad_s",
    "anvil_angle_rad",
    "hammer_mm",
)
# accuracy of the plant; the error of the head's angle is 5e-5 (`vgroove bench speed`)
MODE = "fast"


def start_angles(theta0: np.ndarray) -> np.ndarray:
    """Start angles (M,) in rad of the hammer over the free angle between two lugs, for the rig's
    parameters (P,).
    """
    lugs, overlap = theta0[PARAMETERS.index(LUGS)], theta0[PARAMETERS.index(OVERLAP)]
    free = TURN_RAD / lugs - overlap
    return -free * (np.arange(STARTS.tried) + 0.5) / STARTS.tried


def from_starts(theta: np.ndarray, start_rad: np.ndarray) -> np.ndarray:
    """Parameter sets (M, P): a set (P,) with each start angle (M,) of the hammer."""
    every = np.tile(theta, (len(start_rad), 1))
    every[:, PARAMETERS.index(START)] = start_rad
    return every


def choose_starts(run: ImpactRun, start_rad: np.ndarray, statistics: np.ndarray) -> np.ndarray:
    """The start angles to simulate further (M,), from the statistics (M, W, K) that all of them
    give: the one that follows the log best; several where the end of the run depends on the start.
    """
    late = np.arange(run.windows.count)[:, None] > run.windows.count // 2
    size = np.minimum(np.std(statistics, axis=0) / run.sigma, MIN_CLIP_SIGMAS)
    power = run.flat(size**2)[run.flat(late & (size >= 0.0))]
    order = np.argsort(clipped_cost(run, statistics).sum(axis=1), kind="stable")
    if len(power) and np.sqrt(power.mean()) > STARTS.max_spread:
        return start_rad[np.r_[order[0], STARTS.spread]]
    return start_rad[order[:1]]


def simulate_statistics(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Statistics (B, W, K) of one log for parameter sets (B, P)."""
    columns = model_columns(run, simulate(run, theta))
    return run.reader.statistics(run.reader.fit(columns), True)


def clipped_cost(run: ImpactRun, statistics: np.ndarray) -> np.ndarray:
    """Clipped squared residuals (..., n) of statistics (..., W, K) of a log; the clip where the
    plant cannot simulate.
    """
    size = np.abs(run.measured - statistics) / run.sigma
    return run.flat(np.minimum(np.nan_to_num(size, nan=np.inf), MIN_CLIP_SIGMAS) ** 2)


def simulate(run: ImpactRun, theta: np.ndarray) -> dict[str, np.ndarray]:
    """Simulated columns (B, rows) of one log for parameter sets (B, P), of which some may be
    impossible: these give nan.
    """
    try:
        return _core.simulate_impact(run.drive, theta, mode=MODE)
    except (RuntimeError, ValueError):
        if len(theta) == 1:
            rows = len(run.log.time_s)
            return {name: np.full((1, rows), np.nan) for name in COLUMNS}
    half = len(theta) // 2
    parts = [simulate(run, theta[:half]), simulate(run, theta[half:])]
    return {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}


def model_columns(run: ImpactRun, rows: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The judged columns (B, rows) as the tool's sensors would log the simulated ones."""
    found = {}
    for name in run.reader.columns:
        if name != "speed_rpm":
            found[name] = rows[name]
        elif run.pulses:
            row_s = run.windows.row_s
            angle, speed = rows["angle_measured_rad"], rows["speed_measured_rad_s"]
            reading = mean_hall_speed(angle, speed, row_s, run.pulses, run.timeout_s)
            found[name] = RPM_PER_RAD_S * reading
        else:
            found[name] = RPM_PER_RAD_S * rows["speed_measured_rad_s"]
    return found
