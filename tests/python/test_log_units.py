"""A log with units, signs or a time base that make a diagnosis wrong, and one given twice, are
refused with the mend; no log of a tool is that only differs from its rig.
"""

import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from made_log import drive_log, rig
from telemetry_board import ROOT
from vgroove import _core
from vgroove.cli import app
from vgroove.errors import VgrooveError
from vgroove.gap.log_check import check_log, checked_logs
from vgroove.gap.log_check.compared import refuse_uncompared
from vgroove.gap.log_check.current_driven import acceleration_factors
from vgroove.gap.log_check.factors import COLUMN_UNITS_WRITTEN, GEARED, slope_of, unit_findings
from vgroove.gap.log_check.nominal import nominal_pairs, starts_moving_or_deflected
from vgroove.gap.log_check.plausible import plausibility_findings, rate_finding
from vgroove.gap.log_check.row_convention import Shift
from vgroove.log import Log, as_log, read_log, write_csv
from vgroove.log.table import standstill_offset
from vgroove.log.units_of_columns import unit_factor
from vgroove.rig import Rig, read_rig
from vgroove.units import RAD_S_PER_RPM, RPM_PER_RAD_S, TIME_UNITS

LOGS = sorted((ROOT / "tests/data").rglob("log*.csv"))
PRACTICE = ROOT / "tests/data/practice/practice_006"
ALTERED = (
    "motor.resistance_ohm",
    "motor.inductance_h",
    "motor.torque_constant_nm_per_a",
    "motor.inertia_kg_m2",
    "motor.viscous_nm_s_per_rad",
    "motor.coulomb_nm",
    "gearbox.output_inertia_kg_m2",
)
LEVELS = (None, [(0.3, 0.3)], [(0.3, -0.4), (1.0, 0.5), (2.0, -0.8)], [(0.3, 1.0), (1.5, 0.0)])


def without_rate(tool: Rig) -> Rig:
    """The rig without log_hz."""
    return replace(tool, sensors={k: v for k, v in tool.sensors.items() if k != "log_hz"})


def scaled(log: Log, column: str, factor: float) -> Log:
    """The log with a column, or its time, times a factor."""
    if column == "time_s":
        return replace(log, time_s=log.time_s * factor, warnings=[])
    return replace(log, columns={**log.columns, column: log.columns[column] * factor}, warnings=[])


def practice() -> tuple[Log, Rig]:
    return read_log(PRACTICE / "log.csv"), read_rig(PRACTICE / "rig.toml")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "vgroove.cli", *arguments], capture_output=True, text=True
    )


@pytest.mark.parametrize("path", LOGS, ids=lambda path: f"{path.parent.name}/{path.name}")
@pytest.mark.parametrize("rate", [True, False], ids=["log_hz", "no log_hz"])
def test_the_logs_of_the_tree_are_not_refused(path: Path, rate: bool) -> None:
    tool = read_rig(path.parent / "rig.toml")
    check = check_log(read_log(path), tool if rate else without_rate(tool))
    assert not check.refused, check.findings


def test_altered_tools_are_not_refused() -> None:
    rng, nominal = np.random.default_rng(5), rig()
    for k in range(40):
        values = {key: nominal.value(key) * rng.uniform(0.5, 1.5) for key in ALTERED}
        values["supply.voltage_v"] = 18.0 * rng.uniform(0.7, 1.3)
        made = drive_log(nominal.with_values(values), seed=k, seconds=3.0, levels=LEVELS[k % 4])
        gains = {c: made.columns[c] * rng.uniform(0.7, 1.3) for c in ("current_a", "speed_rpm")}
        log = Log(made.time_s, {**made.columns, **gains}, "altered")
        check = check_log(log, nominal if k % 2 else without_rate(nominal))
        assert not check.refused, (values, check.findings)


UNITS = [
    ("current_a", 1e3, "current_a:mA=current_a"),
    ("current_a", -1.0, "current_a:-A=current_a"),
    ("current_a", -1e3, "current_a:-mA=current_a"),
    ("current_a", 1e-3, "current_a:kA=current_a"),
    ("speed_rpm", 1e-3, "speed_rpm:krpm=speed_rpm"),
    ("speed_rpm", 4.0 / 60.0, "speed_rpm:15 rpm=speed_rpm"),  # edges a second
    ("speed_rpm", np.pi / 30.0 / 9.0, "speed_rpm:85.94367 rpm=speed_rpm"),  # rad/s of the output
    ("duty", 100.0, "duty:%=duty"),
    ("duty", 255.0, "duty:0.003921569=duty"),
    ("duty", 32_767.0, "duty:3.051851e-05=duty"),
    ("supply_v", 1e3, "supply_v:mV=supply_v"),
    ("speed_rpm", np.pi / 30.0, "speed_rpm:rad/s=speed_rpm"),
    ("speed_rpm", 1.0 / 60.0, "speed_rpm:rev/s=speed_rpm"),
    ("speed_rpm", 2.0 * np.pi, "speed_rpm:rad/min=speed_rpm"),
    ("speed_rpm", 30.0 / np.pi, "speed_rpm:0.1047198 rpm=speed_rpm"),
    ("speed_rpm", 60.0, "speed_rpm:0.01666667 rpm=speed_rpm"),
    ("speed_rpm", -1.0, "speed_rpm:-rpm=speed_rpm"),
    ("speed_rpm", 1.0 / 9.0, "gearbox.ratio 9"),  # 60 / (2 pi) is 9.55, 6 % away
    ("duty", -1.0, "duty:-1=duty"),
    ("time_s", 1e3, "time_s:ms=time_s"),
    ("time_s", 1e6, "time_s:us=time_s"),
    ("current_a", 1e20, "more than any tool"),
]


@pytest.mark.parametrize(("column", "factor", "mend"), UNITS)
def test_a_wrong_unit_or_sign_is_named_with_its_mend(column: str, factor: float, mend: str) -> None:
    log, tool = practice()
    with pytest.raises(VgrooveError) as caught:
        checked_logs([scaled(log, column, factor)], tool)
    assert mend in str(caught.value) and "--as-is" in str(caught.value)
    assert checked_logs([scaled(log, column, factor)], tool, as_is=True)


