"""The generator's own laws: bristle friction, energy, the bridge in lock-step, determinism, and the
seal.
"""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from truth_helpers import TRUTH, Command, Generator, TruthTool, sealed, steady

PERIOD_S = 510 / 16e6


def run_lockstep(
    tool: TruthTool, periods: int, coast: int = 0, duty: float = 0.0, dead: float = 0.0
) -> list[tuple]:
    return [tool.period(coast, duty, dead) for _ in range(periods)]


def test_shaft_at_rest_holds_up_to_the_breakaway_torque() -> None:
    held = steady(
        1.0, voltage_v=0.85 * 0.19 * 0.02 / 0.0109, breakaway_nm=0.008, stribeck_rad_s=30.0
    )
    freed = steady(
        1.0, voltage_v=1.05 * 0.19 * 0.02 / 0.0109, breakaway_nm=0.008, stribeck_rad_s=30.0
    )
    assert abs(held["angle_rad"]) < 0.005
    assert abs(held["speed_rad_s"]) < 0.01
    assert freed["angle_rad"] > 1.0


@pytest.mark.parametrize("duty", [0.1, 0.15, 0.3, -0.2])
def test_sliding_friction_is_the_steady_curve(duty: float) -> None:
    inside = steady(duty, seconds=2.0, breakaway_nm=0.006, stribeck_rad_s=120.0)
    w = inside["speed_rad_s"]
    assert abs(w) > 20.0
    assert inside["friction_nm"] == pytest.approx(
        np.sign(w) * (0.012 + 0.006 * np.exp(-((w / 120.0) ** 2))), rel=0.01
    )


def test_bristle_springs_back_below_breakaway() -> None:
    tool = Generator(voltage_v=0.5 * 0.19 * 0.012 / 0.0109)
    points = np.array([0.0, 0.5, 0.5, 1.0])
    command = Command(points, np.array([1.0, 1.0, 0.0, 0.0]), np.zeros(4), np.zeros(0), np.zeros(0))
    run = tool.run(command, np.array([0.49, 0.99]))
    assert 1e-4 < run.angle_rad[0] < 8e-4
    assert abs(run.angle_rad[1]) < 0.6 * run.angle_rad[0]


@pytest.mark.parametrize(
    "params", [{}, {"brush_drop_v": 0.5}, {"coupler_nm_per_rad": 0.05}, {"breakaway_nm": 0.01}]
)
def test_energy_drawn_is_lost_or_stored(params: dict[str, float]) -> None:
    tool = Generator(step_s=2e-6, **params)
    time = np.array([0.0, 0.4, 0.4, 0.7, 0.7, 1.0])
    duty = np.array([0.8, 0.8, -0.5, -0.5, 0.3, 0.3])
    tool.run(
        Command(time, duty, np.zeros(6), np.array([0.0, 1.0]), np.array([0.2, 0.2])),
        np.array([1.0]),
    )
    inside = tool.inside()
    lost = inside["copper_j"] + inside["friction_j"] + inside["load_j"]
    # its spring and damper are not in the energy balance
    coupled = 0.05 * inside["drawn_j"] if "coupler_nm_per_rad" in params else 0.0
    assert inside["drawn_j"] == pytest.approx(
        lost + inside["stored_j"], abs=0.004 * inside["drawn_j"] + coupled
    )
    assert inside["drawn_j"] > 10.0


@pytest.mark.parametrize(
    "params", [{"coupler_nm_per_rad": 0.4, "coupler_damping_ratio": 0.1}, {"play_rad": 0.05}]
)
def test_two_masses_have_no_phase_error_at_any_step(params: dict[str, float]) -> None:
    """A phase error of half a step of 25 us is 0.015 rad at full speed and acts like a smaller
    inertia.
    """
    time, duty = np.array([0.0, 0.2, 1.0]), np.array([0.0, 1.0, 1.0])
    angles = [
        Generator(step_s=step, **params)
        .run(Command(time, duty, np.zeros(3), np.zeros(0), np.zeros(0)), np.array([1.0]))
        .angle_rad[0]
        for step in (2.5e-5, 1e-6)
    ]
    assert angles[0] == pytest.approx(angles[1], abs=2e-3)


def test_coast_opens_the_bridge_and_brake_shorts_it() -> None:
    coasting, braking = TruthTool(), TruthTool()
    for tool in (coasting, braking):
        run_lockstep(tool, 10000, duty=0.5)
    at_once = coasting.inside()["speed_rad_s"]
    run_lockstep(coasting, 60, coast=1)
    run_lockstep(braking, 60)
    assert coasting.inside()["current_a"] == 0.0
    assert coasting.inside()["speed_rad_s"] > 0.97 * at_once
    assert braking.inside()["current_a"] < -30.0


