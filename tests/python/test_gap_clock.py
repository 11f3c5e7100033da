"""Time stamps that scatter around an even clock are corrected, uneven rows are kept: the Hall edges
separate the two cases.
"""

import numpy as np
import pytest

from vgroove.gap.cleaning.clock import correct_time_stamps, even_grid, is_rounding, row_times
from vgroove.gap.hall_edges.stamp_check import stamp_contradictions
from vgroove.log import Log
from vgroove.rig import Rig, read_rig


@pytest.fixture
def rig(tmp_path) -> Rig:
    path = tmp_path / "rig.toml"
    path.write_text(
        'schema = "vgroove.rig/1"\n[input]\nkind = "duty"\n[supply]\nvoltage_v = 18.0\n'
        "[motor]\nresistance_ohm = 0.19\ninductance_h = 1e-4\ntorque_constant_nm_per_a = 0.0109\n"
        "inertia_kg_m2 = 1.6e-5\nviscous_nm_s_per_rad = 4.5e-6\ncoulomb_nm = 0.012\n"
        '[gearbox]\nratio = 5.6\noutput_inertia_kg_m2 = 6e-5\n[mechanism]\nkind = "none"\n'
        '[load]\nkind = "none"\n[sensors]\nhall_pulses_per_rev = 4\nspeed_lsb_rpm = 0.5\n'
    )
    return read_rig(path)


def hall_speed(t: np.ndarray) -> np.ndarray:
    """Speed column (n,), rpm, of rows that end at the times t (n,), s: a shaft whose speed rises
    and falls, four edges a turn, resolution 0.5 rpm.
    """
    fine = np.linspace(0.0, t[-1] + 0.1, 400_001)
    speed = 600.0 + 250.0 * np.sin(4.0 * fine)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))])
    pitch = np.pi / 2.0
    edges = np.interp(np.arange(1, int(angle[-1] / pitch)) * pitch, angle, fine)
    last = np.searchsorted(edges, t, side="right") - 1
    period = np.where(
        last >= 1, edges[np.maximum(last, 1)] - edges[np.maximum(last, 1) - 1], np.inf
    )
    shown = np.where(last >= 1, pitch / np.maximum(period, t - edges[np.maximum(last, 0)]), 0.0)
    return np.round(shown * 30.0 / np.pi / 0.5) * 0.5


GRID = np.arange(1, 3001) * 1e-3


def times_by_edges(stamps: np.ndarray, speed_rpm: np.ndarray, rig: Rig) -> np.ndarray:
    """Row times of a log whose Hall edges check the stamps."""
    return row_times(stamps, stamp_contradictions(Log(stamps, {"speed_rpm": speed_rpm}, ""), rig))


def test_stamps_that_scatter_are_replaced_by_the_even_grid(rig: Rig) -> None:
    stamps = GRID + np.random.default_rng(1).uniform(-5e-5, 5e-5, len(GRID))
    log = Log(stamps, {"speed_rpm": hall_speed(GRID)}, "run.csv")
    log = correct_time_stamps(log, stamp_contradictions(log, rig))
    assert np.abs(log.time_s - GRID).max() < 5e-6
    assert "even clock" in log.warnings[-1]


def test_uneven_rows_keep_their_stamps(rig: Rig) -> None:
    real = GRID + np.random.default_rng(1).uniform(-5e-5, 5e-5, len(GRID))
    assert times_by_edges(real, hall_speed(real), rig) is real


@pytest.mark.parametrize("uneven", [False, True])
def test_few_edges_reject_the_grid_only_with_more_contradictions(rig: Rig, uneven: bool) -> None:
    even = np.arange(1, 121) / 600.0
    stamps = even + np.random.default_rng(1).uniform(-0.05, 0.05, len(even)) / 600.0
    speed = hall_speed(stamps if uneven else even)
    breaks = stamp_contradictions(Log(stamps, {"speed_rpm": speed}, ""), rig)
    assert max(breaks(t) for t in (stamps, even)) <= 3
    found = row_times(stamps, breaks)
    assert found is stamps if uneven else np.abs(found - even).max() < 3e-5


def test_an_exact_log_and_a_log_with_missing_rows_stay_as_they_are(rig: Rig) -> None:
    kept = np.random.default_rng(2).uniform(size=len(GRID)) > 0.1
    for t in (GRID, GRID[kept], np.delete(GRID, np.arange(500, 650))):
        assert times_by_edges(t, hall_speed(t), rig) is t


def test_missing_rows_do_not_hide_the_clock() -> None:
    stamps = GRID + np.random.default_rng(3).uniform(-1e-4, 1e-4, len(GRID))
    kept = np.random.default_rng(2).uniform(size=len(GRID)) > 0.1
    assert np.abs(even_grid(stamps[kept]) - GRID[kept]).max() < 1e-5


def test_stamps_rounded_to_milliseconds_are_corrected_without_edges() -> None:
    even = np.arange(600) / 300.0
    assert np.abs(row_times(np.round(even, 3)) - even).max() < 1e-4
    # scatter of more than the last digit is no rounding
    uneven = np.round(even + np.random.default_rng(1).uniform(-5e-4, 5e-4, 600), 3)
    assert even_grid(uneven) is not None and not is_rounding(uneven, even_grid(uneven))
    assert row_times(uneven) is uneven


@pytest.mark.parametrize("scatter, kept", [(0.05, False), (0.33, True)])
def test_without_edges_a_small_scatter_is_corrected_and_a_large_one_is_kept(
    scatter: float, kept: bool
) -> None:
    stamps = GRID + np.random.default_rng(1).uniform(-scatter, scatter, len(GRID)) * 1e-3
    found = row_times(stamps)
    assert found is stamps if kept else np.abs(found - GRID).max() < 5e-6


def test_stamps_of_no_clock_have_no_grid() -> None:
    assert even_grid(np.cumsum(np.random.default_rng(1).uniform(5e-4, 1.5e-3, 2000))) is None
