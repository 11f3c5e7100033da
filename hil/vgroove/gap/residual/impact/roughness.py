"""How the statistics of a hammering log respond to the roughness of the joint: a slip torque that
varies along the joint and is not determined by a log. Windows that meet the same place meet the
same torque.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vgroove.gap.catalogue.statistics import LEVEL, PERIOD, RISE
from vgroove.gap.residual.impact.cycle_statistics import StatisticPart
from vgroove.gap.residual.impact.impact_run import ImpactRun
from vgroove.gap.residual.impact.roll_outs import PARAMETERS, model_columns, simulate

SLIP_TORQUE = "effects.thread_friction.relative"
# Relative standard deviation of the slip torque along the joint, and the angle of the head over
# which its correlation falls to 1/e: wood and lubricated threads vary by a few per cent within a
# part of a turn (estimates)
ROUGHNESS, LENGTH_RAD = 0.03, 0.5
# Larger and smaller slip torque of which responses are taken, in standard deviations: with the
# plain one the points of Gauss-Hermite quadrature of order 3, whose weights are 1/6, 2/3, 1/6
NODE, NODE_WEIGHT = np.sqrt(3.0), 1.0 / 6.0
PLACES = 5  # of a window or span at which the roughness acts


@dataclass(frozen=True)
class RoughnessResponse:
    """How statistics respond to one standard deviation of each of m independent parts of the
    roughness (n, m), and what is not proportional to it (n,): where hammering begins, or a lug is
    skipped, at one torque and not at another one, no direction describes the change.
    """

    directions: np.ndarray
    curvature: np.ndarray


def roughness_responses(run: ImpactRun, theta: np.ndarray) -> RoughnessResponse:
    """The responses of the statistics to the roughness for parameter sets (B, P), by statistical
    linearisation (S. Sarkka, Bayesian Filtering and Smoothing, 2013, chapter 5). The directions are
    those of the first parameter set, the curvature is the RMS over all of them.

    A statistic responds to the mean of the roughness over its window as to a slip torque that is
    larger throughout. What varies within the window moves a rise, and moves the slope of an angle
    (the period, the speed of the anvil) against the mean: it weights the window's middle.
    """
    rougher = np.repeat(theta, 3, axis=0)
    nodes = ROUGHNESS * NODE * np.array([0.0, 1.0, -1.0])
    rougher[:, PARAMETERS.index(SLIP_TORQUE)] = np.tile(nodes, len(theta))
    rows = simulate(run, rougher)
    statistics = np.nan_to_num(run.read(model_columns(run, rows), True))
    change, curvature = linearised(statistics.reshape(len(theta), 3, -1))
    return RoughnessResponse(_directions(run, rows, change), curvature)


def linearised(at_nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change (n,) by one standard deviation of the slip torque of the first tool, and RMS (n,) of
    what is not proportional to the slip torque over all tools, from the values (tools, 3, n) at the
    plain slip torque, at a larger and at a smaller one.
    """
    plain, more, less = np.moveaxis(at_nodes, 1, 0)
    power = 2.0 * NODE_WEIGHT * (0.5 * (more + less) - plain) ** 2
    return 0.5 * (more[0] - less[0]) / NODE, np.sqrt(power.mean(axis=0))


def _directions(run: ImpactRun, rows: dict[str, np.ndarray], change: np.ndarray) -> np.ndarray:
    """Responses (n, m) to the independent parts, from the simulated columns (B, rows) and the
    change (n,) by a slip torque that is larger throughout.
    """
    at = _places(run)
    angle = np.nan_to_num(rows["anvil_angle_rad"][0])[at].ravel()
    apart = np.abs(angle[:, None] - angle)
    size, parts = np.linalg.eigh(np.exp(-apart / LENGTH_RAD))
    independent = (parts * np.sqrt(np.maximum(size, 0.0))).reshape(*at.shape, -1)
    share = (np.arange(PLACES) + 0.5) / PLACES - 0.5
    length_s = run.windows.rows * run.windows.row_s
    middle, slope = 1.0 - 4.0 * share**2, share / (share @ share) / length_s
    mean, of_middle, of_slope = (
        _of_statistics(run, np.tensordot(weight, independent, (0, 1)))
        for weight in (np.full(PLACES, 1.0 / PLACES), middle / middle.sum(), slope)
    )
    of_angle = _is_of(run, _is_slope_of_angle)[:, None]
    found = change[:, None] * np.where(of_angle, of_middle, mean)
    return found + _change_of_levels(run, change)[:, None] * of_slope


def _places(run: ImpactRun) -> np.ndarray:
    """Rows (W + M, PLACES) at which the roughness acts on each window and on each span."""
    share = (np.arange(PLACES) + 0.5) / PLACES
    windows = run.windows.first[:, None] + share * run.windows.rows
    spans = run.run_up.first[:, None] + share * run.run_up.rows
    return np.concatenate([windows, spans]).astype(int)


def _of_statistics(run: ImpactRun, values: np.ndarray) -> np.ndarray:
    """Values (n, m) of the statistics from those (W + M, m) of their windows and spans."""
    count = run.windows.count
    here = run.of_places(np.arange(count), count + np.arange(len(run.run_up.first)))
    return values[here]


def _change_of_levels(run: ImpactRun, change: np.ndarray) -> np.ndarray:
    """For each rise (n,) of a column the change of its level, 0 for all other statistics."""
    found = np.zeros(len(change))
    level = {part.column: k for k, part in enumerate(run.parts) if part.kind == LEVEL}
    for k, part in enumerate(run.parts):
        if part.kind == RISE and part.column in level:
            found[run.part == k] = change[run.part == level[part.column]]
    return found


def _is_of(run: ImpactRun, condition: Callable[[StatisticPart], bool]) -> np.ndarray:
    """Whether each statistic (n,) is of a part that fulfils a condition."""
    return np.array([condition(part) for part in run.parts])[run.part]


def _is_slope_of_angle(part: StatisticPart) -> bool:
    return part.kind == PERIOD or (part.column == "anvil_angle_rad" and part.kind == RISE)
