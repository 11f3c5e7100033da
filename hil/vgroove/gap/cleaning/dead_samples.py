"""Recognises samples that a sensor or a link did not deliver though a number stands there: dropped
to zero, or frozen at an old value.

They are taken as missing. Nothing is done to a value that a tool could show: a current is 0 where
the bridge is open, a Hall speed after its time-out, a clipped sensor stands at its limit, and a
quiet one repeats itself while nothing else moves.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.gap.cleaning.sensor_noise import high_frequency_sigma
from vgroove.rig import Rig

MEASURED = ("current_a", "supply_v", "speed_rpm", "position_rad")
# times the column's usual changes by which both neighbours of a dropped sample must stand off zero
FAR = 4.0
USUAL = 0.9  # quantile of a column's changes that is usual
# usual changes that make a spike; share of its span the command may move; share of rows
SPIKE, STILL, MANY = 20.0, 0.02, 0.02
BESIDE = 3  # rows on each side that must agree that a value of zero is none
FEWEST_FROZEN = 20  # rows that a column repeats itself before it may be frozen
CHANCE = 1e-4  # expected number of such repeats in a log by chance
PARTS = 5  # into which a stretch is cut to see whether another column moves in it
MOVES = 0.1  # of a column's span, by which another moves while this one stands still
PITCHES = 3.0  # edges that a speed must leave in a time-out before it cannot be one
# of a rig that names none, shorter than measured.py assumes: the doubt is the sensor's
SHORT_TIMEOUT_S = 0.05


def remove_dead_samples(log: Any, rig: Rig) -> Any:
    """The log with dead samples as nan and a warning for each column that had any; VgrooveError
    where no measured column ever changes.
    """
    columns = {name: np.asarray(values, dtype=float) for name, values in log.columns.items()}
    _refuse_lifeless(columns, rig, str(getattr(log, "source", "log")))
    time_s, mask = np.asarray(log.time_s, dtype=float), {}
    stopped = np.zeros(len(time_s), bool)
    for name in (n for n in MEASURED[:3] if n in columns and n != rig.input["kind"]):
        mask[name] = dropped(columns, name, rig), frozen(time_s, columns, name, rig, stopped)
        stopped = stopped | mask[name][1]
    found = {name: masks for name, masks in mask.items() if np.any(masks)}
    if not found:
        return log
    words = [
        f"{name}: {int(zero.sum())} dropped to 0 or spikes, {int(still.sum())} frozen"
        for name, (zero, still) in found.items()
    ]
    cleaned = columns | {
        name: np.where(zero | still, np.nan, columns[name]) for name, (zero, still) in found.items()
    }
    told = (
        f"{log.source}: samples that no sensor would show are taken as missing: {'; '.join(words)}"
    )
    return replace(log, columns=cleaned, warnings=[*log.warnings, told])


def _refuse_lifeless(columns: dict[str, np.ndarray], rig: Rig, source: str) -> None:
    """Nothing can be said about a tool of which every sensor shows one number."""
    seen = [
        columns[name]
        for name in MEASURED
        if name in columns and name != rig.input["kind"] and np.isfinite(columns[name]).any()
    ]
    if seen and all(np.nanmax(v) == np.nanmin(v) for v in seen):
        raise VgrooveError(
            f"{source}: no measured column changes: the log shows a tool at rest, or dead sensors"
        )


def driven(columns: dict[str, np.ndarray], rig: Rig) -> np.ndarray:
    """Rows (n,) in which the bridge drives, neither open nor shorted: a current of exactly 0 says
    nothing elsewhere.
    """
    command = columns.get(rig.input["kind"])
    known = (
        hold_last_value(command) != 0.0
        if command is not None
        else np.ones(len(next(iter(columns.values()))), bool)
    )
    return known & (hold_last_value(columns["coast"]) == 0.0) if "coast" in columns else known


def usual_change(values: np.ndarray) -> float:
    """Change from sample to sample that is usual in a column (n,): noise, and what the tool does."""
    return float(np.quantile(np.abs(np.diff(values)), USUAL)) if len(values) > 1 else 0.0


def dropped(columns: dict[str, np.ndarray], name: str, rig: Rig) -> np.ndarray:
    """Samples (n,) of exactly 0 between samples that stand far off it, as no motor, battery or edge
    counter gives them: between such of one sign, or a long run of zeros while the bridge drives.
    Few of them beyond what noise does must be spikes.
    """
    values, out = columns[name], spiked(columns, name, rig)
    rows = np.flatnonzero(np.isfinite(values))
    live, zero = rows[values[rows] != 0.0], rows[values[rows] == 0.0]
    if len(live) < 2 * BESIDE or not len(zero):
        return out
    least = max(FAR * usual_change(values[live]), _slowest_rpm(rig) if name == "speed_rpm" else 0.0)
    at = np.searchsorted(live, zero)
    inner = (at >= BESIDE) & (at <= len(live) - BESIDE)
    zero, at = zero[inner], at[inner]
    around = np.stack([values[live[at + k]] for k in range(-BESIDE, BESIDE)])
    run = live[at] - live[at - 1] - 1  # zeros in a row
    long_run = run >= FEWEST_FROZEN
    one_sign = np.abs(np.sign(around).sum(axis=0)) == 2 * BESIDE
    wrong = (np.abs(around) > least).all(axis=0) & (one_sign | (long_run & (name == "current_a")))
    if name == "current_a":
        wrong &= driven(columns, rig)[zero] | (run <= BESIDE)
    out[zero[wrong]] = True
    return out


def spiked(columns: dict[str, np.ndarray], name: str, rig: Rig) -> np.ndarray:
    """Single samples (n,) of current or bus far off their neighbours, which agree, while the
    command holds still: a disturbed conversion. Where there are many, something makes them.
    """
    values, command = columns[name], columns.get(rig.input["kind"])
    out = np.zeros(len(values), bool)
    if name == "speed_rpm" or command is None or len(values) < 4 * BESIDE:
        return out
    whole, limit = (
        hold_last_value(values),
        SPIKE * max(usual_change(values[np.isfinite(values)]), 1e-12),
    )
    around = np.lib.stride_tricks.sliding_window_view(np.pad(whole, 2, mode="edge"), 5)[
        :, [0, 1, 3, 4]
    ]
    far = np.abs(whole - np.median(around, axis=1)) > limit
    still = maximum_filter1d(hold_last_value(command), 7) - minimum_filter1d(
        hold_last_value(command), 7
    ) <= STILL * np.ptp(hold_last_value(command))
    out = far & (np.ptp(around, axis=1) < 0.5 * limit) & still & np.isfinite(values)
    return out if out.mean() < MANY else np.zeros(len(values), bool)


def _slowest_rpm(rig: Rig) -> float:
    """Speed below which edges may time out between rows: three pitches a time-out."""
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    return (
        PITCHES * 60.0 / pulses / rig.sensors.get("hall_timeout_s", SHORT_TIMEOUT_S)
        if pulses
        else 0.0
    )


def frozen(
    time_s: np.ndarray, columns: dict[str, np.ndarray], name: str, rig: Rig, stopped: np.ndarray
) -> np.ndarray:
    """Samples (n,) that repeat the one before for longer than chance allows, while another column
    moves or has stopped (n,) with it, or ending in a jump.
    """
    values, out = columns[name], np.zeros(len(time_s), bool)
    rows = np.flatnonzero(np.isfinite(values))
    if len(rows) < 2 * FEWEST_FROZEN:
        return out
    seen = values[rows]
    begin = np.flatnonzero(np.concatenate([[True], seen[1:] != seen[:-1]]))
    end = np.append(begin[1:], len(rows))
    longest = longest_by_chance(end - begin, seen[begin] != 0.0)
    for a, b in zip(begin[end - begin > longest], end[end - begin > longest], strict=True):
        first, last = rows[a], rows[b - 1]
        if _may_stand(columns, name, rig, first, last, float(time_s[last] - time_s[first])):
            continue
        if (
            stopped[first : last + 1].mean() > 0.5
            or _moves(columns, name, rig, first, last)
            or _jumps(columns, name, rig, last)
        ):
            out[rows[a + 1 : b]] = True
    return out


def _may_stand(
    columns: dict[str, np.ndarray], name: str, rig: Rig, first: int, last: int, duration_s: float
) -> bool:
    """Whether a column may show one value between two rows: a current at its limit or undriven, a
    speed for a few pitches.
    """
    value = columns[name][first]
    if name == "current_a":
        return (
            value in (np.nanmin(columns[name]), np.nanmax(columns[name]))
            or not driven(columns, rig)[first : last + 1].all()
        )
    return value == 0.0 or (
        name == "speed_rpm" and duration_s < FEWEST_FROZEN * _pitch_s(rig, value)
    )


def _pitch_s(rig: Rig, speed_rpm: float) -> float:
    """Time between two edges, for which a Hall speed repeats itself; 0 for a speed that is not made
    from edges.
    """
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    return 60.0 / pulses / abs(speed_rpm) if pulses else 0.0


def longest_by_chance(length: np.ndarray, nonzero: np.ndarray) -> float:
    """Length in rows that a run of equal samples reaches by chance, from the runs (r,) of a column
    that are not suspicious themselves.
    """
    usual = length[nonzero & (length < FEWEST_FROZEN)]
    if not len(usual):
        return np.inf
    again = 1.0 - len(usual) / max(int(usual.sum()), 1)  # share of rows that repeat the one before
    return max(FEWEST_FROZEN, np.log(CHANCE / max(int(length.sum()), 1)) / np.log(max(again, 1e-3)))


def _jumps(columns: dict[str, np.ndarray], name: str, rig: Rig, last: int) -> bool:
    """Whether a column leaves the value that it repeated with a jump that no command asked for."""
    values, command = columns[name], columns.get(rig.input["kind"])
    after = values[last + 1 : last + 1 + BESIDE]
    if command is None or not len(after) or _pitch_s(rig, 1.0) * (name == "speed_rpm") > 0.0:
        return False
    if np.ptp(hold_last_value(command)[last : last + 1 + BESIDE]) > STILL * np.ptp(
        hold_last_value(command)
    ):
        return False
    changes = np.abs(np.diff(values[np.isfinite(values)]))
    changing = changes[changes > 0.0]
    return len(changing) > 0 and bool(
        np.nanmin(np.abs(after - values[last])) > FAR * np.quantile(changing, USUAL)
    )


def _moves(columns: dict[str, np.ndarray], name: str, rig: Rig, first: int, last: int) -> bool:
    """Whether the command, or another measured column beyond its noise, moves clearly between two
    rows: medians of parts are compared. A rounded edge speed may well stand while the current
    moves, so that for it only the command counts.
    """
    from_edges = name == "speed_rpm" and _pitch_s(rig, 1.0) > 0.0
    for other in {rig.input["kind"]} if from_edges else {*MEASURED, rig.input["kind"]} - {name}:
        values = columns.get(other)
        if values is None or not np.isfinite(values[first : last + 1]).any():
            continue
        whole = hold_last_value(values)
        middles = [np.median(part) for part in np.array_split(whole[first : last + 1], PARTS)]
        span = float(np.subtract(*np.quantile(whole, [0.99, 0.01])))
        noise = 0.0 if other == rig.input["kind"] else high_frequency_sigma(values)
        if np.ptp(middles) > max(
            MOVES * span, FAR * noise / np.sqrt(max(1.0, (last - first) / PARTS)), 1e-12
        ):
            return True
    return False
