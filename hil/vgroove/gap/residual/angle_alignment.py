"""Estimates the motor's angle after stops from the effects that are periodic in the angle.

A count of edges is lost at every stop, and each log begins at an unknown angle. A stretch is a
sequence of restarts over which the count is not lost. Its angle is known up to whole pitches of the
Hall wheel (with edges) or not at all (without edges, and from a rest to the first edge). All other
parameters are the same in every stretch. The offset of each stretch is the candidate that leaves
the smallest residual under a periodic effect: a cogging, an eccentric gear or an eccentric wheel.
Without such an effect the residuals do not depend on the offset.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.catalogue import PERIODIC
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.huber import huber_weight
from vgroove.gap.residual.measured_run import MeasuredRun
from vgroove.gap.residual.protocol import MeasuredProblem
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.units import TURN_RAD


@dataclass(frozen=True)
class AlignmentRules:
    """Candidate offsets of a stretch, and when one replaces no offset; chosen on the tuning half of
    the blind set (docs/gap_bench.md).
    """

    # without edges: over the period of the effect; with edges: over the period of an effect of the
    # output, besides all pitches of a motor turn
    candidates_per_period: int = 32
    min_gain: float = 10.0  # decrease of the sum of squared residuals, squared sigma


ALIGNMENT = AlignmentRules()
SLOWER_THAN_A_TURN = 1.01  # of a turn: a period longer than this is the output's, not the motor's
# ridge of a 2 x 2 system, relative to its diagonal and absolute
RIDGE_SHARE, RIDGE = 1e-6, 1e-9


@dataclass(frozen=True)
class AngleStretches:
    """Stretches of restarts over which the count of edges is not lost, over all logs."""

    of: np.ndarray  # (n,) stretch of each residual
    rest: np.ndarray  # (stretches,) whether each lasts from a rest to the first edge
    first: np.ndarray  # (stretches,) whether each is its log's first, not counting one of `rest`
    log: np.ndarray  # (stretches,) the log that each lies in
    restart: tuple[np.ndarray, ...]  # per log (S,): the stretch of each restart

    @property
    def count(self) -> int:
        """Stretches of all logs."""
        return len(self.first)

    @property
    def reference(self) -> int:
        """The stretch whose angles the phases of effects refer to."""
        return int(np.argmax(self.first))


def angle_stretches(problem: MeasuredProblem) -> AngleStretches:
    """Stretches of all logs: each begins at the first restart after an instant at which the count
    may have been lost. A log without restarts is one stretch.
    """
    if not any(map(len, problem.angles.by_log)):
        logs = np.arange(len(problem.runs))
        one = np.ones(len(logs), bool)
        return AngleStretches(problem.log, ~one, one, logs, tuple(logs[:0] for _ in logs))
    of, restart, rest, first, log = np.zeros(problem.n, int), [], [], [], []
    for j, run in enumerate(problem.runs):
        number = len(log)
        from_rest, group = _stretch_of_restart(run)
        rows = problem.log == j
        window = run.restarts.before(problem.row[rows])
        of[rows] = (group + number)[np.maximum(window, 0)]
        count = int(group[-1]) + 1
        rest += [from_rest and k == 0 for k in range(count)]
        # stretch 1 where stretch 0 is a rest, else stretch 0
        first += [k == int(from_rest) for k in range(count)]
        log += [j] * count
        restart.append(group + number)
    return AngleStretches(of, np.array(rest), np.array(first), np.array(log), tuple(restart))


def _stretch_of_restart(run: MeasuredRun) -> tuple[bool, np.ndarray]:
    """Whether the first restart is a stretch of its own (a rest at an unknown angle), and the
    stretch of each restart (S,), counted from 0.
    """
    lost = np.searchsorted(run.lost_s, np.asarray(run.log.time_s)[run.restarts.rows])
    from_rest = run.from_rest and len(lost) > 1
    lost[:1] -= from_rest  # a number of its own (-1) makes the first restart a separate stretch
    return from_rest, np.unique(lost, return_inverse=True)[1]


def active_periodic_effects(problem: MeasuredProblem, theta: np.ndarray) -> list[str]:
    """Periodic effects that a parameter vector (P,) switches on."""
    names = {i: f"effects.{i}.{periodic.amplitude}" for i, periodic in PERIODIC.items()}
    return [i for i, name in names.items() if theta[problem.index(name)] != 0.0]


def candidate_shifts(
    problem: MeasuredProblem, parts: AngleStretches, stretch: int, periods_per_rev: float
) -> np.ndarray:
    """Offsets (k,) in rad that a stretch may have for an effect of so many periods a motor turn.

    With edges: whole pitches over a motor turn; in a log's first stretch also over the effect's
    period, where that is longer. From a rest to the first edge, and in the first stretch of a log
    without edges: angles over the effect's period in equal steps. In later stretches of a log
    without edges: 0, since their angle was measured.
    """
    run, first = problem.runs[parts.log[stretch]], bool(parts.first[stretch])
    if not run.pitch_rad and not first:
        return np.zeros(1)
    count = ALIGNMENT.candidates_per_period
    period = TURN_RAD / periods_per_rev
    if not run.pitch_rad or parts.rest[stretch]:
        return period / count * np.arange(count)
    found = np.arange(round(TURN_RAD / run.pitch_rad))
    if first and period > TURN_RAD * SLOWER_THAN_A_TURN:
        over_period = np.round(period / count * np.arange(count) / run.pitch_rad).astype(int)
        found = np.unique(np.concatenate([found, over_period]))
    return run.pitch_rad * found


def periods_per_rev(problem: MeasuredProblem, theta: np.ndarray, effect: str) -> float:
    """Periods a motor turn of a periodic effect with the values of theta (P,)."""
    return PERIODIC[effect].periods_per_rev(
        lambda name: float(theta[problem.index(f"effects.{effect}.{name}")]),
        problem.rig.gearbox["ratio"],
    )


def fewest_periods_per_rev(problem: MeasuredProblem, theta: np.ndarray) -> float:
    """Fewest periods a motor turn of the periodic effects that theta (P,) switches on."""
    active = active_periodic_effects(problem, theta)
    return min(periods_per_rev(problem, theta, effect) for effect in active)


def align_angles(
    problem: MeasuredProblem, theta: np.ndarray, angles: RestartAngles
) -> RestartAngles:
    """Restart angles with the offset of every stretch that leaves the smallest residual under theta
    (P,); the same object where theta switches no periodic effect on.
    """
    parts = angle_stretches(problem)
    fixed = problem.rig.load["kind"] == "pendulum" or parts.count < 2
    if fixed or not active_periodic_effects(problem, theta):
        return angles
    periods = fewest_periods_per_rev(problem, theta)
    choices = [candidate_shifts(problem, parts, g, periods) for g in range(parts.count)]
    choices[parts.reference] = np.zeros(1)
    best, shift = np.full(parts.count, np.inf), np.zeros(parts.count)
    for k in range(max(len(c) for c in choices)):
        trial = np.array([c[k] if k < len(c) else 0.0 for c in choices])
        residual = problem.residuals(theta, angles.shifted(parts.restart, trial))[0]
        cost = np.bincount(
            parts.of,
            weights=np.minimum(np.abs(residual), MIN_CLIP_SIGMAS) ** 2,
            minlength=parts.count,
        )
        better = cost < best - (ALIGNMENT.min_gain if k else 0.0)
        best, shift = np.where(better, cost, best), np.where(better, trial, shift)
    return angles.shifted(parts.restart, shift)


@dataclass(frozen=True)
class FirstOrderRipple:
    """A periodic effect of small amplitude, linearised: periods a motor turn, and the squared
    residual of each stretch as a quadratic form of [amplitude cos(phase), amplitude sin(phase)]:
    normal matrices (stretches, 2, 2) and gradients (stretches, 2).
    """

    periods: float
    normal: np.ndarray
    gradient: np.ndarray

    @staticmethod
    def of(
        parts: AngleStretches, periods: float, residual: np.ndarray, columns: np.ndarray
    ) -> "FirstOrderRipple":
        """From residuals (n,) and their derivatives (n, 2) along the two numbers, with Huber's
        weights.
        """
        weight = huber_weight(residual, MIN_CLIP_SIGMAS)
        products = weight[:, None] * np.column_stack(
            [columns[:, [0, 0, 1, 1]] * columns[:, [0, 1, 0, 1]], columns * residual[:, None]]
        )
        sums = np.stack(
            [np.bincount(parts.of, weights=p, minlength=parts.count) for p in products.T], axis=1
        )
        return FirstOrderRipple(periods, sums[:, :4].reshape(-1, 2, 2), sums[:, 4:])

    def rotated(self, stretch: int, shift_rad: float) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient of one stretch with shift_rad added to its shaft angle."""
        c, s = np.cos(self.periods * shift_rad), np.sin(self.periods * shift_rad)
        rotation = np.array([[c, -s], [s, c]])
        return rotation.T @ self.normal[stretch] @ rotation, rotation.T @ self.gradient[stretch]

    def summed(self, shift_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient of all stretches with offsets (stretches,)."""
        both = [self.rotated(g, d) for g, d in enumerate(shift_rad)]
        return sum(n for n, _ in both), sum(b for _, b in both)

    def gain(self, shift_rad: np.ndarray) -> float:
        """Squared residual that the effect removes with offsets (stretches,)."""
        normal, gradient = self.summed(shift_rad)
        return float(gradient @ solve_ridge(normal, gradient))

    def amplitudes(self, shift_rad: np.ndarray) -> np.ndarray:
        """[amplitude cos(phase), amplitude sin(phase)] that leave the smallest squared residual."""
        return -solve_ridge(*self.summed(shift_rad))

    def best_shifts(self, choices: list[np.ndarray], reference: int = 0) -> np.ndarray:
        """Offsets (stretches,) relative to the reference stretch, each one of the choices of its
        stretch, for which one amplitude and phase fits all stretches best. Greedy: the stretches
        are added one by one, the one of the largest gain first.
        """
        gains = np.array(
            [b @ solve_ridge(n, b) for n, b in zip(self.normal, self.gradient, strict=True)]
        )
        order, shift = np.argsort(-gains, kind="stable"), np.zeros(len(gains))
        normal, gradient = np.zeros((2, 2)), np.zeros(2)
        for g in order:
            ripple = -solve_ridge(normal, gradient)
            rotated = [self.rotated(g, d) for d in choices[g]]
            costs = [2.0 * b @ ripple + ripple @ n @ ripple for n, b in rotated]
            k = int(np.argmin(costs)) if normal.any() else 0
            shift[g] = choices[g][k]
            normal, gradient = normal + rotated[k][0], gradient + rotated[k][1]
        return shift - shift[reference]


def solve_ridge(normal: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Solution (2,) of a 2 x 2 system with a small ridge; zeros where the system is zero."""
    ridge = normal + np.diag(RIDGE_SHARE * np.diag(normal) + RIDGE)
    return np.linalg.solve(ridge, gradient)
