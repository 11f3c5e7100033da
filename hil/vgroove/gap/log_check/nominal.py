"""The nominal signals of a rig that the input of a log drives: what its measured columns are
compared with before a diagnosis.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import LOADS_BEHIND
from vgroove.gap.cleaning.missing_values import hold_last_value
from vgroove.gap.cleaning.sensor_noise import noise_of
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.impact.roll_outs import MODE
from vgroove.gap.residual.inputs import read_input
from vgroove.log import Log, current_is_unsigned
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S

MAX_ROWS = 20_000  # rows that are simulated, from the first command on: 10 ms of work
NO_STATE = np.zeros((1, 3))
# share of the range of a column within which a log begins at rest where the load hangs (chosen)
START_SHARE = 0.1
FIRST_ROWS = 5  # whose median is the start


@dataclass(frozen=True)
class Pair:
    """A measured column and its nominal signal (rows,), nan where one is missing, in the unit of
    the column.
    """

    column: str
    measured: np.ndarray
    nominal: np.ndarray

    def large(self, least: float = 0.2) -> np.ndarray:
        """Rows (rows,) in which the nominal signal is above this share of its maximum."""
        known = np.isfinite(self.measured) & np.isfinite(self.nominal)
        size = np.abs(self.nominal)
        return known & (size > least * size[known].max(initial=0.0))

    def relative_error(self, scaled: bool = False) -> float:
        """Sum of the absolute differences over that of the measured values; scaled: with the
        nominal signal times the factor of least squares. inf without values.
        """
        known = np.isfinite(self.measured) & np.isfinite(self.nominal)
        measured, nominal = self.measured[known], self.nominal[known]
        total, square = float(np.abs(measured).sum()), float(nominal @ nominal)
        factor = float(measured @ nominal) / square if scaled and square > 0.0 else 1.0
        return float(np.abs(measured - factor * nominal).sum()) / total if total else np.inf


def mean_error(pairs: list[Pair], scaled: bool = False) -> float:
    """Mean of the relative errors of the columns that are not 0 throughout; inf without one."""
    errors = [pair.relative_error(scaled) for pair in pairs]
    known = [error for error in errors if np.isfinite(error)]
    return float(np.mean(known)) if known else np.inf


def is_simulated(rig: Rig) -> bool:
    """Whether the plant can be driven by a log of this rig."""
    return rig.load["kind"] in LOADS_BEHIND.get(rig.mechanism["kind"], ())


def starts_moving_or_deflected(log: Log, rig: Rig) -> bool:
    """Whether the load is a pendulum that is in motion or deflected at the first row: its weight
    then moves it as much as the command, unlike in a simulation from rest where it hangs.
    """
    if rig.load["kind"] != "pendulum":
        return False
    hangs = {"speed_rpm": 0.0, "position_rad": rig.load.get("zero_rad", 0.0) * rig.gearbox["ratio"]}
    return any(
        abs(np.median(known[:FIRST_ROWS]) - at)
        > START_SHARE * (max(known.max(), at) - min(known.min(), at))
        for column, at in hangs.items()
        if len(known := _known(log, column))
    )


def _known(log: Log, column: str) -> np.ndarray:
    """The values (k,) of a column that are not missing; none of a column that is."""
    values = np.asarray(log.columns.get(column, []), float)
    return values[np.isfinite(values)]


def first_rows(log: Log, rig: Rig, rows: int = MAX_ROWS) -> Log:
    """The log from its first command on, with at most this many rows: before it the tool rests."""
    command = log.columns.get(rig.input["kind"])
    if command is None or len(log.time_s) <= rows:
        return log
    driven = np.flatnonzero(np.nan_to_num(np.asarray(command, float)) != 0.0)
    begin = max(0, int(driven[0]) - 1) if len(driven) else 0
    part = slice(begin, begin + rows)
    columns = {name: np.asarray(values)[part] for name, values in log.columns.items()}
    return replace(log, time_s=np.asarray(log.time_s)[part], columns=columns)


def nominal_pairs(log: Log, rig: Rig, time_factor: float = 1.0) -> list[Pair]:
    """The judged columns of a log beside the nominal signals of its rig, simulated from rest in one
    run; the times of the log times time_factor are taken as seconds.

    VgrooveError for a command that is missing or cannot have driven the tool.
    """
    time_s = np.asarray(log.time_s, float) * time_factor
    columns = {name: np.asarray(values, float) for name, values in log.columns.items()}
    noise = noise_of(rig, time_s, columns)
    clean = CleanLog(log, rig, time_s, columns, noise, log.source, [])
    plant = read_input(clean).columns.plant()
    theta = rig.parameters()[None]
    try:
        if rig.mechanism["kind"] == "impact":
            rows = _core.simulate_impact(plant, theta, mode=MODE)
        else:
            rows = _core.simulate_log(plant, theta, np.array([0]), NO_STATE, 1, unfinished="nan")
    except (RuntimeError, ValueError) as error:
        raise VgrooveError(f"the rig cannot be simulated along {log.source}: {error}") from error
    nominal = {
        "current_a": rows["current_a"][0],
        "supply_v": rows["supply_v"][0],
        "speed_rpm": rows["speed_measured_rad_s"][0] * RPM_PER_RAD_S,
        "position_rad": rows["angle_measured_rad"][0],
    }
    not_judged = {rig.input["kind"]} | ({"supply_v"} if rig.bus_is_measured else set())
    return [
        _pair(name, log, nominal[name])
        for name in nominal
        if name in columns and name not in not_judged and np.isfinite(columns[name]).any()
    ]


def _pair(name: str, log: Log, nominal: np.ndarray) -> Pair:
    """A column and its nominal signal: of a position, the angles turned since its first measured
    row; of an unsigned current, the magnitudes.
    """
    measured = np.asarray(log.columns[name], float)
    if name == "position_rad":
        first = int(np.isfinite(measured).argmax())
        return Pair(name, measured - measured[first], nominal - nominal[first])
    if name == "current_a" and current_is_unsigned(log):
        return Pair(name, measured, np.abs(nominal))
    return Pair(name, measured, nominal)


def steady_rows(pair: Pair, time_s: np.ndarray, settle_s: float) -> np.ndarray:
    """Rows (rows,) before which the nominal signal has changed by less than 2 % of its maximum for
    settle_s, s.
    """
    nominal = hold_last_value(pair.nominal)
    before = np.clip(np.searchsorted(time_s, time_s - settle_s), 0, len(time_s) - 1)
    top = np.abs(nominal[np.isfinite(nominal)]).max(initial=0.0)
    return (np.abs(nominal - nominal[before]) < 0.02 * top) & (time_s - settle_s >= time_s[0])
