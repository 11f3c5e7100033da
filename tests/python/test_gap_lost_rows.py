"""Rows lost between logger and file: the row after a hole is a mean over its own interval where the
current shows that, otherwise over the hole.
"""

from dataclasses import replace

import numpy as np
import pytest

from made_log import MadeLog, rig
from vgroove import _core
from vgroove.gap.cleaning.lost_rows import insert_lost_rows, rows_after_holes
from vgroove.gap.cleaning.missing_values import interpolate_to_known_levels
from vgroove.gap.residual.clean_log import clean_log
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.measured_run import prepare_run
from vgroove.rig import Rig

HZ = 300
GRID = np.arange(0, 4 * HZ + 1) / HZ
KEPT = np.random.default_rng(3).uniform(size=len(GRID)) > 0.03  # rows that are in the log
KEPT[[0, -1]] = True


def stepping() -> Rig:
    made = rig(sensors={"log_hz": HZ, "hall_pulses_per_rev": 0, "speed_noise_rpm": 2.0})
    return replace(made, input={"kind": "duty"})


def steps(time_s: np.ndarray) -> np.ndarray:
    """Duty that steps every 0.4 s to levels far apart."""
    return np.array([0.0, 0.8, 0.2, 0.9, 0.4, 1.0, 0.1, 0.7, 0.3, 0.6, 0.6])[
        (np.maximum(time_s, 0.0) / 0.4).astype(int)
    ]


