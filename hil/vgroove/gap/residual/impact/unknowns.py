"""What no log of a hammering tool tells, and how far the statistics depend on it: the start angle
of the hammer, the roughness of the joint, and the repeatability of tool and sensors.
"""

from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.gap.catalogue.statistics import LEVEL, PERIOD, RUN_UP, SHAPE
from vgroove.gap.residual.impact.impact_run import ImpactRun
from vgroove.gap.residual.impact.nuisance import NuisanceDirections
from vgroove.gap.residual.impact.roll_outs import PARAMETERS, simulate_statistics
from vgroove.gap.residual.impact.start_angle import (
    COLUMN,
    closest_start,
    other_starts,
    start_angles,
    with_deviations,
    with_start_curvature,
    with_starts,
)
from vgroove.rig import Rig

# Relative standard deviation of a slip torque along the joint, which no log states: wood and
# lubricated threads vary by a few per cent from place to place (an estimate)
SLIP_TORQUE, ROUGHNESS = "effects.thread_friction.relative", 0.03
# Relative standard deviation of a column's scale and of the period from run to run: no tool
# repeats, and no sensor keeps its scale, more closely (an estimate)
REPEATABILITY = 1e-3
SCALED = (LEVEL, PERIOD, RUN_UP, SHAPE)  # kinds of statistics in proportion to a scale


def with_nuisances(run: ImpactRun, rig: Rig) -> tuple[ImpactRun, np.ndarray]:
    """The run with the responses of its statistics to what the log does not tell, and the start
    angles (M,) in rad of the hammer to simulate: the one that follows the log best, and others
    where the end of the run depends on the start.
    """
    theta = rig.parameters()
    neutral = without_effects(theta)
    if "hammer_start_rad" in rig.mechanism:
        run = with_responses(replace(run, early=None), neutral)
        return run, theta[[COLUMN]]
    tried, has_effects = start_angles(theta), not np.array_equal(neutral, theta)
    statistics = simulate_statistics(run, with_starts(neutral, tried))
    run = with_start_scatter(run, statistics)
    neutral[COLUMN] = closest_start(run, neutral, tried)
    run = with_responses(with_start_curvature(run, neutral), neutral)
    best = closest_start(run, theta, tried)
    if has_effects:
        statistics = simulate_statistics(run, with_starts(theta, tried))
    return run, np.concatenate([[best], other_starts(run, tried, statistics)])


def with_start_scatter(run: ImpactRun, statistics: np.ndarray) -> ImpactRun:
    """The run whose standard deviations contain the scatter of statistics (M, n) over all start
    angles; of windows without a cycle, whose phase is not known either, their whole range. The
    run-up follows one start angle.
    """
    cycle = run.of_places(run.windows.periodic, np.zeros(len(run.run_up.first), bool))
    scatter = np.where(cycle, statistics.std(axis=0), np.ptp(statistics, axis=0))
    return with_deviations(run, np.where(run.is_run_up, 0.0, np.nan_to_num(scatter)))


def roughness(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Responses (n, groups) to the roughness of the joint, which each window, and each span of the
    run-up, meets at another place: those to a slip torque that is larger throughout, times
    ROUGHNESS.
    """
    both = np.stack([theta, theta])
    both[1, PARAMETERS.index(SLIP_TORQUE)] = ROUGHNESS
    plain, more = simulate_statistics(run, both)
    spans = run.windows.count + np.arange(len(run.run_up.first))
    place = run.of_places(np.arange(run.windows.count), spans)
    return np.nan_to_num(more - plain)[:, None] * (place[:, None] == np.unique(place))


def repeatability(run: ImpactRun) -> np.ndarray:
    """Responses (n, columns + 1) to the scales of the columns and of the period."""
    columns = [*run.reader.columns, ""]
    scaled = np.array([p.kind in SCALED for p in run.parts])[run.part]
    mine = np.array([columns.index(p.column) for p in run.parts])[run.part]
    size = REPEATABILITY * scaled * run.measured
    return size[:, None] * (mine[:, None] == np.arange(len(columns)))


def with_responses(run: ImpactRun, theta: np.ndarray) -> ImpactRun:
    """The run that is judged beside what else the log does not tell, for parameters (P,)."""
    kept = run.judged
    every = np.concatenate([roughness(run, theta), repeatability(run)], axis=1)
    return replace(run, nuisance=NuisanceDirections.of(every[kept] / run.sigma[kept, None]))


def without_effects(theta: np.ndarray) -> np.ndarray:
    """Parameters (P,) with the effects of a rig off, so that standard deviations are those of the
    rig's own model, whatever effects `--out-rig` has added to it.
    """
    neutral, plain = np.array(_core.parameter_defaults(), dtype=float), theta.copy()
    effects = [k for k, name in enumerate(PARAMETERS) if name.startswith("effects.")]
    plain[effects] = neutral[effects]
    return plain
