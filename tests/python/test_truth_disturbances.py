"""The disturbances of the generator: of size 0 they change nothing, and each has a mean of zero in
what an effect of the catalogue describes.
"""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truth_helpers import NOISELESS, TRUTH, Run, setting_of, simulate, simulate_once

import bench_measured  # isort: skip
import disturbances  # isort: skip
import gap_bench  # isort: skip
from disturbances import IDS, Disturbance  # isort: skip

PHYSICAL = ("command_jitter", "supply_sag", "friction_drift", "bearing_roughness", "gear_tooth")
COLUMNS = ("time_s", "current_a", "supply_v", "speed_rad_s", "angle_rad", "edge_s")


def disturbed(
    name: str, size: float, seed: int = 3, profile: str = "staircase", **rig: object
) -> tuple[Run, Run]:
    """Noiseless runs of two seconds without and with one disturbance."""
    setting = setting_of(profile, seconds=2.0, **rig)
    other = replace(setting, disturbances=(Disturbance(name, size, seed),))
    return simulate_once(setting, NOISELESS)[0], simulate(other, NOISELESS)[0]


@pytest.mark.parametrize("name", IDS)
def test_a_disturbance_of_size_zero_is_none_to_the_bit(name: str) -> None:
    setting = setting_of("reversals", seconds=1.0)
    other = replace(setting, disturbances=(Disturbance(name, 0.0, 3),))
    plain, same = (gap_bench.log_table(one, {}) for one in (setting, other))
    assert plain.keys() == same.keys()
    assert all(np.array_equal(plain[column], same[column]) for column in plain)
    assert all(
        np.array_equal(*(getattr(run, column) for run in disturbed(name, 0.0)))
        for column in COLUMNS
    )


@pytest.mark.parametrize("name", PHYSICAL)
def test_a_physical_disturbance_moves_the_tool_a_little(name: str) -> None:
    size = {"command_jitter": 3e-4, "supply_sag": 0.05}.get(name, 1e-3)
    plain, other = disturbed(name, size)
    change = other.speed_rad_s - plain.speed_rad_s
    assert 1e-3 < np.sqrt(np.mean(change**2)) < 0.05 * np.sqrt(np.mean(plain.speed_rad_s**2))
    assert abs(np.mean(change)) < 0.01 * np.mean(np.abs(plain.speed_rad_s))


@pytest.mark.parametrize("process", ["wander", "parts"])
def test_slow_processes_have_neither_mean_nor_trend(process: str) -> None:
    time_s = np.arange(0.0, 6.0, 0.01)
    for seed in range(5):
        values = getattr(disturbances, process)(time_s, np.random.default_rng(seed))
        assert np.mean(values) == pytest.approx(0.0, abs=1e-9)
        assert np.polyfit(time_s, values, 1)[0] == pytest.approx(0.0, abs=1e-9)
        assert np.sqrt(np.mean(values**2)) == pytest.approx(1.0)


def test_the_roughness_of_a_bearing_has_no_mean_and_no_harmonic_of_a_turn() -> None:
    rough = disturbances.roughness(np.random.default_rng(1))
    assert np.mean(rough) == pytest.approx(0.0, abs=1e-9)
    angle = disturbances.ROUGH_STEP_RAD * np.arange(len(rough))
    for order in (1, 2, 4, 6):
        wave = np.abs(np.mean(rough * np.exp(1j * order * angle)))
        assert wave**2 < 0.05


def test_the_delay_of_the_command_is_early_and_late_and_never_turns_time_back() -> None:
    setting = setting_of("staircase", seconds=6.0)
    at_s = np.arange(0.0, 6.0, 1e-3)
    for profile in (setting.profile, setting_of("hand", seconds=6.0).profile):
        late = disturbances.delays(Disturbance("command_jitter", 3e-3, 2), profile, 6.0, at_s)
        assert late.min() < 0.0 < late.max()
        assert abs(np.mean(late)) < 1e-3
        assert np.all(np.diff(at_s + late) >= 0.0)


@pytest.mark.parametrize("size", [0.3, 0.95])
def test_batches_of_rows_keep_the_mean_time_of_a_batch(size: float) -> None:
    stamps = np.round(0.001 * np.arange(1, 2401), 6)  # whole batches of 3 to 8 rows, but of 7
    for seed in (1, 2, 3, 4):
        d = Disturbance("row_batches", size, seed)
        count = int(d.random().integers(3, 9))
        found = disturbances.disturbed_stamps((d,), stamps)
        whole = len(stamps) // count * count
        shift = (found - stamps)[:whole].reshape(-1, count)
        assert np.all(np.diff(found) > 0.0)
        assert np.mean(shift, axis=1) == pytest.approx(np.zeros(len(shift)), abs=2e-6)
        assert np.max(np.abs(shift)) == pytest.approx(size * 0.0005 * (count - 1), abs=3e-6)


@pytest.mark.parametrize("name", ["supply_current", "converter", "commutation"])
def test_errors_of_the_current_have_no_offset_and_no_gain(name: str) -> None:
    plain, other = disturbed(name, 0.1)
    extra, current = other.current_a - plain.current_a, plain.current_a
    rms = np.sqrt(np.mean(extra**2))
    assert rms > 0.0
    gain = np.sum(extra * current) / np.sum(current**2)
    assert abs(gain) * np.sqrt(np.mean(current**2)) < 0.15 * rms
    assert name == "supply_current" or abs(np.mean(extra)) < 0.15 * rms


