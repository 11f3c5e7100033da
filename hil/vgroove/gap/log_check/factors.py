"""Units and signs of a log: factors between its measured columns and the nominal simulation that a
wrong unit explains, and no fault of a tool.

The factor of a column is the median of measured over nominal values (a robust slope through the
origin) in the steady rows of the run. It is named, and the log refused, only where it agrees with
that of a unit, a simulation times that factor follows the column closely, and one without does not.
"""

import math
from dataclasses import dataclass

import numpy as np

from vgroove.gap.log_check.current_driven import acceleration_factors
from vgroove.gap.log_check.finding import Finding
from vgroove.gap.log_check.magnitude import magnitude_findings
from vgroove.gap.log_check.nominal import (
    Pair,
    first_rows,
    is_simulated,
    nominal_pairs,
    starts_moving_or_deflected,
    steady_rows,
)
from vgroove.gap.log_check.time_unit import best_time_factor, time_finding
from vgroove.gap.residual.inputs import driving_values
from vgroove.log import COLUMN_UNITS, Log
from vgroove.log.units_of_columns import unit_factor
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM, RPM_PER_RAD_S, TURN_RAD


@dataclass(frozen=True)
class FactorRules:
    """When a factor is that of a unit. Checked on the logs of tests/data and on altered tools:
    parameters off by up to 50 %, gains by up to 30 % (tests/python/test_log_units.py).
    """

    # relative, of a factor that a faulty tool could come near; with 0.03 only five of 93 logs in
    # rad/s of altered tools are refused, since their speeds differ from the rig's by more
    tolerance: float = 0.10
    # factor by which 1000 and -1 may be missed, which no tool comes near
    wide: float = 3.0
    # a factor nearer to 1 than this is that of a tool, not of a unit
    least: float = 3.0
    least_warned: float = 5.0  # a farther one that is no unit's is a warning
    counts: float = 7.0  # least factor of a position that is in counts: more than any fault makes
    # a factor, or its inverse, that the errors which a simulated motion adds up do not make: a
    # friction of 60 times the rig's makes 1/60; only 1000 and the counts of an encoder are farther
    drift: float = 100.0
    # relative, of a whole number of pole pairs, which lie by 6 % apart at least
    pole_tolerance: float = 0.01
    nearest: float = 1.5  # factor by which the unit that the warning names may be missed
    max_scatter: float = 0.15  # median relative error that may be left with the factor
    max_wide_scatter: float = 0.5  # the same with 1000 or -1
    better: float = 3.0  # by which the factor must reduce that error
    min_rows: int = 50  # steady rows; with fewer all rows are used
    settle_time_constants: float = 3.0
    settle_s: float = 0.05  # at least: electrical transients, a Hall timeout


RULES = FactorRules()


@dataclass(frozen=True)
class Unit:
    """A unit or sign that a column may have been written in: factor of its numbers over those of
    the expected unit, and the mend. wide: the factor may be missed by RULES.wide.
    """

    factor: float
    name: str
    mend: str
    wide: bool = False


@dataclass(frozen=True)
class Slope:
    """Factor of a column over its nominal signal, and the median relative error of the nominal
    signal times the factor and of the nominal signal alone.
    """

    column: str
    factor: float
    scatter: float
    unscaled: float

    def is_close(self, wide: bool = False) -> bool:
        """Whether the nominal signal times the factor follows the column, and much better; wide:
        for a factor that no tool comes near.
        """
        limit = RULES.max_wide_scatter if wide else RULES.max_scatter
        better = self.unscaled >= (1.0 if self.is_thousand else RULES.better) * self.scatter
        return self.scatter <= limit and better

    @property
    def is_thousand(self) -> bool:
        """Whether the factor is of the size of 1000: the error of a simulation without it cannot be
        larger than the column, so that it says less.
        """
        return abs(self.factor) >= 1e3 / RULES.wide

    @property
    def is_far(self) -> bool:
        """Whether the factor is negative or far from 1."""
        return self.factor < 1.0 / RULES.least or self.factor > RULES.least


@dataclass(frozen=True)
class Causes:
    """What else than the unit of a column may make its factor: the command, if it moves no other
    column, a measured load (loaded), and the errors of friction and load that the simulated motion
    adds up (drifts).
    """

    rig: Rig
    is_only_moved_column: bool
    loaded: bool
    drifts: bool

    def may_make(self, slope: Slope) -> bool:
        """Whether the errors that a simulated motion adds up may make the factor of a column."""
        size = abs(slope.factor)
        return self.drifts and slope.column in GEARED and 1.0 / RULES.drift < size < RULES.drift


