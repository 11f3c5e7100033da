"""What a search for effects holds: fits of the sets that were tried, and how two of them are
weighed on held-out rows.

A fuller set must be worth it twice: its held-out gain is significant under the block bootstrap, and
it is large enough to matter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vgroove.gap.catalogue import Effect
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.fit import Engine, Fit, Hypothesis
from vgroove.gap.selection.model_comparison import (
    SHORTEST_S,
    Blocks,
    block_sums,
    correlation_time,
    interval,
    least_loss,
    make_blocks,
    squared,
)

CLIP = 10.0
WORTH = 0.05
VISIBLE = 0.1
WORTH_SHARE = 0.01
LEVEL = 0.99
CHANCE = 3.84  # squared sigmas that one number gains by chance (95 % of chi-square)
# squared gap above the noise, in noise, and share of it that no chance takes away
LARGE, NEARLY_ALL = 0.5, 0.9
LIKELY = 0.8  # interval whose lower end must still be worth it: the gain is not one lucky block's
# of the best squared gap: fits beyond stay where their first rounds put them, with first-order
# predictions
WITHIN_REACH = 1.5
CONVERGED = 12  # rounds in which fits end; most need four
# what scales edge speeds against stamps
SCALING = ("speed_gain.relative", "clock_skew.relative", "clock_skew.command_clock")
FLOORED = ("effects.transport_delay.delay_s",)


@dataclass(frozen=True)
class Rows:
    """Where each residual comes from: log, time, signal (n,), whether it counts only when not 0,
    and how often the model restarts.
    """

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
    reach: tuple[Fit, list[tuple[Hypothesis, np.ndarray]]] | None = None
    promised: dict[tuple[str, ...], Any] = field(default_factory=dict)
    tell: Callable[[str], None] = lambda _: None

    def sums(self, one: Fit, clip: float | None = None) -> np.ndarray:
        """Squared held-out residuals per bootstrap block (blocks,), clipped as the search compares
        or as asked.
        """
        return block_sums(self.blocks, squared(one, self.clip if clip is None else clip))

    def by_signal(self, one: Fit, clip: float) -> np.ndarray:
        """What each signal adds to the squared held-out gap (signals,)."""
        weights = np.where(self.blocks.tested, squared(one, clip), 0.0)
        return np.bincount(self.rows.signal, weights=weights) / self.blocks.total

    def score(self, one: Fit, clip: float | None = None) -> float:
        """Squared held-out gap."""
        return float(self.sums(one, clip).sum()) / self.blocks.total

    def reported(self, one: Fit) -> float:
        """Squared held-out gap as the contract's figures have it: over their blocks alone."""
        return gap_of(self.engine.problem, one.held) ** 2

    def alike(self, one: Fit, other: Fit) -> bool:
        """Whether two sets leave the same but for what chance does to one number."""
        return abs(float(self.sums(one).sum() - self.sums(other).sum())) <= CHANCE * self.level()

    def tied(self, one: Fit, best: Fit) -> bool:
        """The contract's rule: the 95 % interval of the difference contains 0, or both leave the
        same. What tells two models apart may happen in few blocks, which a draw of blocks may miss:
        far beyond the noise there, and large enough to matter, it tells them apart as well. So do
        the edges.
        """
        if self.contradicted(one) and not self.contradicted(best):
            return False
        if self.alike(one, best):
            return True
        if interval(self.blocks, self.sums(one) - self.sums(best))[0] > 0.0:
            return False
        return self.least_loss(one, best) <= self.least_gain(best)

    def least_loss(self, worse: Fit, better: Fit, level: float = 0.95) -> float:
        """Squared gap that the worse fit surely loses on the run as it was."""
        return least_loss(
            self.blocks, *(np.clip(f.held, -self.clip, self.clip) for f in (worse, better)), level
        )

    def contradicted(self, one: Fit) -> bool:
        """Whether a log's edges follow one another only on another scale than its time stamps, and
        no clock and no gain of the set explains most of that: the sensor times edges by its own
        clock, far finer than what a motion shows.
        """
        problem = self.engine.problem
        scales = [run.edge_scale for run in getattr(problem, "runs", ()) if run.edge_scale != 1.0]
        if not scales:
            return False
        gain, clock, of_command = (
            one.theta(problem.theta0)[problem.index(f"effects.{name}")] for name in SCALING
        )
        told = (1.0 + gain) * (1.0 + (0.0 if of_command else clock))
        return any(abs(scale - told) > 0.5 * abs(scale - 1.0) for scale in scales)

    def better(self, fuller: Fit, leaner: Fit, worth: float = WORTH) -> bool:
        """True when the fuller set is significantly better, in any draw of blocks or on the run as
        it was, and by an amount that matters in most draws; or when it closes a gap that is large.
        """
        if self.closes_large(fuller, leaner):
            return True
        if not self.likely_better(fuller, leaner, worth):
            return False
        apart = self.sums(leaner) - self.sums(fuller)
        return interval(self.blocks, apart, LEVEL)[0] > 0.0 or self.least_loss(
            leaner, fuller, LEVEL
        ) > self.least_gain(leaner, worth)

    def closes_large(self, fuller: Fit, leaner: Fit) -> bool:
        """True when the fuller set takes nearly all of a large gap, whichever block is left out: a
        short log has too few of them to show more by draws.
        """
        noise, more, left = self.level() * self.blocks.rows, self.sums(leaner), self.sums(fuller)
        noise, above, gain = (float(x.sum()) - x for x in (noise, more - noise, more - left))
        return bool(np.all(above > LARGE * noise) and np.all(gain > NEARLY_ALL * above))

    def likely_better(self, fuller: Fit, leaner: Fit, worth: float = WORTH) -> bool:
        """True when the fuller set is better by an amount that matters in most draws of blocks."""
        apart, worth = self.sums(leaner) - self.sums(fuller), self.least_gain(leaner, worth)
        return (
            float(apart.sum()) / self.blocks.total > worth
            and interval(self.blocks, apart, LIKELY)[0] > worth
        )

    def least_gain(self, leaner: Fit, worth: float = WORTH) -> float:
        """Squared gap that a fuller set must take away from a leaner one."""
        return worth * self.level() + WORTH_SHARE * max(0.0, self.score(leaner) - self.level())

    def visible(self, one: Fit) -> bool:
        """The contract's least gap: below VISIBLE of the noise it is no gap, and what takes it away
        is no effect that could be named.
        """
        noise, left = np.sqrt(self.level()), np.sqrt(self.score(one))
        return bool(np.sqrt(self.score(self.retuned)) - min(noise, left) >= VISIBLE * noise)

    def leaves_a_gap(self, one: Fit) -> bool:
        """Whether a set leaves a gap that the contract calls one."""
        return self.score(one) >= (1.0 + VISIBLE) ** 2 * self.level()

    def surely_leaves_a_gap(self, one: Fit) -> bool:
        """Whether what a set leaves is a gap of the contract in most draws of blocks: not by the
        few in which something happened.
        """
        above = self.sums(one) - (1.0 + VISIBLE) ** 2 * self.level() * self.blocks.rows
        return interval(self.blocks, above, LIKELY)[0] > 0.0

    def level(self) -> float:
        """Squared gap that is taken as noise: 1, or what the best fit leaves where no fit comes
        near 1.
        """
        return (self.clip / CLIP) ** 2

    def add(self, hypotheses: Sequence[Hypothesis], iterations: int = 6) -> list[Fit]:
        """Fit, bring what comes near the best to convergence, settle it, and keep the best of each
        set.
        """
        fits = self.engine.fit(hypotheses, iterations)
        if fits:
            self.engine.go_on(self.near(fits), range(iterations, CONVERGED))
            predict_held_out(self.engine, self.near(fits))
        for one in fits:
            known = self.fits.get(key(one.ids))
            if known is None or one.cost < known.cost:
                self.fits[key(one.ids)] = one
        return [self.fits[k] for k in dict.fromkeys(key(h.ids) for h in hypotheses)]

    def near(self, fits: Sequence[Fit]) -> list[Fit]:
        """Those of some fits that come near the best of them."""
        reach = WITHIN_REACH * min(self.score(f) for f in fits)
        return [f for f in fits if self.score(f) <= reach]

    def ranked(self, size: int) -> list[Fit]:
        """Fits of sets of one size, best first; equal scores in catalogue order."""
        mine = (f for k, f in self.fits.items() if len(k) == size and plausible(f))
        return sorted(mine, key=lambda f: (round(self.score(f), 9), f.ids))


