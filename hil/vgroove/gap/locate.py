"""Where the gap lies: Shapley shares of the subsystems, shares of the regimes, and what the remaining residual follows.

A subsystem's flexible correction is the span of all its catalogue effects, linearised at the selected model (speed, sign, current, angle,
time, heat and duty all occur among their regressors); a sensor's correction acts on its own channel only, because its effects do.
"""

from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np

from vgroove.gap.evidence import block_sums, draw_means
from vgroove.gap.fit import KEY_BOUND, Fit, bounded_step
from vgroove.gap.hypotheses import BY_ID
from vgroove.gap.search import LEVEL, WORTH, Search, extensions

BINS = 12
OWN = {"current_a": "current", "supply_v": "bus voltage"}  # a channel's noise would explain itself
RIDGE = 1e-6


@dataclass(frozen=True)
class Bundle:
    """Linear model: residual = target + columns @ step. owner names the subsystem of each column, '' a tolerated key; keys keep their prior
    (curvature) around the rig's value, from which the selected fit stands at offset, and their bounds."""

    target: np.ndarray
    columns: np.ndarray
    owner: np.ndarray
    prior: np.ndarray
    offset: np.ndarray
    bound: np.ndarray


def bundle(search: Search, best: Fit) -> Bundle:
    """All subsystems' columns at the selected model; the target is the residual with every selected effect taken out again."""
    count = best.hypothesis.count
    columns, owner = [best.jacobian], [coordinate_owner(c.name) if not c.prior else "" for c in best.hypothesis.coordinates]
    for one in extensions(search, best):
        new = one.hypothesis.count - count
        columns.append(one.jacobian[:, count:count + new])
        owner += [BY_ID[one.ids[-1]].subsystem] * new
    target = best.residual - best.jacobian[:, :count] @ best.x[:count]
    stacked = np.hstack(columns)
    norm = np.sqrt((stacked**2).mean(axis=0))
    place, keys = np.zeros(stacked.shape[1]), np.array([name == "" for name in owner])
    place[:len(best.x)] = best.x * best.hypothesis.prior
    use = norm > 0
    bound = np.where(keys, KEY_BOUND * norm, np.inf)
    return Bundle(target, stacked[:, use] / norm[use], np.array(owner, dtype=object)[use], keys[use] / norm[use] ** 2, (place * norm)[use],
                  bound[use])


def coordinate_owner(name: str) -> str:
    """Subsystem of the effect that a flat parameter name belongs to."""
    return BY_ID[name.split(".")[1]].subsystem


def normals(search: Search, parts: Bundle) -> list[tuple[np.ndarray, np.ndarray]]:
    """Normal matrix and gradient over the training rows of each fold, all columns."""
    weight = np.minimum(1.0, search.clip / np.maximum(np.abs(parts.target), 1e-9))
    out = []
    for train, _ in search.engine.problem.folds:
        rows = parts.columns * (weight * train)[:, None]
        normal = rows.T @ parts.columns
        normal[np.diag_indices_from(normal)] += RIDGE * np.diag(normal) + 1e-9 + parts.prior
        out.append((normal, rows.T @ parts.target + parts.prior * parts.offset))
    return out


def value(search: Search, parts: Bundle, sums: list[tuple[np.ndarray, np.ndarray]], members: frozenset[str]) -> np.ndarray:
    """Clipped squared residuals (n,) with the members' corrections (and the keys) fitted; judged rows are held out."""
    use = np.flatnonzero(np.isin(parts.owner, [*members, ""]))
    out = parts.target.copy()
    if use.size:
        low, high = (-parts.bound - parts.offset)[use], (parts.bound - parts.offset)[use]
        for (normal, gradient), (_, test) in zip(sums, search.engine.problem.folds, strict=True):
            rows = np.flatnonzero(test)
            out[rows] += parts.columns[np.ix_(rows, use)] @ bounded_step(normal[np.ix_(use, use)], gradient[use], low, high)
    return np.minimum(np.abs(out), search.clip) ** 2


def significant(search: Search, leaner: np.ndarray, fuller: np.ndarray) -> bool:
    """True when the fuller correction's gain (from squared residuals) is significant and matters."""
    gain = block_sums(search.blocks, leaner) - block_sums(search.blocks, fuller)
    low = float(np.quantile(draw_means(search.blocks, gain), 1.0 - LEVEL))
    return low > 0.0 and gain.sum() / search.blocks.total > 2.0 * WORTH * search.level()


def active_subsystems(search: Search, parts: Bundle, sums: list[tuple[np.ndarray, np.ndarray]], best: Fit) -> list[str]:
    """Subsystems with a residual of their own: those of the selected effects, and any whose correction still gains beside them."""
    chosen = list(dict.fromkeys(BY_ID[i].subsystem for i in best.ids))
    pool = sorted(set(parts.owner) - {"", *chosen})
    while pool and len(chosen) < 6:
        base = value(search, parts, sums, frozenset(chosen))
        gains = {s: value(search, parts, sums, frozenset([*chosen, s])) for s in pool}
        top = min(pool, key=lambda s: (float(gains[s][search.blocks.judged].sum()), s))
        if not significant(search, base, gains[top]):
            break
        chosen.append(top)
        pool.remove(top)
    return chosen


