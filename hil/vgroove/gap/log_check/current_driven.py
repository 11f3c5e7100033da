"""Factors between the columns of a log that a current drives and the nominal model of its rig.

A simulation that a current drives adds up every error of its friction, so that it cannot be
compared with the log row by row. The rig's acceleration per current, k / J, can: the changes of the
measured speed w over spans of rows are, by least squares, a k / J times the integral of the
current, and coefficients times those of sign(w), w, the known load and 1, which stand for the
friction and an offset. A missing sample removes the span that holds it. The coefficient a is 1 for
a log in the expected units, the factor of a speed or an angle in another unit, and the inverse of
that of the current.
"""

from dataclasses import dataclass

import numpy as np

from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.log import Log
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM


@dataclass(frozen=True)
class AccelerationRules:
    """When the factor of a column is determined (values chosen; checked on the current-driven logs
    of tests/data and of the blind set).
    """

    spans: tuple[int, ...] = (1, 4, 16, 64)  # rows of a span; the one that explains most is used
    min_spans: int = 60
    min_explained: float = 0.8  # share of the variance of the changes of the speed
    max_error: float = 0.1  # standard error over the factor
    still: float = 0.02  # of the greatest speed, below which the sign of the speed is 0


RULES = AccelerationRules()
LOADS = ("none", "torque")  # whose torque is known without the angle


def acceleration_factors(log: Log, rig: Rig) -> dict[str, float]:
    """The factor a of each column of motion that determines it; none for another input or load."""
    if rig.input["kind"] != "current_a" or rig.load["kind"] not in LOADS:
        return {}
    found = {c: _factor(log, rig, c) for c in ("speed_rpm", "position_rad") if c in log.columns}
    return {column: factor for column, factor in found.items() if factor is not None}


def _factor(log: Log, rig: Rig, column: str) -> float | None:
    time_s = np.asarray(log.time_s, float)
    values = np.asarray(log.columns[column], float)
    fits = []
    for span in RULES.spans:
        if len(time_s) // span < RULES.min_spans:
            break
        speed = values * RAD_S_PER_RPM
        if column == "position_rad":
            speed = np.convolve(np.gradient(values, time_s), np.ones(span) / span, "same")
        fits.append(_fitted(log, time_s, speed, span))
    explained, slope, error = max(fits, default=(0.0, 0.0, np.inf))
    if explained < RULES.min_explained or not error < RULES.max_error * abs(slope):
        return None
    return slope / (rig.motor["torque_constant_nm_per_a"] / rig.shaft_inertia_kg_m2)


def _fitted(
    log: Log, time_s: np.ndarray, speed: np.ndarray, span: int
) -> tuple[float, float, float]:
    """Share of the variance that is explained, acceleration per current and its standard error, of
    the speed (rows,) over spans of so many rows; share 0 where too few spans are known.
    """
    top = np.nanmax(np.abs(speed), initial=0.0)
    moving = np.sign(speed) * (np.abs(speed) > RULES.still * top)
    load = _held(np.asarray(log.columns.get("load_nm", np.zeros(len(time_s))), float))
    terms = (_held(np.asarray(log.columns["current_a"], float)), moving, speed)
    ends = np.arange(0, len(time_s), span)
    columns = [_integrals(term, time_s, ends) for term in (*terms, load, np.ones(len(time_s)))]
    regressors, changes = np.stack(columns, 1), np.diff(speed[ends])
    known = np.isfinite(regressors).all(1) & np.isfinite(changes)
    regressors, changes = regressors[known], changes[known]
    total = float(np.sum((changes - changes.mean()) ** 2)) if len(changes) else 0.0
    if len(changes) < RULES.min_spans or total == 0.0:
        return 0.0, 0.0, np.inf
    fit = np.linalg.lstsq(regressors, changes, rcond=None)[0]
    left = float(np.sum((changes - regressors @ fit) ** 2))
    covariance = np.linalg.pinv(regressors.T @ regressors) * left / len(changes)
    return 1.0 - left / total, float(fit[0]), float(np.sqrt(max(covariance[0, 0], 0.0)))


def _held(values: np.ndarray) -> np.ndarray:
    """A column (rows,) that may be sampled more slowly than the log: each value holds for as many
    further rows as values are usually apart; nan after that and before the first one.
    """
    rows, known = np.arange(len(values)), np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return values
    since = rows - known[np.maximum(np.searchsorted(known, rows, side="right") - 1, 0)]
    recent = (since >= 0) & (since <= np.median(np.diff(known)))
    return np.where(recent, hold_last_value(values), np.nan)


def _integrals(values: np.ndarray, time_s: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Integrals (spans,) of values (rows,) from each of the rows `ends` to the next, by the
    trapezoidal rule; nan for a span in which a value is missing.
    """
    parts = 0.5 * (values[1:] + values[:-1]) * np.diff(time_s)
    return np.add.reduceat(parts[: ends[-1]], ends[:-1])
