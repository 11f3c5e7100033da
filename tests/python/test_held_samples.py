"""Columns that a logger repeats because their sensor answers more slowly than rows are written."""

import numpy as np
import pytest

from made_log import MadeLog, rig
from vgroove import _core
from vgroove.gap.cleaning.held_samples import LIMITS, remove_held_samples
from vgroove.gap.residual.loading import load_problem
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

LSB = 0.25
ROWS = 400


def tool(**sensors: float) -> Rig:
    """A voltage-driven tool with a speed column that is not made from edges."""
    stated = {"hall_pulses_per_rev": 0, "speed_noise_rpm": 5.0, "speed_lsb_rpm": 0.0}
    data = rig(sensors=stated | sensors).as_dict() | {"input": {"kind": "voltage_v"}}
    return rig_from_dict(data, "polled")


def polled(values: np.ndarray, rows: int, jitter: np.random.Generator | None = None) -> np.ndarray:
    """The values (n,) as a logger writes them that asks for a new one every `rows` rows."""
    begin = np.arange(0, len(values), rows)
    if jitter is not None:
        begin[1:] += jitter.integers(-1, 2, size=len(begin) - 1)
    return values[begin[np.searchsorted(begin, np.arange(len(values)), side="right") - 1]]


def wave(rows: int = ROWS) -> np.ndarray:
    """A speed that moves by many resolutions from row to row."""
    return LSB * np.round((9000.0 * np.sin(0.05 * np.arange(rows)) + 3000.0) / LSB)


def log_of(speed: np.ndarray, **more: np.ndarray) -> Log:
    """A log with a row every 5 ms."""
    time_s = 0.005 * np.arange(len(speed))
    return Log(time_s, {"voltage_v": np.ones(len(speed)), "speed_rpm": speed} | more, "held")


@pytest.mark.parametrize("rows", [2, 3, 4, 7])
def test_the_first_row_of_each_sample_is_kept(rows: int) -> None:
    (found,) = remove_held_samples([log_of(polled(wave(), rows))], tool())
    kept = np.isfinite(found["speed_rpm"])
    assert np.array_equal(np.flatnonzero(kept), np.arange(0, ROWS, rows))
    assert np.array_equal(found["speed_rpm"][kept], wave()[::rows])
    said = f"held: sampled more slowly than the rows: speed_rpm every {5 * rows} ms"
    assert said in found.warnings[-1]


@pytest.mark.parametrize("seed", range(5))
def test_either_end_of_a_sample_may_be_a_row_off(seed: int) -> None:
    speed = polled(wave(), 5, np.random.default_rng(seed))
    (found,) = remove_held_samples([log_of(speed)], tool())
    new = np.flatnonzero(np.diff(speed, prepend=np.nan) != 0.0)
    assert np.array_equal(np.flatnonzero(np.isfinite(found["speed_rpm"])), new)


def test_at_rest_a_sample_is_kept_as_often_as_in_motion() -> None:
    speed = np.concatenate([np.zeros(80), polled(wave(), 4), np.zeros(83)])
    (found,) = remove_held_samples([log_of(speed)], tool())
    assert np.isfinite(found["speed_rpm"][:80]).sum() == 20
    assert 19 <= np.isfinite(found["speed_rpm"][480:]).sum() <= 21


