"""The diagnosis of a hammering tool: effects of mechanism, joint, drivetrain and sensors by name,
nothing where there is nothing, the corrected rig, joints of several logs, and what it refuses.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from impact_logs import impact_rig, plant_log, ramp
from vgroove.gap import DiagnosisOptions, diagnose
from vgroove.gap.log_check import check_log
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.simulate import compute_gap
from vgroove.log import Log, write_csv
from vgroove.rig import read_joints, write_rig

SECONDS = 1.6
NAMED = {
    "groove_friction": {"groove_friction.coefficient": 0.012},
    "winding_resistance": {"winding_resistance.relative": 0.05},
    "current_gain": {"current_gain.relative": 0.03},
}


@pytest.mark.proof
@pytest.mark.parametrize("effect", NAMED)
def test_an_effect_is_named_with_its_size(effect: str) -> None:
    rig, levels = impact_rig(), ramp(0.9, SECONDS)
    verdict = diagnose([plant_log(rig, NAMED[effect], 7, levels)], rig)
    assert (verdict.verdict, list(verdict.selected)) == ("effect", [effect])
    assert verdict.gap.after < 1.1 < verdict.gap.before
    (name, value) = next(iter(NAMED[effect].items()))
    found = verdict.effect(effect).parameters[name.split(".")[1]]
    assert found.value == pytest.approx(value, rel=0.06)
    assert verdict.where.subsystem == verdict.effect(effect).subsystem


@pytest.mark.proof
def test_a_log_of_another_start_angle_is_no_gap() -> None:
    rig = impact_rig(load__slip_slope_nm_per_rad=120.0, supply__voltage_v=17.4)
    verdict = diagnose([plant_log(rig, {}, 23, ramp(0.8, SECONDS))], rig)
    assert (verdict.verdict, list(verdict.selected)) == ("none", [])


@pytest.mark.proof  # in `make test` the demo's corrected rig
def test_the_corrected_rig_has_the_gap_that_the_verdict_states(
    tmp_path: Path, simulated_gap: Callable[[Path, Path], float]
) -> None:
    rig = impact_rig()
    log = plant_log(rig, {"spring_preload.relative": 0.06}, 3, ramp(0.9, SECONDS))
    write_csv(log, tmp_path / "run.csv")
    write_rig(rig, tmp_path / "rig.toml")
    command = [sys.executable, "-m", "vgroove.cli", "gap", "diagnose", "run.csv"]
    command += ["--rig", "rig.toml", "--json", "verdict.json", "--html", "page.html"]
    command += ["--out-rig", "corrected.toml"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    verdict = json.loads((tmp_path / "verdict.json").read_text())
    assert (verdict["verdict"], verdict["selected"]) == ("effect", ["spring_preload"])
    assert verdict["gap"]["after"] < 1.1 < verdict["gap"]["before"]
    assert verdict["where"]["subsystem"] == "mechanism"
    (found,) = [e for e in verdict["effects"] if e["id"] == "spring_preload"]
    assert found["parameters"]["relative"]["value"] == pytest.approx(0.06, rel=0.06)
    assert {"blow_period_s", "current_a.level", "speed_rpm.shape"} <= set(
        verdict["gap"]["by_signal"]
    )
    for name, figure in (("rig.toml", "before"), ("corrected.toml", "refit")):
        found_gap = simulated_gap(tmp_path / name, tmp_path / "run.csv")
        assert found_gap == pytest.approx(verdict["gap"][figure], rel=0.02), figure


def test_each_log_may_have_its_own_joint(tmp_path: Path) -> None:
    rig = impact_rig()
    slopes, logs, paths = (100.0, 500.0), [], []
    for k, slope in enumerate(slopes):
        joint = impact_rig(load__slip_slope_nm_per_rad=slope)
        logs.append(plant_log(joint, {}, 40 + k, ramp(0.9, SECONDS)))
        lines = ["[load]", f'kind = "{joint.load["kind"]}"']
        lines += [f"{key} = {v}" for key, v in joint.load.items() if key != "kind"]
        path = tmp_path / f"joint{k}.toml"
        path.write_text("\n".join(lines) + "\n")
        paths.append(path)
    tools = read_joints(paths, rig, 2)
    own = load_problem(logs, rig, joints=tools)
    shared = load_problem(logs, rig)
    gaps = [p.gap(p.residuals(p.theta0)[0]) for p in (own, shared)]
    assert gaps[0] < 1.05
    assert gaps[1] > 1.3 * gaps[0]
    by_command = compute_gap(rig, logs, DiagnosisOptions(as_is=True, joints=tools))[0]["gap"]
    assert by_command == pytest.approx(gaps[0])


def test_a_tolerance_of_a_log_s_own_joint_is_a_nuisance_parameter_of_that_log() -> None:
    loose = impact_rig().as_dict()
    loose["tolerance"] = {"load.slip_slope_nm_per_rad": 0.2}
    from vgroove.rig import rig_from_dict

    rig = rig_from_dict(loose, "loose")
    problem = load_problem([plant_log(rig, {}, 5, ramp(0.9, SECONDS))], rig, joints=[rig])
    assert problem.tolerance == {"load.slip_slope_nm_per_rad, log 1": 0.2}
    theta = np.repeat(problem.theta0[None], 2, axis=0)
    theta[1, problem.index("load.slip_slope_nm_per_rad, log 1")] *= 1.4
    rows = problem.residuals(theta)
    assert np.abs(rows[1] - rows[0]).max() > 1.0


def test_wrong_units_and_numbers_of_joints_are_refused(tmp_path: Path) -> None:
    rig = impact_rig()
    log = plant_log(rig, {}, 1, ramp(0.9, SECONDS))
    milliamps = {**log.columns, "current_a": 1000.0 * log.columns["current_a"]}
    findings = check_log(Log(log.time_s, milliamps, "run.csv"), rig).findings
    assert any(f.refuses and "mA" in f.text for f in findings)
    path = tmp_path / "joint.toml"
    path.write_text('[load]\nkind = "locked"\n[motor]\nresistance_ohm = 1\n')
    done = subprocess.run(
        [sys.executable, "-m", "vgroove.cli", "gap", "diagnose", "a.csv", "b.csv", "--rig"]
        + [str(tmp_path / "rig.toml"), "--joint", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    write_rig(rig, tmp_path / "rig.toml")
    with pytest.raises(Exception, match="1 for 2 logs"):
        read_joints([path], rig, 2)
    with pytest.raises(Exception, match="the table \\[load\\] alone"):
        read_joints([path], rig, 1)
