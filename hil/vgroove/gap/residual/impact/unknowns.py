"""What is not determined by a log of a hammering tool, and how far the statistics depend on it: the
start angle of the hammer, the roughness of the joint, and the repeatability of tool and sensors.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vgroove import _core
from vgroove.gap.catalogue.statistics import LEVEL, PERIOD, RUN_UP, SHAPE
from vgroove.gap.cleaning.sensor_noise import high_frequency_sigma
from vgroove.gap.residual.impact.hall_reading import edge_speed
from vgroove.gap.residual.impact.impact_run import ImpactRun, own_sigma, white_sigma
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
    with_start_search,
    with_starts,
)
from vgroove.gap.residual.impact.start_scatter import StartScatter
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S, TURN_RAD

# Relative standard deviation of a column's scale and of the period from run to run: no tool
# repeats, and no sensor keeps its scale, more closely (an estimate)
REPEATABILITY = 1e-3
SCALED = (LEVEL, PERIOD, RUN_UP, SHAPE)  # kinds of statistics in proportion to a scale
TOLERATED_TOOLS = 8  # tools within the tolerances, over which standard deviations are taken
LEAST_RATIO = 0.1  # of the error of edges to that of white noise: keeps a standard deviation
SIMULATED_LOGS = 4  # from which the scatter that noise and mechanism cause is taken
EDGE_PLACES = 4  # places of the Hall edges in the turn, for each of these logs
STARTS_OF_TOOL = 12  # start angles of each of the further tools over which statistics scatter


def with_nuisances(run: ImpactRun, rig: Rig) -> tuple[ImpactRun, np.ndarray]:
    """The run with the responses of its statistics to what the log does not determine, and the
    start angles (M,) in rad of the hammer to simulate: the one that follows the log best, and
    others where the end of the run depends on the start.
    """
    theta = rig.parameters()
    neutral = without_effects(theta)
    tools = tolerated_tools(rig, neutral)
    if "hammer_start_rad" in rig.mechanism:
        run = with_simulated_scatter(run, tools[:, None])
        run = replace(run, early=None)
        rough = roughness_responses(run, tools)
        run = with_responses(with_deviations(run, rough.curvature), [rough.directions])
        return run, theta[[COLUMN]]
    run = with_simulated_scatter(run, from_all_starts(tools, SIMULATED_LOGS))
    tried, has_effects = start_angles(theta), not np.array_equal(neutral, theta)
    statistics = simulate_statistics(run, with_starts(neutral, tried))
    scatter = start_scatter(run, statistics)
    run = with_deviations(run, np.hypot(scatter.apart, further_scatter(run, tools, statistics)))
    neutral[COLUMN] = closest_start(run, neutral, tried)
    tools[:, COLUMN] = neutral[COLUMN]
    rough = roughness_responses(run, tools)
    run = with_start_curvature(with_deviations(run, rough.curvature), neutral)
    run = with_responses(run, [rough.directions, scatter.shared])
    neutral[COLUMN] = closest_start(run, neutral, tried)
    run = with_start_search(run, neutral)
    best = neutral[COLUMN]
    if has_effects:
        best = closest_start(run, theta, tried)
        statistics = simulate_statistics(run, with_starts(theta, tried))
    return run, np.concatenate([[best], other_starts(run, tried, statistics)])


def from_all_starts(tools: np.ndarray, count: int) -> np.ndarray:
    """Parameter sets (B, count, P): each of the tools (B, P) from start angles over the free angle
    of the hammer.
    """
    starts = start_angles(tools, count).ravel()
    return with_starts(np.repeat(tools, count, axis=0), starts).reshape(len(tools), count, -1)


def further_scatter(run: ImpactRun, tools: np.ndarray, statistics: np.ndarray) -> np.ndarray:
    """Standard deviations (n,) by which the statistics scatter over the start angles beyond those
    (M, n) of the rig's tool, RMS over the tools (B, P) that the tolerances allow: some settle on
    one limit cycle from every start, others do not.
    """
    if len(tools) == 1:
        return np.zeros(statistics.shape[1])
    others = from_all_starts(tools[1:], STARTS_OF_TOOL)
    found = simulate_statistics(run, others.reshape(-1, tools.shape[1]))
    variance = np.var(found.reshape(*others.shape[:2], -1), axis=1)
    own, theirs = np.var(statistics, axis=0), np.nan_to_num(variance).mean(axis=0)
    cycle = run.of_places(run.windows.periodic, np.zeros(len(run.run_up.first), bool))
    excess = np.maximum((theirs - own) * (len(tools) - 1) / len(tools), 0.0)
    return np.where(cycle, np.sqrt(np.nan_to_num(excess)), 0.0)


def with_simulated_scatter(run: ImpactRun, theta: np.ndarray) -> ImpactRun:
    """The run whose standard deviations are at most those of simulated logs of the rig's own model,
    and of a Hall speed at most the errors of its edges: what scatters further in the log is
    evidence. theta (T, M, P): of the rig's tool first and of further tools from M start angles.
    """
    rows = simulate(run, theta.reshape(-1, theta.shape[-1]))
    plain = model_columns(run, rows)
    sensed = sensed_columns(run, rows, plain)
    count = theta.shape[1] * EDGE_PLACES
    each = [own_sigma(run, {n: column[[k]] for n, column in sensed.items()}) for k in range(count)]
    simulated = np.sqrt(np.mean(np.square(each), axis=0))
    error = run.read(sensed, False) - np.repeat(run.read(plain, True), EDGE_PLACES, axis=0)
    run = replace(run, sigma=np.fmin(run.sigma, simulated))
    return with_edge_errors(run, error.reshape(len(theta), count, -1))


def with_edge_errors(run: ImpactRun, error: np.ndarray) -> ImpactRun:
    """The run with smaller standard deviations of the statistics of a Hall speed, where white noise
    overstates them: neighbouring readings share an edge, so that their errors cancel in the mean
    and in slow harmonics.

    error (tools, logs, n): errors of the statistics in simulated logs. Their RMS, in units of the
    standard deviation by white noise and of the tool in which it is largest, times that standard
    deviation in the log is the upper bound.
    """
    sigma, white = run.sigma.copy(), white_sigma(run)
    for k, part in enumerate(run.reader.parts):
        mine = (run.part == k) & run.judged
        if run.pulses and part.column == "speed_rpm" and mine.any():
            power = np.mean((error[..., mine] / white[mine]) ** 2, axis=(1, 2))
            ratio = np.sqrt(max(power[np.isfinite(power)], default=np.inf))
            sigma[mine] = np.fmin(sigma[mine], white[mine] * max(ratio, LEAST_RATIO))
    return replace(run, sigma=sigma)


def sensed_columns(
    run: ImpactRun, rows: dict[str, np.ndarray], plain: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Columns (B * EDGE_PLACES, rows) as the tool's sensors would log simulated ones (B, rows),
    from the simulated motion and the columns without noise. The noise of a Hall speed is that of
    its edges, with EDGE_PLACES places of these in the turn; noise of the column beyond it is added
    as white noise.
    """
    rng, found = np.random.default_rng(0), {}
    for name, values in plain.items():
        noise = run.reader.noise[name]
        sensed = np.repeat(values, EDGE_PLACES, axis=0)
        if name == "speed_rpm" and run.pulses:
            place = np.arange(len(sensed))[:, None] / EDGE_PLACES % 1.0 * TURN_RAD / run.pulses
            angle, speed = (
                np.repeat(rows[of], EDGE_PLACES, axis=0)
                for of in ("angle_measured_rad", "speed_measured_rad_s")
            )
            read = edge_speed(angle + place, speed, run.windows.row_s, run.pulses, run.timeout_s)
            sensed = RPM_PER_RAD_S * read
            own = np.median([high_frequency_sigma(each) for each in sensed])
            noise = np.sqrt(max(noise**2 - own**2, 0.0)) if np.isfinite(own) else noise
        found[name] = sensed + noise * rng.standard_normal(sensed.shape)
    return found


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
    """The run that is judged beside what the log does not determine: responses (n, m) each, and the
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
