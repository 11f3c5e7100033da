"""The start angle of the hammer, which no column of a log holds but which its run-up determines:
the angle at which the simulation follows the log best, for each parameter set (profile likelihood).

The motion settles on a limit cycle, so the start matters in the run-up only. Where several limit
cycles exist, different starts may reach different ones, and the cycles of all are compared.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.huber import huber_loss, huber_weight
from vgroove.gap.residual.impact.impact_run import FirstSpans, ImpactRun, StartSearch
from vgroove.gap.residual.impact.roll_outs import (
    PARAMETERS,
    clipped_cost,
    run_up_residuals,
    simulate,
    simulate_statistics,
    span_residuals,
)
from vgroove.gap.residual.inputs import DrivingColumns
from vgroove.units import TURN_RAD


@dataclass(frozen=True)
class StartRules:
    """How many start angles of the hammer are simulated; chosen on simulated runs."""

    # over the free angle between two lugs: the first blow tells it to about a fortieth of that
    tried: int = 96
    # of the tried ones, besides the best one, where the last half of the run depends on the start
    spread: tuple[int, ...] = (8, 40, 72)
    # RMS difference between the starts, in standard deviations, up to which it does not
    max_spread: float = 1.0
    # for each parameter set: over the same angle, where one of those beside the predicted angle is
    # better than this one
    first: int = 12
    halved: int = 4  # how often the step beside the best is halved at most
    # RMS of half the second difference over a step, in standard deviations, up to which it is not
    # halved further: the statistics are proportional to the angle there
    proportional: float = 0.25
    # longest Gauss-Newton step where the statistics are proportional to the angle within the last
    # halving of the step, in such steps
    far: float = 4.0
    first_spans: int = 8  # of the search's first stage, from that of the first contact on
    growth: float = 2.0  # of the spans from the first contact on, from stage to stage
    reach: float = 3.0  # longest Gauss-Newton step of a stage, in standard deviations of the angle
    difference_rad: float = 1e-3  # between the two angles that give a slope
    for_curvature: int = 7  # angles from which the curvature within a step is taken
    # distance from the best angle within which the curvature widens standard deviations, as a share
    # of the free angle; the steps end far closer
    of_sigma: int = 96


STARTS = StartRules()
BOTH = np.array([-1.0, 1.0])  # sides of an angle
HUBER_SIGMAS = 4.0  # threshold of Huber's loss
# deviation by the start angle, in standard deviations of a log's statistic, above which the
# statistic is not judged
MAX_SHARE = 5.0
START, LUGS, OVERLAP = (
    "mechanism.hammer_start_rad",
    "mechanism.lug_count",
    "mechanism.lug_overlap_rad",
)
COLUMN, RATIO = PARAMETERS.index(START), PARAMETERS.index("gearbox.ratio")


def start_angles(theta0: np.ndarray, count: int = STARTS.tried) -> np.ndarray:
    """Start angles (count,) in rad of the hammer over the free angle between two lugs, for the
    rig's parameters (P,).
    """
    return -free_angle(theta0) / count * (np.arange(count) + 0.5)


def free_angle(theta0: np.ndarray) -> float:
    """Angle in rad that the hammer's lugs can turn between two lugs of the anvil."""
    lugs, overlap = theta0[PARAMETERS.index(LUGS)], theta0[PARAMETERS.index(OVERLAP)]
    return float(TURN_RAD / lugs - overlap)


def with_starts(theta: np.ndarray, start_rad: np.ndarray | float) -> np.ndarray:
    """Parameter sets (B, P) with start angles (B,) of the hammer; of a set theta (P,) or (B, P) and
    angles () or (B,) the single one serves all.
    """
    count = np.broadcast_shapes(theta.shape[:-1], np.shape(start_rad))
    found = np.broadcast_to(theta, (*count, theta.shape[-1])).copy()
    found[:, COLUMN] = start_rad
    return found


def closest_start(run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray) -> float:
    """The start angle in rad, of those tried (M,), from which a parameter set (P,) follows the log
    best: its run-up, where there is one.
    """
    tried = with_starts(theta, start_rad)
    if run.early is None:
        return float(start_rad[np.argmin(clipped_cost(run, simulate_statistics(run, tried)))])
    return float(start_rad[np.argmin(_misfit(run_up_residuals(run, tried)))])


def with_start_curvature(run: ImpactRun, theta: np.ndarray) -> ImpactRun:
    """The run whose run-up allows for its curvature near the start angle of a parameter set (P,):
    later blows depend on the angle ever more steeply. The standard deviations contain it near the
    angle; the weights of the search, within the distance of its trials and from the best of them.
    """
    if run.early is None:
        return run
    free = free_angle(theta)
    run = with_deviations(run, _curvature(run, theta, free / STARTS.of_sigma))
    return replace(run, search=_start_search(run, theta))


