"""Long and impossible runs of the plant: Ctrl-C ends them, a run of an extreme rig ends with a
message, the impossible tool of a batch is named.
"""

import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from test_impact_laws import JOINTS
from test_impact_plant import HARD, LOCKED, rig_with
from vgroove import _core as core
from vgroove.errors import VgrooveError
from vgroove.plant_alone import simulate_scenario
from vgroove.rig import Rig, rig_from_dict
from vgroove.scenario import full_trigger

ROOT = Path(__file__).resolve().parents[2]
# Time allowed to a busy machine for ending a run; without Ctrl-C each of these runs takes minutes.
CTRL_C_TIMEOUT_S = 30.0

BEGIN = """
import sys, numpy as np
from vgroove import _core as core
theta, load = np.array(eval(sys.stdin.readline()))[None, :], sys.stdin.readline().strip()
def log(seconds, row_s):
    time_s = np.arange(0.0, seconds, row_s)
    return core.LogInput(time_s, "duty", np.full(time_s.size, 1.0), load_kind=load)
print("go", flush=True)
"""
ENDLESS = {
    "impact reference": "core.simulate_impact(log(1e6, 100.0), theta, mode='reference')",
    "impact fast": "core.simulate_impact(log(1e6, 100.0), theta, mode='fast')",
    "impact fixed": "core.simulate_impact(log(1e6, 100.0), theta, mode='fixed', step_s=1e-5)",
    "impact batch": (
        "core.simulate_impact(log(1e5, 100.0), np.repeat(theta, 64, 0), mode='fast', threads=2)"
    ),
    "drivetrain": (
        "core.simulate_log(log(2e4, 1e-3), np.repeat(theta, 40, 0), np.array([0]),"
        " np.zeros((1, 3)), 2, 'adaptive')"
    ),
    "drill driver": (
        "core.simulate_drill(core.drill_parameters(), 'euler', 3600.0, step_s=1e-7, row_s=1.0)"
    ),
}


@pytest.mark.parametrize("name", ENDLESS)
def test_ctrl_c_ends_a_run(name: str) -> None:
    load = "none" if name == "drivetrain" else "locked"
    words = [sys.executable, "-c", BEGIN + ENDLESS[name]]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        try:
            run.stdin.write(
                f"{rig_with(LOCKED).parameters().tolist()!r}\n".replace("inf", "float('inf')")
                + load
                + "\n"
            )
            run.stdin.flush()
            assert run.stdout.readline() == "go\n"
            time.sleep(0.3)
            assert run.poll() is None
            run.send_signal(2)
            _, errors = run.communicate(timeout=CTRL_C_TIMEOUT_S)
        finally:
            run.kill()
    assert "KeyboardInterrupt" in errors
    assert run.returncode != 0


def test_ctrl_c_at_the_command_line_leaves_no_file_and_exit_code_130(tmp_path: Path) -> None:
    rig = tomllib.loads((ROOT / "rigs/impact_driver.toml").read_text())
    # effects with which the solver is slowest
    rig["effects"] = {"gear_backlash": {"play_rad": 0.01}, "groove_friction": {"coefficient": 0.05}}
    (tmp_path / "rig.toml").write_text(tomli_w.dumps(rig))
    scenario = {
        "schema": "vgroove.scenario/1",
        "rig": "rig.toml",
        "duration_s": 3600.0,
        "trigger": {"travel": [[0.0, 1.0]]},
    }
    (tmp_path / "long.toml").write_text(tomli_w.dumps(scenario))
    words = [
        sys.executable,
        "-X",
        "importtime",
        "-m",
        "vgroove.cli",
        "sim",
        "long.toml",
        "-o",
        "out.csv",
        "--json",
        "out.json",
    ]
    with subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        try:
            # wait until the modules are imported, which takes longer on a busy machine
            while "vgroove.plant_alone" not in (line := run.stderr.readline()):
                assert line
            time.sleep(1.0)
            assert run.poll() is None
            run.send_signal(2)
            run.communicate(timeout=CTRL_C_TIMEOUT_S)
        finally:
            run.kill()
    assert run.returncode == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == ["long.toml", "rig.toml"]


def changed(section: str, key: str, value: float) -> dict:
    data = rig_with({**HARD, "run_torque_nm": 60.0}).as_dict()
    data[section][key] = value
    return data