def test_a_speed_without_its_sign_is_refused_where_the_drive_turns_backwards() -> None:
    nominal = without_rate(rig())
    levels = [(0.2, 0.6), (1.0, 0.0), (1.6, -0.5), (2.6, 0.0)]
    made = drive_log(rig(), seconds=3.4, levels=levels)
    log = Log(made.time_s, made.columns, "reversed")
    (speed,) = (p.nominal for p in nominal_pairs(log, nominal) if p.column == "speed_rpm")
    log = replace(log, columns={**log.columns, "speed_rpm": speed})
    assert not check_log(log, nominal).refused
    unsigned = replace(log, columns={**log.columns, "speed_rpm": np.abs(log["speed_rpm"])})
    (text,) = (f.text for f in check_log(unsigned, nominal).findings if f.refuses)
    assert "column speed_rpm: never negative" in text and "sign of the motion" in text
    forward = {name: values[:1500] for name, values in unsigned.columns.items()}
    assert not check_log(Log(log.time_s[:1500], forward, "forward"), nominal).refused


@pytest.mark.parametrize(
    ("column", "factor", "mend"),
    [
        ("current_a", 1e3, "current_a:mA=current_a"),
        ("current_a", -1e3, "current_a:-mA=current_a"),
        ("current_a", -1.0, "current_a:-A=current_a"),
        ("position_rad", 180.0 / np.pi, "position_rad:deg=position_rad"),
        ("position_rad", 0.5 / np.pi, "position_rad:rev=position_rad"),
        ("position_rad", 1e3, "position_rad:mrad=position_rad"),
        ("position_rad", -1.0, "position_rad:-rad=position_rad"),
    ],
)
def test_a_wrong_unit_is_named_where_a_current_drives(
    column: str, factor: float, mend: str
) -> None:
    folder = ROOT / "tests/data/emps"
    log, tool = read_log(folder / "log.csv"), read_rig(folder / "rig.toml")
    found = [f.text for f in check_log(scaled(log, column, factor), tool).findings if f.refuses]
    assert len(found) == 1 and mend in found[0], found


def current_driven() -> tuple[Log, Rig]:
    """A log with noise of a tool with friction and a load, which a current drives."""
    tool = replace(rig(), input={"kind": "current_a"}, load={"kind": "torque"})
    rng, time_s = np.random.default_rng(3), np.arange(4000) / 1000.0
    current = 6.0 * np.sign(np.sin(9.0 * time_s)) + 2.0 * np.sin(31.0 * time_s)
    load, speed = 0.15 * np.sign(np.sin(9.0 * time_s)), np.zeros(4000)
    motor, inertia = tool.motor, tool.shaft_inertia_kg_m2
    for k in range(1, 4000):
        torque = motor["torque_constant_nm_per_a"] * current[k] - load[k] / tool.gearbox["ratio"]
        torque -= 0.02 * np.tanh(speed[k - 1] / 5.0) + 5e-5 * speed[k - 1]
        speed[k] = speed[k - 1] + torque / inertia * 1e-3
    columns = {
        "current_a": current + rng.normal(0.0, 0.1, 4000),
        "speed_rpm": (speed + rng.normal(0.0, 1.0, 4000)) * 30.0 / np.pi,
        "load_nm": load,
    }
    return Log(time_s, columns, "made"), tool


def test_the_acceleration_per_current_allows_for_friction_noise_and_load() -> None:
    log, tool = current_driven()
    factors = acceleration_factors(log, tool)
    assert factors["speed_rpm"] == pytest.approx(1.0, abs=0.03)
    noise = {**log.columns, "speed_rpm": np.random.default_rng(1).normal(0.0, 100.0, 4000)}
    assert acceleration_factors(replace(log, columns=noise), tool) == {}


@pytest.mark.parametrize("column", ["speed_rpm", "load_nm", "current_a"])
@pytest.mark.parametrize("rows", [[0], [5], [2000], range(0, 4000, 7), range(100, 3000)])
def test_missing_samples_leave_the_acceleration_that_the_others_show(
    column: str, rows: Iterable[int]
) -> None:
    log, tool = current_driven()
    whole = acceleration_factors(log, tool)["speed_rpm"]
    part = with_values(log, column, rows, np.nan)
    assert acceleration_factors(part, tool)["speed_rpm"] == pytest.approx(whole, rel=0.08)
    (found,) = unit_findings(scaled(part, "speed_rpm", RAD_S_PER_RPM), tool)
    assert found.refuses and '"speed_rpm:rad/s=speed_rpm"' in found.text
    assert unit_findings(part, tool) == []


@pytest.mark.parametrize("column", ["current_a", "load_nm"])
def test_a_column_that_is_slower_than_the_log_shows_the_acceleration(column: str) -> None:
    log, tool = current_driven()
    slow = with_values(log, column, np.flatnonzero(np.arange(4000) % 10), np.nan)
    assert acceleration_factors(slow, tool)["speed_rpm"] == pytest.approx(1.0, abs=0.08)


def test_a_run_without_current_shows_no_acceleration_per_current() -> None:
    log, tool = current_driven()
    coasting = 5000.0 * np.exp(-log.time_s) + log["speed_rpm"] % 1.0
    columns = log.columns | {"current_a": np.zeros(4000), "speed_rpm": coasting}
    assert acceleration_factors(replace(log, columns=columns), tool) == {}
    assert not check_log(replace(log, columns=columns), tool).refused