# per column: factor of the numbers, unit as --map names it
COLUMN_UNITS_WRITTEN = {
    "current_a": {1e3: "mA", 1e-3: "kA"},
    "supply_v": {1e3: "mV", 1e-3: "kV"},
    "speed_rpm": {
        1e-3: "krpm",
        RAD_S_PER_RPM: "rad/s",
        1 / 60: "rev/s",
        6.0: "deg/s",
        2.0 * math.pi: "rad/min",
        RPM_PER_RAD_S: "0.1047198 rpm",
        60.0: "0.01666667 rpm",
    },
    "position_rad": {180.0 / math.pi: "deg", 0.5 / math.pi: "rev", 1e3: "mrad"},
}
CONVERTED_TWICE = {
    "0.1047198 rpm": "it was converted from rad/s to rpm twice",
    "0.01666667 rpm": "it was converted from rev/s to rpm twice",
}
CURRENT_UNITS = {1e3: "mA", -1e3: "-mA", -1.0: "-A"}
GEARED = ("speed_rpm", "position_rad")
# More than 3, of which an electrical speed is a warning, and so few that the factors within
# RULES.pole_tolerance of one of them are less than a third of all factors
POLE_PAIRS = range(4, 16)
# factor of a speed in one pole pair, and its name: an electrical speed is a multiple of it
ELECTRICAL = {1.0: "rpm", 1.0 / 60.0: "Hz"}
WIDE_FACTORS = (1e3, 1e-3)


def unit_findings(log: Log, rig: Rig) -> list[Finding]:
    """Findings on the units and signs of a log, from its simulation; none for a rig that the plant
    cannot drive with a log, and none on the sign of a motion that does not begin as simulated.
    VgrooveError where the column that drives the model is missing or holds no value.

    A simulation that a current drives adds up the errors of friction and load: where the log does
    not determine its acceleration, a factor of its motion that they may make refuses nothing.
    """
    if not is_simulated(rig):
        return []
    driving_values(log.columns, rig.input["kind"], log.source)
    part = first_rows(log, rig)
    factor = 1.0 if "log_hz" in rig.sensors else best_time_factor(part, rig)
    if factor != 1.0:
        return [time_finding(part, rig, factor)]
    if accelerations := acceleration_factors(part, rig):
        return _acceleration_findings(accelerations, part, rig)
    pairs = nominal_pairs(part, rig)
    if rig.input["kind"] != "current_a" and (found := magnitude_findings(pairs)):
        return found
    slopes = [s for pair in pairs if (s := slope_of(pair, part, rig))]
    if starts_moving_or_deflected(part, rig):
        slopes = [slope for slope in slopes if slope.factor > 0.0]
    # errors of friction and load move speed and angle alike
    moves_as_simulated = any(s.column in GEARED and not s.is_far for s in slopes)
    drifts = rig.input["kind"] == "current_a" and not moves_as_simulated
    return _input_findings(slopes, rig, drifts) or _findings_of_columns(slopes, part, rig, drifts)


def _acceleration_findings(factors: dict[str, float], log: Log, rig: Rig) -> list[Finding]:
    """Findings on factors of columns that a current drives: the current's, where its unit explains
    all of them.
    """
    slopes = [Slope(column, factor, 0.0, 1.0) for column, factor in factors.items()]
    for size, unit in CURRENT_UNITS.items():
        if all(_matches(slope.factor, Unit(1.0 / size, "", "", wide=True)) for slope in slopes):
            what, factor = f"columns current_a and {_names(slopes)}", f"{slopes[0].factor:.4g}"
            said = (
                "one of them has the opposite sign" if size == -1.0 else f"current_a is in {unit}"
            )
            if "log_hz" not in rig.sensors and unit == "mA":
                said += " (or time_s in ms)"
            mends = [_mend("current_a", unit)]
            if size == -1.0:
                mends += [_mend(s.column, f"-{COLUMN_UNITS[s.column]}") for s in slopes]
            return [_refusal(what, factor, said, ", or ".join(mends))]
    return _findings_of_columns(slopes, log, rig)


def _findings_of_columns(
    slopes: list[Slope], log: Log, rig: Rig, drifts: bool = False
) -> list[Finding]:
    """Findings on each column by itself; drifts: as in Causes."""
    is_only = sum(slope.column != "supply_v" for slope in slopes) == 1
    loaded = rig.load["kind"] == "torque" and "load_nm" in log.columns
    causes = Causes(rig, is_only, loaded, drifts)
    return [finding for slope in slopes for finding in _column_findings(slope, causes)]