@pytest.mark.parametrize(
    ("section", "key", "value", "words"),
    [
        ("motor", "resistance_ohm", 1e9, ["motor.resistance_ohm", "10000"]),
        (
            "mechanism",
            "lug_overlap_rad",
            3.2,
            ["mechanism.lug_overlap_rad 3.2", "gap", "lug_count", "3.142"],
        ),
        ("mechanism", "lug_count", 7, ["mechanism.lug_overlap_rad 1", "lug_count", "0.8976"]),
        (
            "mechanism",
            "hammer_start_rad",
            0.5,
            ["mechanism.hammer_start_rad 0.5", "on a lug", "2.142"],
        ),
        ("mechanism", "hammer_start_rad", -2.2, ["mechanism.hammer_start_rad -2.2", "on a lug"]),
        ("mechanism", "travel_rad", 1.0, ["mechanism.travel_rad", "lug_height_m"]),
        (
            "mechanism",
            "contact_stiffness_n_per_m",
            1e12,
            ["mechanism.contact_stiffness_n_per_m", "contact in rad/s", "unit"],
        ),
        (
            "mechanism",
            "contact_damping_n_s_per_m",
            1e8,
            ["mechanism.contact_damping_n_s_per_m", "per s"],
        ),
        ("mechanism", "anvil_inertia_kg_m2", 1e-9, ["mechanism.anvil_inertia_kg_m2"]),
        ("load", "damping_nm_s_per_rad", 1e6, ["load.damping_nm_s_per_rad", "per s"]),
        ("load", "stiffness_nm_per_rad", 1e9, ["load.stiffness_nm_per_rad", "rad/s"]),
    ],
)
def test_a_rig_that_the_plant_would_refuse_is_refused_when_read(
    section: str, key: str, value: float, words: list[str]
) -> None:
    with pytest.raises(VgrooveError) as error:
        rig_from_dict(changed(section, key, value), "x.toml")
    for word in ("x.toml", *words):
        assert word in str(error.value)


def test_an_effect_may_make_a_tool_impossible() -> None:
    with pytest.raises(
        VgrooveError,
        match=r"mechanism.lug_height_m 0.0045 must be more than effects.lug_wear.height_m, 0.005",
    ):
        rig_with(LOCKED).with_effects({"lug_wear": {"height_m": 5e-3}})


def test_a_free_load_needs_a_tool_without_mechanism() -> None:
    free = {"kind": "free", "torque_nm": 0.5}
    with pytest.raises(VgrooveError, match=r"free.*mechanism.*none"):
        rig_with(free)
    data = rig_with(LOCKED).as_dict() | {
        "mechanism": {"kind": "none"},
        "load": {**free, "form": "exponential"},
    }
    rig = rig_from_dict(data, "x")
    assert dict(zip(core.PARAMETERS, rig.parameters(), strict=True))["load.exponential"] == 1.0
    speed = [
        simulate_scenario(full_trigger(rig_from_dict(data | {"load": load}, "x"), "x")).columns[
            "speed_rpm"
        ][-1]
        for load in ({"kind": "none"}, free, {**free, "torque_nm": 1.0})
    ]
    assert speed[0] > speed[1] > speed[2] > 0.5 * speed[0]


def test_a_batch_names_its_impossible_tool() -> None:
    time_s = np.arange(50) * 1e-3
    log = core.LogInput(time_s, "duty", np.ones(50), load_kind="locked")
    theta = np.repeat(rig_with(LOCKED).parameters()[None, :], 5, 0)
    theta[3, core.PARAMETERS.index("mechanism.hammer_mass_kg")] = -1.0
    with pytest.raises(
        ValueError, match=r"parameter set 3: .*mechanism.hammer_mass_kg must be positive"
    ):
        core.simulate_impact(log, theta, mode="fast", threads=2)
    drive = core.LogInput(time_s, "duty", np.ones(50))
    theta[1, core.PARAMETERS.index("motor.inductance_h")] = 0.0
    with pytest.raises(ValueError, match=r"parameter set 1: .*motor.inductance_h must be positive"):
        core.simulate_log(drive, theta, np.array([0]), np.zeros((1, 3)))


def random_rig(rng: np.random.Generator) -> Rig | None:
    """A tool with three in ten of its values changed by up to a factor of 1000; None where the rig
    refuses it with a message.
    """
    data = rig_with(
        JOINTS[str(rng.choice(["locked", "slip 60", "slope 700", "screw", "discs"]))]
    ).as_dict()
    for section in ("motor", "mechanism", "load"):
        for key, value in data[section].items():
            if (
                isinstance(value, float | int)
                and key not in ("lug_count", "parallel", "series")
                and rng.random() < 0.3
            ):
                data[section][key] = float(value * 10.0 ** rng.uniform(-3.0, 3.0))
    try:
        return rig_from_dict(data, "x.toml")
    except VgrooveError as error:
        assert any(word in str(error) for word in ("motor.", "mechanism.", "load.")), error
        return None


@pytest.mark.parametrize("seed", range(40))
def test_any_rig_runs_or_ends_with_a_message(seed: int) -> None:
    rig = random_rig(np.random.default_rng(seed))
    if rig is None:
        return
    log = core.LogInput(np.arange(100) * 1e-3, "duty", np.ones(100), load_kind=rig.load["kind"])
    began = time.process_time()
    try:
        out = core.simulate_impact(log, rig.parameters()[None, :], mode="fast")
        assert np.all(np.isfinite(out["current_a"]))
    except RuntimeError as error:
        assert "impact mechanism: " in str(error) and (
            " s: the fastest rate" in str(error) or "switch" in str(error)
        )
    assert time.process_time() - began < 20.0
