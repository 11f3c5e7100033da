"""Finds the set of effects that predicts held-out rows best: singles, then forward steps and exchanges, then backward elimination.

A further effect must be worth it twice: its held-out gain is significant under the block bootstrap, and it is large enough to matter.
"""

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vgroove.gap import phases
from vgroove.gap.evidence import SHORTEST_S, Blocks, block_sums, correlation_time, draw_means, interval, least_loss, make_blocks, squared
from vgroove.gap.fit import NARROW, Engine, Fit, Hypothesis, portions
from vgroove.gap.hypotheses import BY_ID, FRICTION_LAWS, RARE, SPECIAL_CASES, Effect, contains
from vgroove.gap.problem import Problem

CLIP = 10.0
LARGEST_SET = 4
WORTH = 0.05
VISIBLE = 0.1
WORTH_SHARE = 0.01
WORTH_FORM = 0.03
NEAR_NOISE = 2.0  # a set that leaves less has found what is there; real machines stay above
FORM_SHARE = 0.05  # of the squared gap that effects close: a form off by a quarter of its size leaves (1 / 4)^2
SHAPE_SHARE = 0.3 / 0.7  # by the contract an effect of another form closes at least 0.7
UNSURE_SHARE = 0.1  # of what the others close, that a member which goes by several names must gain
LEVEL = 0.99
LIKELY = 0.8  # interval whose lower end must still be worth it: the gain is not one lucky block's
PROPOSALS = 6
CONVERGED = 12  # rounds in which single effects end; most need four
SCREEN_ABOVE, SCREENED = 6, 3  # starts of one effect beyond which they are screened, and how many are fitted then
AMPLITUDES, PHASES = (3.0, 8.0), 8  # of a periodic effect, in its size, that are screened
STARTS = 32  # that are fitted at once, with their Jacobians in memory
MANY_STARTS = 4  # of more starts than this two are taken on
LARGE = 1.1  # squared gap after retuning, in noise, below which no start of a resonance, a play or a large ripple is looked for
WITHIN_REACH = 1.5  # of the best squared gap: single effects beyond keep their first-order predictions
FIRM, FIRMER = 100.0, 1.2  # squared sigmas that offsets at stops must gain an effect which follows the angle; times the gain without
EXCHANGES = 3
FLOORED = ("effects.transport_delay.delay_s",)


@dataclass(frozen=True)
class Rows:
    """Where each residual comes from: log, time, signal (n,), whether it counts only when not 0, and how often the model restarts."""

    log: np.ndarray
    time_s: np.ndarray
    signal: np.ndarray
    conditional: np.ndarray
    restart_s: float