def slope_of(pair: Pair, log: Log, rig: Rig) -> Slope | None:
    """The factor between a column and its nominal signal in steady rows; in all rows where few are
    steady. None without rows, or where the column is 0 in most of them.
    """
    large = pair.large()
    steady = large & steady_rows(pair, np.asarray(log.time_s, float), settle_time_s(rig))
    rows = steady if np.count_nonzero(steady) >= RULES.min_rows else large
    measured, nominal = pair.measured[rows], pair.nominal[rows]
    size = float(np.median(np.abs(measured))) if len(measured) else 0.0
    if size == 0.0 or (factor := float(np.median(measured / nominal))) == 0.0:
        return None
    scatter = float(np.median(np.abs(measured - factor * nominal))) / size
    unscaled = float(np.median(np.abs(measured - nominal))) / size
    return Slope(pair.column, factor, scatter, unscaled)


def settle_time_s(rig: Rig) -> float:
    """Time in s after which the nominal motor is steady: its run-up time constant J R / k^2."""
    damping = rig.back_emf_damping_nm_s_per_rad + rig.motor["viscous_nm_s_per_rad"]
    constant_s = rig.shaft_inertia_kg_m2 / damping
    return max(RULES.settle_s, RULES.settle_time_constants * constant_s)


def _input_findings(slopes: list[Slope], rig: Rig, drifts: bool) -> list[Finding]:
    """A finding where all columns that the command moves have the same factor: that of the
    command. drifts: as in Causes; an unknown load may then make the factor -1.
    """
    kind = rig.input["kind"]
    moved = [slope for slope in slopes if slope.column != "supply_v"]
    if len(moved) < 2 or not all(slope.is_close(wide=True) for slope in moved):
        return []
    unit = COLUMN_UNITS[kind]
    opposite = all(_matches(slope.factor, Unit(-1.0, "", "", wide=True)) for slope in moved)
    if opposite and not drifts:
        reason = f"{kind} has the opposite sign"
        return [_refusal(f"columns {_names(moved)}", "-1", reason, _mend(kind, f"-{unit or 1}"))]
    if kind != "duty" and all(_matches(s.factor, Unit(1e-3, "", "", wide=True)) for s in moved):
        reason = f"{kind} is in m{unit}"
        return [_refusal(f"columns {_names(moved)}", "1/1000", reason, _mend(kind, f"m{unit}"))]
    return []


def _mend(column: str, unit: str) -> str:
    """The option that reads a column in another unit."""
    return f'read it with --map "{column}:{unit}={column}"'


def _names(slopes: list[Slope]) -> str:
    return " and ".join(slope.column for slope in slopes)


def _or_input(column: str, factor: float, causes: Causes) -> str:
    """The mend of another column that may make the factor of a column; empty where none does."""
    kind = causes.rig.input["kind"]
    own = COLUMN_UNITS[kind]
    scaled = {} if kind == "duty" else {1e-3: f"m{own}", -1e-3: f"-m{own}"}
    for size, unit in ({-1.0: f"-{own or 1}"} | scaled).items():
        if causes.is_only_moved_column and factor == size:
            return f", or, if {kind} is in {unit}, {_mend(kind, unit)}"
    if causes.loaded and column == "current_a" and factor == -1.0:
        return f", or, if load_nm is in -Nm, {_mend('load_nm', '-Nm')}"
    return ""


def _column_findings(slope: Slope, causes: Causes) -> list[Finding]:
    """A refusal where the factor of a column is that of a unit, a warning where it is far from 1
    without being one.
    """
    if not slope.is_far:
        return []
    units = units_of(slope.column, causes.rig)
    nearest = min(units, key=lambda unit: _distance(slope.factor, unit))
    if causes.may_make(slope):
        return [_warning(slope, nearest)] if slope.is_close() else []
    for unit in (nearest, *units):
        if slope.is_close(unit.wide) and _matches(slope.factor, unit):
            mend = unit.mend + _or_input(slope.column, unit.factor, causes)
            if not _is_near(slope.factor, unit.factor):
                mend += "".join(f"; or is it {electrical}" for electrical in _electrical(slope))
            return [_refusal(f"column {slope.column}", f"{slope.factor:.4g}", unit.name, mend)]
    if slope.column == "position_rad" and slope.is_close() and abs(slope.factor) > RULES.counts:
        return [_counts_finding(slope)]
    far = max(abs(slope.factor), 1.0 / abs(slope.factor)) > RULES.least_warned
    far = far or (abs(slope.factor) > 1.0 and bool(_electrical(slope)))
    return [_warning(slope, nearest)] if far and slope.is_close() else []


def _electrical(slope: Slope) -> list[str]:
    """The electrical speeds of a motor with pole pairs that the factor of a speed is near to, each
    with its mend.
    """
    if slope.column != "speed_rpm":
        return []
    found = []
    for one, name in ELECTRICAL.items():
        pairs = round(abs(slope.factor) / one)
        factor = math.copysign(pairs * one, slope.factor)
        if pairs in POLE_PAIRS and _is_near(slope.factor, factor):
            mend = _mend(slope.column, f"{1.0 / factor:.6g} rpm")
            found.append(f"electrical {name} with {pairs} pole pairs? If so, {mend}")
    return found