@pytest.mark.parametrize("duty", [0.5, -0.5])
def test_dead_time_reduces_the_voltage_against_the_current(duty: float) -> None:
    dead = 8 / 2 / 255
    speeds = []
    for lost in (0.0, dead):
        tool = TruthTool()
        run_lockstep(tool, 40000, duty=duty, dead=lost)
        speeds.append(tool.inside()["speed_rad_s"])
    fallen = 1.0 - speeds[1] / speeds[0]
    assert fallen == pytest.approx(dead / 0.5, rel=0.1)


def test_lockstep_edges_are_cycles_of_the_period_and_count_the_angle() -> None:
    tool = TruthTool()
    answers = run_lockstep(tool, 20000, duty=0.9)
    edges = [cycle for _, _, cycles in answers for cycle in cycles]
    assert edges and all(0 <= cycle < 510 for cycle in edges)
    assert len(edges) == pytest.approx(tool.inside()["angle_rad"] / (np.pi / 2), abs=1.0)
    assert len(set(edges)) > 100


def test_lockstep_and_log_run_are_the_same_tool() -> None:
    tool = TruthTool()
    run_lockstep(tool, 31373, duty=0.7)
    logged = steady(0.7, seconds=31373 * PERIOD_S, pwm_hz=1 / PERIOD_S, duty_levels=0.0)
    assert tool.inside()["speed_rad_s"] == pytest.approx(logged["speed_rad_s"], rel=1e-9)


def test_lockstep_delay_counts_periods() -> None:
    tool = TruthTool(transport_delay_s=10 * PERIOD_S)
    currents = [tool.period(0, 1.0, 0.0)[0] for _ in range(12)]
    assert currents[9] == 0.0
    assert currents[10] > 1.0


def test_unknown_parameter_is_refused_by_name() -> None:
    with pytest.raises(KeyError, match="coulomb_mn"):
        Generator(coulomb_mn=0.1)


def make(folder: Path, seed: int) -> None:
    command = [
        sys.executable,
        str(TRUTH / "make_cases.py"),
        str(folder),
        "--seed",
        str(seed),
        "--count",
        "3",
        "--seconds",
        "3",
        "--kind",
        "single,none,unlisted",
        "--logger",
        "mixed",
    ]
    subprocess.run(command, check=True, capture_output=True)


def test_cases_are_the_same_bytes_for_the_same_seed(tmp_path: Path) -> None:
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        make(tmp_path / name, seed)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*.*"))
    assert len(files) == 9
    assert all(
        (tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files
    )
    assert any(
        (tmp_path / "a" / f).read_bytes() != (tmp_path / "c" / f).read_bytes() for f in files
    )
    labels = [json.loads((tmp_path / "a" / f).read_text()) for f in files if f.name == "label.json"]
    assert [label["label"] for label in labels] == ["effect", "none", "unlisted"]
    assert not labels[1]["truth"]


def test_rigs_of_cases_obey_the_schema(tmp_path: Path) -> None:
    import tomllib

    import jsonschema

    schema = TRUTH.parents[1] / "hil/vgroove/data/rig.schema.json"
    make(tmp_path, 9)
    for path in tmp_path.rglob("rig.toml"):
        jsonschema.validate(tomllib.loads(path.read_text()), json.loads(schema.read_text()))


def test_seal_is_unreadable_and_opens_to_the_answer(tmp_path: Path) -> None:
    shut = sealed.draw_sealed(4, tmp_path)
    data = shut.path.read_bytes()
    assert not any(
        name.encode() in data for name in (*sealed.DEMO_IDS, *sealed.OUTSIDE_IDS, "label", "params")
    )
    answer = sealed.open_sealed(shut.path, shut.commitment)
    assert answer == sealed.draw_answer(4)
    changed = {
        name: value for name, value in answer["params"].items() if shut.tool.get(name) != value
    }
    assert answer["params"] and not changed


def test_seal_refuses_a_changed_file_and_a_wrong_commitment(tmp_path: Path) -> None:
    shut = sealed.draw_sealed(2, tmp_path)
    data = bytearray(shut.path.read_bytes())
    with pytest.raises(ValueError, match="not what was committed"):
        sealed.open_sealed(shut.path, hashlib.sha256(b"other").hexdigest())
    data[40] ^= 1
    shut.path.write_bytes(bytes(data))
    with pytest.raises(ValueError, match="not what was committed"):
        sealed.open_sealed(shut.path, shut.commitment)


@pytest.mark.proof
def test_of_ten_seeds_one_has_no_effect_and_one_is_outside_the_catalogue() -> None:
    answers = [sealed.draw_answer(seed) for seed in range(1, 11)]
    assert sorted(answer["label"] for answer in answers) == ["effect"] * 8 + ["none", "unlisted"]
    assert all(
        1.5 <= answer["times_visible"] <= 8.0 for answer in answers if answer["label"] != "none"
    )
    assert len(sealed.DEMO_IDS) >= 10


def test_lockstep_samples_current_at_the_very_end_of_the_period() -> None:
    tool = TruthTool()
    current = run_lockstep(tool, 200, duty=0.6)[-1][0]
    assert current == tool.inside()["current_a"]
    assert TruthTool().period(1, 0.0, 0.0)[:2] == (0.0, 18.0)
