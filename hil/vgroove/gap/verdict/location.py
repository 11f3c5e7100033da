"""Where the gap lies: Shapley shares of the subsystems, shares of the regimes, and what the
remaining residual follows.

A subsystem's flexible correction is the span of all its catalogue effects, linearised at the
selected model (speed, sign, current, angle, time, heat and duty all occur among their regressors);
a sensor's correction acts on its own channel only, because its effects do.
"""

from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np

from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.fit import KEY_BOUND, Fit, bounded_step
from vgroove.gap.selection.extension import extension_slopes
from vgroove.gap.selection.model_comparison import block_sums, draw_means, interval
from vgroove.gap.selection.search_state import LEVEL, LIKELY, WORTH, Search
from vgroove.gap.verdict import correlates

OWN = {"current_a": "current", "supply_v": "bus voltage"}  # a channel's noise would explain itself
RIDGE = 1e-6
LEFT = 0.15  # of the noise power: a smaller remainder is none


@dataclass(frozen=True)
class Bundle:
    """Linear model: residual = target + columns @ step. owner names the subsystem of each column,
    '' a tolerated key; keys keep their prior (curvature) around the rig's value, from which the
    selected fit stands at offset, and their bounds.
    """

    target: np.ndarray
    columns: np.ndarray
    owner: np.ndarray
    prior: np.ndarray
    offset: np.ndarray
    bound: np.ndarray


def bundle(search: Search, best: Fit) -> Bundle:
    """All subsystems' columns at the selected model; the target is the residual with every selected
    effect taken out again.
    """
    count = best.hypothesis.count
    columns, owner = (
        [best.jacobian],
        [coordinate_owner(c.name) if not c.prior else "" for c in best.hypothesis.coordinates],
    )
    for h, slopes in extension_slopes(search, best):
        columns.append(slopes)
        owner += [BY_ID[h.ids[-1]].subsystem] * slopes.shape[1]
    target = best.residual - best.jacobian[:, :count] @ best.x[:count]
    stacked = np.hstack(columns)
    norm = np.sqrt((stacked**2).mean(axis=0))
    place, keys = np.zeros(stacked.shape[1]), np.array([name == "" for name in owner])
    place[: len(best.x)] = best.x * best.hypothesis.prior
    use = norm > 0
    bound = np.where(keys, KEY_BOUND * norm, np.inf)
    return Bundle(
        target,
        stacked[:, use] / norm[use],
        np.array(owner, dtype=object)[use],
        keys[use] / norm[use] ** 2,
        (place * norm)[use],
        bound[use],
    )


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


def value(
    search: Search,
    parts: Bundle,
    sums: list[tuple[np.ndarray, np.ndarray]],
    members: frozenset[str],
) -> np.ndarray:
    """Clipped squared residuals (n,) with the members' corrections (and the keys) fitted; rows are
    held out.
    """
    use = np.flatnonzero(np.isin(parts.owner, [*members, ""]))
    out = parts.target.copy()
    if use.size:
        low, high = (-parts.bound - parts.offset)[use], (parts.bound - parts.offset)[use]
        for (normal, gradient), (_, test) in zip(sums, search.engine.problem.folds, strict=True):
            rows = np.flatnonzero(test)
            out[rows] += parts.columns[np.ix_(rows, use)] @ bounded_step(
                normal[np.ix_(use, use)], gradient[use], low, high
            )
    return np.minimum(np.abs(out), search.clip) ** 2


def significant(search: Search, leaner: np.ndarray, fuller: np.ndarray) -> bool:
    """True when the fuller correction's gain (from squared residuals) is significant and matters."""
    gain = block_sums(search.blocks, leaner) - block_sums(search.blocks, fuller)
    low = float(np.quantile(draw_means(search.blocks, gain), 1.0 - LEVEL))
    return low > 0.0 and gain.sum() / search.blocks.total > 2.0 * WORTH * search.level()


def active_subsystems(
    search: Search, parts: Bundle, sums: list[tuple[np.ndarray, np.ndarray]], best: Fit
) -> list[str]:
    """Subsystems with a residual of their own: those of the selected effects, and any whose
    correction still gains beside them.
    """
    chosen = list(dict.fromkeys(BY_ID[i].subsystem for i in best.ids))
    pool = sorted(set(parts.owner) - {"", *chosen})
    while pool and len(chosen) < 6:
        base = value(search, parts, sums, frozenset(chosen))
        gains = {s: value(search, parts, sums, frozenset([*chosen, s])) for s in pool}
        top = min(pool, key=lambda s: (float(gains[s][search.blocks.tested].sum()), s))
        if not significant(search, base, gains[top]):
            break
        chosen.append(top)
        pool.remove(top)
    return chosen


def shapley_shares(search: Search, best: Fit, floor: float) -> dict[str, float]:
    """Shapley shares of the squared gap beyond retuning; they add to one with 'unexplained'."""
    parts = bundle(search, best)
    sums = normals(search, parts)
    chosen = active_subsystems(search, parts, sums, best)
    worth = {
        frozenset(s): -float(
            block_sums(search.blocks, value(search, parts, sums, frozenset(s))).sum()
        )
        / search.blocks.total
        for k in range(len(chosen) + 1)
        for s in combinations(chosen, k)
    }
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
    tested = search.blocks.tested
    sums = {
        name: max(0.0, float(square[tested & (regime == i)].sum())) for i, name in enumerate(names)
    }
    total = sum(sums.values())
    if total <= 0.0:
        return []
    return [
        {"regime": n, "share": s / total}
        for n, s in sorted(sums.items(), key=lambda item: -item[1])
        if s > 0.005 * total
    ]