def _is_near(factor: float, other: float) -> bool:
    """Whether two factors of one sign agree as those of pole pairs do."""
    return abs(math.log(factor / other)) <= math.log1p(RULES.pole_tolerance)


def _counts_finding(slope: Slope) -> Finding:
    """The refusal of a position that is in no unit of angle: the counts of an encoder."""
    counts = slope.factor * TURN_RAD
    reason = f"it is in counts of an encoder, {abs(counts):.4g} a turn of the motor"
    mend = f"{_mend(slope.column, f'{1.0 / counts:.4g} rev')}, with 1 / the exact counts"
    return _refusal(f"column {slope.column}", f"{slope.factor:.4g}", reason, mend)


def _warning(slope: Slope, nearest: Unit) -> Finding:
    """A warning of a factor that is far from 1 and from those of the units; it names a near one."""
    near = _distance(slope.factor, nearest) <= math.log(RULES.nearest)
    hint = f" (the nearest factor is {nearest.factor:.4g}: {nearest.name}?)" if near else ""
    if electrical := _electrical(slope):
        hint = f": is it {electrical[0]}"
    text = (
        f"column {slope.column}: the values are {slope.factor:.4g} times those of the rig's "
        f"simulation: a value of the rig, the sensor's scale or the unit is far off{hint}"
    )
    return Finding(text, warns=True)


def _refusal(what: str, factor: str, reason: str, mend: str) -> Finding:
    seems = f"the values are {factor} times those of the rig's simulation: it seems that {reason}"
    text = f"{what}: {seems}; {mend}"
    return Finding(text, refuses=True)


def units_of(column: str, rig: Rig) -> list[Unit]:
    """The units and signs that a column may have been written in; the gear's ratio first."""
    ratio, own = rig.gearbox["ratio"], COLUMN_UNITS[column]
    found = []
    if column in GEARED and ratio >= RULES.least:
        name = f"it is measured behind the gear (gearbox.ratio {ratio:g})"
        found += [Unit(1.0 / ratio, name, _mend(column, f"{ratio:g} {own}"))]
        found += [Unit(-1.0 / ratio, name, _mend(column, f"-{ratio:g} {own}"))]
    for factor, name in COLUMN_UNITS_WRITTEN[column].items():
        wide = factor in WIDE_FACTORS and column != "position_rad"
        said = CONVERTED_TWICE.get(name, f"it is in {name}")
        found += _both_signs(column, factor, said, name, wide)
    found.append(Unit(-1.0, "it has the opposite sign", _mend(column, f"-{own}"), wide=True))
    return [*found, *_seldom_units(column, rig, found)]


def _both_signs(column: str, factor: float, said: str, unit: str, wide: bool = False) -> list[Unit]:
    """A unit, and the same with the opposite sign."""
    opposite = f"{said} with the opposite sign"
    return [
        Unit(factor, said, _mend(column, unit), wide),
        Unit(-factor, opposite, _mend(column, f"-{unit}"), wide),
    ]


def _seldom_units(column: str, rig: Rig, others: list[Unit]) -> list[Unit]:
    """Units behind the gear, and the frequency of the Hall edges, where their factors are those of
    none of the other units.
    """
    ratio, edges = rig.gearbox["ratio"], rig.sensors.get("hall_pulses_per_rev", 0)
    found = []
    for factor, unit in COLUMN_UNITS_WRITTEN[column].items() if column in GEARED else ():
        if ratio >= RULES.least and not unit[0].isdigit() and factor not in WIDE_FACTORS:
            per_turn = ratio * unit_factor(unit, column)
            said = f"it is in {unit}, measured behind the gear (gearbox.ratio {ratio:g})"
            found += _both_signs(
                column, factor / ratio, said, f"{per_turn:.7g} {COLUMN_UNITS[column]}"
            )
    if column == "speed_rpm" and edges:
        said = f"it is the frequency of the edges ({edges:g} a turn) in Hz"
        found += _both_signs(column, edges / 60.0, said, f"{60.0 / edges:.7g} rpm")
    apart = 2.0 * math.log1p(RULES.tolerance)
    return [u for u in found if min(_distance(u.factor, other) for other in others) > apart]


def _matches(factor: float, unit: Unit) -> bool:
    """Whether a factor is that of a unit."""
    limit = RULES.wide if unit.wide else 1.0 + RULES.tolerance
    return _distance(factor, unit) <= math.log(limit)


def _distance(factor: float, unit: Unit) -> float:
    """Magnitude of the logarithm of a factor over that of a unit; inf with opposite signs."""
    ratio = factor / unit.factor
    return abs(math.log(ratio)) if ratio > 0.0 else math.inf