@dataclass
class Search:
    """State of the search; fits holds the best converged fit of each set that was tried."""

    engine: Engine
    effects: list[Effect]
    rows: Rows
    blocks: Blocks
    nominal: Fit
    retuned: Fit
    seed: int = 0
    clip: float = CLIP
    without: frozenset[str] = frozenset()
    fits: dict[tuple[str, ...], Fit] = field(default_factory=dict)
    leaned: Fit | None = None
    reach: dict[int, tuple[Fit, list[tuple[Hypothesis, np.ndarray]]]] = field(default_factory=dict)
    tell: Callable[[str], None] = lambda _: None

    def sums(self, one: Fit) -> np.ndarray:
        """Clipped squared held-out residuals per bootstrap block (blocks,)."""
        return block_sums(self.blocks, squared(one, self.clip))

    def score(self, one: Fit) -> float:
        """Squared held-out gap."""
        return float(self.sums(one).sum()) / self.blocks.total

    def tied(self, one: Fit, best: Fit) -> bool:
        """The contract's rule: the 95 % interval of the difference contains 0. What tells two models apart may happen in few blocks, which
        a draw of blocks may miss: far beyond the noise there, and large enough to matter, it tells them apart as well."""
        if interval(self.blocks, self.sums(one) - self.sums(best))[0] > 0.0:
            return False
        worse, better = (np.clip(f.held, -self.clip, self.clip) for f in (one, best))
        return least_loss(self.blocks, worse, better) <= self.least_gain(best)

    def better(self, fuller: Fit, leaner: Fit, worth: float = WORTH) -> bool:
        """True when the fuller set is significantly better and by an amount that matters."""
        worth = self.least_gain(leaner, worth)
        if self.score(leaner) - self.score(fuller) <= worth:
            return False
        apart = self.sums(leaner) - self.sums(fuller)
        return interval(self.blocks, apart, LEVEL)[0] > 0.0 and interval(self.blocks, apart, LIKELY)[0] > worth

    def least_gain(self, leaner: Fit, worth: float = WORTH) -> float:
        """Squared gap that a fuller set must take away from a leaner one."""
        return worth * self.level() + WORTH_SHARE * max(0.0, self.score(leaner) - self.level())

    def visible(self, one: Fit) -> bool:
        """The contract's least gap: below VISIBLE of the noise it is no gap, and what takes it away is no effect that could be named."""
        noise, left = np.sqrt(self.level()), np.sqrt(self.score(one))
        return bool(np.sqrt(self.score(self.retuned)) - min(noise, left) >= VISIBLE * noise)

    def level(self) -> float:
        """Squared gap that is taken as noise: 1, or what the best fit leaves where no fit comes near 1."""
        return (self.clip / CLIP) ** 2

    def add(self, hypotheses: Sequence[Hypothesis], iterations: int = 6) -> list[Fit]:
        """Fit, settle what comes near the best, and keep the best of each set."""
        fits = self.engine.fit(hypotheses, iterations)
        if fits:
            near = WITHIN_REACH * min(self.score(f) for f in fits)
            self.engine.settle([f for f in fits if self.score(f) <= near])
        for one in fits:
            known = self.fits.get(key(one.ids))
            if known is None or one.cost < known.cost:
                self.fits[key(one.ids)] = one
        return [self.fits[k] for k in dict.fromkeys(key(h.ids) for h in hypotheses)]

    def ranked(self, size: int) -> list[Fit]:
        """Fits of sets of one size, best first; equal scores in catalogue order."""
        mine = (f for k, f in self.fits.items() if len(k) == size and plausible(f))
        return sorted(mine, key=lambda f: (round(self.score(f), 9), f.ids))


def plausible(one: Fit) -> bool:
    """False when a number that must not be zero (a delay beyond the logger's convention) is pressed against its lower bound."""
    pressed = (c.low > 0.0 and x < 1.02 * c.low for c, x in zip(one.hypothesis.coordinates, one.x, strict=True) if c.name in FLOORED)
    return not any(pressed)


def key(ids: Sequence[str]) -> tuple[str, ...]:
    """Order-free name of a set."""
    return tuple(sorted(ids))


def begin(engine: Engine, effects: list[Effect], rows: Rows, seed: int, tell: Callable[[str], None]) -> Search:
    """Nominal and retuned fits, bootstrap blocks."""
    tell("nominal and retuned model")
    empty = Hypothesis((), (), np.zeros(0))
    nominal = engine.fit([empty], 0)[0]
    nominal.exact = True
    retuned = nominal
    if engine.keys:
        retuned = engine.fit(engine.hypotheses([]))[0]
        engine.settle([retuned])
        engine.key_columns = retuned.jacobian
    tested = np.logical_or.reduce([test for _, test in engine.problem.folds])
    blocks = make_blocks(rows.log, rows.time_s, tested, rows.restart_s, seed, rows.conditional)
    search = Search(engine, effects, rows, blocks, nominal, retuned, seed, tell=tell)
    search.fits[()] = retuned
    return search