@dataclass(frozen=True)
class Structure:
    """What is left: is it more than noise, what it follows in which signal, how much of the squared
    gap that takes away; then what a smooth correction over it would gain of what is left above the
    noise, its points, and what it looks like.
    """

    significant: bool
    best_correlate: str | None
    gain: float
    signal: str | None
    could_gain: float = 0.0
    correction: tuple[tuple[float, float], ...] = ()
    looks_like: str | None = None


def remaining(
    search: Search,
    best: Fit,
    drivers: dict[str, np.ndarray],
    signal: np.ndarray,
    names: list[str],
    floor: float,
) -> Structure:
    """What the held-out residual of each signal follows, cross-validated over alternating blocks."""
    residual = np.clip(best.held, -search.clip, search.clip)
    known = [
        as_driver(name, value)
        for name, value in sorted(drivers.items())
        if name != "unwound motor angle"
    ]
    top = strongest(search, residual, known, signal, names)
    found = top is not None and significant(search, residual**2, top.left**2)
    if not (found or stands_above(search, best, floor**2 * search.level())):
        return Structure(False, None, top.gain if top else 0.0, None)
    lines = spectral(search, residual, drivers, signal, names)
    line = strongest(search, residual, lines, signal, names)
    if (
        line is not None
        and (not found or line.gain > top.gain)
        and significant(search, residual**2, line.left**2)
    ):
        top, found = line, True
    if not found:
        return Structure(True, None, top.gain if top else 0.0, None)
    rows = search.blocks.tested & (signal == top.signal) & np.isfinite(top.driver.value)
    driver = correlates.Driver(top.driver.name, top.driver.value[rows], top.driver.period)
    x, y = correlates.smooth_curve(residual[rows], driver)
    gain = correlates.gained(residual[rows], driver, search.blocks.cluster[rows]) * float(
        (residual[rows] ** 2).sum()
    )
    above = max((search.score(best) - floor**2) * search.blocks.total, 1e-9)
    return Structure(
        True,
        top.driver.name,
        top.gain,
        names[top.signal],
        float(np.clip(gain / above, 0.0, 1.0)),
        tuple((float(a), float(b)) for a, b in correlates.thinned(x, y, 1.0)),
        correlates.looks(x, y, driver),
    )


def stands_above(search: Search, best: Fit, noise: float) -> bool:
    """Whether what a fit leaves is more than the noise power, and not in a block or two only: that
    is an event of the run, no gap.
    """
    above = search.sums(best) - noise * search.blocks.rows
    return (
        search.score(best) > (1.0 + LEFT) * noise
        and interval(search.blocks, above, LIKELY)[0] > WORTH * noise
    )


def as_driver(name: str, value: np.ndarray) -> correlates.Driver:
    """A driver of the log; angles come round."""
    return correlates.Driver(name, value, correlates.TURN if name.endswith("angle") else 0.0)


@dataclass(frozen=True)
class Strongest:
    """A driver with the signal that follows it, the gain of squared residual over all rows, and the
    residual that is left (n,).
    """

    driver: correlates.Driver
    signal: int
    gain: float
    left: np.ndarray


def strongest(
    search: Search,
    residual: np.ndarray,
    drivers: list[correlates.Driver],
    signal: np.ndarray,
    names: list[str],
) -> Strongest | None:
    """The driver and the signal whose bins take most away; None where nothing gains."""
    top: Strongest | None = None
    for driver in drivers:
        for s in (s for s in range(len(names)) if OWN.get(names[s]) != driver.name):
            rows = search.blocks.tested & (signal == s) & np.isfinite(driver.value)
            corrected = residual.copy()
            corrected[rows] -= correlates.predicted(
                residual[rows], driver.value[rows], search.blocks.cluster[rows]
            )
            gain = float((residual[rows] ** 2 - corrected[rows] ** 2).sum()) / search.blocks.total
            if gain > (top.gain if top else 0.0):
                top = Strongest(driver, s, gain, corrected)
    return top


def spectral(
    search: Search,
    residual: np.ndarray,
    drivers: dict[str, np.ndarray],
    signal: np.ndarray,
    names: list[str],
) -> list[correlates.Driver]:
    """Lines of the residual's spectra over time and over the motor's angle, of every signal, as
    drivers.
    """
    rows_of, out = search.rows, []
    angle = drivers.get("unwound motor angle")
    for s in range(len(names)):
        rows = search.blocks.tested & (signal == s) & (residual != 0.0)
        if angle is not None:
            rows &= np.isfinite(angle)
        if rows.sum() < 200:
            continue
        ratio = getattr(getattr(search.engine.problem, "rig", None), "gearbox", {"ratio": 1.0})[
            "ratio"
        ]
        found = correlates.lines(
            residual[rows],
            rows_of.time_s[rows],
            angle[rows] if angle is not None else None,
            ratio,
            rows_of.log[rows],
        )
        for one in found:
            whole = np.full(len(residual), np.nan)
            whole[rows] = one.value
            out.append(correlates.Driver(one.name, whole, one.period))
    return out


def by_correlate(
    search: Search,
    drivers: dict[str, np.ndarray],
    signal: np.ndarray,
    names: list[str],
    floor: float,
) -> list[dict[str, object]]:
    """What the gap that retuning leaves follows: share of its square above the noise per driver and
    signal, largest first.
    """
    residual = np.clip(search.retuned.held, -search.clip, search.clip)
    known = [
        as_driver(name, value)
        for name, value in sorted(drivers.items())
        if name != "unwound motor angle"
    ]
    return correlates.shares(residual, known, signal, names, OWN, search.blocks, floor)
