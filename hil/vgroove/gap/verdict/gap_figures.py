"""The figures of the gap: before, retuned and after, the closed share, and all per signal."""

import numpy as np

from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.model_comparison import (
    block_sums,
    bootstrap_means,
    clipped_squares,
    make_blocks,
)
from vgroove.gap.selection.search_state import COMPARISON, Search, reported_gap
from vgroove.gap.verdict.schema import Gap, SignalGap

MIN_GAP = 0.1  # gap above the floor below which no share is stated (docs/spec/gap.md, section 5)
MIN_SAMPLE_GAP = 1e-6  # of a bootstrap sample: avoids a division by 0
QUANTILES_95 = (0.025, 0.975)


def closed_share(before: float, after: float, floor: float) -> float | None:
    """Share 0..1 of a gap above the floor that is closed; None where the gap is below MIN_GAP."""
    if before - floor < MIN_GAP:
        return None
    return float(np.clip((before - after) / (before - floor), 0.0, 1.0))


def gap_figures(search: Search, shown: Fit) -> Gap:
    """All figures of the gap; shown: the fit whose gap is reported as `after`."""
    problem, floor = search.problem, search.floor
    before, retuned, after = (
        reported_gap(problem, f) for f in (search.nominal, search.retuned, shown)
    )
    return Gap(
        before=before,
        retuned=retuned,
        after=after,
        floor=floor,
        closed=closed_share(before, after, floor),
        closed_ci95=closed_interval(search, shown),
        closed_by_retuning=closed_share(before, retuned, floor),
        closed_beyond_retuning=closed_share(retuned, after, floor),
        restart_s=float(problem.restart_s),
        held_out_s=[[[float(a), float(b)] for a, b in log] for log in problem.held_out_s],
        by_signal=signal_gaps(search, shown),
    )


def closed_interval(search: Search, shown: Fit) -> list[float] | None:
    """95 % block-bootstrap interval of the closed share over the judged rows; residuals are clipped
    as in the reported gap, also where the search has widened its clip.
    """
    problem, floor = search.problem, search.floor
    if reported_gap(problem, search.nominal) - floor < MIN_GAP:
        return None
    blocks = make_blocks(problem, problem.judged, search.blocks.length_s, search.seed)
    before, after = (
        np.sqrt(
            bootstrap_means(blocks, block_sums(blocks, clipped_squares(f, COMPARISON.clip_sigma)))
        )
        for f in (search.nominal, shown)
    )
    share = (before - after) / np.maximum(before - floor, MIN_SAMPLE_GAP)
    return [float(q) for q in np.quantile(np.clip(share, 0.0, 1.0), QUANTILES_95)]


def signal_gaps(search: Search, shown: Fit) -> dict[str, SignalGap]:
    """Gap of each judged signal in its unit, and its ISO/TS 18571 ratings."""
    problem = search.problem
    before, retuned, after = (
        problem.gap_by_signal(f.out_of_fold, problem.judged)
        for f in (search.nominal, search.retuned, shown)
    )
    floors = problem.floor_by_signal(problem.judged)
    rated, rated_after = (
        problem.iso18571(f.out_of_fold, problem.judged) for f in (search.nominal, shown)
    )
    return {
        s.column: SignalGap(
            s.unit,
            before[s.column],
            retuned[s.column],
            after[s.column],
            floors[s.column],
            rated.get(s.column),
            rated_after.get(s.column),
        )
        for s in problem.signals
        if s.column in before
    }
