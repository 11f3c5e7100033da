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

    # over the free angle between two lugs: the first blow determines it to about a fortieth of that
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
    rounds: int = 2  # Gauss-Newton steps over the whole run-up
    difference_rad: float = 1e-3  # between the two angles that give a slope
    for_curvature: int = 7  # angles from which the curvature within a step is taken
    # distance from the best angle within which the curvature widens standard deviations, as a share
    # of the free angle; the steps end far closer
    of_sigma: int = 96


STARTS = StartRules()
BOTH = np.array([-1.0, 1.0])  # sides of an angle
EDGE_RAD = 1e-6  # from a lug: more than rounding, less than the angle is known to
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
    rig's parameters (P,); for parameter sets (B, P) those of each (B, count).
    """
    return -np.multiply.outer(free_angle(theta0), (np.arange(count) + 0.5) / count)


def free_angle(theta: np.ndarray) -> np.ndarray:
    """Angles (...) in rad that the hammer's lugs can turn between two lugs of the anvil, for
    parameters (..., P).
    """
    lugs, overlap = theta[..., PARAMETERS.index(LUGS)], theta[..., PARAMETERS.index(OVERLAP)]
    return TURN_RAD / lugs - overlap


def within(theta: np.ndarray, start_rad: np.ndarray, margin_rad: float = EDGE_RAD) -> np.ndarray:
    """Start angles (B,) or (B, K) in rad of parameter sets (B, P), moved into the free angle: at
    least a margin from either lug, on which no hammer can start.
    """
    free = free_angle(theta)
    free = free[:, None] if np.ndim(start_rad) > np.ndim(free) else free
    return np.clip(start_rad, margin_rad - free, -margin_rad)


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
    """The run whose standard deviations allow for start angles near that of a parameter set (P,).
    The later a blow, the more steeply it depends on the angle: the standard deviations of the
    run-up contain the curvature of that response near the angle.
    """
    if run.early is None:
        return run
    kept, deviation = run.is_run_up & run.judged, np.zeros(len(run.part))
    near = float(free_angle(theta)) / STARTS.of_sigma
    deviation[kept] = _curvature(run, run.all_spans, theta, near) * run.sigma[kept]
    return with_deviations(run, deviation)


def with_start_search(run: ImpactRun, theta: np.ndarray) -> ImpactRun:
    """The run with the search near the start angle of a parameter set (P,)."""
    return run if run.early is None else replace(run, search=_start_search(run, theta))


def _start_search(run: ImpactRun, theta: np.ndarray) -> StartSearch:
    """The search near the start angle of a parameter set (P,). The weights of its first stage
    contain the curvature within the step beside an angle.
    """
    row = _contact_row(run, theta)
    until = run.early.first_rows(min(int(row) + 2, len(run.early.time_s)))
    stages = tuple(run.first_spans(count) for count in _stage_spans(run, row))
    steps = float(free_angle(theta)) / STARTS.first * 0.5 ** np.arange(STARTS.halved + 1)
    curvature = [_curvature(run, stages[0], theta, step) for step in steps]
    weights = 1.0 / np.hypot(1.0, curvature)
    return StartSearch(row, until, stages, weights[0], weights[1:])


def _stage_spans(run: ImpactRun, contact_row: float) -> list[int]:
    """Numbers of first spans of the stages of the search: up to the first blows, and to the first
    judged statistic; then twice as many from the first contact on, and so on up to all.
    """
    count, contact = len(run.run_up.first), int(contact_row) // run.run_up.rows
    judged = run.window[run.is_run_up & run.judged]
    least = int(judged.min()) + 1 if len(judged) else 1
    found = [min(max(contact + STARTS.first_spans, least), count)]
    while found[-1] < count:
        longer = contact + round(STARTS.growth * (found[-1] - contact))
        found.append(min(longer, count))
    return found


def _contact_row(run: ImpactRun, theta: np.ndarray) -> float:
    """Row, between two rows, at which the hammer of a parameter set (P,) first meets the anvil: up
    to there it turns with the spindle by the angle to the lug ahead.
    """
    turned = np.nan_to_num(_spindle_angle(run, run.early, theta[None])[0])
    ahead = -theta[COLUMN] if turned[-1] >= 0.0 else float(free_angle(theta)) + theta[COLUMN]
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
    farthest = within(theta, np.full(len(theta), -np.inf if forwards else 0.0))
    return simulate(run, with_starts(theta, farthest), drive)["angle_rad"] / theta[:, [RATIO]]


def predicted_starts(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Start angles (B,) in rad from which the hammers of parameter sets (B, P) meet the anvil at
    the same time as that of the rig's model from its best angle.
    """
    turned = np.nan_to_num(_spindle_angle(run, run.search.until_contact, theta))
    free, row = free_angle(theta), turned.shape[1] - 2
    share = run.search.contact_row - row
    at = (1.0 - share) * turned[:, row] + share * turned[:, row + 1]
    return within(theta, np.where(turned[:, -1] >= 0.0, -at, -free - at))


