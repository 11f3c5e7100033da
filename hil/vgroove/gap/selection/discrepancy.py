"""Standard deviations that hold noise and model discrepancy together, and bootstrap blocks of a few
correlation times: what a search computes with follows from what its best fit leaves.
"""

from dataclasses import replace

import numpy as np

from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.fitting.whitening import whitening_of
from vgroove.gap.residual.agreement import noise_ratio
from vgroove.gap.selection.model_comparison import BOOTSTRAP, correlation_time, make_blocks
from vgroove.gap.selection.search_state import COMPARISON, Search, SearchCache


def rescale(search: Search) -> Search:
    """The search with the standard deviation of each signal widened where even the best fit leaves
    residuals far above the sensors' noise, as on measured machines: it then holds noise and model
    discrepancy together (Kennedy and O'Hagan, Journal of the Royal Statistical Society B 63 (2001)
    425). All known fits are converted to it, and those near the best fitted again.
    """
    other = with_present_discrepancy(search)
    if other is not search:
        refit_near_best(other)
    return other


def with_present_discrepancy(search: Search) -> Search:
    """The search with each signal's standard deviation as rescale() widens it, its fits converted;
    the search itself where none changes.

    The factor of a signal is the 95 % quantile of the best fit's absolute residuals, divided by
    that of unit noise and by far_from_noise, and at least 1.
    """
    best = min(search.fits.values(), key=lambda one: cauchy_loss(search, one))
    discrepancy = discrepancy_of(search, best)
    ratio = search.engine.discrepancy / discrepancy
    if np.all(np.abs(ratio - 1.0) < COMPARISON.same_discrepancy):
        return search
    engine = search.engine.with_discrepancy(discrepancy)
    for one in {id(f): f for f in (search.nominal, search.retuned, *search.fits.values())}.values():
        engine.rescale_fit(one, ratio)
    return replace(search, engine=engine, cache=SearchCache(search.fits))


def refit_near_best(search: Search) -> None:
    """Bring the retuned fit and the sets near the best to convergence under the standard deviations
    of the search, and predict their held-out rows. A fit that ended under others is no minimum: any
    set that is fitted later would gain on it what the refit gains.
    """
    found = [f for f in search.fits.values() if f is not search.retuned]
    near = [search.retuned, *search.near_best(found)] if found else [search.retuned]
    near = [f for f in near if len(f.x)]
    for one in near:
        one.improving, one.exact = True, False
    search.engine.continue_fits(near, range(COMPARISON.max_rounds))
    closest = {id(f) for f in search.near_best(near)} if near else set()
    predict_held_out(search.engine, [f for f in near if f is search.retuned or id(f) in closest])


def whitened(search: Search) -> Search:
    """The search on prewhitened residuals: each signal of each log is filtered by the prediction
    error filter of what the best fit leaves, and sets near the best are fitted again. The search
    itself where the best fit ends near the sensors' noise, or where residuals are white as loaded.
    """
    if search.problem.is_whitened or np.all(search.engine.discrepancy == 1.0):
        return search
    search.progress("residuals without correlation in time")
    engine, problem = search.engine, search.problem
    best = min(search.fits.values(), key=search.score)
    counts = search.blocks.tested & ~problem.censored
    series = tuple(rows[counts[rows]] for rows in search.blocks.series)
    clip = COMPARISON.clip_sigma
    whitening = whitening_of(series, np.clip(best.out_of_fold, -clip, clip))
    fits = {k: engine.whitened_fit(whitening, f) for k, f in search.fits.items()}
    nominal = engine.whitened_fit(whitening, search.nominal)
    retuned = fits[()]
    other = replace(
        search,
        engine=engine.with_whitening(whitening),
        nominal=nominal,
        retuned=retuned,
        cache=SearchCache(fits),
        unwhitened=search,
    )
    other = with_present_discrepancy(other)
    refit_near_best(other)
    return rescale(other)


def cauchy_loss(search: Search, one: Fit) -> float:
    """Mean negative logarithm of Cauchy's density at the held-out residuals: a loss without a clip,
    which ranks fits whose residuals are all far from the noise.
    """
    return float(np.mean(np.log1p(one.out_of_fold[search.blocks.tested] ** 2)))


def discrepancy_of(search: Search, best: Fit) -> np.ndarray:
    """Factors (n,) by which the sensors' standard deviations are multiplied so that they cover what
    a fit leaves of each signal; all residuals of a signal have the same factor.
    """
    problem = search.problem
    size = np.abs(best.out_of_fold * search.engine.discrepancy)
    counts = search.blocks.tested & ~problem.censored
    out = np.ones(problem.n)
    for k in range(len(problem.signals)):
        mine = problem.signal == k
        out[mine] = max(1.0, noise_ratio(size[mine & counts]) / COMPARISON.far_from_noise)
    return out


def reblock(search: Search) -> Search:
    """The search with bootstrap blocks of a few correlation times of the best fit's residual."""
    problem, best = search.problem, min(search.fits.values(), key=search.score)
    group = problem.log * len(problem.signals) + problem.signal
    correlated_s = correlation_time(best.residual, problem.time_s, group, problem.restart_s)
    length = min(
        max(BOOTSTRAP.min_block_s, COMPARISON.block_correlation_times * correlated_s),
        COMPARISON.max_block_restarts * problem.restart_s,
    )
    return replace(search, blocks=make_blocks(problem, search.blocks.tested, length, search.seed))