def singles(search: Search) -> None:
    """Every effect alone, all starts briefly, the best start of each to convergence."""
    search.tell("each effect alone")
    x_keys, swings = search.retuned.x, swinging(search)
    starts = [screened(search, swings.get((e.id,)) or search.engine.hypotheses([e], x_keys)) for e in search.effects]
    again = []
    for part in portions([len(group) for group in starts], STARTS):
        brief = search.engine.fit([h for group in starts[part] for h in group], 2)
        again += [replace(f.hypothesis, start=f.x) for group in by_effect(brief) for f in group[:2 if len(group) > MANY_STARTS else 1]]
    search.add(again, CONVERGED)
    turn_again(search)
    for effect in search.effects:
        if len(search.engine.hypotheses([effect])) > SCREEN_ABOVE and not effect.phase:
            search.engine.remember(search.fits[(effect.id,)])
    rescale(search)
    reblock(search)


def swinging(search: Search) -> dict[tuple[str, ...], list[Hypothesis]]:
    """Starts of the effects that follow the angle, each with the amplitudes that a straight line asks for; before that the shaft of each
    stretch between stops, and of each log, is set where the one of them that gains most wants it."""
    engine, problem = search.engine, search.engine.problem
    starts = [h for e in search.effects if e.phase for h in engine.hypotheses([e], search.retuned.x)]
    if not starts or not hasattr(problem, "runs"):
        return {}
    parts, found = phases.stretches(problem), {}
    free = parts.count > 1 and problem.rig.load["kind"] != "pendulum"
    trials = [(h, swing_of(h, rows, parts, problem)) for h, rows in
              differenced(search, search.retuned, [replace(h, start=with_swing(h, (1e-3, 1e-3))) for h in starts])]
    shift = firmest(problem, parts, [one for _, one in trials]) if free else np.zeros(parts.count)
    engine.problem = phases.turned(problem, parts, shift) if shift.any() else problem
    for h, one in trials:
        found.setdefault(h.ids, []).append(replace(h, start=with_swing(h, one.amplitudes(shift))))
    return found


def swing_of(h: Hypothesis, rows: np.ndarray, parts: phases.Stretches, problem: Problem) -> phases.Swing:
    """First order of a periodic effect from its residuals at next to no amplitude and one step along each of its numbers."""
    at = cosine_at(h)
    columns = (rows[1 + at:3 + at] - rows[0]).T / [c.step for c in h.coordinates[at:at + 2]]
    return phases.Swing.of(parts, periods_of(h, problem.rig.gearbox["ratio"]), rows[0], columns)


def firmest(problem: Problem, parts: phases.Stretches, swings: Sequence[phases.Swing]) -> np.ndarray:
    """Offsets (stretches,) that the effect which gains most by them wants; zeros where none gains much."""
    best, shift = FIRM, np.zeros(parts.count)
    for swing in swings:
        found = swing.best_shifts([phases.offsets(problem, parts, g, swing.periods) for g in range(parts.count)])
        gain, plain = swing.gain(found), swing.gain(np.zeros(parts.count))
        if gain > best and gain > FIRMER * plain:
            best, shift = gain, found
    return shift


def turn_again(search: Search) -> None:
    """Set the stretches anew by the converged fit of the best effect that follows the angle, where it is a good one; fit those again."""
    mine = [search.fits[(e.id,)] for e in search.effects if e.phase]
    best = min(mine, key=search.score, default=search.retuned)
    if not hasattr(search.engine.problem, "runs") or not search.better(best, search.retuned):
        return
    problem = search.engine.problem
    search.engine.problem = phases.aligned(problem, best.theta(problem.theta0))
    if search.engine.problem is problem:
        return
    for one in mine:
        del search.fits[key(one.ids)]
    search.add([replace(one.hypothesis, start=one.x) for one in mine], CONVERGED)


