"""The figures of the gap: before, retuned and after, the closed share, and all per signal."""

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.intervals import Estimate
from vgroove.gap.selection.model_comparison import (
    BOOTSTRAP,
    Blocks,
    block_sums,
    make_blocks,
    small_sample_factor,
)
from vgroove.gap.selection.search_state import Search
from vgroove.gap.verdict.schema import Gap, SignalGap

MIN_GAP = 0.1  # gap above the floor below which no share is stated (docs/spec/gap.md, section 5)
MIN_SAMPLE_GAP = 1e-6  # of a bootstrap sample: avoids a division by 0
QUANTILES_95 = (0.025, 0.975)


def closed_share(before: float, after: float, floor: float) -> float | None:
    """Share 0..1 of a gap above the floor that is closed; None where the gap is below MIN_GAP."""
    if before - floor < MIN_GAP:
        return None
    return float(np.clip((before - after) / (before - floor), 0.0, 1.0))


def gap_figures(search: Search, shown: Fit, estimated: Estimate) -> Gap:
    """All figures of the gap; shown: the fit whose gap is reported as `after`, estimated: the fit
    to all rows whose values the corrected rig holds.
    """
    problem, floor = search.simulated, search.floor
    before, retuned, after = (
        search.reported_gap(f) for f in (search.nominal, search.retuned, shown)
    )
    return Gap(
        before=before,
        retuned=retuned,
        after=after,
        refit=refit_gap(search, estimated),
        floor=floor,
        closed=closed_share(before, after, floor),
        closed_ci95=closed_interval(search, shown),
        closed_by_retuning=closed_share(before, retuned, floor),
        closed_beyond_retuning=closed_share(retuned, after, floor),
        restart_s=float(problem.restart_s),
        held_out_s=[[[float(a), float(b)] for a, b in log] for log in problem.held_out_s],
        by_signal=signal_gaps(search, shown),
    )


def refit_gap(search: Search, estimated: Estimate) -> float:
    """Gap over the judged rows of the fit to all rows."""
    problem = search.simulated
    theta = estimated.fit.theta(problem.theta0)
    angles = search.engine.angles if problem is search.problem else None
    return float(problem.gap(problem.residuals(theta, angles)[0]))


def closed_interval(search: Search, shown: Fit) -> list[float] | None:
    """95 % block-bootstrap interval of the closed share over the judged rows, widened for few
    blocks by small_sample_factor(); residuals are clipped as in the reported gap.
    """
    problem, floor = search.simulated, search.floor
    closed = closed_share(search.reported_gap(search.nominal), search.reported_gap(shown), floor)
    if closed is None:
        return None
    blocks = make_blocks(problem, problem.judged, search.blocks.length_s, search.seed)
    if blocks.count < BOOTSTRAP.min_count:
        return [0.0, 1.0]
    before, after = (
        np.sqrt(_drawn_means(blocks, problem.squared(search.gap_residual(f))))
        for f in (search.nominal, shown)
    )
    share = np.clip((before - after) / np.maximum(before - floor, MIN_SAMPLE_GAP), 0.0, 1.0)
    wider = small_sample_factor(blocks.count, 0.95)
    low, high = closed + wider * (np.quantile(share, QUANTILES_95) - closed)
    return [max(0.0, min(float(low), closed)), min(1.0, max(float(high), closed))]


def _drawn_means(blocks: Blocks, squared: np.ndarray) -> np.ndarray:
    """Mean (draws,) of squares (n,) over the rows of each bootstrap sample that count: a respected
    bound is nan.
    """
    sums, counts = (
        blocks.draws @ block_sums(blocks, values)
        for values in (np.nan_to_num(squared), np.isfinite(squared).astype(float))
    )
    return sums / np.maximum(counts, 1.0)


def signal_gaps(search: Search, shown: Fit) -> dict[str, SignalGap]:
    """Gap of each judged signal in its unit, not clipped, and its ISO/TS 18571 ratings."""
    problem = search.simulated
    residuals = [search.gap_residual(f) for f in (search.nominal, search.retuned, shown)]
    errors = [problem.gap_by_signal(r, problem.judged) for r in residuals]
    floors, sizes = problem.floor_by_signal(problem.judged), problem.rms_by_signal()
    ratings = [problem.iso18571(r, problem.judged) for r in (residuals[0], residuals[2])]
    found = {}
    for signal, clip in zip(problem.signals, problem.clip, strict=True):
        column = signal.column
        before, retuned, after = (error[column] for error in errors)
        floor, size = floors[column], sizes[column]
        found[column] = SignalGap(
            signal.unit,
            before,
            retuned,
            after,
            floor,
            *(rating.get(column) for rating in ratings),
            clip=float(clip),
            closed=closed_share(before / floor, after / floor, 1.0) if floor > 0.0 else None,
            rms=size,
            before_share=before / size if size > 0.0 else None,
            after_share=after / size if size > 0.0 else None,
        )
    return found
