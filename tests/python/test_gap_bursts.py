"""Loggers that write bursts of rows: a pause between two bursts is their interval, not a hole."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made_log import MadeLog, rig
from vgroove.gap.cleaning.missing_values import usual_interval_s
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem

SECONDS, ROW_S = 6.0, 0.0015
TOOL = rig(sensors={"log_hz": 1.0 / ROW_S, "hall_pulses_per_rev": 0, "speed_noise_rpm": 20.0})


def bursts(rows: int, pause_s: float) -> np.ndarray:
    """Times in s of bursts of so many rows, so far from the end of one to the next."""
    period = (rows - 1) * ROW_S + pause_s
    starts = np.arange(0.0, SECONDS, period)
    return (starts[:, None] + ROW_S * np.arange(rows)).ravel()


def loaded(time_s: np.ndarray) -> Problem:
    """Problem of a tool that runs up, seen at these times."""
    rng = np.random.default_rng(1)
    speed = 12000.0 * (1.0 - np.exp(-time_s / 0.4)) + rng.normal(0.0, 20.0, len(time_s))
    return load_problem(
        [MadeLog(time_s, {"duty": np.full(len(time_s), 0.8), "speed_rpm": speed})], TOOL
    )


@settings(deadline=None)
@given(rows=st.integers(2, 9), pause_s=st.floats(0.03, 0.2))
def test_the_usual_interval_of_bursts_is_their_pause(rows: int, pause_s: float) -> None:
    assert usual_interval_s(bursts(rows, pause_s)) == pytest.approx(pause_s)


@settings(deadline=None)
@given(seed=st.integers(0, 1000), lost=st.integers(0, 40))
def test_a_clock_that_loses_some_rows_keeps_its_interval(seed: int, lost: int) -> None:
    time_s = np.arange(1000) * ROW_S
    kept = np.sort(np.random.default_rng(seed).permutation(1000)[lost:])
    assert usual_interval_s(time_s[kept]) == pytest.approx(ROW_S)


@pytest.mark.parametrize(("rows", "pause_s"), [(5, 0.03), (7, 0.06)])
def test_the_model_runs_on_through_the_pauses_of_bursts(rows: int, pause_s: float) -> None:
    time_s = bursts(rows, pause_s)
    problem = loaded(time_s)
    assert len(problem.runs[0].restarts.rows) <= 1 + SECONDS / (32.0 * pause_s)
    assert problem.judged.sum() > 0.9 * len(time_s)


def test_the_model_restarts_after_a_pause_that_is_an_exception() -> None:
    time_s = np.arange(int(SECONDS / ROW_S)) * ROW_S
    paused = time_s[(time_s % 2.0 < 1.5) | (time_s % 2.0 > 1.6)]
    ends = paused[1:][np.diff(paused) > 0.05]
    restarts = paused[loaded(paused).runs[0].restarts.rows]
    assert len(ends) == 3
    assert all(np.any((restarts > end) & (restarts < end + 0.15)) for end in ends)
