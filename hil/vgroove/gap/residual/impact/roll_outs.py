"""Simulates a hammering log for many parameter sets and computes the statistics of its windows."""

import numpy as np

from vgroove import _core
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.impact.hall_reading import mean_hall_speed
from vgroove.gap.residual.impact.impact_run import FirstSpans, ImpactRun
from vgroove.gap.residual.inputs import DrivingColumns
from vgroove.units import RPM_PER_RAD_S

PARAMETERS = list(_core.PARAMETERS)
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


def simulate_statistics(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Statistics (B, n) of one log for parameter sets (B, P)."""
    return run.read(model_columns(run, simulate(run, theta)), True)


def run_up_means(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Statistics (B, m) of the run-up alone for parameter sets (B, P)."""
    return _span_means(run, run.all_spans, theta)


def run_up_residuals(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Residuals (B, m) of the judged statistics of the run-up for parameter sets (B, P)."""
    return span_residuals(run, run.all_spans, theta)


def span_residuals(run: ImpactRun, spans: FirstSpans, theta: np.ndarray) -> np.ndarray:
    """Residuals (B, m) of the judged statistics of the first spans of the run-up for parameter sets
    (B, P).
    """
    return spans.residuals(_span_means(run, spans, theta))


def _span_means(run: ImpactRun, spans: FirstSpans, theta: np.ndarray) -> np.ndarray:
    """Statistics (B, m) of the first spans of the run-up for parameter sets (B, P)."""
    means = spans.run_up.means(model_columns(run, simulate(run, theta, spans.early)))
    return means.reshape(len(theta), -1)


def clipped_cost(run: ImpactRun, statistics: np.ndarray) -> np.ndarray:
    """Sum (...) of the clipped squared residuals of statistics (..., n) of a log; the clip counts
    where the plant cannot simulate.
    """
    size = np.nan_to_num(np.abs(run.residuals(statistics)), nan=np.inf)
    return np.sum(np.minimum(size, MIN_CLIP_SIGMAS) ** 2, axis=-1)


def simulate(
    run: ImpactRun, theta: np.ndarray, early: DrivingColumns | None = None
) -> dict[str, np.ndarray]:
    """Simulated columns (B, rows) of a log, or of its first rows `early` alone, for parameter sets
    (B, P), of which some may be impossible: these give nan.
    """
    try:
        drive = run.drive if early is None else early.plant()
        return _core.simulate_impact(drive, theta, mode=MODE)
    except (RuntimeError, ValueError):
        if len(theta) == 1:
            rows = len(run.log.time_s if early is None else early.time_s)
            return {name: np.full((1, rows), np.nan) for name in COLUMNS}
    half = len(theta) // 2
    parts = [simulate(run, theta[:half], early), simulate(run, theta[half:], early)]
    return {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}


def model_columns(run: ImpactRun, rows: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The judged columns (B, rows) as the tool's sensors would log the simulated ones, with what is
    missing in the log filled as there.
    """
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
    return found | {name: fill.filled(found[name]) for name, fill in run.fills.items()}