@pytest.mark.parametrize("name", ["heavy_noise", "noise_bursts"])
def test_noise_of_the_current_has_no_mean(name: str) -> None:
    plain, other = disturbed(name, 1.0)
    extra = other.current_a - plain.current_a
    assert abs(np.mean(extra)) < 4.0 * np.std(extra) / len(extra) ** 0.5
    assert 0.05 < np.std(extra) < 2.0


def test_displaced_edges_keep_their_order_and_their_mean() -> None:
    plain, other = disturbed("displaced_edges", 0.05)
    late = other.edge_s - plain.edge_s
    moved = late != 0.0
    assert 0.02 < np.mean(moved) < 0.3
    assert np.all(np.diff(other.edge_s) > 0.0)
    assert abs(np.mean(late[moved])) < 0.5 * np.std(late[moved])


def test_slips_of_an_encoder_lose_and_gain_counts() -> None:
    sensors = setting_of("staircase").rig.sensors
    edges = replace(sensors, hall_pulses_per_rev=32)
    plain, other = disturbed("slips", 5.0, sensors=edges)
    assert abs(len(other.edge_s) - len(plain.edge_s)) <= 1
    assert 4 <= len(np.setxor1d(other.edge_s, plain.edge_s)) <= 30
    angle = replace(sensors, hall_pulses_per_rev=0, position_lsb_rad=2 * np.pi / 1024)
    plain, other = disturbed("slips", 5.0, sensors=angle)
    counts = np.round((other.angle_rad - plain.angle_rad) / angle.position_lsb_rad)
    slips = np.diff(counts)[np.diff(counts) != 0]
    assert 3 <= len(slips) <= 25
    assert set(np.abs(counts)) <= {0, *range(2, 9)}  # what is lost is gained at the next slip


def test_goals_of_disturbances_are_visible_and_of_the_drawn_share() -> None:
    class Named:
        found = np.zeros(0)

        def __init__(self, gap: float) -> None:
            self.gap = gap

        def retuned(self, found: np.ndarray) -> float:
            return self.gap

    for seed in range(20):
        rng = np.random.default_rng(seed)
        goals, share = bench_measured.draw_goals(Named(8.0), rng)
        square = float(np.sum(np.square(goals)))
        assert 3 <= len(goals) <= 5 and all(1.5 <= goal <= 10.0 for goal in goals)
        assert 0.1 <= share <= 0.5
        assert square / (square + 64.0) == pytest.approx(share, abs=0.01)
    with pytest.raises(bench_measured.UnsuitableDisturbance):
        bench_measured.draw_goals(Named(2.0), np.random.default_rng(0))


def test_drawn_disturbances_are_visible_and_no_effect_explains_them() -> None:
    setting = setting_of("staircase", seconds=1.5)
    params = {"brush_drop_v": 0.05}
    drawn = bench_measured.draw_disturbances(setting, params, np.random.default_rng(4))
    made = replace(setting, disturbances=drawn.disturbances)
    alone, whole = bench_measured.Basis(made, {}), bench_measured.Basis(made, params)
    share = (alone.retuned(alone.found) / whole.retuned(whole.found)) ** 2
    assert share == pytest.approx(drawn.share) and 0.1 <= share <= 0.5
    assert alone.explained(alone.found)[0] <= bench_measured.LIMITS.explained
    assert len(drawn.disturbances) >= 3
    for d in drawn.disturbances:
        basis, found = bench_measured.Basis(setting, {}).with_disturbance(d)
        assert d.id == "slips" or 1.4 <= basis.retuned(found) <= 10.5


def test_cases_with_and_without_disturbances_are_of_the_same_tool(tmp_path: Path) -> None:
    plain = ["--seed", "5", "--count", "1", "--seconds", "2", "--kind", "none", "--jobs", "1"]
    for folder, more in (("a", []), ("b", ["--disturbances", "heavy_noise:1.0,slips:0"])):
        command = [sys.executable, TRUTH / "make_cases.py", tmp_path / folder, *plain, *more]
        subprocess.run(command, check=True, capture_output=True)
    a, b = (tmp_path / folder / "case_001" for folder in "ab")
    assert (a / "rig.toml").read_bytes() == (b / "rig.toml").read_bytes()
    assert (a / "log.csv").read_bytes() != (b / "log.csv").read_bytes()
    label = json.loads((b / "label.json").read_text(encoding="utf-8"))
    assert label["disturbances"] == {"heavy_noise": 1.0, "slips": 0.0}
    assert "disturbances" not in json.loads((a / "label.json").read_text(encoding="utf-8"))


def test_answers_of_disturbed_cases_are_of_one_length() -> None:
    rows = [{"id": "slips", "size": 1.0, "seed": n, "times_visible": 2.0} for n in range(6)]
    lines = [
        gap_bench.seal({"regime": "measured", "disturbances": rows[:count]}, "abc")
        for count in (0, 6)
    ]
    assert len(lines[0]) == len(lines[1])