@pytest.mark.parametrize(("values", "said"), [(None, "is missing"), (np.nan, "holds no value")])
@pytest.mark.parametrize("rate", [True, False], ids=["log_hz", "no log_hz"])
def test_a_log_without_its_driving_current_is_refused_in_the_same_sentence(
    values: float | None, said: str, rate: bool
) -> None:
    log, tool = current_driven()
    rest = {name: column for name, column in log.columns.items() if name != "current_a"}
    given = {} if values is None else {"current_a": np.full(4000, values)}
    table = replace(log, columns=rest | {"duty": np.full(4000, 0.5)} | given)
    with pytest.raises(VgrooveError, match="made: the column current_a.*drives the model") as text:
        check_log(table, tool if rate else without_rate(tool))
    assert said in str(text.value)


@pytest.mark.parametrize("weight_nm", [40.0, 46.0, 50.0, 55.0, 80.0])
def test_a_load_that_the_rig_of_a_current_driven_arm_lacks_is_no_unit(weight_nm: float) -> None:
    """The simulation without the arm's weight turns several times as far: with some weights by the
    factor of a unit.
    """
    time_s, speed = np.arange(600) / 133.3, 0.7
    angle = speed * np.maximum(time_s - 0.3, 0.0)
    torque = 7.8 * speed + 6.1 + weight_nm * np.sin(angle)
    motor = {"inertia_kg_m2": 2.33, "viscous_nm_s_per_rad": 7.8, "coulomb_nm": 6.1}
    tool = replace(
        rig(),
        input={"kind": "current_a"},
        motor=rig().motor | motor | {"torque_constant_nm_per_a": 1.0},
        gearbox={"ratio": 1.0, "output_inertia_kg_m2": 0.0},
        sensors={"log_hz": 133.3},
    )
    log = Log(time_s, {"current_a": torque * (time_s > 0.3), "position_rad": angle}, "arm")
    assert acceleration_factors(log, tool) == {}
    findings = check_log(log, tool).findings
    assert any("position_rad" in f.text and f.warns for f in findings)
    assert not any(f.refuses for f in findings)
    damaged = check_log(scaled(log, "position_rad", 1e3), tool)  # more than a load makes
    assert any("position_rad" in f.text and f.refuses for f in damaged.findings)


def slow_drive(friction: float = 1.0) -> Rig:
    """A drive that accelerates faster than its logger writes rows, driven by a current, with so
    many times its usual viscous friction.
    """
    motor = {"inertia_kg_m2": 1.5e-6, "coulomb_nm": 0.0, "viscous_nm_s_per_rad": 1e-5 * friction}
    tool = rig(motor=motor, gearbox={"ratio": 1.0, "output_inertia_kg_m2": 0.0})
    return replace(tool, input={"kind": "current_a"}, sensors={"log_hz": 4.0})


def slow_log(tool: Rig, load: float = 0.0) -> Log:
    """A correct log of the slow drive, with a load that the rig does not state, a multiple of the
    motor's torque.
    """
    fine_s, time_s = np.arange(12_000) / 100.0, np.arange(480) / 4.0
    levels = np.repeat([0.3, 0.6, 0.9, 0.5, 0.2, 0.7, 1.0, 0.4], 60)
    current = np.interp(fine_s, time_s, levels)
    torque = tool.motor["torque_constant_nm_per_a"] * current * (1.0 - load)
    viscous = tool.motor["viscous_nm_s_per_rad"]
    kept = np.exp(-viscous / tool.shaft_inertia_kg_m2 / 100.0)  # of the speed, after 10 ms
    speed = scipy.signal.lfilter([(1.0 - kept) / viscous], [1.0, -kept], torque)
    columns = {
        "current_a": levels,
        "speed_rpm": np.interp(time_s, fine_s, speed) * RPM_PER_RAD_S,
        "position_rad": np.interp(time_s, fine_s, np.cumsum(speed) / 100.0),
    }
    columns["speed_rpm"] += np.random.default_rng(1).normal(0.0, 0.3, 480)
    return Log(time_s, columns, "slow")


DRIFTS = [(6.3, 1.0), (9.0, 1.0), (9.55, 1.0), (60.0, 1.0), (6.0, 57.3), (6.0, 343.8)]


@pytest.mark.parametrize(("friction", "stated"), DRIFTS)
@pytest.mark.parametrize("columns", [("speed_rpm",), ("position_rad",), GEARED])
def test_friction_far_from_the_rigs_is_no_unit_where_the_simulated_motion_drifts(
    friction: float, stated: float, columns: tuple[str, ...]
) -> None:
    log, tool = slow_log(slow_drive(friction)), slow_drive(stated)
    log = replace(log, columns={name: log[name] for name in ("current_a", *columns)})
    assert acceleration_factors(log, tool) == {}
    check = check_log(log, tool)
    assert not check.refused, check.findings
    assert all(any(n in f.text and f.warns for f in check.findings) for n in columns), check


@pytest.mark.parametrize(
    ("column", "factor", "mend"),
    [
        ("speed_rpm", 1e-3, '"speed_rpm:krpm=speed_rpm"'),
        ("position_rad", 1e3, '"position_rad:mrad=position_rad"'),
        ("position_rad", 4096.0 / (2.0 * np.pi), "counts of an encoder, 4"),
    ],
)
def test_a_factor_that_only_a_unit_makes_is_refused_where_the_simulated_motion_drifts(
    column: str, factor: float, mend: str
) -> None:
    log, tool = slow_log(slow_drive(6.0)), slow_drive(6.0)
    assert check_log(log, tool).findings == []
    found = [f.text for f in unit_findings(scaled(log, column, factor), tool) if f.refuses]
    assert len(found) == 1 and mend in found[0], found


def test_a_load_that_drives_the_shaft_backwards_is_no_wrong_sign_of_the_current() -> None:
    """A current that lowers loads which the rig does not state, and supports half of each."""
    tool = slow_drive(6.0)
    log = slow_log(tool, load=2.0)
    assert np.nanmax(log["speed_rpm"]) < 0.0
    check = check_log(log, tool)
    assert not check.refused, check.findings
    assert {f.text.split()[1] for f in check.findings if f.warns} == {"speed_rpm:", "position_rad:"}


