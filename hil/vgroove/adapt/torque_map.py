"""The voltage level and the motor current that belong to each torque of a tool, from the plant
(docs/controllers/torque.md).

The slopes of the fit differ from those on which the controller is evaluated.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from vgroove.adapt.level_control import LEAD_ABOVE_V, Run
from vgroove.rig import Rig

FIRST_NM, LAST_NM = 40, 120  # rows of the map, 1 N m each
ROWS = LAST_NM - FIRST_NM + 1
LEAST_V, MOST_V = 5.4, 11.84  # range of the levels on which joints settle
RUN_V = 5.5  # level of the run-up
BASE_V, LEVEL_STEP_V = 5.0, 0.04  # of the levels in the map
RAISED_COST = 1 / 16  # processor time of a soft joint over that of a level with its 16 joints
# Seconds after the level is reached at which the current is measured, and seconds from then on
# until the slip torque is settled. Below SLOW_BELOW_V the current is measured as soon as the
# filters have settled: it depends little on the torque above about 55 N m, and later soft joints
# have gained so much torque that their current is that of hard ones.
MEASURE_S, SETTLE_S = 1.2, 2.8
SLOW_BELOW_V, SLOW_MEASURE_S, SLOW_SETTLE_S = 7.0, 0.6, 4.4
MEAN_TICKS = 100  # the measured current is a mean over several blows
# Smaller targets are below the slip torque that the weakest blows over the lugs lead to: they have
# a raised level only.
LEAST_HELD_NM = 58
# N m/rad, of the slip torque that a level leads to
HARD_SLOPES = (130.0, 200.0, 330.0, 500.0, 800.0)
# (supply in V, winding resistance over its nominal value) of the tools of the hard and soft joints
HELD_TOOLS = ((18.5, 1.0), (16.9, 1.08), (20.1, 0.92))
RAISED_TOOLS = ((18.5, 1.0), (17.0, 1.07), (20.0, 0.93))
# N m/rad; softer joints get the raised level. Where lugs have begun to be hit once a joint gains
# little in the settling time and much on the raised level.
SLOW_DIVIDING_SLOPE, DIVIDING_SLOPE, ONCE_DIVIDING_SLOPE = 88.0, 100.0, 75.0
ONCE_V = (9.56, 10.3)
# Levels between which the number of hits of a lug changes (from three to two, from two to one),
# back and forth: the current does not determine the torque. No row gets such a level.
CHANGING_V = ((6.74, 7.06), (9.18, 9.54))
# The dividing current is at least this far below the least current of a hard joint, since irregular
# blows scatter it.
DIVIDING_MARGIN_A = 0.1
SOFT_SLOPES = (50.0, 58.0, 68.0, 80.0, 94.0, 110.0, 130.0)
# (raised level in V, first and last row in N m): levels at which the current determines the torque
# and a single blow adds little
RAISED_V = ((5.6, 40, 57), (8.6, 58, 81), (10.0, 82, 93), (12.68, 94, 105), (13.6, 106, 120))
# Seconds on the raised level until its current is valid, as in torque.c; the points of the fit
# begin then. Without them the transient of the filters is part of the fit.
RAISED_VALID_S, LEAD_VALID_S = 0.3, 0.15
# Added to the stop currents of the lowest level, since noise makes the filtered current pass a
# limit early
EARLY_A = 0.03


def decision_current_a(run: Run, level_v: float) -> float:
    """Slow current in A on a level (V) at the time of the controller's decision, a mean over
    MEAN_TICKS.
    """
    run.go(level_v, (SLOW_MEASURE_S if level_v < SLOW_BELOW_V else MEASURE_S) - 0.05)
    current = 0.0
    for _ in range(MEAN_TICKS):
        run.level.tick(run.tool)
        current += run.level.slow_a / MEAN_TICKS
    return current


def settled_torques_nm(rig: Rig, scale: float, level: float) -> tuple[list[float], float]:
    """Settled torques in N m of the hard joints on a level (V), and the current in A that divides
    hard from soft joints.
    """
    torques_nm, hard_a = [], []
    for slope, tool in itertools.product(HARD_SLOPES, HELD_TOOLS):
        run = Run(rig, slope, scale * RUN_V, tool)
        hard_a.append(decision_current_a(run, level))
        run.go(level, (SLOW_SETTLE_S if level < SLOW_BELOW_V else SETTLE_S) - 0.05)
        torques_nm.append(run.torque_nm)
    soft_a = decision_current_a(Run(rig, dividing_slope(level, scale), scale * RUN_V), level)
    return torques_nm, min(soft_a, min(hard_a) - DIVIDING_MARGIN_A)


def dividing_slope(level_v: float, scale: float) -> float:
    """Slope in N m/rad between the joints that settle on a level and those that are raised."""
    if level_v < SLOW_BELOW_V:
        return SLOW_DIVIDING_SLOPE
    once = ONCE_V[0] <= level_v / scale < ONCE_V[1]
    return ONCE_DIVIDING_SLOPE if once else DIVIDING_SLOPE


def choose_levels(torque: np.ndarray) -> np.ndarray:
    """Index (targets,) of the level for each torque from LEAST_HELD_NM on: the level whose largest
    error over all joints (levels, joints) is least, the neighbouring levels weighted by half.
    """
    targets = np.arange(LEAST_HELD_NM, LAST_NM + 1)
    wrong = np.abs(torque[None] - targets[:, None, None]).max(axis=2)
    wide = np.pad(wrong, ((0, 0), (1, 1)), mode="edge")
    return np.argmin(wrong + 0.5 * (wide[:, 2:] + wide[:, :-2]), axis=1)


def raised_joint(
    rig: Rig, scale: float, band: tuple[float, int, int, float], joint: tuple[float, Any]
) -> np.ndarray:
    """Points (n, 2) of torque in N m and current in A of a soft joint (slope, tool) on a raised
    level; band: the level, first and last torque, and the level before. At most about 400 points;
    none for a joint that gives fewer than 40.
    """
    level_v, first_nm, last_nm, before_v = band
    slope, tool = joint
    run = Run(rig, slope, scale * RUN_V, tool)
    if before_v > scale * RUN_V:
        run.go(before_v, MEASURE_S)
    run.go(level_v, RAISED_VALID_S if level_v < LEAD_ABOVE_V else LEAD_VALID_S)
    points = raised_points(run, level_v, first_nm, last_nm)
    if len(points) <= 40:
        return np.zeros((0, 2))
    return np.array(points)[:: max(len(points) // 200, 1)]


def stop_currents(joints: Sequence[np.ndarray], first_nm: int, last_nm: int) -> np.ndarray:
    """Current in A on a raised level at each torque first_nm..last_nm: a cubic through the points
    (n, 2) of all joints, each joint with the same weight.
    """
    points = [np.column_stack([p, np.full(len(p), len(p) ** -0.5)]) for p in joints if len(p)]
    t, current, weight = np.concatenate(points).T
    fit = np.polynomial.Polynomial.fit(t, current, 3, w=weight)
    early_a = EARLY_A if last_nm < LEAST_HELD_NM else 0.0
    return np.maximum.accumulate(fit(np.arange(first_nm, last_nm + 1))) + early_a


def raised_points(
    run: Run, level_v: float, first_nm: int, last_nm: int
) -> list[tuple[float, float]]:
    """Pairs (torque in N m, current in A), one for each control tick in which the torque lies
    between first_nm - 3 and last_nm + 4, at most until 9 s after the start from rest.
    """
    points = []
    while run.torque_nm < last_nm + 4 and run.tool.time_s < 9.0:
        run.level.tick(run.tool)
        if run.torque_nm > first_nm - 3:
            points.append((run.torque_nm, run.level.map_current_a(level_v)))
    return points


def tables(
    rig: Rig, scale: float, *, workers: int = 2, progress: Callable[[float], None] | None = None
) -> dict[str, np.ndarray]:
    """Columns level, settled, raised, stop (rows,), in V and A; NaN where a row has no level.
    scale: the tool's levels over those of the reference tool; progress: called with the share that
    is done.
    """
    levels = levels_of(scale)
    bands = [(rounded_level_v(scale * v), first, last) for v, first, last in RAISED_V]
    joints = list(itertools.product(SOFT_SLOPES, RAISED_TOOLS))
    steps = len(levels) + RAISED_COST * len(bands) * len(joints)
    done = 0.0

    def counted(found: Iterator[Any], step: float) -> list[Any]:
        nonlocal done
        kept = []
        for one in found:
            done += step
            kept.append(one)
            if progress:
                progress(done / steps)
        return kept

    with mapper(workers) as each:
        found = counted(each(partial(settled_torques_nm, rig, scale), levels), 1.0)
        torque, dividing = np.array([t for t, _ in found]), np.array([a for _, a in found])
        chosen = choose_levels(torque)
        low = np.full(LEAST_HELD_NM - FIRST_NM, np.nan)
        level, settled = (np.concatenate([low, v[chosen]]) for v in (levels, dividing))
        raised, stop = np.zeros(ROWS), np.zeros(ROWS)
        for level_v, first_nm, last_nm in bands:
            rows = slice(first_nm - FIRST_NM, last_nm + 1 - FIRST_NM)
            band = (level_v, first_nm, last_nm, np.nan_to_num(level[rows]).mean())
            points = counted(each(partial(raised_joint, rig, scale, band), joints), RAISED_COST)
            raised[rows] = level_v
            stop[rows] = stop_currents(points, first_nm, last_nm)
    return {"level": level, "settled": settled, "raised": raised, "stop": stop}


def levels_of(scale: float) -> np.ndarray:
    """The levels (n,) on which joints may settle; none where the number of hits changes."""
    levels = np.unique(rounded_level_v(scale * np.arange(LEAST_V, MOST_V, LEVEL_STEP_V)))
    changing = [any(low < v / scale < high for low, high in CHANGING_V) for v in levels]
    return levels[~np.array(changing) & (levels >= BASE_V)]


def rounded_level_v(level_v: np.ndarray | float) -> np.ndarray | float:
    """Levels in V rounded to the steps of the map, LEVEL_STEP_V."""
    return np.round(level_v / LEVEL_STEP_V) * LEVEL_STEP_V


@contextmanager
def mapper(workers: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """`map` in so many processes, in this one for 1."""
    if workers == 1:
        yield map
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield partial(pool.map, chunksize=2)