def _start_search(run: ImpactRun, theta: np.ndarray) -> StartSearch:
    """The search near the start angle of a parameter set (P,)."""
    free, row = free_angle(theta), _contact_row(run, theta)
    until = run.early.first_rows(min(int(row) + 2, len(run.early.time_s)))
    stages = tuple(run.first_spans(count) for count in _stage_spans(run, row))
    steps = free / STARTS.first * 0.5 ** np.arange(STARTS.halved + 1)
    first = run.is_run_up & run.judged & (run.window < len(stages[0].run_up.first))
    ratio = [_curvature(run, theta, step)[first] / run.sigma[first] for step in steps]
    weights = 1.0 / np.hypot(1.0, ratio)
    return StartSearch(row, until, stages, weights[0], weights[1:])


def _stage_spans(run: ImpactRun, contact_row: float) -> list[int]:
    """Numbers of first spans of the stages of the search: the first blows, twice as many spans from
    the first contact on, and so on up to all.
    """
    count, contact = len(run.run_up.first), int(contact_row) // run.run_up.rows
    found = [min(contact + STARTS.first_spans, count)]
    while found[-1] < count:
        found.append(min(contact + round(STARTS.growth * (found[-1] - contact)), count))
    return found


def _middle(theta: np.ndarray, near_rad: float) -> float:
    """The start angle of a parameter set (P,), so far from the lugs that near_rad fits beside."""
    return float(np.clip(theta[COLUMN], near_rad - free_angle(theta), -near_rad))


def _contact_row(run: ImpactRun, theta: np.ndarray) -> float:
    """Row, between two rows, at which the hammer of a parameter set (P,) first meets the anvil: up
    to there it turns with the spindle by the angle to the lug ahead.
    """
    turned = _spindle_angle(run, run.early, theta[None])[0]
    ahead = -theta[COLUMN] if turned[-1] >= 0.0 else free_angle(theta) + theta[COLUMN]
    reached = np.abs(turned) >= ahead
    row = int(np.argmax(reached)) if reached.any() else len(turned) - 1
    if row == 0:
        return 0.0
    before, after = np.abs(turned[row - 1 : row + 1])
    return row - 1.0 + float(np.clip((ahead - before) / max(after - before, 1e-12), 0.0, 1.0))


def _spindle_angle(run: ImpactRun, drive: DrivingColumns, theta: np.ndarray) -> np.ndarray:
    """Angle (B, rows) in rad of the spindle of parameter sets (B, P) along the first rows of a log,
    each from the start angle at which the hammer is farthest from the lug ahead.
    """
    forwards = np.sum(np.sign(drive.command)) >= 0.0
    farthest = with_starts(theta, -free_angle(theta[0]) if forwards else 0.0)
    return simulate(run, farthest, drive)["angle_rad"] / theta[:, [RATIO]]