def logged(tool: Rig, time_s: np.ndarray) -> MadeLog:
    """Log of the tool with rows at these times and with sensor noise."""
    rng, duty = np.random.default_rng(1), steps(time_s - 1.0 / HZ)
    rows = _core.simulate_log(
        _core.LogInput(time_s, "duty", duty),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    current = rows["current_a"][0] + 0.15 * rng.standard_normal(len(time_s))
    speed = rows["speed_measured_rad_s"][0] * 30.0 / np.pi + 2.0 * rng.standard_normal(len(time_s))
    return MadeLog(time_s, {"duty": duty, "current_a": current, "speed_rpm": speed})


def with_rows(log: MadeLog, kept: np.ndarray) -> MadeLog:
    """The log with the rows of a mask (rows,)."""
    return MadeLog(log.time_s[kept], {name: values[kept] for name, values in log.columns.items()})


@pytest.mark.parametrize("never_recorded", [False, True])
def test_a_row_after_a_hole_covers_the_interval_that_the_logger_measured(
    never_recorded: bool,
) -> None:
    """Rows lost on the line, or never recorded: in both cases the residuals are noise, although the
    current falls by half within three rows.
    """
    tool = stepping()
    log = logged(tool, GRID[KEPT]) if never_recorded else with_rows(logged(tool, GRID), KEPT)
    problem = load_problem([log], tool)
    after = problem.time_s[problem.signal == 0]
    left = problem.residuals(problem.theta0)[0][problem.signal == 0]
    second = np.isin(np.round(after * HZ), np.round(GRID[np.flatnonzero(~KEPT) + 1] * HZ))
    assert second.sum() > 15
    assert np.abs(left[second]).max() < 4.5
    assert any("lost" in warning for warning in problem.warnings) is not never_recorded


def test_uneven_clocks_and_clocks_that_skip_often_have_no_holes() -> None:
    assert np.array_equal(
        rows_after_holes(GRID[KEPT]), np.flatnonzero(np.diff(np.flatnonzero(KEPT)) > 1) + 1
    )
    uneven = GRID + np.random.default_rng(2).uniform(-0.3, 0.3, len(GRID)) / HZ
    assert not len(rows_after_holes(uneven[KEPT]))
    assert not len(rows_after_holes(GRID[np.arange(len(GRID)) % 5 != 0]))
    assert not len(rows_after_holes(GRID))


def test_a_long_hole_is_replaced_by_one_empty_row() -> None:
    log = insert_lost_rows(
        with_rows(logged(stepping(), GRID), (GRID < 1.0) | (GRID > 3.0)), stepping()
    )
    assert len(log.time_s) == np.count_nonzero((GRID < 1.0) | (GRID > 3.0)) + 1
    assert np.isnan(log.columns["current_a"]).sum() == 1


def test_a_command_that_steps_in_every_row_is_judged_despite_missing_samples() -> None:
    """Leaving out what follows each step in a hole would leave out nearly the whole log."""
    tool, rng = stepping(), np.random.default_rng(4)
    duty = rng.uniform(0.2, 0.9, len(GRID))
    rows = _core.simulate_log(
        _core.LogInput(GRID, "duty", duty), tool.parameters()[None], np.array([0]), np.zeros((1, 3))
    )
    speed = rows["speed_measured_rad_s"][0] * 30.0 / np.pi + 2.0 * rng.standard_normal(len(GRID))
    command = np.where(rng.uniform(size=len(GRID)) > 0.02, duty, np.nan)
    run = prepare_run(clean_log(MadeLog(GRID, {"duty": command, "speed_rpm": speed}), tool))
    assert len(run.channels[0].row) > 0.9 * len(GRID)


def test_without_a_current_a_row_lasts_since_the_row_before() -> None:
    log = with_rows(logged(stepping(), GRID), KEPT)
    quiet = MadeLog(
        log.time_s, {name: values for name, values in log.columns.items() if name != "current_a"}
    )
    assert insert_lost_rows(quiet, stepping()) is quiet
    blind = replace(log, columns=log.columns | {"current_a": np.full(len(log.time_s), np.nan)})
    assert insert_lost_rows(blind, stepping()) is blind


def test_one_pause_that_is_no_whole_number_of_intervals_hides_no_lost_rows() -> None:
    paused = GRID[KEPT] + np.where(GRID[KEPT] > 2.0, 0.4 / HZ, 0.0)
    assert len(rows_after_holes(paused)) >= len(rows_after_holes(GRID[KEPT])) - 1


@pytest.mark.parametrize("change", [0.6, 0.02])
def test_a_step_in_a_hole_is_left_out_up_to_the_next_restart(change: float) -> None:
    """The row in which the command stepped is unknown: for large steps the rows after it cannot be
    judged.
    """
    tool = stepping()
    command = np.where(GRID > 2.0, 0.3 + change, 0.3)
    command[np.abs(GRID - 2.0) < 0.5 / HZ] = np.nan
    command[GRID < 0.2] = 0.9
    rows = logged(tool, GRID)
    run = prepare_run(clean_log(replace(rows, columns=rows.columns | {"duty": command}), tool))
    judged = run.channels[0].time_s
    after = judged[(judged > 2.0) & (judged < 2.05)]
    assert len(after) == 0 if change > 0.1 else len(after) > 10
    assert any("holes in the command" in warning for warning in run.warnings) is (change > 0.1)


def test_a_ramp_runs_straight_through_missing_samples() -> None:
    """With the last value held the current would be 0.33 A too small, then 0.33 A too large."""
    tool = replace(stepping(), input={"kind": "duty", "slew_per_s": 6.0})
    duty = 0.5 + 0.4 * np.abs(np.mod(GRID, 0.8) / 0.4 - 1.0)
    rows = _core.simulate_log(
        _core.LogInput(GRID, "duty", duty, slew_per_s=6.0),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    rng = np.random.default_rng(5)
    command = np.where(rng.uniform(size=len(GRID)) > 0.08, duty, np.nan)
    current = rows["current_a"][0] + 0.02 * rng.standard_normal(len(GRID))
    tool = replace(tool, sensors={"log_hz": HZ, "current_noise_a": 0.02})
    problem = load_problem([MadeLog(GRID, {"duty": command, "current_a": current})], tool)
    assert problem.gap(problem.residuals(problem.theta0)[0], problem.judged) < 1.3


def test_a_missing_sample_takes_a_value_that_occurs_or_the_last_one_of_a_slow_column() -> None:
    time_s = np.arange(40.0)
    values = np.round(time_s / 3.0)
    values[[12, 21]] = np.nan
    assert interpolate_to_known_levels(time_s, values)[[12, 21]].tolist() == [4.0, 7.0]
    assert set(interpolate_to_known_levels(time_s, values)) == set(values[np.isfinite(values)])
    seldom = np.where(time_s % 4 == 0, time_s, np.nan)
    assert np.array_equal(interpolate_to_known_levels(time_s, seldom), time_s - time_s % 4)