def with_angle(log: Log, turn: float) -> Log:
    """The log with a position in units of which `turn` are one turn of the motor."""
    angle = np.cumsum(log["speed_rpm"]) / 60.0 * np.median(np.diff(log.time_s)) * turn
    return replace(log, columns={**log.columns, "position_rad": angle}, warnings=[])


@pytest.mark.parametrize(
    ("turn", "mend"),
    [
        (360.0, '"position_rad:deg='),
        (1.0, '"position_rad:rev='),
        (2.0 * np.pi / 9.0, "gearbox.ratio 9"),
        (64.0, "counts of an encoder, 63."),
        (4096.0, "counts of an encoder, 40"),  # the shaft is 0.5 % slower than the rig's
        (-2000.0, "counts of an encoder, 19"),
    ],
)
def test_a_position_in_another_unit_is_named(turn: float, mend: str) -> None:
    log, tool = practice()
    assert not check_log(with_angle(log, 2.0 * np.pi), tool).refused
    found = [f.text for f in check_log(with_angle(log, turn), tool).findings if f.refuses]
    assert len(found) == 1 and mend in found[0], found


@pytest.mark.parametrize("missing", [slice(0, 1500), slice(0, 1), slice(700, 1500)])
def test_a_position_that_begins_in_motion_is_compared_from_its_first_row_on(missing: slice) -> None:
    log, tool = practice()
    late = with_angle(log, 2.0 * np.pi)
    late["position_rad"][missing] = np.nan
    (pair,) = (pair for pair in nominal_pairs(late, tool) if pair.column == "position_rad")
    assert pair.relative_error() < 0.01
    assert not check_log(late, tool).refused
    turns = scaled(late, "position_rad", 0.5 / np.pi)
    found = [f.text for f in check_log(turns, tool).findings if f.refuses]
    assert len(found) == 1 and '"position_rad:rev=position_rad"' in found[0], found


@pytest.mark.parametrize("turn", [2.0 * np.pi, 360.0])
def test_an_angle_within_one_turn_is_refused(turn: float) -> None:
    log, tool = practice()
    turning = with_angle(log, turn)
    wrapped = {**turning.columns, "position_rad": turning["position_rad"] % turn}
    found = check_log(replace(turning, columns=wrapped), tool)
    assert found.refused and "within one turn" in found.findings[0].text, found.findings


def test_an_angle_that_wraps_once_is_refused() -> None:
    log, tool = practice()
    slow = with_angle(log, 2.0 * np.pi)
    angle = slow["position_rad"] / np.ptp(slow["position_rad"]) * 9.0  # 1.4 turns
    for shift in (0.0, 1.0, 3.0):
        wrapped = {**slow.columns, "position_rad": (angle + shift) % (2.0 * np.pi)}
        found = check_log(replace(slow, columns=wrapped), tool)
        assert "jumps once" in found.findings[0].text, (shift, found.findings)


def test_one_jump_with_the_motion_or_over_a_gap_is_no_wrap() -> None:
    time_s, slope = np.arange(100) / 100, np.linspace(0.0, 5.0, 100)
    gap = time_s + np.where(time_s > 0.5, 1.0, 0.0)
    for times, jump in ((time_s, 9.0), (gap, 9.0), (gap, -9.0)):
        angle = slope + np.where(time_s > 0.5, jump, 0.0)
        log = Log(times, {"duty": slope / 5, "position_rad": angle}, "stepped")
        assert not check_log(log).refused
    log = Log(time_s, {"duty": slope / 5, "position_rad": angle}, "wrapped")
    assert check_log(log).refused


@given(st.integers(0, 1000), st.floats(1e-4, 0.05), st.sampled_from([-10.0, 10.0]))
@settings(max_examples=50, deadline=None)
def test_a_step_between_two_rows_is_no_wrap(seed: int, noise: float, step: float) -> None:
    rng, time_s = np.random.default_rng(seed), np.arange(100) / 5
    for moves in ([50], [20, 50, 80]):
        angle = sum(step * (-1) ** k * (time_s > row / 5) for k, row in enumerate(moves))
        columns = {"duty": time_s / 20, "position_rad": angle + rng.normal(0.0, noise, 100)}
        check = check_log(Log(time_s, columns, "stepped"))
        assert not check.refused
        assert ["may be an angle" in f.text and f.warns for f in check.findings] == [
            True for _ in moves[2:]
        ]


def test_a_counter_that_is_set_to_another_value_is_named() -> None:
    time_s = np.arange(400) / 100
    angle = 5.0 * time_s - np.where(time_s > 2.0, 10.0, 0.0)
    found = check_log(Log(time_s, {"duty": time_s / 4, "position_rad": angle}, "homed"))
    assert found.refused and "(homing): cut the log there" in found.findings[0].text


@given(st.floats(0.02, 1.0))
@settings(max_examples=50, deadline=None)
def test_a_driving_voltage_in_mv_is_named_before_the_speed(share: float) -> None:
    folder = ROOT / "tests/data/real/robotino_m1_delay"
    log, tool = read_log(folder / "log.csv"), read_rig(folder / "rig.toml")
    top = np.nanmax(np.abs(log["voltage_v"]))
    for factor, refused in ((24.0 * share / top, False), (24e3 * share / top, True)):
        found = plausibility_findings(scaled(log, "voltage_v", factor), tool)
        assert [f.refuses for f in found] == [True] * refused, found
    assert "voltage_v:mV=voltage_v" in found[0].text
    assert not plausibility_findings(scaled(log, "voltage_v", 9.9 * 24.0 / top), tool)
    far = plausibility_findings(scaled(log, "voltage_v", 1.1e4 * 24.0 / top), tool)
    assert "mV" not in far[0].text and far[0].refuses


