"""Logs of slow loggers, and logs whose rows are instants: restarts at intervals of several rows,
and the command of a row held from the row on.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import SCALES, Toy
from made_log import MadeLog, drive_log, rig
from vgroove import _core
from vgroove.gap import diagnose
from vgroove.gap.catalogue import BY_ID, Effect
from vgroove.gap.cleaning.logging_interval import logging_interval_s
from vgroove.gap.fitting.coordinates import HypothesisBuilder
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.restarts import RESTART, restart_interval_s
from vgroove.gap.selection.log_content import shown_effects
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.parameter_estimate import ParameterEstimate
from vgroove.gap.verdict.row_delay import row_delay_remarks
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RAD_S_PER_RPM

RESTART_S, NOISE_RPM = 0.25, 5.0
ROWS = 400
FAST_MOTOR_ROW_S = 0.03


def slow_tool(hold: str = "before") -> Rig:
    """A voltage-driven tool with a speed column that is not made from edges."""
    sensors = {"hall_pulses_per_rev": 0, "speed_noise_rpm": NOISE_RPM, "speed_lsb_rpm": 0.0}
    data = rig(sensors=sensors).as_dict() | {"input": {"kind": "voltage_v", "hold": hold}}
    return rig_from_dict(data, "a slow logger")


def slow_log(row_s: float) -> MadeLog:
    """A log of the tool under a voltage that changes slowly, from rest."""
    time_s = row_s * np.arange(ROWS)
    wave = 8.0 + 3.0 * np.sin(2.0 * np.pi * time_s / (100.0 * row_s))
    voltage = wave * np.clip(time_s / row_s / 20.0 - 0.5, 0.0, 1.0)
    rows = _core.simulate_log(
        _core.LogInput(time_s, "voltage_v", voltage),
        slow_tool().parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    noise = NOISE_RPM * np.random.default_rng(1).standard_normal(ROWS)
    speed = rows["speed_measured_rad_s"][0] / RAD_S_PER_RPM + noise
    return MadeLog(time_s, {"voltage_v": voltage, "speed_rpm": speed})


@pytest.mark.parametrize(
    ("row_s", "interval_s"),
    [(0.001, 0.25), (0.0078, 0.25), (0.0078125, 0.25), (0.008, 0.256), (0.05, 1.6), (0.1, 3.2)],
)
def test_the_interval_between_restarts_is_at_least_32_rows(row_s: float, interval_s: float) -> None:
    assert RESTART.min_interval_rows == 32.0
    time_s = 7.0 + row_s * np.arange(100)
    usual_s = logging_interval_s(time_s)
    assert restart_interval_s(usual_s, RESTART_S) == pytest.approx(interval_s)
    assert restart_interval_s(usual_s, 5.0) == 5.0
    gap = np.concatenate([time_s[:50], 100.0 + time_s[50:]])  # a hole in the log
    usual_s = logging_interval_s(gap)
    assert restart_interval_s(usual_s, RESTART_S) == pytest.approx(interval_s)


@pytest.mark.parametrize("row_s", [0.018, 0.031, 0.06, 0.1])
def test_a_slow_logger_has_restarts_at_that_interval(row_s: float) -> None:
    problem = load_problem([slow_log(row_s)], slow_tool())
    restarts = problem.runs[0].restarts
    wanted = max(RESTART_S, 32.0 * row_s)
    assert problem.restart_s == pytest.approx(wanted)
    steps = np.diff(restarts.rows) * row_s
    assert len(restarts.rows) > 0.8 * ROWS * row_s / wanted
    assert np.median(steps) == pytest.approx(wanted, abs=2.0 * row_s)
    assert np.min(np.diff(restarts.rows)) >= RESTART.min_rows


@pytest.mark.parametrize("row_s", [0.018, 0.031, 0.06, 0.1])
def test_a_slow_logger_restarts_from_the_true_speed(row_s: float) -> None:
    log = slow_log(row_s)
    exact = log.columns["speed_rpm"] - NOISE_RPM * np.random.default_rng(1).standard_normal(ROWS)
    restarts = load_problem([log], slow_tool()).runs[0].restarts
    error = restarts.measured[1:, 1] / RAD_S_PER_RPM - exact[restarts.rows[1:]]
    assert float(np.sqrt(np.mean(error**2))) < 2.0 * NOISE_RPM


@pytest.mark.parametrize("row_s", [0.018, 0.1])
def test_a_slow_log_of_the_rig_itself_is_noise(row_s: float) -> None:
    problem = load_problem([slow_log(row_s)], slow_tool())
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.3


def test_a_command_that_holds_after_its_row_is_the_command_of_the_next_row() -> None:
    log = drive_log(rig(), seconds=2.0, levels=[(0.2, 0.4), (0.8, 0.9), (1.4, 0.5)])
    instants = MadeLog(log.time_s, dict(log.columns))
    # the same run, each command written into the row before
    duty = log.columns["duty"]
    instants.columns["duty"] = np.concatenate([duty[1:], duty[-1:]])
    after, before = rig(input={"hold": "after"}), rig()
    assert after.command_holds_after and not before.command_holds_after
    assert not rig(input={"hold": "before"}).command_holds_after
    same, one = load_problem([instants], after), load_problem([log], before)
    np.testing.assert_allclose(
        same.runs[0].driving.command[1:], one.runs[0].driving.command[1:], atol=1e-12
    )
    np.testing.assert_allclose(
        same.residuals(same.theta0)[0], one.residuals(one.theta0)[0], atol=1e-6
    )
    late = load_problem([log], after)
    assert late.gap(late.residuals(late.theta0)[0]) > 1.05 * one.gap(one.residuals(one.theta0)[0])


def test_the_first_command_of_instants_holds_from_the_start() -> None:
    log = slow_log(0.02)
    command = load_problem([log], slow_tool("after")).runs[0].driving.command
    plain = load_problem([log], slow_tool()).runs[0].driving.command
    np.testing.assert_allclose(command[1:], plain[:-1], atol=0.02)
    assert command[0] == pytest.approx(plain[0], abs=1e-6)


def test_an_open_bridge_of_instants_is_shifted_with_the_command() -> None:
    log = slow_log(0.02)
    log.columns["coast"] = (np.arange(ROWS) >= 100).astype(float)
    closed = load_problem([log], slow_tool("after")).runs[0].bridge_closed
    assert closed[100] and not closed[101]
    assert not load_problem([log], slow_tool()).runs[0].bridge_closed[100]


def bridge_log(off: np.ndarray, is_open: np.ndarray) -> MadeLog:
    """A log of instants whose command is 0 in the rows `off` and whose bridge is open as stated."""
    log = slow_log(0.02)
    log.columns["voltage_v"] = np.where(off, 0.0, 8.0)
    log.columns["coast"] = is_open.astype(float)
    return log


def closed_bridge(log: MadeLog) -> tuple[np.ndarray, bool]:
    """Rows before which the bridge is closed, and whether it is said that coast is late."""
    problem = load_problem([log], slow_tool("after"))
    late = any("coast changes a row later" in text for text in problem.warnings)
    return problem.runs[0].bridge_closed, late


@pytest.mark.parametrize("late_rows", [0, 1])
@pytest.mark.parametrize("resumes", [False, True])
def test_the_bridge_of_instants_opens_as_the_command_becomes_zero(
    late_rows: int, resumes: bool
) -> None:
    """Whether its column is that of the instant, or of the interval that the row closes."""
    row = np.arange(ROWS)
    off = (row >= 100) & ((row < 140) | (not resumes))
    closed, late = closed_bridge(bridge_log(off, np.roll(off, late_rows) & (row >= late_rows)))
    np.testing.assert_array_equal(closed[1:], ~off[:-1])
    assert late == (late_rows == 1)


def test_a_bridge_that_brakes_before_it_opens_is_no_late_column() -> None:
    row = np.arange(ROWS)
    is_open = row >= 120
    closed, late = closed_bridge(bridge_log(row >= 100, is_open))
    np.testing.assert_array_equal(closed[1:], ~is_open[:-1])
    assert not late


def test_a_command_that_is_never_zero_tells_nothing_of_the_bridges_rows() -> None:
    row = np.arange(ROWS)
    is_open = (row < 40) | ((row >= 100) & (row < 140))
    closed, late = closed_bridge(bridge_log(row < 0, is_open))
    np.testing.assert_array_equal(closed[1:], ~is_open[:-1])
    assert not late


def test_changes_beside_missing_samples_do_not_make_the_bridge_late() -> None:
    """Only the row in which the bridge closes with the command, 140, has no value."""
    off = np.arange(ROWS) < 140
    log = bridge_log(off, off)
    log.columns["coast"][140] = np.nan
    assert not closed_bridge(log)[1]


@pytest.mark.parametrize(
    ("value", "interval", "after", "said"),
    [
        (0.0011, (0.0009, 0.0013), False, True),
        (0.0011, (0.00105, 0.0013), False, False),
        (0.0011, (0.0009, 0.0013), True, False),
        (0.00105, None, False, True),
        (0.00115, None, False, False),
    ],
)
def test_a_delay_of_one_row_is_remarked_with_what_to_put_into_the_rig(
    value: float, interval: tuple[float, float] | None, after: bool, said: bool
) -> None:
    fitted = {"transport_delay": {"delay_s": ParameterEstimate(value, interval, "s")}}
    remarks = row_delay_remarks(fitted, 0.001, after)
    assert bool(remarks) == said and all('hold = "after"' in remark for remark in remarks)
    assert row_delay_remarks({}, 0.001, False) == []


@pytest.mark.parametrize(
    ("row_s", "shown"), [(0.01, True), (0.5, True), (0.7, False), (3.0, False)]
)
def test_a_coupler_is_looked_for_where_the_rows_resolve_its_slowest_oscillation(
    row_s: float, shown: bool
) -> None:
    """The lowest natural frequency that is looked for is 10 rad/s, a period of 0.63 s."""
    problem = load_problem([slow_log(row_s)], slow_tool())
    ids = {effect.id for effect in shown_effects(problem, frozenset())}
    assert ("coupler_compliance" in ids) == shown
    assert "added_inertia" in ids


@pytest.mark.parametrize("row_s", [0.0005, 0.001, 0.01, 0.05, 0.2])
def test_a_coupler_is_started_where_the_rows_resolve_its_oscillation(row_s: float) -> None:
    """A light output side oscillates far faster on the same spring than a heavy one. Where no start
    is resolved, all are kept.
    """
    toy, coupler = Toy({}), BY_ID["coupler_compliance"]
    scales = replace(SCALES, interval=row_s)
    builder, names = (
        HypothesisBuilder(toy, scales, {}),
        [coupler.name(p) for p in coupler.parameters],
    )

    def frequencies(effect: Effect) -> np.ndarray:
        starts = builder.hypotheses([effect], (), np.zeros(0))
        theta = np.stack([h.theta(toy.theta0, h.start[None])[0] for h in starts])
        stiffness, _, inertia = (theta[:, toy.index(name)] for name in names)
        output = scales.inertia - scales.motor_inertia + inertia
        return np.sqrt(stiffness * (1.0 / scales.motor_inertia + 1.0 / output))

    found, every = frequencies(coupler), frequencies(replace(coupler, is_resolved=None))
    resolved = every[every <= 2.0 * np.pi / row_s]
    np.testing.assert_array_equal(found, resolved if resolved.size else every)
    assert (resolved.size == every.size) == (row_s < 0.001)


@pytest.mark.parametrize(("share", "shown"), [(0.0099, False), (0.01, False), (0.0101, True)])
def test_an_output_side_of_a_hundredth_of_the_inertia_is_none(share: float, shown: bool) -> None:
    """A rig of a motor without output side states a tiny output inertia: 0 is not allowed."""
    motor = slow_tool().motor["inertia_kg_m2"]
    tool = slow_tool().with_values(
        {"gearbox.ratio": 1.0, "gearbox.output_inertia_kg_m2": share * motor}
    )
    problem = load_problem([slow_log(0.01)], tool)
    ids = {effect.id for effect in shown_effects(problem, frozenset())}
    assert ("gear_backlash" in ids) == shown


def fast_motor_log(delay_s: float) -> MadeLog:
    """A log of fast_motor(): its voltage changes at random every 12 rows and acts delay_s later."""
    tool, time_s = fast_motor(), FAST_MOTOR_ROW_S * np.arange(ROWS)
    levels = np.random.default_rng(4).uniform(2.0, 12.0, ROWS // 12 + 1)
    voltage = np.repeat(levels, 12)[:ROWS]
    fine_s = np.arange(0.0, time_s[-1], 0.001)
    late = np.interp(fine_s - delay_s, time_s, np.arange(ROWS)).astype(int)
    rows = _core.simulate_log(
        _core.LogInput(fine_s, "voltage_v", voltage[late]),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    noise = NOISE_RPM * np.random.default_rng(1).standard_normal(ROWS)
    speed = np.interp(time_s, fine_s, rows["speed_measured_rad_s"][0]) / RAD_S_PER_RPM
    return MadeLog(time_s, {"voltage_v": voltage, "speed_rpm": speed + noise})


def fast_motor() -> Rig:
    """A motor that reaches its steady speed in about 1 ms, a small part of a row interval."""
    return slow_tool("after").with_values(
        {
            "motor.inertia_kg_m2": 6e-7,
            "gearbox.ratio": 1.0,
            "gearbox.output_inertia_kg_m2": 1e-9,
            "sensors.log_hz": 1.0 / FAST_MOTOR_ROW_S,
        }
    )


@pytest.mark.parametrize("rows", [1.4, 3.3, 5.6, 7.5])
def test_a_delay_of_several_rows_is_found_though_the_rows_between_do_not_change(
    rows: float,
) -> None:
    """The speed at a row depends on the delay in steps of a row: within a step there is no slope
    along which a fit could move.
    """
    delay_s = rows * FAST_MOTOR_ROW_S
    others = tuple(i for i in BY_ID if i not in ("transport_delay", "coulomb_friction"))
    log = fast_motor_log(delay_s)
    found = diagnose([log], fast_motor(), DiagnosisOptions(without=others))
    assert found.selected == ["transport_delay"]
    delay = found.effect("transport_delay").parameters["delay_s"]
    assert delay.value == pytest.approx(delay_s, abs=FAST_MOTOR_ROW_S)
    assert delay.ci95[1] - delay.ci95[0] < 4.0 * FAST_MOTOR_ROW_S
    assert found.gap.after < 0.2 * found.gap.before