def gap_of(problem: Any, held: np.ndarray) -> float:
    """The contract's gap of held-out residuals."""
    return float(problem.gap(held, problem.judged))


def plausible(one: Fit) -> bool:
    """False when a number that must not be zero (a delay beyond the logger's convention) is pressed
    against its lower bound.
    """
    pressed = (
        c.low > 0.0 and x < 1.02 * c.low
        for c, x in zip(one.hypothesis.coordinates, one.x, strict=True)
        if c.name in FLOORED
    )
    return not any(pressed)


def key(ids: Sequence[str]) -> tuple[str, ...]:
    """Order-free name of a set."""
    return tuple(sorted(ids))


def begin(
    engine: Engine, effects: list[Effect], rows: Rows, seed: int, tell: Callable[[str], None]
) -> Search:
    """Nominal and retuned fits, bootstrap blocks."""
    tell("nominal and retuned model")
    empty = Hypothesis((), (), np.zeros(0))
    nominal = engine.fit([empty], 0)[0]
    nominal.exact = True
    retuned = nominal
    if engine.keys:
        retuned = engine.fit(engine.hypotheses([]))[0]
        predict_held_out(engine, [retuned])
        engine.key_columns = retuned.jacobian
    tested = np.logical_or.reduce([test for _, test in engine.problem.folds])
    blocks = make_blocks(rows.log, rows.time_s, tested, rows.restart_s, seed, rows.conditional)
    search = Search(engine, effects, rows, blocks, nominal, retuned, seed, tell=tell)
    search.fits[()] = retuned
    return search


def rescale(search: Search) -> None:
    """Where even the best fit is far from the noise (real machines), clip in units of what it
    leaves, so that models still compare.
    """
    leanest = min(
        search.fits.values(), key=lambda f: np.median(np.abs(f.held[search.blocks.tested]))
    )
    left = 1.4826 * float(np.median(np.abs(leanest.held[search.blocks.tested])))
    search.clip = CLIP * max(1.0, left / 2.0)


def reblock(search: Search) -> None:
    """Bootstrap blocks a few correlation times long, as the residual of the best single fit shows
    them.
    """
    rows, best = search.rows, min(search.fits.values(), key=search.score)
    memory = correlation_time(
        best.residual, rows.time_s, rows.log * 1000 + rows.signal, rows.restart_s
    )
    length = min(max(SHORTEST_S, 3.0 * memory), 2.0 * rows.restart_s)
    search.blocks = make_blocks(
        rows.log, rows.time_s, search.blocks.tested, length, search.seed, rows.conditional
    )
