"""Reduces long logs to a number of rows that a diagnosis can judge: stretches that excite the tool
differently are kept whole, the rest is thinned.

A thinned row stands for an interval of rows and holds no value, so that it is not judged. The model
skips it: only the states that no restart sets go on there, from the first row of the log to the
last. Heat and charge follow the means of the measured current over the interval, cold grease the
time. Without a measured current heat and charge stay as they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.log import Log, current_is_unsigned
from vgroove.rig import Rig

# columns of a reduced log that hold values in thinned rows alone, means over the interval: the
# square of the current, A^2, and the current that the bus delivers, A
SQUARE_A2, BUS_A = "thinned_square_a2", "thinned_bus_a"
EXCITATION = ("duty", "voltage_v", "current_a", "speed_rpm", "load_nm")


@dataclass(frozen=True)
class ReductionLimits:
    """When logs are reduced, and to what."""

    # rows of all logs of a diagnosis together: with as many, one of 5 million rows takes about 60 s
    # of processor time and less than 1 GiB (measured by tests/proof/gap_long_log.py)
    max_rows: int = 40_000
    thinned_share: float = 0.05  # share of these rows that are thinned ones (chosen)
    # s that a thinned row stands for at least; well below the time constants of the slow states,
    # 10 s and more (chosen)
    interval_s: float = 1.0
    # s; four blocks of the cross-validation, so that every stretch has a part in each fold
    stretch_s: float = 4.0
    # fewest stretches that the rows suffice for: those of a fast logger are shorter than stretch_s
    min_stretches: int = 8
    # most stretches that are chosen: those of a slow logger are longer than stretch_s
    max_stretches: int = 64
    # quantiles of a stretch that count as its lowest and its highest value: a short motion lies
    # within them, a spike beyond (chosen)
    low: float = 0.01
    high: float = 0.99
    # distance of two equal stretches at both ends of the log, where 1 is the whole span of a
    # column: it spreads stretches of equal excitation over heat and charge (chosen)
    time_weight: float = 0.5


LIMITS = ReductionLimits()


def reduce_long_logs(logs: Sequence[Log], rig: Rig, max_rows: int = LIMITS.max_rows) -> list[Log]:
    """The logs; where they have more than max_rows rows together, the longest of them are reduced
    and say so in a warning. A reduced log stays as it is.
    """
    limit = rows_each([len(log.time_s) for log in logs], max_rows)
    return [
        reduce_log(log, rig, limit)
        if len(log.time_s) > limit and SQUARE_A2 not in log.columns
        else log
        for log in logs
    ]


def rows_each(lengths: Sequence[int], max_rows: int) -> int:
    """Number of rows to which each log is limited so that logs of these lengths have at most
    max_rows together.
    """
    left, limit = max_rows, max(lengths)
    for done, length in enumerate(sorted(lengths)):
        share = left // (len(lengths) - done)
        if length > share:
            return share
        left -= length
    return limit


def is_thinned(columns: Mapping[str, np.ndarray], rows: int) -> np.ndarray:
    """Mask (rows,) of the thinned rows of a log with these columns."""
    return np.isfinite(columns[SQUARE_A2]) if SQUARE_A2 in columns else np.zeros(rows, bool)


def without_thinned(time_s: np.ndarray, thinned: np.ndarray) -> np.ndarray:
    """Times (n,), s, on which the interval of a thinned row (mask (n,)) is a usual one: the rows
    that it stands for were not lost.
    """
    steps = np.diff(time_s)
    return time_s - np.append(0.0, np.cumsum(np.where(thinned[1:], steps - np.median(steps), 0.0)))


def reduce_log(log: Log, rig: Rig, limit: int) -> Log:
    """The log with about `limit` rows: its first stretch, those that differ most from one another,
    and thinned rows in between.
    """
    time_s = np.asarray(log.time_s, dtype=float)
    thin = int(LIMITS.thinned_share * limit)
    length = _rows_of_a_stretch(time_s, limit)
    chosen = farthest_first(stretch_features(log, length), max(1, (limit - thin) // length))
    whole = np.zeros(len(time_s), bool)
    for k in chosen:
        whole[k * length : (k + 1) * length] = True
    interval_s = max(LIMITS.interval_s, float(time_s[-1] - time_s[0]) / thin)
    row = _kept_rows(whole, max(1, round(interval_s / float(np.median(np.diff(time_s))))))
    columns = {
        name: np.where(whole[row], np.asarray(values, dtype=float)[row], np.nan)
        for name, values in log.columns.items()
    }
    for name, values in zip((SQUARE_A2, BUS_A), _drives_of_slow_states(log, rig), strict=True):
        columns[name] = np.where(whole[row], np.nan, _means(values, row))
    return replace(
        log,
        time_s=time_s[row],
        columns=columns,
        warnings=[*log.warnings, _warning(log, whole, len(chosen))],
    )


def _warning(log: Log, whole: np.ndarray, stretches: int) -> str:
    return (
        f"{log.source}: {np.count_nonzero(whole)} of {len(whole)} rows are judged, in {stretches} "
        "stretches that excite the tool differently; of the rest only heat and charge are followed "
        "(--from and --to choose other rows)"
    )


def _drives_of_slow_states(log: Log, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Square of the measured current (n,), A^2, and the current that the bus delivers (n,), A;
    zeros without a measured current. One without sign is taken to have that of the duty, as it has
    except while the drive brakes.
    """
    if "current_a" not in log.columns:
        return np.zeros(len(log.time_s)), np.zeros(len(log.time_s))
    current = hold_last_value(np.asarray(log.columns["current_a"], dtype=float))
    if rig.input["kind"] != "duty":
        return np.square(current), np.zeros(len(current))
    duty = hold_last_value(np.asarray(log.columns["duty"], float))
    delivered = np.abs(current * duty) if current_is_unsigned(log) else current * duty
    return np.square(current), delivered


