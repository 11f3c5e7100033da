"""Locates the gap: Shapley shares (L. S. Shapley, A value for n-person games, 1953) of the
subsystems in the squared gap that retuning leaves, and the shares of the regimes of motion.

A subsystem's flexible correction is the span of all its catalogue effects, linearised at the
selected model; among their regressors are speed, its sign, current, angle, time, heat and duty. The
correction of a sensor acts on its own channel alone, because its effects do. The value of a
coalition of subsystems is the squared gap that their corrections close together, held out.
"""

from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np

from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.engine import MAX_RESIDUAL
from vgroove.gap.fitting.hypothesis import MAX_NUISANCE_SIGMAS, Fit
from vgroove.gap.fitting.steps import bounded_step
from vgroove.gap.selection.extension import added_effects
from vgroove.gap.selection.model_comparison import block_sums, bootstrap_means, clipped_squares
from vgroove.gap.selection.search_state import COMPARISON, Search
from vgroove.gap.verdict.schema import RegimeShare

NUISANCE = ""  # owner of a nuisance parameter's column
UNEXPLAINED = "unexplained"


@dataclass(frozen=True)
class LocationLimits:
    """Thresholds of the location; chosen on the tuning half of the blind set
    (docs/gap_bench.md).
    """

    ridge: float = 1e-6  # relative ridge of the normal matrices: columns may be collinear
    absolute_ridge: float = 1e-9  # of columns scaled to RMS 1, for those that are zero in a fold
    max_subsystems: int = 6  # in the Shapley sum: 2^n coalitions are fitted
    min_gain: float = 2.0 * COMPARISON.min_gain  # squared gap, in noise powers, of a correction
    min_regime_share: float = 0.005  # of the squared gap: smaller regimes are not listed


LOCATION = LocationLimits()


@dataclass(frozen=True)
class LinearModel:
    """Linearised residuals: target (n,) + columns (n, m) @ step.

    owner (m,): subsystem of each column, NUISANCE for a nuisance parameter. Of a nuisance
    parameter, prior (m,) is the curvature of its prior around the rig's value, offset (m,) the
    distance of the selected fit from the rig's value, and bound (m,) the largest such distance.
    Columns are scaled to RMS 1.
    """

    target: np.ndarray
    columns: np.ndarray
    owner: np.ndarray
    prior: np.ndarray
    offset: np.ndarray
    bound: np.ndarray


NormalEquations = list[tuple[np.ndarray, np.ndarray]]


def linear_model(search: Search, best: Fit) -> LinearModel:
    """All subsystems' columns at the selected model; the target is the residual of the model
    without the selected effects.
    """
    columns, owner = (
        [best.jacobian],
        [subsystem_of(c.name) if not c.prior else NUISANCE for c in best.hypothesis.coordinates],
    )
    for added in added_effects(search, best):
        columns.append(added.columns)
        owner += [BY_ID[added.hypothesis.ids[-1]].subsystem] * added.columns.shape[1]
    stacked = np.hstack(columns)
    norm = np.sqrt((stacked**2).mean(axis=0))
    offset, keys = np.zeros(stacked.shape[1]), np.array([name == NUISANCE for name in owner])
    offset[: len(best.x)] = best.x * best.hypothesis.prior
    use = norm > 0
    bound = np.where(keys, MAX_NUISANCE_SIGMAS * norm, np.inf)
    return LinearModel(
        residual_without_effects(search, best),
        stacked[:, use] / norm[use],
        np.array(owner, dtype=object)[use],
        keys[use] / norm[use] ** 2,
        (offset * norm)[use],
        bound[use],
    )


def residual_without_effects(search: Search, best: Fit) -> np.ndarray:
    """Residuals (n,) of a fit's model with its effects off and its nuisance parameters as fitted.
    A number that is no size (a period, a speed, a limit) makes their first order far too large.
    """
    if not best.ids:
        return best.residual
    engine, problem = search.engine, search.problem
    theta = best.theta(problem.theta0)
    numbers = best.hypothesis.coordinates[: best.hypothesis.count]
    columns = [column for c in numbers for column in c.columns]
    columns += [column for column, _ in best.hypothesis.fixed]
    theta[columns] = problem.theta0[columns]
    (row,) = engine.weighted(problem.residuals(theta[None, :], engine.angles))
    return np.clip(row, -MAX_RESIDUAL, MAX_RESIDUAL)


def subsystem_of(name: str) -> str:
    """Subsystem of the effect that a flat parameter name belongs to."""
    return BY_ID[name.split(".")[1]].subsystem


def normal_equations(search: Search, model: LinearModel) -> NormalEquations:
    """Normal matrix (m, m) and gradient (m,) over the training rows of each fold, with Huber
    weights at the clip of the search.
    """
    weight = np.minimum(1.0, COMPARISON.clip_sigma / np.maximum(np.abs(model.target), 1e-9))
    found = []
    for train, _ in search.problem.folds:
        rows = model.columns * (weight * train)[:, None]
        normal = rows.T @ model.columns
        diagonal = np.diag_indices_from(normal)
        normal[diagonal] += LOCATION.ridge * np.diag(normal) + LOCATION.absolute_ridge + model.prior
        found.append((normal, rows.T @ model.target + model.prior * model.offset))
    return found


