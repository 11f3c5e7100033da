"""Where the shaft stands: a count of edges is lost at every stop, each log begins anywhere. Effects
that follow the angle tell how much.

A stretch is a run of restarts over which the count holds. Its angle is known up to whole pitches of
the Hall wheel (with edges) or not at all (without, and from a rest to the first edge); nothing else
of the tool changes from stretch to stretch. Offsets are read from what a cogging, an eccentric gear
or an eccentric wheel leaves least with; a tool without such an effect does not feel them.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from vgroove.gap.residual.problem import Problem

PERIODIC = {
    "cogging_torque": "torque_nm",
    "gear_eccentricity": "torque_nm",
    "hall_eccentricity": "amplitude_rad",
}
FINE = 32  # offsets that are tried over a period without edges, and over a turn of the output
WORTH = 10.0  # squared sigmas by which an offset must be better than none
CLIP = 10.0


@dataclass(frozen=True)
class AngleStretches:
    """of (n,): stretch of each residual; rest: whether each is the way from a rest to the first
    edge; first: whether it is its log's first but for that; log: which it lies in; restart: of each
    log's restarts.
    """

    of: np.ndarray
    rest: np.ndarray
    first: np.ndarray
    log: np.ndarray
    restart: list[np.ndarray]

    @property
    def count(self) -> int:
        """Stretches of all logs."""
        return len(self.first)

    @property
    def reference(self) -> int:
        """The stretch whose angles the phases are told in."""
        return int(np.argmax(self.first))


def angle_stretches(problem: "Problem") -> AngleStretches:
    """Stretches of all logs: a new one at the first restart after each instant at which the count
    may be lost.
    """
    of, restart, rest, first, log, number = np.zeros(problem.n, int), [], [], [], [], 0
    for j, run in enumerate(problem.runs):
        time_s = np.asarray(run.log.time_s)
        lost = np.searchsorted(run.lost_s, time_s[run.restarts.rows])
        alone = run.from_rest and len(lost) > 1
        lost[:1] -= alone
        group = np.unique(lost, return_inverse=True)[1] + number
        rows = problem.log == j
        # a restart's own row shows what was before
        window = np.searchsorted(run.restarts.rows, problem.row[rows], side="left") - 1
        of[rows] = group[np.maximum(window, 0)]
        count = int(group[-1]) - number + 1
        rest += [alone and k == 0 for k in range(count)]
        first += [k == alone for k in range(count)]
        log += [j] * count
        restart.append(group)
        number += count
    return AngleStretches(of, np.array(rest), np.array(first), np.array(log), restart)


def with_angle_shift(problem: "Problem", parts: AngleStretches, shift_rad: np.ndarray) -> "Problem":
    """The problem with each stretch's shaft standing shift_rad (stretches,) further on."""
    runs = []
    for run, group in zip(problem.runs, parts.restart, strict=True):
        measured = run.restarts.measured.copy()
        measured[:, 2] += shift_rad[group]
        runs.append(replace(run, restarts=replace(run.restarts, measured=measured)))
    return replace(problem, runs=tuple(runs))


def active_periodic_effects(problem: "Problem", theta: np.ndarray) -> list[str]:
    """Effects of a parameter vector that follow the angle."""
    return [i for i, size in PERIODIC.items() if theta[problem.index(f"effects.{i}.{size}")] != 0.0]


def offsets(problem: "Problem", parts: AngleStretches, stretch: int, periods: float) -> np.ndarray:
    """Offsets (k,) in rad that a stretch may have for an effect of so many periods a motor turn:
    with edges whole pitches, over a turn (at a log's start: over the effect's period); without
    edges at a log's start, and at a rest before the first edge, anything.
    """
    run, first = problem.runs[parts.log[stretch]], bool(parts.first[stretch])
    if not run.pitch_rad and not first:
        return np.zeros(1)
    period = 2.0 * np.pi / periods
    if not run.pitch_rad or parts.rest[stretch]:
        return period / FINE * np.arange(FINE)
    found = np.arange(round(2.0 * np.pi / run.pitch_rad))
    if first and period > 2.0 * np.pi * 1.01:
        found = np.unique(
            np.concatenate(
                [found, np.round(period / FINE * np.arange(FINE) / run.pitch_rad).astype(int)]
            )
        )
    return run.pitch_rad * found


def periods_of(problem: "Problem", theta: np.ndarray) -> float:
    """Fewest periods a motor turn of the effects of theta that follow the angle."""
    every = {
        "cogging_torque": float(theta[problem.index("effects.cogging_torque.periods_per_rev")]),
        "hall_eccentricity": 1.0,
        "gear_eccentricity": 1.0 / problem.rig.gearbox["ratio"],
    }
    return min(every[i] for i in active_periodic_effects(problem, theta))