def _means(values: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Means (m,) of a column (n,) over the rows up to each of last (m,), since the one before."""
    total = np.cumsum(values)[last]
    return np.diff(total, prepend=0.0) / np.diff(last, prepend=-1)


def _rows_of_a_stretch(time_s: np.ndarray, limit: int) -> int:
    """Length of the stretches of a log with rows at time_s (n,), in rows."""
    usual = LIMITS.stretch_s / float(np.median(np.diff(time_s)))
    return int(np.clip(usual, limit / LIMITS.max_stretches, limit / LIMITS.min_stretches))


def stretch_features(log: Log, length: int) -> np.ndarray:
    """Features (stretches, features) of the successive stretches of `length` rows of a log: mean,
    standard deviation, lowest and highest value of each column of EXCITATION in units of the
    column's span, so that noise alone gives no distance; the RMS change of the command from row to
    row, in units of the largest; and the position in the log.
    """
    count = len(log.time_s) // length
    found = [LIMITS.time_weight * np.linspace(0.0, 1.0, count)]
    for name, values in _excitation(log).items():
        parts = _in_stretches(values, length)
        low, high = np.quantile(parts, (LIMITS.low, LIMITS.high), axis=1)
        columns = [parts.mean(axis=1), parts.std(axis=1), low, high]
        span = float(high.max() - low.min())
        if name in ("duty", "voltage_v"):
            rate = np.sqrt(np.mean(np.diff(parts, axis=1) ** 2, axis=1))
            found.append(rate / max(float(rate.max()), np.finfo(float).tiny))
        found += [column / span for column in columns if span > 0.0]
    return np.stack(found, axis=1)


def _excitation(log: Log) -> dict[str, np.ndarray]:
    """Columns (n,) without missing samples that show how a log excites the tool."""
    found = {
        name: hold_last_value(np.asarray(log.columns[name], dtype=float))
        for name in EXCITATION
        if name in log.columns
    }
    if "speed_rpm" not in found and "position_rad" in log.columns:
        position = hold_last_value(np.asarray(log.columns["position_rad"], dtype=float))
        found["speed_rpm"] = np.gradient(position, np.asarray(log.time_s, dtype=float))
    return found


def _in_stretches(values: np.ndarray, length: int) -> np.ndarray:
    """A column (n,) as (stretches, length), without a shorter one at its end."""
    return values[: len(values) // length * length].reshape(-1, length)


def farthest_first(features: np.ndarray, count: int) -> np.ndarray:
    """Indices (count,) or less of rows of features (stretches, f): the first one, then always the
    one that is farthest from all before it (k-centre clustering: Gonzalez, Theoretical Computer
    Science 38, 1985).
    """
    chosen = [0]
    distance = np.linalg.norm(features - features[0], axis=1)
    while len(chosen) < min(count, len(features)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(features - features[chosen[-1]], axis=1))
    return np.array(chosen)


def _kept_rows(whole: np.ndarray, interval: int) -> np.ndarray:
    """Rows (m,) that are kept: those of the mask `whole` (n,), and of the others the last one of
    every `interval` rows.
    """
    borders = np.flatnonzero(np.diff(whole, prepend=~whole[:1]))
    kept = []
    for begin, end in zip(borders, [*borders[1:], len(whole)], strict=True):
        if whole[begin]:
            kept.append(np.arange(begin, end))
        else:
            kept.append(np.append(np.arange(begin + interval - 1, end - 1, interval), end - 1))
    return np.concatenate(kept)
