"""Sets with one effect more, to first order: what a newcomer beside a fitted set promises."""

import heapq
from dataclasses import replace

import numpy as np

from vgroove.gap.fit import NARROW, Fit, Hypothesis
from vgroove.gap.hypotheses import BY_ID, Effect
from vgroove.gap.search_state import Search

PROPOSALS = 6


def extensions(search: Search, base: Fit, count: int = PROPOSALS) -> list[Fit]:
    """The best first-order fits of base plus a further effect, best first: own Jacobian columns for the newcomer, those of base for the
    rest. They are many: they keep no Jacobian."""
    fits = (first_order(search, base, h, rows) for h, rows in newcomers(search, base))
    return heapq.nsmallest(count, fits, key=search.score)


def newcomers(search: Search, base: Fit) -> list[tuple[Hypothesis, np.ndarray]]:
    """Each further effect's hypothesis beside base, and its residuals (1 + new, n) at its start and one step along each new number.

    Those of the last base asked for are kept: `where` asks again for what the search ended with.
    """
    if search.reach is None or search.reach[0] is not base:
        search.reach = base, differenced(search, base, trials_beside(search, base))
    return search.reach[1]


def trials_beside(search: Search, base: Fit) -> list[Hypothesis]:
    """Hypotheses of base plus each further effect, started from base and the newcomer's own starts."""
    return [h for effect in search.effects if effect.id not in base.ids for h in starts_beside(search, base, effect)]


def starts_beside(search: Search, base: Fit, effect: Effect, anew: bool = False) -> list[Hypothesis]:
    """Hypotheses of base plus an effect, started from base and the effect's own starts, anew wherever it ended alone; none twice."""
    count, trials = base.hypothesis.count, {}
    for h in search.engine.hypotheses([*(BY_ID[i] for i in base.ids), effect], anew=effect if anew else None):
        new = h.count - count
        if new >= 1 and same_coordinates(h, base, count):
            trial = replace(h, start=np.concatenate([base.x[:count], h.start[count:count + new], base.x[count:]]))
            trials.setdefault((trial.fixed, trial.start.tobytes()), trial)
    return list(trials.values())


def started_anew(search: Search, base: Fit) -> list[Fit]:
    """First-order fits of base plus each effect of many starts, from the best of them beside base: where it ended alone it may have done
    another effect's work."""
    found = []
    for effect in (e for e in search.effects if search.engine.is_known(e) and e.id not in base.ids):
        trials = differenced(search, base, starts_beside(search, base, effect, anew=True))
        found.append(min((first_order(search, base, h, rows) for h, rows in trials), key=search.score))
    return found


def differenced(search: Search, base: Fit, trials: list[Hypothesis]) -> list[tuple[Hypothesis, np.ndarray]]:
    """Each trial with its residuals (1 + new, n) at its start and one step along each of its new numbers."""
    count, jobs = base.hypothesis.count, []
    for h in trials:
        steps = np.diag([c.step_at(float(x)) for c, x in zip(h.coordinates, h.start, strict=True)])[count:h.count]
        jobs.append((h, np.vstack([h.start, h.start + steps])))
    if not jobs:
        return []
    rows, ends = search.engine.residuals(jobs), np.cumsum([len(points) for _, points in jobs])
    return list(zip(trials, np.split(rows, ends[:-1]), strict=True))


def same_coordinates(h: Hypothesis, base: Fit, count: int) -> bool:
    """True when an extension begins with its base's coordinates and form (a Coulomb newcomer changes what asymmetric_friction means)."""
    return h.coordinates[:count] == base.hypothesis.coordinates[:count] and set(base.hypothesis.fixed) <= set(h.fixed)


def columns_of(h: Hypothesis, rows: np.ndarray, count: int) -> np.ndarray:
    """Jacobian columns (n, new) of a newcomer after the first `count` numbers, from its residuals (1 + new, n)."""
    steps = np.array([c.step_at(float(x)) for c, x in zip(h.coordinates, h.start, strict=True)])[count:count + len(rows) - 1]
    columns = ((rows[1:] - rows[0]) / steps[:, None]).T
    # Next to no amplitude says nothing about periods: they stay as they start.
    columns[:, [c.name.endswith("periods_per_rev") for c in h.coordinates[count:count + len(steps)]]] = 0.0
    return columns


def first_order(search: Search, base: Fit, h: Hypothesis, rows: np.ndarray) -> Fit:
    """The extended fit as one Newton step from base predicts it."""
    engine, count = search.engine, base.hypothesis.count
    jacobian = np.hstack([base.jacobian[:, :count], columns_of(h, rows, count), base.jacobian[:, count:]])
    one = Fit(h, h.start.copy(), rows[0], jacobian, np.inf, max(base.delta, NARROW))
    step = engine.step(one, engine.train)
    one.held = one.residual + jacobian @ step
    for train, test in engine.problem.folds:
        if not np.array_equal(train, engine.train):
            one.held[test] = one.residual[test] + jacobian[test] @ engine.step(one, train)
    one.x, one.residual, one.jacobian = one.x + step, one.residual + jacobian @ step, jacobian[:0]
    return one