def align_angles(problem: "Problem", theta: np.ndarray) -> "Problem":
    """The problem with the offset of every stretch that leaves least of the gap under theta (P,);
    as it is if nothing follows the angle.
    """
    parts = angle_stretches(problem)
    if (
        parts.count < 2
        or not active_periodic_effects(problem, theta)
        or problem.rig.load["kind"] == "pendulum"
    ):
        return problem
    choices = [offsets(problem, parts, g, periods_of(problem, theta)) for g in range(parts.count)]
    choices[parts.reference] = np.zeros(1)
    best, shift = np.full(parts.count, np.inf), np.zeros(parts.count)
    for k in range(max(len(c) for c in choices)):
        trial = np.array([c[k] if k < len(c) else 0.0 for c in choices])
        residual = with_angle_shift(problem, parts, trial).residuals(theta)[0]
        cost = np.bincount(
            parts.of, weights=np.minimum(np.abs(residual), CLIP) ** 2, minlength=parts.count
        )
        better = cost < best - (WORTH if k else 0.0)
        best, shift = np.where(better, cost, best), np.where(better, trial, shift)
    return with_angle_shift(problem, parts, shift)


@dataclass(frozen=True)
class FirstOrderRipple:
    """What a small effect that follows the angle would do, to first order: periods a motor turn,
    normal matrices (stretches, 2, 2) and gradients (stretches, 2) of the squared residual over its
    sine and cosine amplitudes.
    """

    periods: float
    normal: np.ndarray
    gradient: np.ndarray

    @staticmethod
    def of(
        parts: AngleStretches, periods: float, residual: np.ndarray, columns: np.ndarray
    ) -> "FirstOrderRipple":
        """From residuals (n,) and their derivatives (n, 2)."""
        weight = np.minimum(1.0, CLIP / np.maximum(np.abs(residual), 1e-9))
        products = weight[:, None] * np.column_stack(
            [columns[:, [0, 0, 1, 1]] * columns[:, [0, 1, 0, 1]], columns * residual[:, None]]
        )
        sums = np.stack(
            [np.bincount(parts.of, weights=p, minlength=parts.count) for p in products.T], axis=1
        )
        return FirstOrderRipple(periods, sums[:, :4].reshape(-1, 2, 2), sums[:, 4:])

    def seen_from(self, stretch: int, shift_rad: float) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient of one stretch over the amplitudes of a shaft that stands
        shift_rad further on.
        """
        c, s = np.cos(self.periods * shift_rad), np.sin(self.periods * shift_rad)
        turn = np.array([[c, -s], [s, c]])
        return turn.T @ self.normal[stretch] @ turn, turn.T @ self.gradient[stretch]

    def together(self, shift_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient of all stretches with offsets (stretches,)."""
        both = [self.seen_from(g, d) for g, d in enumerate(shift_rad)]
        return sum(n for n, _ in both), sum(b for _, b in both)

    def gain(self, shift_rad: np.ndarray) -> float:
        """Squared residual that the effect takes away with offsets (stretches,)."""
        normal, gradient = self.together(shift_rad)
        return float(gradient @ solved(normal, gradient))

    def amplitudes(self, shift_rad: np.ndarray) -> np.ndarray:
        """Sine and cosine amplitude that take it away."""
        return -solved(*self.together(shift_rad))

    def best_shifts(self, choices: list[np.ndarray], reference: int = 0) -> np.ndarray:
        """Offsets (stretches,) against a reference, out of each stretch's choices, that fit one
        amplitude and phase best: the stretch that shows most leads.
        """
        alone = np.array(
            [b @ solved(n, b) for n, b in zip(self.normal, self.gradient, strict=True)]
        )
        order, shift = np.argsort(-alone, kind="stable"), np.zeros(len(alone))
        normal, gradient = np.zeros((2, 2)), np.zeros(2)
        for g in order:
            swing = -solved(normal, gradient)
            seen = [self.seen_from(g, d) for d in choices[g]]
            costs = [2.0 * b @ swing + swing @ n @ swing for n, b in seen]
            k = int(np.argmin(costs)) if normal.any() else 0
            shift[g], normal, gradient = choices[g][k], normal + seen[k][0], gradient + seen[k][1]
        return shift - shift[reference]


def solved(normal: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Solution (2,) of a 2 x 2 system; zeros where nothing is seen."""
    ridge = normal + np.diag(1e-6 * np.diag(normal) + 1e-9)
    return np.linalg.solve(ridge, gradient)