def turn_for_good(search: Search, loaded: Problem, best: Fit) -> Fit:
    """The selected fit with the shaft's angles as anyone finds them who loads the logs with its parameters (`vgroove sim`)."""
    theta = best.theta(loaded.theta0)
    if not phases.active(loaded, theta):
        return best
    now, wanted = search.engine.problem, phases.aligned(loaded, theta)
    if all(np.array_equal(a.restarts.measured, b.restarts.measured) for a, b in zip(now.runs, wanted.runs, strict=True)):
        return best
    search.engine.problem = wanted
    again = search.engine.fit([replace(best.hypothesis, start=best.x)], CONVERGED)[0]
    search.engine.settle([again])
    search.fits[key(best.ids)] = again
    return again


def with_swing(h: Hypothesis, amplitudes: Sequence[float]) -> np.ndarray:
    """Start of a periodic effect with these sine and cosine amplitudes."""
    start = h.start.copy()
    start[cosine_at(h):cosine_at(h) + 2] = amplitudes
    return np.clip(start, h.low, h.high)


def cosine_at(h: Hypothesis) -> int:
    """Place of a periodic effect's first amplitude among its numbers."""
    return next(i for i, c in enumerate(h.coordinates) if c.role == "cosine")


def periods_of(h: Hypothesis, ratio: float) -> float:
    """Periods a motor turn of a periodic effect as it starts."""
    if h.ids[0] == "gear_eccentricity":
        return 1.0 / ratio
    return next((float(x) * c.factors[0] for c, x in zip(h.coordinates, h.start, strict=True) if c.name.endswith("periods_per_rev")), 1.0)


def by_effect(fits: Sequence[Fit]) -> list[list[Fit]]:
    """Fits of single effects, effect by effect, the best start first."""
    groups: dict[str, list[Fit]] = {}
    for one in fits:
        groups.setdefault(one.ids[0], []).append(one)
    return [sorted(group, key=lambda f: f.cost) for group in groups.values()]