def shares(search: Search, best: Fit, floor: float) -> dict[str, float]:
    """Shapley shares of the squared gap beyond retuning; they add to one with 'unexplained'."""
    parts = bundle(search, best)
    sums = normals(search, parts)
    chosen = active_subsystems(search, parts, sums, best)
    worth = {frozenset(s): -float(block_sums(search.blocks, value(search, parts, sums, frozenset(s))).sum()) / search.blocks.total
             for k in range(len(chosen) + 1) for s in combinations(chosen, k)}
    total = max(-worth[frozenset()] - floor**2, 1e-12)
    raw = {s: max(0.0, shapley(chosen, worth, s) / total) for s in chosen}
    explained = sum(raw.values())
    raw = {s: v / max(1.0, explained) for s, v in raw.items()}
    everything = {s: 0.0 for s in sorted(set(parts.owner) - {""})}
    return {**everything, **raw, "unexplained": max(0.0, 1.0 - sum(raw.values()))}


def shapley(players: list[str], worth: dict[frozenset[str], float], player: str) -> float:
    """Mean marginal contribution of a player over all orders."""
    others, n, total = [p for p in players if p != player], len(players), 0.0
    for k in range(len(others) + 1):
        weight = factorial(k) * factorial(n - k - 1) / factorial(n)
        for group in combinations(others, k):
            total += weight * (worth[frozenset([*group, player])] - worth[frozenset(group)])
    return total


def by_regime(search: Search, regime: np.ndarray, names: list[str]) -> list[dict[str, object]]:
    """Share of the squared gap above the noise of each regime, largest first."""
    square = np.minimum(np.abs(search.nominal.held), search.clip) ** 2 - 1.0
    judged = search.blocks.judged
    sums = {name: max(0.0, float(square[judged & (regime == i)].sum())) for i, name in enumerate(names)}
    total = sum(sums.values())
    if total <= 0.0:
        return []
    return [{"regime": n, "share": s / total} for n, s in sorted(sums.items(), key=lambda item: -item[1]) if s > 0.005 * total]


@dataclass(frozen=True)
class Structure:
    """What is left: is it more than noise, what it follows, and how much of the squared gap that correlate takes away."""

    significant: bool
    best_correlate: str | None
    gain: float
    signal: str | None
    shape: list[tuple[float, float]]


def remaining(search: Search, best: Fit, drivers: dict[str, np.ndarray], signal: np.ndarray, names: list[str], floor: float) -> Structure:
    """Regress the held-out residual of each signal on bins of each driver, cross-validated over alternating blocks."""
    residual = np.clip(best.held, -search.clip, search.clip)
    top: tuple[float, str | None, int, np.ndarray] = (0.0, None, -1, residual)
    for name, driver in sorted(drivers.items()):
        for s in (s for s in range(len(names)) if OWN.get(names[s]) != name):
            rows = search.blocks.judged & (signal == s) & np.isfinite(driver)
            corrected = residual.copy()
            corrected[rows] -= predicted(residual[rows], driver[rows], search.blocks.cluster[rows])
            gain = float((residual[rows] ** 2 - corrected[rows] ** 2).sum()) / search.blocks.total
            if gain > top[0]:
                top = (gain, name, s, corrected)
    found = top[1] is not None and significant(search, residual**2, top[3] ** 2)
    excess = search.score(best) / (floor**2 * search.level()) - 1.0
    shape = profile(residual, drivers[top[1]], signal == top[2], search.blocks.judged) if found and top[1] else []
    return Structure(bool(found or excess > 0.15), top[1] if found else None, top[0], names[top[2]] if found else None, shape)


def edges_of(driver: np.ndarray) -> np.ndarray:
    """Inner bin edges at quantiles of the driver (few values: between them)."""
    levels = np.unique(driver)
    if len(levels) <= BINS:
        return (levels[1:] + levels[:-1]) / 2.0
    return np.unique(np.quantile(driver, np.linspace(0.0, 1.0, BINS + 1)[1:-1]))


def predicted(residual: np.ndarray, driver: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Bin means of the other half of the blocks (even blocks predict odd ones and the other way round)."""
    if len(driver) < 4 * BINS:
        return np.zeros_like(residual)
    bins = np.searchsorted(edges_of(driver), driver)
    out = np.zeros_like(residual)
    for parity in (0, 1):
        there, here = cluster % 2 == parity, cluster % 2 != parity
        count = np.bincount(bins[there], minlength=BINS + 1)
        mean = np.bincount(bins[there], weights=residual[there], minlength=BINS + 1) / (count + 3.0)
        out[here] = mean[bins[here]]
    return out


def profile(residual: np.ndarray, driver: np.ndarray, mine: np.ndarray, judged: np.ndarray) -> list[tuple[float, float]]:
    """Mean residual over bins of its best correlate: (driver, residual in sigma)."""
    rows = mine & judged & np.isfinite(driver)
    bins = np.searchsorted(edges_of(driver[rows]), driver[rows])
    return [(float(driver[rows][bins == b].mean()), float(residual[rows][bins == b].mean())) for b in np.unique(bins)]