def corrected_squares(
    search: Search, model: LinearModel, sums: NormalEquations, members: frozenset[str]
) -> np.ndarray:
    """Clipped squared held-out residuals (n,) with the corrections of the members (and the nuisance
    parameters) fitted on the other folds.
    """
    use = np.flatnonzero(np.isin(model.owner, [*members, NUISANCE]))
    out = model.target.copy()
    if use.size:
        low, high = (-model.bound - model.offset)[use], (model.bound - model.offset)[use]
        for (normal, gradient), (_, test) in zip(sums, search.problem.folds, strict=True):
            rows = np.flatnonzero(test)
            out[rows] += model.columns[np.ix_(rows, use)] @ bounded_step(
                normal[np.ix_(use, use)], gradient[use], low, high
            )
    return clipped_squares(out, COMPARISON.clip_sigma)


def is_significant_gain(search: Search, leaner: np.ndarray, fuller: np.ndarray) -> bool:
    """Whether the gain of a correction, from squared residuals (n,) without and with it, is
    significant and exceeds LOCATION.min_gain.
    """
    gain = block_sums(search.blocks, leaner) - block_sums(search.blocks, fuller)
    samples = bootstrap_means(search.blocks, gain)
    low = float(np.quantile(samples, 1.0 - COMPARISON.significance))
    least = LOCATION.min_gain
    return bool(low > 0.0 and gain.sum() / search.blocks.total > least)


def active_subsystems(
    search: Search, model: LinearModel, sums: NormalEquations, best: Fit
) -> list[str]:
    """Subsystems of the selected effects, and any other whose correction gains significantly beside
    them, in order of gain.
    """
    chosen = list(dict.fromkeys(BY_ID[i].subsystem for i in best.ids))
    pool = sorted(set(model.owner) - {NUISANCE, *chosen})
    while pool and len(chosen) < LOCATION.max_subsystems:
        base = corrected_squares(search, model, sums, frozenset(chosen))
        squares = {s: corrected_squares(search, model, sums, frozenset([*chosen, s])) for s in pool}
        top = min(pool, key=lambda s: (float(squares[s][search.blocks.tested].sum()), s))
        if not is_significant_gain(search, base, squares[top]):
            break
        chosen.append(top)
        pool.remove(top)
    return chosen


def shapley_shares(search: Search, best: Fit) -> dict[str, float]:
    """Shapley share of each subsystem in the squared gap that retuning leaves; with 'unexplained'
    they add to one.
    """
    model = linear_model(search, best)
    sums = normal_equations(search, model)
    chosen = active_subsystems(search, model, sums, best)
    coalitions = (frozenset(s) for k in range(len(chosen) + 1) for s in combinations(chosen, k))
    values = {
        s: -float(block_sums(search.blocks, corrected_squares(search, model, sums, s)).sum())
        / search.blocks.total
        for s in coalitions
    }
    total = max(-values[frozenset()] - search.floor_power, 1e-12)
    raw = {s: max(0.0, shapley(chosen, values, s) / total) for s in chosen}
    explained = sum(raw.values())
    raw = {s: v / max(1.0, explained) for s, v in raw.items()}
    everything = {s: 0.0 for s in sorted(set(model.owner) - {NUISANCE})}
    return {**everything, **raw, UNEXPLAINED: max(0.0, 1.0 - sum(raw.values()))}


def shapley(players: list[str], values: dict[frozenset[str], float], player: str) -> float:
    """Shapley value: mean marginal contribution of a player over all orders of the players."""
    others, n, total = [p for p in players if p != player], len(players), 0.0
    for k in range(len(others) + 1):
        weight = factorial(k) * factorial(n - k - 1) / factorial(n)
        for group in combinations(others, k):
            total += weight * (values[frozenset([*group, player])] - values[frozenset(group)])
    return total


def largest_share(shares: dict[str, float]) -> str | None:
    """The subsystem of the largest share; None where none has one."""
    known = {k: v for k, v in shares.items() if k != UNEXPLAINED}
    return max(known, key=lambda k: (known[k], k)) if any(known.values()) else None


def regime_shares(search: Search) -> list[RegimeShare]:
    """Share of each regime in the nominal model's squared gap above the noise, largest first."""
    residual, tested = search.nominal.out_of_fold, search.blocks.tested
    # that of the sensors in units of noise and discrepancy; a bound that is kept has none
    noise = search.engine.discrepancy**-2.0 * ~search.problem.censored
    square = clipped_squares(residual, COMPARISON.clip_sigma) - noise
    powers = search.problem.power_by_regime(residual, np.where(tested, square, 0.0))
    sums = {name: max(0.0, power) for name, power in powers.items()}
    total = sum(sums.values())
    if total <= 0.0:
        return []
    return [
        RegimeShare(n, s / total)
        for n, s in sorted(sums.items(), key=lambda item: -item[1])
        if s > LOCATION.min_regime_share * total
    ]
