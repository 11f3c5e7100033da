"""Loggers that write bursts of rows: a pause between two bursts is their interval, not a hole."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made_log import MadeLog, drive_log, rig
from vgroove.gap.cleaning.logging_interval import logging_interval_s
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem

ROW_S = 0.001
TOOL = rig()


def bursts(rows: int, pause_s: float, seconds: float = 6.0) -> np.ndarray:
    """Times in s of bursts of so many rows, so far from the end of one to the next."""
    period = (rows - 1) * ROW_S + pause_s
    starts = np.arange(0.0, seconds, period)
    return (starts[:, None] + ROW_S * np.arange(rows)).ravel()


def problem_of_rows(log: MadeLog, kept: np.ndarray) -> Problem:
    """The measured problem, with the residuals of TOOL, of a log that has only the rows `kept`."""
    columns = {name: values[kept] for name, values in log.columns.items()}
    return load_problem([MadeLog(log.time_s[kept], columns)], TOOL)


def rms(problem: Problem) -> float:
    """Gap of TOOL's own parameter values: RMS of the judged residuals, in sigmas."""
    return float(problem.gap(problem.residuals(problem.theta0)[0], problem.judged))


@settings(deadline=None)
@given(rows=st.integers(2, 30), pause_s=st.floats(0.03, 0.2))
def test_the_logging_interval_of_bursts_is_their_pause(rows: int, pause_s: float) -> None:
    assert logging_interval_s(bursts(rows, pause_s)) == pytest.approx(pause_s)


def test_stretches_that_are_longer_than_the_pauses_are_no_bursts() -> None:
    assert logging_interval_s(bursts(80, 0.06)) == pytest.approx(ROW_S)


@pytest.mark.parametrize(("pauses", "interval_s"), [(1, ROW_S), (7, ROW_S), (8, 0.5)])
def test_a_few_pauses_are_no_bursts(pauses: int, interval_s: float) -> None:
    time_s = bursts(50, 0.5)[: 50 * (pauses + 1)]
    assert logging_interval_s(time_s) == pytest.approx(interval_s)


@settings(deadline=None)
@given(seed=st.integers(0, 1000), lost=st.integers(0, 40))
def test_a_clock_that_loses_some_rows_keeps_its_interval(seed: int, lost: int) -> None:
    time_s = np.arange(1000) * ROW_S
    kept = np.sort(np.random.default_rng(seed).permutation(1000)[lost:])
    assert logging_interval_s(time_s[kept]) == pytest.approx(ROW_S)


@pytest.mark.parametrize(("rows", "pause_s"), [(5, 0.03), (7, 0.06), (32, 0.06)])
def test_the_model_runs_on_through_the_pauses_of_bursts(rows: int, pause_s: float) -> None:
    """The log is simulated with TOOL, so that the gap should be about 1. Its command has steps; the
    rows after a step in a pause are left out up to the next restart.
    """
    log = drive_log(TOOL)
    period = rows - 1 + round(pause_s / ROW_S)
    kept = np.flatnonzero(np.arange(len(log.time_s)) % period < rows)
    problem = problem_of_rows(log, kept)
    current = problem.signal == [s.column for s in problem.signals].index("current_a")
    assert np.count_nonzero(current) > 0.6 * len(kept)
    assert rms(problem) < 1.5


def test_the_model_restarts_after_a_pause_that_is_an_exception() -> None:
    log = drive_log(TOOL)
    kept = np.flatnonzero((log.time_s % 2.0 < 1.5) | (log.time_s % 2.0 > 1.6))
    problem = problem_of_rows(log, kept)
    time_s = log.time_s[kept]
    restarts = time_s[problem.runs[0].restarts.rows]
    ends = time_s[1:][np.diff(time_s) > 0.05]
    assert len(ends) == 3
    assert all(np.any((restarts > end) & (restarts < end + 0.15)) for end in ends)
