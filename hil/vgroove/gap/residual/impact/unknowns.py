"""What no log of a hammering tool tells, and how far the statistics depend on it: the start angle
of the hammer, the roughness of the joint, and the repeatability of tool and sensors.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.gap.catalogue.statistics import LEVEL, PERIOD, RUN_UP, SHAPE
from vgroove.gap.residual.impact.impact_run import ImpactRun, own_sigma
from vgroove.gap.residual.impact.nuisance import NuisanceDirections
from vgroove.gap.residual.impact.roll_outs import (
    PARAMETERS,
    model_columns,
    simulate,
    simulate_statistics,
)
from vgroove.gap.residual.impact.roughness import roughness_responses
from vgroove.gap.residual.impact.start_angle import (
    COLUMN,
    closest_start,
    other_starts,
    start_angles,
    with_deviations,
    with_start_curvature,
    with_starts,
)
from vgroove.gap.residual.impact.start_scatter import StartScatter
from vgroove.rig import Rig

# Relative standard deviation of a column's scale and of the period from run to run: no tool
# repeats, and no sensor keeps its scale, more closely (an estimate)
REPEATABILITY = 1e-3
SCALED = (LEVEL, PERIOD, RUN_UP, SHAPE)  # kinds of statistics in proportion to a scale
TOLERATED_TOOLS = 8  # tools within the tolerances, over which the response to roughness is taken
SIMULATED_LOGS = 4  # from which the scatter that noise and mechanism cause is taken


def with_nuisances(run: ImpactRun, rig: Rig) -> tuple[ImpactRun, np.ndarray]:
    """The run with the responses of its statistics to what the log does not tell, and the start
    angles (M,) in rad of the hammer to simulate: the one that follows the log best, and others
    where the end of the run depends on the start.
    """
    theta = rig.parameters()
    neutral = without_effects(theta)
    if "hammer_start_rad" in rig.mechanism:
        run = with_simulated_scatter(run, neutral, theta[[COLUMN]])
        run = replace(run, early=None)
        rough = roughness_responses(run, tolerated_tools(rig, neutral))
        run = with_responses(with_deviations(run, rough.curvature), [rough.directions])
        return run, theta[[COLUMN]]
    run = with_simulated_scatter(run, neutral, start_angles(theta, SIMULATED_LOGS))
    tried, has_effects = start_angles(theta), not np.array_equal(neutral, theta)
    statistics = simulate_statistics(run, with_starts(neutral, tried))
    scatter = start_scatter(run, statistics)
    run = with_deviations(run, scatter.apart)
    neutral[COLUMN] = closest_start(run, neutral, tried)
    rough = roughness_responses(run, tolerated_tools(rig, neutral))
    run = with_start_curvature(with_deviations(run, rough.curvature), neutral)
    run = with_responses(run, [rough.directions, scatter.shared])
    best = closest_start(run, theta, tried)
    if has_effects:
        statistics = simulate_statistics(run, with_starts(theta, tried))
    return run, np.concatenate([[best], other_starts(run, tried, statistics)])


def with_simulated_scatter(run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray) -> ImpactRun:
    """The run whose standard deviations are at most those of logs of the rig's own model from start
    angles (M,), with the sensors' noise: what scatters further in the log is evidence.
    """
    rows = simulate(run, with_starts(theta, start_rad))
    noise = np.random.default_rng(0)
    columns = {
        name: values + run.reader.noise[name] * noise.standard_normal(values.shape)
        for name, values in model_columns(run, rows).items()
    }
    each = [
        own_sigma(run, {name: values[[k]] for name, values in columns.items()})
        for k in range(len(start_rad))
    ]
    simulated = np.sqrt(np.mean(np.square(each), axis=0))
    return replace(run, sigma=np.fmin(run.sigma, simulated))


def start_scatter(run: ImpactRun, statistics: np.ndarray) -> StartScatter:
    """How the statistics scatter, from those (M, n) over all start angles; windows without a cycle,
    whose phase is not known either, apart and over their whole range. The run-up follows one start
    angle.
    """
    cycle = run.of_places(run.windows.periodic, np.zeros(len(run.run_up.first), bool))
    found = StartScatter.of(np.where(cycle, statistics, 0.0))
    other = np.where(cycle | run.is_run_up, 0.0, np.nan_to_num(np.ptp(statistics, axis=0)))
    return replace(found, apart=np.where(cycle, found.apart, other))


def repeatability(run: ImpactRun) -> np.ndarray:
    """Responses (n, columns + 1) to the scales of the columns and of the period."""
    columns = [*run.reader.columns, ""]
    scaled = np.array([p.kind in SCALED for p in run.parts])[run.part]
    mine = np.array([columns.index(p.column) for p in run.parts])[run.part]
    size = REPEATABILITY * scaled * run.measured
    return size[:, None] * (mine[:, None] == np.arange(len(columns)))


def tolerated_tools(rig: Rig, theta: np.ndarray) -> np.ndarray:
    """Parameter sets (B, P): the given one (P,), and where the rig has tolerances some tools that
    they allow. Hammering may begin at another place of the joint with each of them.
    """
    keys = {PARAMETERS.index(key): sigma for key, sigma in rig.tolerance.items()}
    found = np.tile(theta, (1 + TOLERATED_TOOLS if keys else 1, 1))
    draws = np.random.default_rng(0).standard_normal((TOLERATED_TOOLS, len(keys)))
    for (column, sigma), drawn in zip(keys.items(), draws.T, strict=True):
        found[1:, column] *= np.exp(sigma * drawn)
    return found


def with_responses(run: ImpactRun, responses: Sequence[np.ndarray]) -> ImpactRun:
    """The run that is judged beside what the log does not tell: responses (n, m) each, and the
    repeatability of tool and sensors.
    """
    kept = run.judged
    every = np.concatenate([*responses, repeatability(run)], axis=1)
    return replace(run, nuisance=NuisanceDirections.of(every[kept] / run.sigma[kept, None]))


def without_effects(theta: np.ndarray) -> np.ndarray:
    """Parameters (P,) with the effects of a rig off, so that standard deviations are those of the
    rig's own model, whatever effects `--out-rig` has added to it.
    """
    neutral, plain = np.array(_core.parameter_defaults(), dtype=float), theta.copy()
    effects = [k for k, name in enumerate(PARAMETERS) if name.startswith("effects.")]
    plain[effects] = neutral[effects]
    return plain