def _curvature(run: ImpactRun, spans: FirstSpans, theta: np.ndarray, near_rad: float) -> np.ndarray:
    """RMS (m,), in standard deviations, of what is not proportional to the start angle in the
    statistics of spans, within a distance from the angle of a parameter set (P,).
    """
    beside = near_rad * np.linspace(-1.0, 1.0, STARTS.for_curvature)
    middle = within(theta[None], theta[None, COLUMN], near_rad + EDGE_RAD)
    change = np.nan_to_num(span_residuals(run, spans, with_starts(theta, middle + beside)))
    design = np.stack([np.ones_like(beside), beside], axis=1)
    left = change - design @ np.linalg.lstsq(design, change, rcond=None)[0]
    return np.sqrt((left**2).mean(axis=0))


def with_deviations(run: ImpactRun, deviation: np.ndarray) -> ImpactRun:
    """The run with further independent deviations (n,) of its statistics; those that show little
    else are not judged.
    """
    sigma = np.hypot(run.sigma, deviation)
    return replace(run, sigma=np.where(deviation > MAX_SHARE * run.sigma, np.inf, sigma))


def profiled_starts(run: ImpactRun, theta: np.ndarray) -> np.ndarray:
    """Start angles (B,) in rad from which parameter sets (B, P) follow the run-up best."""
    search, predicted = run.search, predicted_starts(run, theta)
    if not len(search.of_trials):  # no statistic of the run-up is judged
        return predicted
    step = free_angle(theta) / STARTS.first
    tried = _Starts.beside(run, theta, predicted, step)
    found, bent = tried.best(search.of_trials), tried.is_bent()
    elsewhere = found.start_rad[:, 0] != tried.start_rad[:, 1]
    if elsewhere.any():
        everywhere = start_angles(theta[elsewhere], STARTS.first)
        more = _Starts.of_angles(run, theta[elsewhere], everywhere)
        joined = found.of(elsewhere).joined(more)
        found = found.replaced(elsewhere, joined.best(search.of_trials))
    longest, active = step.copy(), bent | elsewhere
    closest, finest = active & ~elsewhere, step * 0.5**STARTS.halved
    if closest.any():
        tried = found.of(closest).with_sides(run, theta[closest], finest[closest])
        found = found.replaced(closest, tried.best(search.of_halves[-1]))
        longest[closest], active[closest] = STARTS.far * finest[closest], tried.is_bent()
    for weight in search.of_halves:
        if not active.any():
            break
        step = 0.5 * step
        tried = found.of(active).with_sides(run, theta[active], step[active])
        found = found.replaced(active, tried.best(weight))
        longest[active], active[active] = step[active], tried.is_bent()
    start = found.start_rad[:, 0]
    for spans in search.stages[:-1]:
        at = _SlopedStart.of(run, spans, theta, start)
        start = within(theta, start + at.step(longest))
        longest = np.minimum(STARTS.reach * at.sigma_rad, longest)
    return _nearest_minimum(run, theta, start, longest)


def _nearest_minimum(
    run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray, longest_rad: np.ndarray
) -> np.ndarray:
    """Start angles (B,) in rad of the least Huber loss over the whole run-up of parameter sets
    (B, P): of start_rad (B,) and those after each of STARTS.rounds Gauss-Newton steps from there
    with the slopes at start_rad, of at most longest_rad (B,).
    """
    spans = run.search.stages[-1]
    at = _SlopedStart.of(run, spans, theta, start_rad)
    angles, losses = [start_rad], [_huber(at.residual)]
    for _ in range(STARTS.rounds):
        step = at.step(longest_rad)
        longest_rad = np.abs(step)
        angles.append(within(theta, angles[-1] + step))
        residual = span_residuals(run, spans, with_starts(theta, angles[-1]))
        at = replace(at, residual=residual)
        losses.append(_huber(residual))
    best = np.argmin(losses, axis=0)
    return np.stack(angles)[best, np.arange(len(theta))]


@dataclass(frozen=True)
class _SlopedStart:
    """The m residuals of spans of the run-up, simulated from a start angle of each of B parameter
    sets (B, m), and their slopes per rad (B, m); 0 where the plant cannot simulate.
    """

    residual: np.ndarray
    slope: np.ndarray

    @staticmethod
    def of(
        run: ImpactRun, spans: FirstSpans, theta: np.ndarray, start_rad: np.ndarray
    ) -> "_SlopedStart":
        """The simulations of parameter sets (B, P) from start angles (B,) in rad."""
        apart = np.where(start_rad < -2.0 * STARTS.difference_rad, 1.0, -1.0)
        apart = STARTS.difference_rad * apart
        at, beside = (
            span_residuals(run, spans, with_starts(theta, start_rad + more))
            for more in (np.zeros(len(theta)), apart)
        )
        return _SlopedStart(at, np.nan_to_num((beside - at) / apart[:, None]))

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
        run: ImpactRun, theta: np.ndarray, start_rad: np.ndarray, step_rad: np.ndarray
    ) -> "_Starts":
        """The simulations of parameter sets (B, P) from start angles (B,) in rad and one step (B,)
        to either side of each.
        """
        angles = start_rad[:, None] + np.multiply.outer(step_rad, [-1.0, 0.0, 1.0])
        return _Starts.of_angles(run, theta, within(theta, angles))

    def with_sides(self, run: ImpactRun, theta: np.ndarray, step_rad: np.ndarray) -> "_Starts":
        """This one angle of each set, and one step (B,) to either side of it, in ascending
        order.
        """
        sides = within(theta, self.start_rad + np.multiply.outer(step_rad, BOTH))
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
