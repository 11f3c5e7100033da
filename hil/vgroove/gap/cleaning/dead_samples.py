"""Recognises samples that hold a number though the sensor or the link delivered none: dropped to
zero, frozen at an old value, or disturbed.

They are taken as missing. Values that a tool can produce are kept: a current of 0 while the
bridge is open, a Hall speed of 0 after its timeout, a clipped sensor at its limit, a quiet sensor
that repeats itself while nothing else moves.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.long_logs import is_thinned
from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.gap.cleaning.sensor_noise import high_frequency_sigma
from vgroove.log import Log
from vgroove.rig import Rig

CHECKED = ("current_a", "supply_v", "speed_rpm")
MEASURED = (*CHECKED, "position_rad")
TINY = 1e-12  # smallest threshold on a change: a column without noise must not divide by zero


@dataclass(frozen=True)
class DeadSampleLimits:
    """Limits of the search for dead samples, chosen on the tuning half of the blind set. A column's
    usual change is the quantile usual_quantile of its changes from sample to sample.
    """

    usual_quantile: float = 0.9
    # dropped to zero
    beside: int = 3  # rows on each side that must differ from zero
    far: float = 4.0  # usual changes by which these rows must differ from zero
    timeout_pitches: float = 3.0  # edges in a Hall timeout: at a higher speed no row can read 0
    # timeout of a rig that states none, s: short, so that in doubt a speed of 0 is a real timeout
    default_timeout_s: float = 0.05
    # spikes
    spike: float = 20.0  # usual changes by which a spike differs from its neighbours
    spike_neighbours: float = 0.5  # share of that limit, within which the neighbours must agree
    constant_share: float = 0.02  # of its span, by which a constant command may change
    max_spike_share: float = 0.02  # of the rows: more spikes have a cause in the tool
    constant_rows: int = 7  # window in which the command must be constant
    # frozen
    min_frozen: int = 20  # rows (of a Hall speed: pitches) that a value may be repeated for
    by_chance: float = 1e-4  # expected number of such repeats in a log by chance
    min_repeat_probability: float = 1e-3  # smallest estimate, for a column without any repeat
    parts: int = 5  # parts of a stretch whose medians show whether another column moves
    moves_share: float = 0.1  # of a column's span, by which it moves between the parts
    moves_sigma: float = 4.0  # standard deviations of a part's mean, by which it moves as well
    span_quantiles: tuple[float, float] = (0.99, 0.01)  # whose difference is a column's span
    others_frozen_share: float = 0.5  # of a stretch, in which other columns are frozen as well


LIMITS = DeadSampleLimits()


@dataclass(frozen=True)
class _Column:
    """One measured column (n,) among all columns of a log, times (n,), s, and the rig."""

    name: str
    time_s: np.ndarray
    columns: dict[str, np.ndarray]
    rig: Rig

    @property
    def values(self) -> np.ndarray:
        """Samples (n,) of the column itself."""
        return self.columns[self.name]

    @property
    def command(self) -> np.ndarray | None:
        """The driving column (n,), with nan where samples are missing; None without one."""
        return self.columns.get(self.rig.input["kind"])


def remove_dead_samples(log: Log, rig: Rig) -> Log:
    """The log with dead samples as nan and a warning that names the columns; VgrooveError where no
    measured column ever changes.
    """
    columns = {name: np.asarray(values, dtype=float) for name, values in log.columns.items()}
    _refuse_constant(columns, rig, log.source)
    time_s, found = np.asarray(log.time_s, dtype=float), {}
    others_frozen = np.zeros(len(time_s), bool)
    for name in (n for n in CHECKED if n in columns and n != rig.input["kind"]):
        column = _Column(name, time_s, columns, rig)
        masks = dropped_samples(column), frozen_samples(column, others_frozen)
        others_frozen = others_frozen | masks[1]
        if np.any(masks):
            found[name] = masks
    if not found:
        return log
    counts = [
        f"{name}: {int(zero.sum())} dropped to 0 or spikes, {int(repeated.sum())} frozen"
        for name, (zero, repeated) in found.items()
    ]
    cleaned = columns | {
        name: np.where(zero | repeated, np.nan, columns[name])
        for name, (zero, repeated) in found.items()
    }
    warning = (
        f"{log.source}: values that no sensor produces are taken as missing: {'; '.join(counts)}"
    )
    return replace(log, columns=cleaned, warnings=[*log.warnings, warning])


def _refuse_constant(columns: dict[str, np.ndarray], rig: Rig, source: str) -> None:
    """VgrooveError where every measured column holds one number only."""
    seen = [
        columns[name]
        for name in MEASURED
        if name in columns and name != rig.input["kind"] and np.isfinite(columns[name]).any()
    ]
    if seen and all(np.nanmax(v) == np.nanmin(v) for v in seen):
        raise VgrooveError(
            f"{source}: no measured column changes: the log shows a tool at rest, or dead sensors"
        )


def bridge_drives(column: _Column) -> np.ndarray:
    """Rows (n,) in which the bridge drives, neither open nor shorted: elsewhere a current of
    exactly 0 is possible.
    """
    command, columns = column.command, column.columns
    known = np.ones(len(column.time_s), bool)
    if command is not None:
        known = hold_last_value(command) != 0.0
    return known & (hold_last_value(columns["coast"]) == 0.0) if "coast" in columns else known


def usual_change(values: np.ndarray) -> float:
    """Usual change of a column (n,) from sample to sample, in its unit: noise and motion."""
    if len(values) < 2:
        return 0.0
    return float(np.quantile(np.abs(np.diff(values)), LIMITS.usual_quantile))


def dropped_samples(column: _Column) -> np.ndarray:
    """Samples (n,) of exactly 0 between samples that are far from 0, and spikes.

    Either the samples around have one sign, or the zeros are a long run of the current while the
    bridge drives: no motor, battery or edge counter gives such values. A shaft that nothing drives
    may be at rest between samples that are its time constant or more apart.
    """
    values, out = column.values, spikes(column)
    beside, is_current = LIMITS.beside, column.name == "current_a"
    rows = np.flatnonzero(np.isfinite(values))
    live, zero = rows[values[rows] != 0.0], rows[values[rows] == 0.0]
    if len(live) < 2 * beside or not len(zero):
        return out
    slowest_rpm = _slowest_rpm(column.rig) if column.name == "speed_rpm" else 0.0
    least = max(LIMITS.far * usual_change(values[live]), slowest_rpm)
    at = np.searchsorted(live, zero)
    inner = (at >= beside) & (at <= len(live) - beside)
    zero, at = zero[inner], at[inner]
    around = np.stack([values[live[at + k]] for k in range(-beside, beside)])
    run = live[at] - live[at - 1] - 1  # zeros in a row
    one_sign = np.abs(np.sign(around).sum(axis=0)) == 2 * beside
    long_run = (run >= LIMITS.min_frozen) & is_current
    wrong = (np.abs(around) > least).all(axis=0) & (one_sign | long_run)
    if is_current:
        wrong &= bridge_drives(column)[zero] | (run <= beside)
        wrong &= ~without_drive(column)[zero]
    elif not slowest_rpm:
        apart_s = column.time_s[live[at]] - column.time_s[live[at - 1]]
        stops = apart_s >= column.rig.speed_time_constant_s
        wrong &= ~(stops & without_drive(column)[zero])
    out[zero[wrong]] = True
    return out


def without_drive(column: _Column) -> np.ndarray:
    """Rows (n,) at which a current may be 0, or a shaft come to rest: the bridge is open there or
    in a row beside, or a speed's command is 0.
    """
    none = np.zeros(len(column.time_s), bool)
    coast = column.columns.get("coast")
    off = none if coast is None else hold_last_value(coast) != 0.0
    if column.name == "speed_rpm" and column.command is not None:
        off = off | (hold_last_value(column.command) == 0.0)
    return scipy.ndimage.binary_dilation(off, np.ones(3))


def spikes(column: _Column) -> np.ndarray:
    """Single samples (n,) of current or bus voltage far from their neighbours, which agree, while
    the command is constant: a disturbed conversion. All False where there are many, because these
    have a cause in the tool.
    """
    values, command = column.values, column.command
    none = np.zeros(len(values), bool)
    if column.name == "speed_rpm" or command is None or len(values) < 4 * LIMITS.beside:
        return none
    whole = hold_last_value(values)
    limit = LIMITS.spike * max(usual_change(values[np.isfinite(values)]), TINY)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(whole, 2, mode="edge"), 5)
    around = windows[:, [0, 1, 3, 4]]
    far = np.abs(whole - np.median(around, axis=1)) > limit
    held = hold_last_value(command)
    moved = scipy.ndimage.maximum_filter1d(
        held, LIMITS.constant_rows
    ) - scipy.ndimage.minimum_filter1d(held, LIMITS.constant_rows)
    constant = moved <= LIMITS.constant_share * np.ptp(held)
    agree = np.ptp(around, axis=1) < LIMITS.spike_neighbours * limit
    out = far & agree & constant & np.isfinite(values)
    return out if out.mean() < LIMITS.max_spike_share else none


def _slowest_rpm(rig: Rig) -> float:
    """Speed, rpm, of timeout_pitches edges in a Hall timeout: at a lower one a row may read 0 after
    the timeout; 0 for a speed that is not made from edges.
    """
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    if not pulses:
        return 0.0
    timeout_s = rig.sensors.get("hall_timeout_s", LIMITS.default_timeout_s)
    return LIMITS.timeout_pitches * 60.0 / pulses / timeout_s


def frozen_samples(column: _Column, others_frozen: np.ndarray) -> np.ndarray:
    """Samples (n,) that repeat the one before for longer than chance explains, while another column
    moves or is frozen as well (others_frozen, (n,)), or that end in a jump.
    """
    values, out = column.values, np.zeros(len(column.time_s), bool)
    rows = np.flatnonzero(np.isfinite(values))
    if len(rows) < 2 * LIMITS.min_frozen:
        return out
    seen = values[rows]
    skipped = np.cumsum(is_thinned(column.columns, len(values)))[rows]
    changes = (seen[1:] != seen[:-1]) | (skipped[1:] > skipped[:-1])
    begin = np.flatnonzero(np.concatenate([[True], changes]))
    end = np.append(begin[1:], len(rows))
    long_run = end - begin > longest_by_chance(end - begin, seen[begin] != 0.0)
    for a, b in zip(begin[long_run], end[long_run], strict=True):
        first, last = rows[a], rows[b - 1]
        if _may_repeat(column, first, last):
            continue
        if (
            others_frozen[first : last + 1].mean() > LIMITS.others_frozen_share
            or _other_moves(column, first, last)
            or _jumps(column, last)
        ):
            out[rows[a + 1 : b]] = True
    return out


def _may_repeat(column: _Column, first: int, last: int) -> bool:
    """Whether a column may hold one value from row first to last: a current at its limit or without
    drive, a Hall speed for a few pitches, any column at 0.
    """
    values, value = column.values, column.values[first]
    if column.name == "current_a":
        at_limit = value in (np.nanmin(values), np.nanmax(values))
        return at_limit or not bridge_drives(column)[first : last + 1].all()
    if value == 0.0:
        return True
    duration_s = float(column.time_s[last] - column.time_s[first])
    longest_s = LIMITS.min_frozen * _pitch_s(column.rig, value)
    return column.name == "speed_rpm" and duration_s < longest_s


def _pitch_s(rig: Rig, speed_rpm: float) -> float:
    """Time between two edges, s, for which a Hall speed repeats itself; 0 for a speed that is not
    made from edges.
    """
    pulses = rig.sensors.get("hall_pulses_per_rev", 0)
    return 60.0 / pulses / abs(speed_rpm) if pulses else 0.0


def longest_by_chance(length: np.ndarray, nonzero: np.ndarray) -> float:
    """Length, rows, that a run of equal samples exceeds by_chance times in a log by chance, from
    the lengths of all runs (r,); nonzero (r,): runs of another value than 0.

    The probability of a repeat is estimated from the short runs; repeats are taken as independent
    (geometric distribution of the length).
    """
    usual = length[nonzero & (length < LIMITS.min_frozen)]
    if not len(usual):
        return np.inf
    repeat = 1.0 - len(usual) / max(int(usual.sum()), 1)
    log_chance = np.log(LIMITS.by_chance / max(int(length.sum()), 1))
    log_repeat = np.log(max(repeat, LIMITS.min_repeat_probability))
    return max(LIMITS.min_frozen, log_chance / log_repeat)


def _jumps(column: _Column, last: int) -> bool:
    """Whether a column leaves the value that it repeated up to row `last` with a jump while the
    command is constant; a Hall speed changes in jumps anyway.
    """
    values, command = column.values, column.command
    end = last + 1 + LIMITS.beside
    after = values[last + 1 : end]
    from_edges = column.name == "speed_rpm" and _pitch_s(column.rig, 1.0) > 0.0
    if command is None or not len(after) or from_edges:
        return False
    held = hold_last_value(command)
    if np.ptp(held[last:end]) > LIMITS.constant_share * np.ptp(held):
        return False
    changes = np.abs(np.diff(values[np.isfinite(values)]))
    changing = changes[changes > 0.0]
    if len(changing) == 0:
        return False
    usual = np.quantile(changing, LIMITS.usual_quantile)
    return bool(np.nanmin(np.abs(after - values[last])) > LIMITS.far * usual)


def _other_moves(column: _Column, first: int, last: int) -> bool:
    """Whether the command or another measured column moves clearly beyond its noise from row first
    to last. A rounded Hall speed may repeat while the current moves: for it only the command
    counts.
    """
    kind = column.rig.input["kind"]
    from_edges = column.name == "speed_rpm" and _pitch_s(column.rig, 1.0) > 0.0
    for other in {kind} if from_edges else {*MEASURED, kind} - {column.name}:
        values = column.columns.get(other)
        if values is not None and _moves(values, first, last, noisy=other != kind):
            return True
    return False


def _moves(values: np.ndarray, first: int, last: int, noisy: bool) -> bool:
    """Whether the medians of parts of the rows first..last of a column (n,) differ by more than
    moves_share of its span and, if it is noisy, by more than the noise of a median explains.
    """
    if not np.isfinite(values[first : last + 1]).any():
        return False
    whole = hold_last_value(values)
    middles = [np.median(part) for part in np.array_split(whole[first : last + 1], LIMITS.parts)]
    span = float(np.subtract(*np.quantile(whole, LIMITS.span_quantiles)))
    noise = high_frequency_sigma(values) if noisy else 0.0
    rows = max(1.0, (last - first) / LIMITS.parts)
    return np.ptp(middles) > max(
        LIMITS.moves_share * span, LIMITS.moves_sigma * noise / np.sqrt(rows), TINY
    )