def predicted_starts(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Start angles (B,) in rad from which the hammers of parameter sets (B, P) meet the anvil at
    the same time as that of the rig's model from its best angle.
    """
    turned = np.nan_to_num(_spindle_angle(run, run.search.until_contact, theta))
    free, row = free_angle(theta[0]), turned.shape[1] - 2
    share = run.search.contact_row - row
    at = (1.0 - share) * turned[:, row] + share * turned[:, row + 1]
    return np.clip(np.where(turned[:, -1] >= 0.0, -at, -free - at), -free, 0.0)


def _curvature(run: ImpactRun, theta: np.ndarray, near_rad: float) -> np.ndarray:
    """RMS (n,) of what is not proportional to the start angle in the run-up of a parameter set
    (P,), within a distance; in the units of the statistics.
    """
    beside = near_rad * np.linspace(-1.0, 1.0, STARTS.for_curvature)
    tried = with_starts(theta, _middle(theta, near_rad) + beside)
    change = np.nan_to_num(run_up_residuals(run, tried))
    design = np.stack([np.ones_like(beside), beside], axis=1)
    left = change - design @ np.linalg.lstsq(design, change, rcond=None)[0]
    found, kept = np.zeros(len(run.part)), run.is_run_up & run.judged
    found[kept] = np.sqrt((left**2).mean(axis=0)) * run.sigma[kept]
    return found


def with_deviations(run: ImpactRun, deviation: np.ndarray) -> ImpactRun:
    """The run with further independent deviations (n,) of its statistics; those that show little
    else are not judged.
    """
    sigma = np.hypot(run.sigma, deviation)
    return replace(run, sigma=np.where(deviation > MAX_SHARE * run.sigma, np.inf, sigma))


def profiled_starts(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Start angles (B,) in rad from which parameter sets (B, P) follow the run-up best."""
    limit, weight = free_angle(theta[0]), run.search.of_trials
    step = limit / STARTS.first
    tried = _Starts.beside(run, theta, predicted_starts(run, theta), step)
    found, bent = tried.best(weight), tried.is_bent()
    elsewhere = found.start_rad[:, 0] != tried.start_rad[:, 1]
    if elsewhere.any():
        everywhere = np.tile(start_angles(theta[0], STARTS.first), (int(elsewhere.sum()), 1))
        more = _Starts.of_angles(run, theta[elsewhere], everywhere)
        found = found.replaced(elsewhere, found.of(elsewhere).joined(more).best(weight))
    longest, active = np.full(len(theta), step), bent | elsewhere
    closest, finest = active & ~elsewhere, step * 0.5**STARTS.halved
    if closest.any():
        tried = found.of(closest).with_sides(run, theta[closest], finest)
        found = found.replaced(closest, tried.best(run.search.of_halves[-1]))
        longest[closest], active[closest] = STARTS.far * finest, tried.is_bent()
    for weight in run.search.of_halves:
        if not active.any():
            break
        step *= 0.5
        tried = found.of(active).with_sides(run, theta[active], step)
        found, longest[active] = found.replaced(active, tried.best(weight)), step
        active[active] = tried.is_bent()
    start = found.start_rad[:, 0]
    for spans in run.search.stages[:-1]:
        at = _SlopedStart.of(run, spans, theta, start)
        start = at.moved(at.step(longest), limit)
        longest = np.minimum(STARTS.reach * at.sigma_rad, longest)
    return _nearest_minimum(run, theta, start, longest)


def _nearest_minimum(
    run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray, longest_rad: np.ndarray
) -> np.ndarray:
    """Start angles (B,) in rad of the least Huber loss over the whole run-up of parameter sets
    (B, P), near start_rad (B,), by two Gauss-Newton steps of at most longest_rad (B,) with the
    slopes at start_rad. The steps are taken where the first one lowers the loss.
    """
    spans, limit = run.search.stages[-1], free_angle(theta[0])
    at = _SlopedStart.of(run, spans, theta, start_rad)
    first = at.step(longest_rad)
    met = replace(at, start_rad=at.moved(first, limit))
    met = replace(met, residual=span_residuals(run, spans, with_starts(theta, met.start_rad)))
    lower = _huber(met.residual) < _huber(at.residual)
    return np.where(lower, met.moved(met.step(np.abs(first)), limit), start_rad)


@dataclass(frozen=True)
class _SlopedStart:
    """A start angle in rad of each of B parameter sets (B,), the m residuals of spans of the run-up
    (B, m), and their slopes per rad (B, m).
    """

    start_rad: np.ndarray
    residual: np.ndarray
    slope: np.ndarray

    @staticmethod
    def of(
        run: ImpactRun, spans: FirstSpans, theta: np.ndarray, start_rad: np.ndarray
    ) -> "_SlopedStart":
        """The simulations of parameter sets (B, P) from start angles (B,) in rad."""
        at, beside = (
            span_residuals(run, spans, with_starts(theta, start_rad + more))
            for more in (0.0, STARTS.difference_rad)
        )
        slope = (np.nan_to_num(beside) - np.nan_to_num(at)) / STARTS.difference_rad
        return _SlopedStart(start_rad, at, slope)

    @property
    def _information(self) -> np.ndarray:
        """Weighted squared slopes (B,), 1/rad^2, under Huber's loss."""
        weight = huber_weight(np.nan_to_num(self.residual), HUBER_SIGMAS)
        return np.maximum((weight * self.slope**2).sum(axis=1), np.finfo(float).tiny)

    @property
    def sigma_rad(self) -> np.ndarray:
        """Standard deviations (B,) in rad of the angles."""
        return 1.0 / np.sqrt(self._information)

    def step(self, longest_rad: np.ndarray) -> np.ndarray:
        """Gauss-Newton step (B,) in rad under Huber's loss, of at most longest_rad (B,)."""
        residual = np.nan_to_num(self.residual)
        gradient = huber_weight(residual, HUBER_SIGMAS) * self.slope * residual
        change = -gradient.sum(axis=1) / self._information
        return np.clip(change, -longest_rad, longest_rad)

    def moved(self, step_rad: np.ndarray, limit_rad: float) -> np.ndarray:
        """Start angles (B,) after a step (B,), within the free angle limit_rad."""
        return np.clip(self.start_rad + step_rad, -limit_rad, 0.0)


@dataclass(frozen=True)
class _Starts:
    """K start angles in rad for each of B parameter sets (B, K), and the m residuals of the run-up
    that is simulated from each of them (B, K, m).
    """

    start_rad: np.ndarray
    residual: np.ndarray

    @staticmethod
    def of_angles(run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray) -> "_Starts":
        """The simulations of parameter sets (B, P) from start angles (B, K) in rad."""
        return _Starts(start_rad, _residuals_from(run, theta, start_rad))

    @staticmethod
    def beside(
        run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray, step_rad: float
    ) -> "_Starts":
        """The simulations of parameter sets (B, P) from start angles (B,) in rad and one step to
        either side of each.
        """
        angles = start_rad[:, None] + step_rad * np.array([-1.0, 0.0, 1.0])
        return _Starts.of_angles(run, theta, np.clip(angles, -free_angle(theta[0]), 0.0))

    def with_sides(self, run: ImpactRun, theta: np.ndarray, step_rad: float) -> "_Starts":
        """This one angle of each set, and one step to either side of it, in ascending order."""
        angles = self.start_rad + step_rad * BOTH
        sides = np.clip(angles, -free_angle(theta[0]), 0.0)
        both = self.joined(_Starts.of_angles(run, theta, sides))
        return _Starts(both.start_rad[:, [1, 0, 2]], both.residual[:, [1, 0, 2]])

    def is_bent(self) -> np.ndarray:
        """Of three neighbouring angles: whether the residuals of each set (B,) are not proportional
        to the angle.
        """
        left, middle, right = np.moveaxis(self.residual, 1, 0)
        half = 0.5 * (left + right) - middle
        return ~(np.sqrt(np.mean(half**2, axis=1)) <= STARTS.proportional)

    def of(self, sets: np.ndarray) -> "_Starts":
        """The angles and residuals of the parameter sets marked in `sets` (B,)."""
        return _Starts(self.start_rad[sets], self.residual[sets])

    def replaced(self, sets: np.ndarray, other: "_Starts") -> "_Starts":
        """A copy in which the parameter sets marked in `sets` (B,) have the angles and residuals of
        `other`.
        """
        start, residual = self.start_rad.copy(), self.residual.copy()
        start[sets], residual[sets] = other.start_rad, other.residual
        return _Starts(start, residual)

    def joined(self, other: "_Starts") -> "_Starts":
        """The angles of both."""
        return _Starts(
            np.concatenate([self.start_rad, other.start_rad], axis=1),
            np.concatenate([self.residual, other.residual], axis=1),
        )

    def best(self, weight: np.ndarray) -> "_Starts":
        """Of each parameter set the angle (B, 1) that follows the run-up best, under weights (m,)
        of the residuals.
        """
        return self.least(_misfit(self.residual * weight))

    def least(self, cost: np.ndarray) -> "_Starts":
        """Of each parameter set the angle (B, 1) of the least cost (B, K)."""
        at = np.argmin(cost, axis=1)[:, None]
        return _Starts(
            np.take_along_axis(self.start_rad, at, axis=1),
            np.take_along_axis(self.residual, at[..., None], axis=1),
        )


def _residuals_from(run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray) -> np.ndarray:
    """Residuals (B, K, m) of the search's first stage: each of the parameter sets (B, P) is
    simulated from its start angles (B, K) in rad.
    """
    tried = with_starts(np.repeat(theta, start_rad.shape[1], axis=0), start_rad.ravel())
    return span_residuals(run, run.search.stages[0], tried).reshape(*start_rad.shape, -1)


def _misfit(residual: np.ndarray) -> np.ndarray:
    """Sum (...) of the absolute residuals (..., m), which an effect that acts later moves little;
    infinite where the plant cannot simulate.
    """
    return np.nan_to_num(np.abs(residual), nan=np.inf).sum(axis=-1)


def _huber(residual: np.ndarray) -> np.ndarray:
    """Huber's loss (...) of residuals (..., m); infinite where the plant cannot simulate."""
    size = np.nan_to_num(np.abs(residual), nan=np.inf)
    return huber_loss(size, HUBER_SIGMAS)


def other_starts(run: ImpactRun, start_rad: np.ndarray, statistics: np.ndarray) -> np.ndarray:
    """Start angles to simulate besides the best one, of those (M,) whose statistics (M, n) are
    given: some where the end of the run depends on the start, else none.
    """
    end = run.judged & (run.row > len(run.log.time_s) // 2)
    size = np.minimum(np.std(statistics[:, end], axis=0) / run.sigma[end], MIN_CLIP_SIGMAS)
    if np.isfinite(size).any() and np.sqrt(np.nanmean(size**2)) > STARTS.max_spread:
        return start_rad[list(STARTS.spread)]
    return start_rad[:0]