@pytest.mark.parametrize(
    "speed",
    [
        wave(),
        LSB * np.floor(0.3 * np.arange(ROWS)),  # a coarse encoder that turns slowly
        np.repeat(wave(ROWS // 4), np.random.default_rng(1).integers(1, 8, ROWS // 4)),
        np.zeros(ROWS),
        polled(wave(LIMITS.min_runs * 4), 4),  # too few samples to tell
        # codes of 5.86 rpm in whole rpm: a ramp that passes one every few rows
        np.round(5.86 * np.round(0.3 * np.arange(ROWS))),
        np.full(ROWS, np.nan),
    ],
    ids=["every row", "coarse", "irregular", "at rest", "short", "few decimals", "missing"],
)
def test_other_columns_are_left_as_they_are(speed: np.ndarray) -> None:
    log = log_of(speed)
    assert remove_held_samples([log], tool())[0] is log


def every(log: Log, rows: int) -> Log:
    """Every so many rows of a log."""
    columns = {name: values[::rows] for name, values in log.columns.items()}
    return Log(log.time_s[::rows], columns, "fewer rows")


def kept(log: Log) -> int:
    """Samples of the speed."""
    return int(np.isfinite(log["speed_rpm"]).sum())


def test_a_short_log_is_read_as_the_others_of_its_tool() -> None:
    found = remove_held_samples([log_of(polled(wave(n), 4)) for n in (40, 400)], tool())
    assert [kept(log) for log in found] == [10, 100]
    assert remove_held_samples([], tool()) == []


def test_a_log_of_new_samples_contradicts_the_others_of_its_tool() -> None:
    logs = [log_of(polled(wave(), 4)), log_of(wave())]
    assert remove_held_samples(logs, tool()) == logs


@pytest.mark.parametrize(("rows", "left"), [(1, 100), (2, 100), (4, 100)])
def test_logs_of_one_tool_may_have_different_rows(rows: int, left: int) -> None:
    """Two logs of a sensor that is sampled every 20 ms: rows every 5 ms, and every 5, 10 or 20."""
    whole = log_of(polled(wave(), 4))
    found = remove_held_samples([whole, every(whole, rows)], tool())
    assert [kept(log) for log in found] == [100, left]


@pytest.mark.parametrize("seed", range(5))
def test_missing_rows_leave_one_sample_of_each(seed: int) -> None:
    """The first row that is left of each sample, whichever rows are missing."""
    speed = polled(wave(), 4)
    missing = np.random.default_rng(seed).random(ROWS) < 0.1
    (found,) = remove_held_samples([log_of(np.where(missing, np.nan, speed))], tool())
    here = np.isfinite(found["speed_rpm"])
    sample = np.arange(ROWS) // 4
    assert np.array_equal(np.unique(sample[~missing]), sample[here])
    assert np.array_equal(found["speed_rpm"][here], speed[here])


def test_edges_and_the_driving_column_are_left_as_they_are() -> None:
    held = polled(wave(), 4)
    log = log_of(held)
    assert remove_held_samples([log], tool(hall_pulses_per_rev=4))[0] is log
    log = log_of(wave(), voltage_v=held)
    assert remove_held_samples([log], tool())[0] is log


def test_a_run_up_that_is_sampled_every_sixth_row_has_no_gap() -> None:
    """With the repeats as samples the gap is that of a speed that is up to 25 ms old."""
    time_s = 0.005 * np.arange(300)
    voltage = np.where(time_s > 0.1, 9.0, 0.0) + np.where(time_s > 0.8, 5.0, 0.0)
    drive = _core.LogInput(time_s, "voltage_v", voltage)
    rows = _core.simulate_log(drive, tool().parameters()[None], np.array([0]), np.zeros((1, 3)))
    speed = rows["speed_measured_rad_s"][0] * RPM_PER_RAD_S
    speed = speed + 5.0 * np.random.default_rng(1).standard_normal(300)
    made = MadeLog(time_s, {"voltage_v": voltage, "speed_rpm": polled(speed, 6)})
    problem = load_problem([made], tool())
    assert problem.gap(problem.residuals(problem.theta0)[0]) == pytest.approx(1.0, abs=0.2)
    assert any("every 30 ms" in warning for warning in problem.warnings)


@pytest.mark.parametrize("level_rpm", [0.0, 120.0])
def test_pauses_of_one_length_are_no_slow_samples(level_rpm: float) -> None:
    """A sensor that answers more slowly has no value that lasts for one row."""
    stroke = np.concatenate([np.full(40, level_rpm), [1500.0, 4500.0, 7500.0, 6000.0, 3000.0]])
    log = log_of(np.tile(stroke, 12))
    (found,) = remove_held_samples([log], tool(speed_noise_rpm=0.0))
    assert np.isfinite(found["speed_rpm"]).all() and not found.warnings


def test_single_steps_between_the_samples_of_a_slow_sensor_do_not_hide_them() -> None:
    """A value that is rounded differently when it is read again."""
    rng = np.random.default_rng(4)
    dithered = polled(wave(), 10) + LSB * (rng.uniform(size=ROWS) < 0.1)
    (found,) = remove_held_samples([log_of(dithered)], tool())
    assert found.warnings and "speed_rpm every 50 ms" in found.warnings[0]