def screened(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The best few of many starts, by what they predict as they are: a resonance or a play is only found from nearby."""
    quiet = search.score(search.retuned) < LARGE
    if any(c.role == "cosine" for c in starts[0].coordinates):
        return starts if quiet else starts + promising(search, [turned for h in starts for turned in around(h)])
    if quiet:
        return starts[::max(1, len(starts) // SCREENED)]
    return starts if len(starts) <= SCREEN_ABOVE else promising(search, starts)


def promising(search: Search, starts: list[Hypothesis]) -> list[Hypothesis]:
    """The SCREENED starts that predict best as they are."""
    rows = np.abs(search.engine.residuals([(h, h.start) for h in starts])[:, search.engine.train])
    cost = (np.minimum(rows, search.clip) ** 2).sum(axis=1)
    return [starts[k] for k in np.argsort(cost, kind="stable")[:SCREENED]]


def around(h: Hypothesis) -> list[Hypothesis]:
    """Starts of a periodic effect with amplitudes and phases that no straight line leads to from 0: large ones stop the shaft."""
    at, out = cosine_at(h), []
    for size in AMPLITUDES:
        for angle in np.arange(PHASES) * (2.0 * np.pi / PHASES):
            start = h.start.copy()
            start[at:at + 2] = size * np.cos(angle), size * np.sin(angle)
            out.append(replace(h, start=np.clip(start, h.low, h.high)))
    return out


def rescale(search: Search) -> None:
    """Where even the best fit is far from the noise (real machines), clip in units of what it leaves, so that models still compare."""
    leanest = min(search.fits.values(), key=lambda f: np.median(np.abs(f.held[search.blocks.tested])))
    left = 1.4826 * float(np.median(np.abs(leanest.held[search.blocks.tested])))
    search.clip = CLIP * max(1.0, left / 2.0)


def reblock(search: Search) -> None:
    """Bootstrap blocks a few correlation times long, as the residual of the best single fit shows them."""
    rows, best = search.rows, min(search.fits.values(), key=search.score)
    memory = correlation_time(best.residual, rows.time_s, rows.log * 1000 + rows.signal, rows.restart_s)
    length = min(max(SHORTEST_S, 3.0 * memory), 2.0 * rows.restart_s)
    search.blocks = make_blocks(rows.log, rows.time_s, search.blocks.tested, length, search.seed, rows.conditional)


def extensions(search: Search, base: Fit, count: int = PROPOSALS) -> list[Fit]:
    """The best first-order fits of base plus a further effect, best first: own Jacobian columns for the newcomer, those of base for the
    rest. They are many: they keep no Jacobian."""
    fits = (first_order(search, base, h, rows) for h, rows in newcomers(search, base))
    return heapq.nsmallest(count, fits, key=search.score)


def newcomers(search: Search, base: Fit) -> list[tuple[Hypothesis, np.ndarray]]:
    """Each further effect's hypothesis beside base, and its residuals (1 + new, n) at its start and one step along each new number.

    Those of the last base asked for are kept: `where` asks again for what the search ended with.
    """
    known = search.reach.get(0)
    if known is None or known[0] is not base:
        search.reach[0] = (base, differenced(search, base, trials_beside(search, base)))
    return search.reach[0][1]


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


def run(search: Search) -> tuple[Fit, list[Fit]]:
    """The whole search: the selected fit (the retuned one when no effect is worth it) and its rivals."""
    singles(search)
    best = forward(search)
    if not best.ids:
        return best, []
    best = backward(search, lean(search, best))
    search.tell("rivals")
    return settled(search, trimmed(search, exchanged(search, best), FORM_SHARE))


def settled(search: Search, best: Fit) -> tuple[Fit, list[Fit]]:
    """The selected fit and its rivals. A small member that goes by several names is none that could be named; nor is one that only bends
    another law of friction, when several laws bend it as well."""
    found = rivals(search, best)
    doubtful = [i for i in best.ids if any(i not in f.ids for f in found)]
    leaner = trimmed(search, best, UNSURE_SHARE, doubtful) if doubtful else best
    bends = bending(best, found)
    leaner = trimmed(search, best, SHAPE_SHARE, bends) if leaner is best and bends else leaner
    return (best, found) if leaner is best else settled(search, leaner)


def bending(best: Fit, found: Sequence[Fit]) -> list[str]:
    """Laws of friction in the best set that rivals replace by other such laws, beside one that stays."""
    replaced = {i: [set(f.ids) - set(best.ids) for f in found if i not in f.ids] for i in FRICTION_LAWS.intersection(best.ids)}
    if len(replaced) < 2:
        return []
    return sorted(i for i, instead in replaced.items() if instead and all(new <= FRICTION_LAWS for new in instead))


def forward(search: Search) -> Fit:
    """Grow the set while a further effect, or an exchange, is better in both senses."""
    best = simplest(search, search.ranked(1)[0]) if search.ranked(1) else search.retuned
    if not search.better(best, search.retuned) or not search.visible(best):
        pair = grow(search, best)
        return pair if pair is not None and search.better(pair, search.retuned) and search.visible(pair) else search.retuned
    while len(best.ids) < LARGEST_SET:
        larger = grow(search, best)
        if larger is not None and not search.better(larger, best):
            larger = two_further(search, best, larger)
        if larger is None:
            return best
        best = larger
        if search.score(best) < NEAR_NOISE**2:
            rescale(search)
    return best


def two_further(search: Search, base: Fit, larger: Fit) -> Fit | None:
    """A set of two more effects than base that is better than base, where one more gains enough and still is not: what the second leaves
    may hide what the first gains. It is looked for only where both promise to close the larger part of what is left: effects that are
    there leave nothing."""
    enough = search.score(base) - search.score(larger) > search.least_gain(base)
    if not enough or not has_room_for_two(search, base) or len(larger.ids) >= LARGEST_SET:
        return None
    promised = extensions(search, larger)
    if not promised or search.score(promised[0]) - search.level() > 0.5 * (search.score(base) - search.level()):
        return None
    search.add(distinct(promised))
    both = simplest(search, search.ranked(len(larger.ids) + 1)[0])
    return both if search.better(both, base, 2.0 * WORTH) else None


def has_room_for_two(search: Search, base: Fit) -> bool:
    """Whether base leaves a gap that is one, and one from which two effects could take more than its members' forms may leave."""
    above = search.score(base) - search.level()
    return leaves_a_gap(search, base) and above > 2.0 * FORM_SHARE * (search.score(search.retuned) - search.score(base))


def grow(search: Search, base: Fit) -> Fit | None:
    """Best converged set with one more effect than base: extensions of base and of its closest rivals."""
    search.tell(f"a further effect beside {', '.join(base.ids)}")
    size = len(base.ids) + 1
    rivals = [] if nothing_left(search, base) else [f for f in search.ranked(size - 1) if key(f.ids) != key(base.ids)][:2]
    proposals = [f for rival in rivals for f in extensions(search, rival, 3)]
    search.add(distinct(extensions(search, base) + proposals))
    found = next(iter(search.ranked(size)), base)
    if leaves_a_gap(search, found):
        search.add(distinct([one for one in started_anew(search, base) if search.score(one) < search.score(found)]))
        search.add([replace(f.hypothesis, start=f.x) for f in search.ranked(size)[:1]], CONVERGED)
    ranked = search.ranked(size)
    return simplest(search, ranked[0]) if ranked else None


def leaves_a_gap(search: Search, one: Fit) -> bool:
    """Whether a set leaves a gap that the contract calls one."""
    return search.score(one) >= (1.0 + VISIBLE) ** 2 * search.level()


def nothing_left(search: Search, base: Fit) -> bool:
    """Whether base leaves so little above the noise that no further effect, beside it or beside its rivals, could be worth its place."""
    return search.score(base) < (1.0 + WORTH) * search.level()


def simplest(search: Search, best: Fit) -> Fit:
    """Put special cases in the place of general effects that are not clearly better."""
    for member in best.ids:
        known = {e.id for e in search.effects} - set(best.ids)
        for special in (s for s in SPECIAL_CASES.get(member, ()) if s in known):
            one = fit_set(search, [special if i == member else i for i in best.ids], best)
            if not search.better(best, one, WORTH_FORM):
                return simplest(search, one)
    return best


def distinct(proposals: Sequence[Fit]) -> list[Hypothesis]:
    """Hypotheses of first-order fits, each set once."""
    seen: dict[tuple[str, ...], Hypothesis] = {}
    for one in proposals:
        seen.setdefault(key(one.ids), replace(one.hypothesis, start=one.x))
    return list(seen.values())


def fit_set(search: Search, ids: Sequence[str], near: Fit) -> Fit:
    """Converged fit of a set of ids, started from the numbers of a related fit."""
    known = search.fits.get(key(ids))
    if known is not None:
        search.engine.settle([known])
        return known
    return search.add([started(search, ids, near)])[0]


def started(search: Search, ids: Sequence[str], near: Fit) -> Hypothesis:
    """Hypothesis of a set of ids that starts from the numbers of a related fit."""
    values = {c.name: x for c, x in zip(near.hypothesis.coordinates, near.x, strict=True)}
    members = search.engine.hypotheses([BY_ID[i] for i in ids])
    h = next((m for m in members if set(m.fixed) <= set(near.hypothesis.fixed)), members[0])
    start = np.array([values.get(c.name, s) for c, s in zip(h.coordinates, h.start, strict=True)])
    return replace(h, start=np.clip(start, h.low, h.high))


def leaner(search: Search, best: Fit) -> list[Fit]:
    """The sets of all members but one. Each starts once from the best set's numbers too: what it was first fitted from may have led it
    astray, and a member that is needed nowhere else would then be kept."""
    sets = [[i for i in best.ids if i != out] for out in best.ids]
    if search.leaned is not best:
        search.add([started(search, ids, best) for ids in sets])
        search.leaned = best
    return [fit_set(search, ids, best) for ids in sets]


def backward(search: Search, best: Fit) -> Fit:
    """Drop members that are not worth their place, the least useful first."""
    search.tell("is every effect needed")
    while len(best.ids) > 1:
        leanest = min(leaner(search, best), key=search.score)
        if search.better(best, leanest):
            return best
        best = leanest
    return best


def trimmed(search: Search, best: Fit, share: float, members: Sequence[str] | None = None) -> Fit:
    """The best set without those members (default: any) that do so little beside the others that it may be what the others' forms leave.

    Shares are of the gap as the contract clips it, whatever the search compares in.
    """
    def left(one: Fit) -> float:
        return float(block_sums(search.blocks, squared(one, CLIP)).sum()) / search.blocks.total

    while len(best.ids) > 1:
        leaner = [fit_set(search, [i for i in best.ids if i != out], best) for out in best.ids if members is None or out in members]
        leanest = min(leaner, key=search.score, default=best)
        if leanest is best or left(leanest) - left(best) > share * (left(search.retuned) - left(leanest)):
            return best
        best = leanest
    return best


def exchanged(search: Search, best: Fit) -> Fit:
    """The best set after exchanges of one member, as long as one is clearly better; steps that add one effect at a time miss pairs whose
    members say little alone."""
    for _ in range(EXCHANGES):
        exchange(search, best)
        other = search.ranked(len(best.ids))[0]
        if other is best or search.score(other) >= search.score(best) or search.tied(best, other):
            break
        best = backward(search, lean(search, simplest(search, other)))
    return best


def rivals(search: Search, best: Fit) -> list[Fit]:
    """Converged sets that predict the held-out rows as well as best, are no larger, and do not just generalise it; best first."""
    pool = [f for k, f in search.fits.items() if k and key(best.ids) != k and f.hypothesis.count <= best.hypothesis.count + 2]
    pool = [f for f in pool if len(f.ids) <= len(best.ids) and plausible(f) and not contains(f.ids, best.ids)]
    return sorted((f for f in pool if search.tied(f, best)), key=search.score)


def exchange(search: Search, best: Fit) -> None:
    """Try every other effect in each member's place, to first order, and converge the close ones."""
    if len(best.ids) < 2:
        return
    close: list[Fit] = []
    for out in best.ids:
        rest = fit_set(search, [i for i in best.ids if i != out], best)
        close += [f for f in extensions(search, rest, 4) if key(f.ids) not in search.fits]
    search.add(distinct(close))


def lean(search: Search, best: Fit) -> Fit:
    """Between equals the one with fewer numbers: a special case unless the general effect is clearly better, or any tied set; between tied
    sets of as many numbers the likelier effects (added inertia rather than a clock that is off)."""
    for one in sorted((f for k, f in search.fits.items() if k and plausible(f)), key=lambda f: (*preference(f), search.score(f))):
        if preference(one) >= preference(best) or len(one.ids) > len(best.ids):
            continue
        if not search.better(best, one, WORTH_FORM) if contains(best.ids, one.ids) else search.tied(one, best):
            return one
    return best


def preference(one: Fit) -> tuple[int, int]:
    """Smaller is preferred between equals: fitted numbers, then rare effects."""
    return one.hypothesis.count, sum(i in RARE for i in one.ids)


def win_shares(search: Search, candidates: Sequence[Fit]) -> np.ndarray:
    """Share of bootstrap draws in which each candidate set wins, with a handicap for each further number."""
    worth = 0.5 * WORTH * search.level()
    means = np.stack([draw_means(search.blocks, search.sums(f)) + worth * f.hypothesis.count for f in candidates])
    return np.bincount(np.argmin(means, axis=0), minlength=len(candidates)) / means.shape[1]