def test_a_factor_that_the_command_may_have_names_it_too() -> None:
    folder = ROOT / "tests/data/real/robotino_m1_delay"
    log, tool = read_log(folder / "log.csv"), read_rig(folder / "rig.toml")
    alone = replace(log, columns={n: log[n] for n in ("voltage_v", "speed_rpm")}, warnings=[])
    for factor, unit in ((1e-3, "mV"), (-1e-3, "-mV"), (-1.0, "-V")):
        (found,) = unit_findings(scaled(alone, "speed_rpm", factor), tool)
        assert f'voltage_v:{unit}=voltage_v"' in found.text and "speed_rpm:" in found.text
    (found,) = unit_findings(scaled(log, "speed_rpm", 1e-3), tool)
    assert "voltage_v:" not in found.text  # the current shows that the command is in V


MARKS = [(6553.5, True), (-3276.8, True), (60.0, False)]  # times most / 20


@pytest.mark.parametrize(("mark", "refused"), MARKS)
@pytest.mark.parametrize("column", ["current_a", "speed_rpm"])
def test_any_value_far_beyond_the_others_marks_missing_samples_in_single_rows(
    column: str, mark: float, refused: bool
) -> None:
    log, tool = practice()
    value = mark / 20.0 * float(np.nanmax(np.abs(log[column])))
    for rows in ([500], [500, 700], range(500, 560)):  # too few, or one after the other
        assert not plausibility_findings(with_values(log, column, rows, value), tool)
    found = plausibility_findings(with_values(log, column, range(500, 5000, 97), value), tool)
    assert [(f.refuses, "47 rows" in f.text) for f in found] == [(True, True)] * refused


SINGLE = tuple(range(500, 5000, 97))
BURSTS = tuple(row + k for row in range(500, 5000, 500) for k in range(10))


@pytest.mark.parametrize("mark", [65_535, 32_767, -32_768])
@pytest.mark.parametrize("rows", [SINGLE, BURSTS, (0, 1, 2), (5997, 5998, 5999), range(500, 4000)])
@pytest.mark.parametrize("top", [9000.0, 13_200.0, 24_700.0])
def test_a_number_that_loggers_write_is_a_mark_whatever_its_ratio_and_run(
    mark: float, rows: tuple[int, ...], top: float
) -> None:
    log, tool = practice()
    slower = scaled(log, "speed_rpm", top / np.nanmax(log["speed_rpm"]))
    found = plausibility_findings(with_values(slower, "speed_rpm", rows, mark), tool)
    unloaded = tool.supply["voltage_v"] / tool.motor["torque_constant_nm_per_a"] * RPM_PER_RAD_S
    certain = rows is SINGLE or abs(mark) > min(5.0 * top, 2.0 * unloaded)
    assert [(f.refuses, f.warns, f"in {len(rows)} rows" in f.text) for f in found] == [
        (certain, not certain, True)
    ], found
    assert not plausibility_findings(with_values(slower, "speed_rpm", rows[:2], mark), tool)


@pytest.mark.parametrize("rows", [SINGLE, BURSTS])
def test_a_mark_within_the_range_of_its_column_is_seen_where_the_column_is_far_from_it(
    rows: tuple[int, ...],
) -> None:
    log, tool = practice()  # its speed passes 9999 rpm on the way to 24,700 rpm
    (found,) = plausibility_findings(with_values(log, "speed_rpm", rows, 9999.0), tool)
    assert found.refuses == (rows is SINGLE) and "exactly 9999" in found.text


@pytest.mark.parametrize("rest", [0.0, 32_768.0])
def test_a_column_that_rests_at_a_loggers_number_is_not_refused(rest: float) -> None:
    rows = np.arange(600)
    clipped = np.minimum(np.where(rows % 60 < 30, 6000.0, 14_000.0) + rows % 3, 9999.0)
    stations = np.where(rows % 100 < 50, rest, 32_767.0 - 0.4 * rest)
    switched = np.where(rows % 40 < 20, 0.0, 9999.0)
    columns = {"position_rad": stations, "speed_rpm": clipped, "current_a": switched}
    log = Log(0.1 * rows, {"duty": np.full(600, 0.5)} | columns, "at rest")
    found = [f for f in plausibility_findings(log) if "missing samples" in f.text]
    assert not [f for f in found if f.refuses] and "current_a" not in str(found)


