"""Gap of one column of two logs, and its explanation: equal, quantisation, timing, or other."""

from dataclasses import dataclass

import numpy as np

from vgroove.log_compare.limits import BRIDGE_COMMAND, DISCRETE, Limits

EQUAL, QUANTISATION, TIMING, PARTLY, OTHER = (
    "equal",
    "quantisation",
    "timing",
    "timing in part",
    "other",
)


@dataclass(frozen=True)
class SignalGap:
    """Gap of one column, B minus A, in the column's unit.

    `resolution`: the mean of the two logs' resolutions, 0 for values on no grid; `largest`, `rms`:
    over the rows with both values; `rms_aligned`: after the time map (None for discrete columns);
    `missing`: rows with a value in one log only; `worst_shift_s`: of discrete columns whose values
    follow each other in the same order, the largest time between two equal changes.
    """

    name: str
    rows: int
    differing: int
    missing: int
    first_s: float | None
    first_a: float | None
    first_b: float | None
    largest: float
    rms: float
    resolution: float
    rms_aligned: float | None
    worst_shift_s: float | None
    explanation: str


def differs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Where two columns (n,) differ; two missing samples are equal."""
    return (a != b) & ~(np.isnan(a) & np.isnan(b))


def resolution(values: np.ndarray, limits: Limits, near_share: float) -> float:
    """Step of the grid on which all values (n,) lie; 0 where there is none, or where fewer than
    `least_values` different ones show it whose step exceeds near_share of the largest value.
    """
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    scale = float(np.nanmax(np.abs(values), initial=0.0))
    steps = steps[steps > 1e-9 * scale]
    if not len(steps):
        return 0.0
    if len(steps) + 1 < limits.least_values and steps.min() > near_share * scale:
        return 0.0
    ratio = steps / steps.min()
    off = np.abs(ratio - np.round(ratio))
    return float(steps.min()) if (off < limits.grid_tolerance).all() else 0.0


def changes(time_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a column at its first sample and wherever it changes."""
    known = np.isfinite(values)
    time_s, values = time_s[known], values[known]
    if not len(values):
        return time_s, values
    at = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    return time_s[at], values[at]


def worst_shift(time_s: np.ndarray, a: np.ndarray, b: np.ndarray) -> float | None:
    """The largest time in s between the same changes of two discrete columns (n,); None where
    their values follow each other in another order.
    """
    (time_a, values_a), (time_b, values_b) = changes(time_s, a), changes(time_s, b)
    if len(values_a) != len(values_b) or (values_a != values_b).any():
        return None
    return float(np.max(np.abs(time_b - time_a), initial=0.0))


@dataclass(frozen=True)
class ColumnPair:
    """One column of both logs at paired rows (n,); `aligned` (n,): log B at the mapped times."""

    name: str
    time_s: np.ndarray
    a: np.ndarray
    b: np.ndarray
    aligned: np.ndarray | None


def signal_gap(pair: ColumnPair, limits: Limits) -> SignalGap:
    """Gap of a column and its explanation."""
    name, time_s, a, b, aligned = pair.name, pair.time_s, pair.a, pair.b, pair.aligned
    different = differs(a, b)
    both = np.isfinite(a) & np.isfinite(b)
    gap = np.where(both, b - a, 0.0)
    first = int(np.argmax(different)) if different.any() else None
    near_share = 0.0 if name in BRIDGE_COMMAND else limits.near_share
    steps = [resolution(values, limits, near_share) for values in (a, b)]
    step = sum(steps) / max(1, np.count_nonzero(steps))
    discrete = name in DISCRETE
    rms = _rms(gap[both])
    rms_aligned = None if discrete or aligned is None else _rms(_finite(aligned - a))
    shift_s = worst_shift(time_s, a, b) if discrete else None
    found = SignalGap(
        name=name,
        rows=int(both.sum()),
        differing=int(different.sum()),
        missing=int((np.isfinite(a) != np.isfinite(b)).sum()),
        first_s=None if first is None else float(time_s[first]),
        first_a=None if first is None else float(a[first]),
        first_b=None if first is None else float(b[first]),
        largest=float(np.max(np.abs(gap), initial=0.0)),
        rms=rms,
        resolution=step,
        rms_aligned=rms_aligned,
        worst_shift_s=shift_s,
        explanation="",
    )
    return SignalGap(**{**vars(found), "explanation": _explanation(found, discrete, limits)})


def _explanation(gap: SignalGap, discrete: bool, limits: Limits) -> str:
    if gap.differing == 0:
        return EQUAL
    if gap.missing:
        return OTHER
    if discrete:
        timing = gap.worst_shift_s is not None and gap.worst_shift_s <= limits.max_shift_s
        return TIMING if timing else OTHER
    if gap.largest <= gap.resolution * (1.0 + 1e-6):
        return QUANTISATION
    if gap.rms_aligned is None or gap.rms == 0.0:
        return OTHER
    removed = 1.0 - (gap.rms_aligned / gap.rms) ** 2
    if removed >= limits.timing_share:
        return TIMING
    return PARTLY if removed >= limits.partly_share else OTHER


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
