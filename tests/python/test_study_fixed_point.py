"""Fixed point against floating point of the same source: replays equal the runs, errors, state
changes, cycles on the simulated AVR, and equality of host and AVR at the ends of the formats.
"""

import importlib.util
import json
import struct
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vgroove.study.fixed_point import (
    BARE,
    DRILL,
    LEAST_RATIO,
    MODES,
    RunResult,
    design_scenarios,
    drawn_scenarios,
    error_row,
    run_both,
    unmatched_changes,
)
from vgroove.study.replay import (
    CURRENT,
    DOUBLE,
    FIXED,
    REQUESTED,
    SPEED,
    STATE,
    STOP_REASON,
    Records,
    replay,
    replay_on_avr,
)

ROOT = Path(__file__).resolve().parents[2]
RUNS = {name: (mode, scenario) for name, mode, scenario in design_scenarios()}


@pytest.fixture(scope="module")
def runs() -> dict[str, RunResult]:
    """The design's runs."""
    return {name: run_both(name, *RUNS[name]) for name in RUNS}


def designators() -> ModuleType:
    path = ROOT / "hil/fixed_point/designators.py"
    spec = importlib.util.spec_from_file_location("designators", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", RUNS)
def test_a_replay_with_fixed_point_is_the_run(name: str, runs: dict[str, RunResult]) -> None:
    run = runs[name]
    driven = run.ticks[run.ticks["controlled"] == 1]
    assert set(driven["mode"]) == {run.mode} and len(driven) > 500
    assert (run.fixed[:, REQUESTED] == driven["requested_q15"]).all()
    assert (run.fixed[:, STATE] == driven["state"]).all()
    assert (run.filters_fixed[:, CURRENT] == run.ticks["current_a_q9"]).all()
    assert (run.filters_fixed[:, SPEED] == run.ticks["speed_rpm_q1"]).all()


@pytest.mark.parametrize("name", RUNS)
def test_floating_point_differs_by_the_rounding(name: str, runs: dict[str, RunResult]) -> None:
    row = error_row(runs[name])
    assert 0.0 < row["current_worst"] < 2.0
    assert 0.0 < row["speed_worst"] <= 1.0
    assert row["duty_worst"] < 0.02 * 2**15
    assert row["apart"] == 0
    if runs[name].mode not in (0, DRILL):
        assert row["duty_worst"] > 0.0


def test_every_controller_has_state_changes_in_drawn_runs() -> None:
    rows = [(mode, error_row(run_both(n, mode, s))) for n, mode, s in drawn_scenarios(3, seed=1)]
    total, apart = (sum(row[key] for _, row in rows) for key in ("changes", "apart"))
    assert total > 15 and apart <= 1
    assert {mode for mode, row in rows if row["changes"]} >= {1, 2, 3, 4}


@pytest.mark.parametrize(
    ("double", "count", "rest"),
    [
        ([0, 0, 1, 1, 2, 2], 2, []),
        ([0, 1, 1, 2, 2, 2], 2, []),  # one tick earlier each
        ([0, 0, 0, 0, 1, 2], 2, [{"step": 2, "state": 1, "double_step": 4}]),
        ([0, 0, 1, 1, 1, 1], 2, [{"step": 4, "state": 2, "double_step": None}]),
        ([0, 0, 1, 1, 2, 3], 2, [{"step": None, "state": 3, "double_step": 5}]),
    ],
)
def test_changes_more_than_a_tick_apart_are_listed(
    double: list[int], count: int, rest: list[dict[str, int | None]]
) -> None:
    fixed = np.array([0, 0, 1, 1, 2, 2])
    assert unmatched_changes(fixed, np.array(double)) == (count, rest)


@pytest.mark.parametrize("mode", range(1, len(MODES)))
def test_the_avr_has_the_answers_of_the_host_for_a_third_of_the_cycles(
    mode: int, runs: dict[str, RunResult]
) -> None:
    run = next(run for run in runs.values() if run.mode == mode)
    records = Records(run.control.parts[:700])
    host, fixed = replay(FIXED, records), replay_on_avr(FIXED, records)
    for column in (REQUESTED, STATE, STOP_REASON):
        assert (host[:, column] == fixed.answers[:, column]).all()
    single = replay_on_avr(DOUBLE, records)
    assert np.abs(replay(DOUBLE, records)[:, REQUESTED] - single.answers[:, REQUESTED]).max() < 1.0
    bare = replay_on_avr(BARE, records)
    assert LEAST_RATIO * fixed.mean_cycles < bare.mean_cycles < single.mean_cycles
    assert LEAST_RATIO * fixed.worst_cycles < bare.worst_cycles


def test_filters_on_the_avr(runs: dict[str, RunResult]) -> None:
    records = Records(next(iter(runs.values())).filters.parts[300:1000])
    host, fixed = replay(FIXED, records), replay_on_avr(FIXED, records)
    assert (host[:, [CURRENT, SPEED]] == fixed.answers[:, [CURRENT, SPEED]]).all()
    assert LEAST_RATIO * fixed.mean_cycles < replay_on_avr(BARE, records).mean_cycles


def ends(rng: np.random.Generator) -> bytes:
    """A step whose inputs are at the ends of their formats, or anywhere between."""
    signed = [-32768, -32767, -1, 0, 1, 32766, 32767, int(rng.integers(-32768, 32768))]
    positive = [0, 1, 32766, 32767, int(rng.integers(0, 32768))]
    supply = [0, 1, 32767, 32768, 65534, 65535, int(rng.integers(0, 65536))]
    travel, duty, trigger = (int(rng.choice(positive)) for _ in range(3))
    speed, current = (int(rng.choice(signed)) for _ in range(2))
    values = (travel, speed, current, duty, trigger, int(rng.choice(supply)))
    flags = (int(rng.integers(2)), int(rng.integers(0, 4)))
    return b"T" + struct.pack("<5hHBB", *values, *flags)


@pytest.mark.parametrize("mode", range(1, len(MODES)))
def test_host_and_avr_agree_at_the_ends_of_the_formats(
    mode: int, runs: dict[str, RunResult]
) -> None:
    rng = np.random.default_rng(mode)
    run = next(run for run in runs.values() if run.mode == mode)
    start, normal = run.control.parts[0], list(run.control.parts[1:])
    parts = []
    for begin in (20, 120, 500):  # at rest, in the run-up, under load
        parts += [start, *normal[:begin], *(ends(rng) for _ in range(150))]
    records = Records(tuple(parts))
    host, avr = replay(FIXED, records), replay_on_avr(FIXED, records).answers
    for column in (REQUESTED, STATE, STOP_REASON):
        assert (host[:, column] == avr[:, column]).all()
    assert (host[:, REQUESTED] <= 32767).all() and (host[:, REQUESTED] >= -2).all()


@pytest.mark.parametrize(
    ("c", "members"),
    [
        ("*self = (Sync){.state = PLAIN};", {"state": "PLAIN"}),
        ("return (A){.b = f(1, 2), .a = {3}};", {"b": "f(1, 2)", "a": "{3}"}),
        ("Blow made_of = {.x = y ? 1 : 2,  // why\n  .z = 0};", {"x": "y ? 1 : 2", "z": "0"}),
    ],
)
def test_compound_literals_become_assignments(c: str, members: dict[str, str]) -> None:
    text = designators().rewritten(c)
    assert "{." not in text and "//" not in text
    for name, value in members.items():
        assert f"made.{name} = {value};" in text


def test_the_command_writes_its_files(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vgroove.cli", "study", "fixed-point", "--draws", "1"]
    done = subprocess.run(
        [*command, "--repeats", "2", "-o", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "double of avr-gcc 5.4 is single precision" in done.stdout
    data = json.loads((tmp_path / "fixed_point.json").read_text())
    assert [row["step"].split()[-1] for row in data["costs"][:5]] == list(MODES[1:])
    assert all(row["avr_equals_host"] for row in data["costs"])
    assert data["least_ratio"] >= LEAST_RATIO
    assert (tmp_path / "fixed_point_costs.csv").is_file()
    assert "Traces" in (tmp_path / "fixed_point.html").read_text()