@given(st.integers(-2, 2), st.sampled_from([9999, 32_767, 65_535]), st.integers(1, 500))
@settings(max_examples=60, deadline=None)
def test_a_number_that_a_column_comes_near_to_is_no_mark(rest: int, mark: int, speed: int) -> None:
    """A counter that passes the number or rests at it, a speed around it, a sensor at its limit."""
    rng, rows = np.random.default_rng(speed), np.arange(2000)
    counter = np.minimum(mark - 90 + speed * np.maximum(rows - 100, 0) // 20, mark + rest)
    steady = np.round(mark + rng.normal(0.0, 1.0 + 0.01 * speed, 2000))
    clipped = np.minimum(mark, np.round(1.2 * mark * np.sin(rows * speed / 1e5) ** 2))
    columns = {"position_rad": counter, "speed_rpm": steady, "current_a": clipped}
    log = Log(rows / 1000.0, {"duty": np.full(2000, 0.5)} | columns, "near")
    assert not [f for f in plausibility_findings(log) if "missing samples" in f.text]


def with_values(log: Log, column: str, rows: Iterable[int], value: float) -> Log:
    """The log with a value in these rows of a column."""
    values = log[column].copy()
    values[list(rows)] = value
    return replace(log, columns=log.columns | {column: values}, warnings=[])


@pytest.mark.parametrize("mark", [65_535, -32_768, 99_999, 2**32 - 1])
@pytest.mark.parametrize("column", ["current_a", "position_rad"])
def test_the_marks_of_loggers_are_refused_without_a_rig(column: str, mark: float) -> None:
    log = with_angle(practice()[0], 1.0)
    found = plausibility_findings(with_values(log, column, range(500, 5000, 97), mark))
    assert any(f.refuses and "marks missing samples" in f.text for f in found)


@given(st.floats(5.2, 12.8), st.integers(3, 9))
@settings(max_examples=30, deadline=None)
def test_inrush_at_the_limit_of_the_sensor_is_a_warning(ratio: float, starts: int) -> None:
    log, tool = practice()
    current = np.full(len(log), 1.6)
    current[200 : 200 + 500 * starts : 500] = 1.6 * ratio
    saturated = replace(log, columns=log.columns | {"current_a": current}, warnings=[])
    for rig_or_none in (tool, None):
        (found,) = plausibility_findings(saturated, rig_or_none)
        assert found.warns and not found.refuses


def loaded() -> tuple[Log, Rig]:
    folder = PRACTICE.parent / "practice_005"
    return read_log(folder / "log.csv"), read_rig(folder / "rig.toml")


@pytest.mark.parametrize(
    ("torque_nm", "part"),
    [
        (0.7, ""),
        (40.0, ""),
        (41.0, '"load_nm:mNm='),
        (40_000.0, '"load_nm:mNm='),
        (41e3, "another unit"),
    ],
)
def test_a_load_beyond_ten_times_the_stall_torque_is_refused(torque_nm: float, part: str) -> None:
    log, tool = loaded()  # 12 V / 0.35 ohm * 0.0085 Nm/A * 14 = 4.08 Nm
    factor = torque_nm / np.nanmax(np.abs(log["load_nm"]))
    found = plausibility_findings(scaled(log, "load_nm", factor), tool)
    assert [f.refuses for f in found] == [True] * bool(part) and all(part in f.text for f in found)
    assert not plausibility_findings(scaled(log, "load_nm", factor))


@pytest.mark.parametrize("kind", ["current_a", "voltage_v"])
def test_the_load_of_a_barely_driven_run_is_compared_with_the_supply(kind: str) -> None:
    log, tool = loaded()
    driven = replace(tool, input={"kind": kind})
    weak = replace(log, columns=log.columns | {kind: np.full(len(log), 1e-4)}, warnings=[])
    assert not plausibility_findings(weak, driven)
    (found,) = plausibility_findings(scaled(weak, "load_nm", 1e3), driven)
    assert found.refuses and "load_nm:mNm" in found.text
    without = replace(driven, supply={})
    assert not plausibility_findings(scaled(weak, "load_nm", 1e3), without)


def test_a_load_of_the_opposite_sign_is_named_beside_the_current() -> None:
    log, tool = loaded()
    assert not check_log(log, tool).refused
    (found,) = (f for f in check_log(scaled(log, "load_nm", -1.0), tool).findings if f.refuses)
    assert '"current_a:-A=current_a"' in found.text and '"load_nm:-Nm=load_nm"' in found.text


@given(st.floats(60.0, 1e4), st.booleans())
@settings(max_examples=30, deadline=None)
def test_a_current_around_the_middle_of_its_range_has_an_offset(middle: float, sign: bool) -> None:
    log, _ = practice()
    most = float(np.nanmax(np.abs(log["current_a"])))
    middle = (1.0 if sign else -1.0) * max(middle, 1.1 * most)
    rest = {"duty": np.zeros(60), "current_a": np.zeros(60), "speed_rpm": np.zeros(60)}
    columns = {n: np.concatenate([v, log[n]]) for n, v in rest.items()}
    shifted = columns | {"current_a": columns["current_a"] + middle}
    made = as_log({"time_s": np.arange(len(columns["duty"])) / 1000} | shifted)
    assert standstill_offset(made) == pytest.approx(middle, rel=0.02)
    assert ["at standstill" in warning for warning in made.warnings] == [True]
    small = replace(made, columns=columns | {"current_a": columns["current_a"] + 0.9 * most})
    assert standstill_offset(small) == 0.0 == standstill_offset(log)


def test_a_column_without_a_value_compares_no_sample() -> None:
    log, tool = practice()
    empty = replace(log, columns={**log.columns, "current_a": np.full(len(log), np.nan)})
    with pytest.raises(VgrooveError, match="column current_a: holds no value"):
        checked_logs([empty], tool)
    assert not check_log(empty).refused


def test_each_unit_that_a_message_names_is_one_that_the_map_reads() -> None:
    ratio = practice()[1].gearbox["ratio"]
    written = {
        (c, name): f for c, units in COLUMN_UNITS_WRITTEN.items() for f, name in units.items()
    }
    written |= {("time_s", name): factor for factor, name in TIME_UNITS.items()}
    written |= {("speed_rpm", f"{ratio:g} rpm"): 1.0 / ratio, ("duty", "-1"): -1.0}
    for (column, name), factor in written.items():
        assert unit_factor(name, column) * factor == pytest.approx(1.0), (column, name)


SERVO = {
    "motor": {
        "resistance_ohm": 3.4,
        "inductance_h": 5e-4,
        "torque_constant_nm_per_a": 0.354,
        "inertia_kg_m2": 1.8e-3,
    },
    "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
    "load": {"kind": "pendulum", "mass_kg": 0.49, "length_m": 0.1, "zero_rad": 0.15},
    "sensors": {"hall_pulses_per_rev": 0},
}


@pytest.mark.parametrize(("angle", "speed"), [(0.95, 0.0), (0.95, -3.0), (0.15, -8.0)])
def test_a_pendulum_that_starts_moving_or_deflected_has_no_wrong_sign(
    angle: float, speed: float
) -> None:
    """The command brakes the pendulum that falls: from rest it would move it the other way."""
    servo = rig(**SERVO)
    time_s = 0.005 * np.arange(30)
    duty = np.full(30, 0.02)
    drive = _core.LogInput(time_s, "duty", duty, load_kind="pendulum")
    start = np.array([[0.0, speed, angle]])
    rows = _core.simulate_log(drive, servo.parameters()[None], np.array([0]), start)
    columns = {
        "duty": duty,
        "speed_rpm": rows["speed_rad_s"][0] * RPM_PER_RAD_S,
        "position_rad": rows["angle_rad"][0],
    }
    assert np.median(columns["speed_rpm"]) < 0.0
    log = Log(time_s, columns, "falling")
    assert starts_moving_or_deflected(log, servo) and unit_findings(log, servo) == []
    quiet = log.columns["speed_rpm"] + np.random.default_rng(1).standard_normal(30)
    noisy = replace(log, columns=log.columns | {"speed_rpm": quiet})
    assert starts_moving_or_deflected(noisy, servo)


def test_a_pendulum_that_hangs_at_rest_shows_a_wrong_sign() -> None:
    servo = rig(**SERVO)
    time_s = 0.005 * np.arange(200)
    duty = np.where(time_s > 0.05, 0.2, 0.0)
    drive = _core.LogInput(time_s, "duty", duty, load_kind="pendulum")
    start = np.array([[0.0, 0.0, 0.15]])
    rows = _core.simulate_log(drive, servo.parameters()[None], np.array([0]), start)
    speed = rows["speed_rad_s"][0] * RPM_PER_RAD_S
    log = Log(time_s, {"duty": duty, "speed_rpm": -speed}, "hanging")
    assert not starts_moving_or_deflected(log, servo)
    assert any(found.refuses for found in unit_findings(log, servo))


def test_a_factor_of_a_tool_is_no_unit() -> None:
    log, tool = practice()
    for factor in (0.7, 1.3, 0.4, 2.5):
        assert not check_log(scaled(log, "speed_rpm", factor), tool).findings
    off = check_log(scaled(log, "speed_rpm", 1.3 / 60.0), tool)
    assert not off.refused and "rev/s" in off.findings[0].text


@pytest.mark.parametrize("pairs", [4, 5, 7, 9, 11, 14, 15])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_electrical_speed_is_named_with_its_pole_pairs(pairs: int, sign: float) -> None:
    log, tool = practice()
    (pair,) = (pair for pair in nominal_pairs(log, tool) if pair.column == "speed_rpm")
    own = slope_of(pair, log, tool).factor
    exact = scaled(log, "speed_rpm", sign * pairs / own)
    said = [f.text for f in check_log(exact, tool).findings if "speed_rpm" in f.text]
    mend = f'--map "speed_rpm:{sign / pairs:.6g} rpm=speed_rpm"'
    assert f"electrical rpm with {pairs} pole pairs" in said[0] and mend in said[0], said
    half = scaled(log, "speed_rpm", sign * (pairs + 0.5) / own)
    assert not [f for f in check_log(half, tool).findings if "electrical rpm" in f.text]


def test_a_factor_of_many_pole_pairs_is_named_without_them() -> None:
    log, tool = practice()
    (pair,) = (pair for pair in nominal_pairs(log, tool) if pair.column == "speed_rpm")
    own = slope_of(pair, log, tool).factor
    for factor in (2.0, 3.0, 16.0, 30.0):
        findings = check_log(scaled(log, "speed_rpm", factor / own), tool).findings
        assert not [f for f in findings if "pole pairs" in f.text], factor


def test_an_electrical_frequency_is_named_beside_the_nearest_unit() -> None:
    log, tool = practice()
    found = check_log(scaled(log, "speed_rpm", 7.0 / 60.0), tool).findings
    assert found[0].refuses and "electrical Hz with 7 pole pairs" in found[0].text, found
    found = check_log(scaled(log, "speed_rpm", RAD_S_PER_RPM), tool).findings
    assert "electrical" not in found[0].text and "rad/s" in found[0].text


def test_times_in_ms_are_seen_without_a_stated_rate() -> None:
    log, tool = practice()
    with pytest.raises(VgrooveError, match="time_s:ms=time_s"):
        checked_logs([scaled(log, "time_s", 1e3)], without_rate(tool))


@given(st.sampled_from(["min", "h", "d"]), st.floats(0.5e-3, 5e-3))
@settings(max_examples=30, deadline=None)
def test_rows_faster_than_any_logger_are_in_a_longer_unit(unit: str, interval_s: float) -> None:
    log, tool = practice()
    stamps = log.time_s[:400] * interval_s * 1e3 / unit_factor(unit, "time_s")
    fast = replace(
        log, time_s=stamps, columns={n: v[:400] for n, v in log.columns.items()}, warnings=[]
    )
    found = [f for f in rate_finding(fast, without_rate(tool)) if f.refuses]
    assert bool(found) == (np.median(np.diff(stamps)) < 1e-6), found
    assert all(f"time_s:{unit}=time_s" in f.text for f in found)


@pytest.mark.parametrize("start_s", [0.0, 3.0, 100.0])
def test_rows_at_1_mhz_are_those_of_a_logger(start_s: float) -> None:
    log, tool = practice()
    columns = {n: v[:400] for n, v in log.columns.items()}
    fast = replace(log, time_s=start_s + np.arange(400) / 1e6, columns=columns, warnings=[])
    assert not rate_finding(fast, without_rate(tool))


def test_times_in_minutes_are_seen_without_a_stated_rate() -> None:
    log, tool = practice()
    found = check_log(scaled(log, "time_s", 1 / 60), without_rate(tool)).findings
    assert found[0].refuses and "time_s:min=time_s" in found[0].text, found
    stated = check_log(scaled(log, "time_s", 1 / 86_400), tool).findings
    assert stated[0].refuses and "time_s:d=time_s" in stated[0].text, stated


@pytest.mark.parametrize(("factor", "refused"), [(2.9, False), (3.1, True), (1 / 3.1, True)])
def test_a_rate_far_from_the_rigs_is_refused(factor: float, refused: bool) -> None:
    log, tool = practice()
    stated = replace(tool, sensors={**tool.sensors, "log_hz": 1000.0 / factor})
    findings = [f for f in check_log(log, stated).findings if "log_hz" in f.text]
    assert bool(findings) == refused


def test_a_logger_that_writes_its_rows_in_batches_keeps_its_rate() -> None:
    log, tool = practice()
    rows = np.arange(len(log))
    batched = replace(log, time_s=log.time_s[0] + (rows // 16 * 16 + rows % 16 * 0.2) * 1e-3)
    assert np.median(np.diff(batched.time_s)) * tool.sensors["log_hz"] < 1.0 / 4.0
    assert not [f for f in check_log(batched, tool).findings if "log_hz" in f.text]


def test_the_same_log_twice_is_refused_by_its_content(tmp_path: Path) -> None:
    log, tool = practice()
    shifted = replace(log, time_s=log.time_s + 5.0, source="copy")
    for as_is in (False, True):
        with pytest.raises(VgrooveError, match="copy: holds the same samples as"):
            checked_logs([log, shifted], tool, as_is)
    assert len(checked_logs([log, scaled(log, "speed_rpm", 1.001)], tool)) == 2


def test_a_column_without_a_compared_sample_is_refused() -> None:
    class Problem:
        """Two columns, of which the second is nowhere judged."""

        theta0 = None
        signals = (type("S", (), {"column": "current_a"}), type("S", (), {"column": "speed_rpm"}))
        signal, judged = np.array([0, 0, 1]), np.array([True, True, False])
        logs = (type("L", (), {"source": "a.csv"}),)

        def residuals(self, theta: None) -> list[np.ndarray]:
            return [np.ones(3)]

        def squared(self, residual: np.ndarray) -> np.ndarray:
            return residual**2

    with pytest.raises(VgrooveError, match="no sample of speed_rpm"):
        refuse_uncompared(Problem())


def with_rows_as_instants(log: Log, kind: str = "duty") -> Log:
    """The log with each command in the row from which on it acts."""
    command = log.columns[kind]
    later = np.append(command[1:], command[-1])
    return replace(log, columns={**log.columns, kind: later}, warnings=[])


@pytest.mark.parametrize("number", ["001", "004", "006", "009", "010", "011"])
def test_the_convention_of_the_rows_is_that_of_the_response(number: str) -> None:
    folder = PRACTICE.parent / f"practice_{number}"
    log, tool = read_log(folder / "log.csv"), read_rig(folder / "rig.toml")
    check = check_log(log, tool)
    assert check.facts.command_rows == "interval" and not check.findings, check
    check = check_log(with_rows_as_instants(log), tool)
    assert check.facts.command_rows == "instant", check.facts
    assert 'hold = "after"' in check.findings[0].text
    stated = replace(tool, input={**tool.input, "hold": "after"})
    assert not check_log(with_rows_as_instants(log), stated).findings


def test_a_longer_delay_of_the_tool_is_no_convention() -> None:
    folder = PRACTICE.parent / "practice_003"  # 4.2 rows
    log, tool = read_log(folder / "log.csv"), read_rig(folder / "rig.toml")
    assert check_log(log, tool).facts.command_rows == "unknown"


def test_a_log_that_does_not_show_the_convention_leaves_it_open() -> None:
    log, tool = practice()
    steady = replace(log, columns={**log.columns, "duty": np.full(len(log), 0.5)}, warnings=[])
    assert check_log(steady, tool).facts.command_rows == "unknown"
    noise = np.random.default_rng(1).normal(0.0, 20.0, len(log))
    noisy = replace(log, columns={**log.columns, "current_a": noise}, warnings=[])
    assert check_log(noisy, tool).facts.command_rows == "unknown"
    assert Shift("current_a", 0.2, 0.09, 1.0).side == "interval"
    assert Shift("current_a", 0.2, 0.11, 1.0).side == ""
    assert Shift("current_a", 0.2, 0.01, 0.1).side == ""


def test_the_command_prints_facts_and_writes_them(tmp_path: Path) -> None:
    path = tmp_path / "check.json"
    arguments = ["log", "check", f"{PRACTICE / 'log.csv'}", "--rig", f"{PRACTICE / 'rig.toml'}"]
    done = CliRunner().invoke(app, [*arguments, "--json", str(path)])
    assert done.exit_code == 0 and "6000 rows" in done.stdout, done.output
    facts = json.loads(path.read_text())
    assert facts["interval_s"] == pytest.approx(1e-3) and not facts["refused"]


def test_commands_end_with_2_for_a_wrong_unit_unless_it_is_wanted(tmp_path: Path) -> None:
    rig_path, wrong = str(PRACTICE / "rig.toml"), tmp_path / "mA.csv"
    write_csv(scaled(practice()[0], "current_a", 1e3), wrong)
    done = run("gap", "diagnose", str(wrong), "--rig", rig_path, "--json", f"{tmp_path / 'v.json'}")
    assert done.returncode == 2 and "current_a:mA=current_a" in done.stderr, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mA.csv"]
    check = ["log", "check", str(wrong), "--rig", rig_path]
    simulate = ["sim", rig_path, "--log", str(wrong)]
    for command in (check, simulate):
        assert isinstance(CliRunner().invoke(app, command).exception, VgrooveError)
    for command in (check, simulate):
        done = CliRunner().invoke(app, [*command, "--as-is"])
        assert done.exit_code == 0 and ("mA=current_a" in done.stderr) == (command is check)


def test_a_proposed_map_names_the_column_as_the_file_does(tmp_path: Path) -> None:
    path = tmp_path / "named.csv"
    write_csv(scaled(scaled(practice()[0], "current_a", 1e3), "time_s", 1e3), path)
    header, rest = path.read_text().split("\n", 1)
    path.write_text(header.replace("time_s", "Zeit").replace("current_a", "Strom") + "\n" + rest)
    check = ["log", "check", str(path), "--rig", str(PRACTICE / "rig.toml")]
    time = ["--map", "Zeit=time_s", "--map", "Strom=current_a"]
    with pytest.raises(VgrooveError, match='--map "Zeit:ms=time_s"'):
        CliRunner().invoke(app, [*check, *time], catch_exceptions=False)
    mended = ["--map", "Zeit:ms=time_s", "--map", "Strom=current_a"]
    with pytest.raises(VgrooveError, match='--map "Strom:mA=current_a"'):
        CliRunner().invoke(app, [*check, *mended], catch_exceptions=False)
    done = CliRunner().invoke(app, [*check, *mended[:-1], "Strom:mA=current_a"])
    assert done.exit_code == 0, done.output
