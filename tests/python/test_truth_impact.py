"""The generator's impact tool: with every effect off it agrees with the plant, its energy does not
grow, its step has converged, and the cases are what their labels say.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truth_helpers import TRUTH, Command, sealed
from vgroove import _core as core
from vgroove.rig import read_rig

if str(TRUTH) not in sys.path:
    sys.path.insert(0, str(TRUTH))

import impact_plan  # noqa: E402
import make_impact_cases  # noqa: E402
import sealed_impact  # noqa: E402
from impact_cases import ImpactSetting, effect_params, log_columns, simulate  # noqa: E402
from impact_effects import BY_ID, CATALOGUE, MECHANISM, OUTSIDE_IDS  # noqa: E402
from impact_forms import FORMS  # noqa: E402
from impact_joints import Roughness, disc_force_n, rough_part, slip_torque, wood_nm  # noqa: E402
from impact_profiles import draw_impact  # noqa: E402
from impact_rigs import (  # noqa: E402
    ImpactRig,
    draw_impact_rig,
    impact_params,
    impact_toml,
    locked_rig,
    reference_rig,
)
from impact_tool import ImpactGenerator, ImpactRun, SlipTorque  # noqa: E402
from impact_visible import reference_of, visible_limit  # noqa: E402

SECONDS = 1.2
JOINTS = {
    "locked": (locked_rig(), 1.0),
    "locked, duty 0.7": (locked_rig(), 0.7),
    "slope 700": (reference_rig("hard_joint"), 1.0),
    "slope 100": (reference_rig("hard_joint", slip_slope_nm_per_rad=100.0), 1.0),
    "60 N m": (
        reference_rig("hard_joint", run_torque_nm=60.0, slip_slope_nm_per_rad=0.0),
        1.0,
    ),
    "discs": (reference_rig("disc_spring"), 1.0),
    "discs, loosened": (reference_rig("disc_spring", from_turns=12.0), -1.0),
    "wood": (reference_rig("wood_screw"), 1.0),
    "wood, loosened": (reference_rig("wood_screw", from_turns=30.0), -1.0),
}


def constant(duty: float) -> Command:
    """A constant duty from the start."""
    none = np.zeros(0)
    return Command(np.array([0.0, 100.0]), np.full(2, duty), np.zeros(2), none, none)


def rows_of(seconds: float) -> np.ndarray:
    return 1e-3 * np.arange(1, round(seconds * 1000) + 1)


def truth_run(rig: ImpactRig, duty: float, **params: float) -> ImpactRun:
    """The generator's tool with every effect off, the hammer at the plant's start angle."""
    tool = ImpactGenerator(**impact_params(rig), **params)
    return tool.run(constant(duty), slip_torque(rig, {}, None), rows_of(SECONDS))


def plant_run(rig: ImpactRig, duty: float, folder: Path) -> dict:
    """The same run of the plant, by its rig."""
    path = folder / "rig.toml"
    path.write_text(impact_toml(rig))
    read = read_rig(path)
    time_s = np.concatenate([[0.0], rows_of(SECONDS)])
    log = core.LogInput(time_s, "duty", np.full(time_s.size, duty), load_kind=read.load["kind"])
    return core.simulate_impact(log, read.parameters()[None, :], mode="reference")


@pytest.mark.parametrize("supply_v", [16.5, 18.5])
@pytest.mark.parametrize("joint", JOINTS)
def test_effect_free_tool_is_the_plant(joint: str, supply_v: float, tmp_path: Path) -> None:
    rig, duty = JOINTS[joint]
    rig = rig.with_values(supply__voltage_v=supply_v)
    plant, truth = plant_run(rig, duty, tmp_path), truth_run(rig, duty)
    blows = plant["blows"][0]
    blow_s = blows[blows["kind"] == 0]["time_s"]
    assert len(truth.blow_s) == len(blow_s)
    assert np.max(np.abs(truth.blow_s - blow_s)) < 1e-4
    late = slice(-500, None)
    for name, values in (("current_a", truth.run.current_a), ("supply_v", truth.run.supply_v)):
        assert values[late].mean() == pytest.approx(plant[name][0, late].mean(), rel=1e-3)
    speed = truth.run.speed_rad_s[late].mean()
    assert speed == pytest.approx(plant["speed_rad_s"][0, late].mean(), rel=1e-3)
    angle = plant["anvil_angle_rad"][0, -1]
    assert truth.anvil_angle_rad[-1] == pytest.approx(angle, rel=1e-3, abs=2e-3)


def test_figures_of_the_reference_set() -> None:
    run = truth_run(locked_rig(), 1.0)
    late = run.blow_s > 0.5
    assert 60.0 / np.diff(run.blow_s[late]).mean() == pytest.approx(2857, rel=1e-3)
    assert run.peak_nm[late][:-1].max() == pytest.approx(144.0, rel=0.01)
    assert run.run.current_a[-500:].mean() == pytest.approx(32.3, abs=0.05)
    assert run.hammer_mm[-500:].max() == pytest.approx(10.9, abs=0.1)


def test_step_has_converged() -> None:
    rig = reference_rig("hard_joint", slip_slope_nm_per_rad=100.0)
    usual, fine = truth_run(rig, 1.0), truth_run(rig, 1.0, tolerance=0.05)
    assert np.max(np.abs(usual.blow_s - fine.blow_s)) < 5e-5
    assert usual.head_rad[-1] == pytest.approx(fine.head_rad[-1], rel=1e-4)


@pytest.mark.parametrize("joint", ["locked", "60 N m", "wood"])
def test_energy_is_balanced_and_does_not_grow(joint: str) -> None:
    rig, duty = JOINTS[joint]
    tool = ImpactGenerator(**impact_params(rig))
    tool.run(constant(duty), slip_torque(rig, {}, None), rows_of(SECONDS))
    inside = tool.inside()
    kept = inside["input_j"] - inside["lost_j"] - inside["stored_j"]
    # a contact that ends at a release loses its elastic energy: docs/spec/model.md, section 4
    assert 0.0 <= kept < 1e-3 * inside["input_j"]


def test_energy_falls_after_the_bridge_has_opened() -> None:
    rig = locked_rig()
    times = np.array([0.0, 0.3, 0.3, 2.0])
    none = np.zeros(0)
    command = Command(
        times, np.array([1.0, 1.0, 0.0, 0.0]), np.array([0.0, 1.0, 1.0, 1.0]), none, none
    )
    stored = []
    for end in np.arange(0.31, 0.6, 0.02):
        tool = ImpactGenerator(**impact_params(rig))
        tool.run(command, slip_torque(rig, {}, None), rows_of(end))
        stored.append(tool.inside()["stored_j"])
    assert np.all(np.diff(stored) < 1e-6)
    assert stored[-1] < 0.3 * stored[0]


def test_no_load_speed() -> None:
    free = SlipTorque(np.full(2, 1e-9), np.full(2, 1e-9), 0.0, 1.0)
    tool = ImpactGenerator(**impact_params(locked_rig()))
    run = tool.run(constant(1.0), free, rows_of(1.0)).run
    assert run.speed_rad_s[-1] / 5.6 * 30.0 / np.pi == pytest.approx(2813, abs=2)


def test_springs_and_screws_of_the_specification() -> None:
    discs = reference_rig("disc_spring", parallel=1, series=1)
    turns = 0.75 * 0.00115 / 2e-3
    assert disc_force_n(discs, np.array([turns]))[0] == pytest.approx(2621, rel=2e-3)
    wood = reference_rig("wood_screw")
    depth = np.array([-0.5, 0.0, 36.0, 36.25, 36.5, 40.0])
    assert wood_nm(wood, depth) == pytest.approx([0.0, 0.5, 6.0, 12.0, 6.0, 4.2])


def test_roughness_is_a_few_percent_and_smooth() -> None:
    head = np.arange(0.0, 200.0, 0.01)
    rough = rough_part(head, Roughness(0.03, 0.3, 5))
    assert rough.std() == pytest.approx(0.03, rel=0.2)
    assert abs(rough.mean()) < 0.005
    assert np.max(np.abs(np.diff(rough))) < 0.01


def setting_of(joint: str, profile: str = "plain", **changes: object) -> ImpactSetting:
    """A drawn tool on a joint and a profile, rig exact."""
    rng = np.random.default_rng(3)
    rig = draw_impact_rig(joint, rng)
    made = draw_impact(profile, 1.5, joint != "hard_joint", rng)
    return replace(ImpactSetting(rig, rig, made, 1.5, 5), **changes)


@pytest.mark.parametrize("effect_id", BY_ID)
def test_an_effect_of_no_size_changes_little_and_one_of_full_size_much(effect_id: str) -> None:
    effect = BY_ID[effect_id]
    profile = "loosen" if effect.needs == "loosen" else "levels"
    setting = setting_of(effect.joints[-1], profile)
    base = log_columns(setting, {})
    top = log_columns(setting, effect_params(setting, effect_id, effect.top(setting.tool)))
    assert any(np.max(np.abs(top[name] - base[name])) > 0.0 for name in base)
    hidden = ("saturation", "coupler_compliance", "u_soft_grip", "u_bit_play")
    if not any(word in effect_id for word in hidden):
        tiny = log_columns(setting, effect_params(setting, effect_id, 1e-12))
        assert np.max(np.abs(tiny["current_a"] - base["current_a"])) < 2.0


@pytest.mark.parametrize("effect_id", FORMS)
def test_other_forms_run(effect_id: str) -> None:
    effect = BY_ID[effect_id]
    setting = setting_of(effect.joints[-1], other_forms=True)
    size = 0.3 * effect.top(setting.tool)
    made = effect_params(setting, effect_id, size)
    assert made != effect_params(replace(setting, other_forms=False), effect_id, size)
    assert len(simulate(setting, made).out.blow_s) > 10


def test_logs_of_other_seeds_differ_and_those_of_one_seed_do_not() -> None:
    setting = setting_of("hard_joint")
    one, again = log_columns(setting, {}), log_columns(setting, {})
    other = log_columns(replace(setting, seed=6), {})
    assert all(np.array_equal(one[name], again[name]) for name in one)
    assert not np.array_equal(one["speed_rpm"], other["speed_rpm"])


def test_visible_limit_is_that_of_the_statistics() -> None:
    reference = reference_of(setting_of("wood_screw"))
    limit = visible_limit(reference, "winding_resistance")
    assert limit is not None and 1e-3 < limit < 0.1
    assert visible_limit(reference, "dead_time") is None  # full duty


def test_cases_have_the_files_and_labels_of_the_format(tmp_path: Path) -> None:
    options = ["--count", "2", "--kind", "single,none", "--ids", "spring_preload", "--joint", "1"]
    assert make_impact_cases.main([str(tmp_path), *options, "--seconds", "1.5:1.6"]) == 0
    label = json.loads((tmp_path / "case_000/label.json").read_text())
    assert label["ids"] == ["spring_preload"]
    assert 1.5 <= label["times_visible"]["spring_preload"] <= 10.0
    rig = read_rig(tmp_path / "case_000/rig.toml")
    assert rig.mechanism["kind"] == "impact"
    assert json.loads((tmp_path / "case_001/label.json").read_text())["label"] == "none"


def test_plan_has_every_effect_joint_and_regime_in_each_half() -> None:
    for half in ("tune", "report"):
        entries = impact_plan.impact_plan(half)
        assert len(entries) >= 120
        for regime in impact_plan.IMPACT_REGIMES:
            singles = {e.first for e in entries if e.kind == "single" and e.regime == regime}
            assert singles == {effect.id for effect in CATALOGUE}
            outside = {e.first for e in entries if e.kind == "unlisted" and e.regime == regime}
            assert outside == set(OUTSIDE_IDS)
        assert {e.joint for e in entries} == {"locked", "hard_joint", "disc_spring", "wood_screw"}
        assert all(e.joint in BY_ID[e.first].joints for e in entries if e.first)
    assert len(MECHANISM) == 9


def test_sealed_tool_opens_by_its_commitment_and_differs_by_seed(tmp_path: Path) -> None:
    kinds = {sealed_impact.draw_impact_answer(seed)["label"] for seed in (1, 6, 8)}
    assert kinds == {"effect", "none", "unlisted"}
    drawn = sealed_impact.draw_sealed_impact(4, tmp_path)
    answer = sealed.open_sealed(drawn.path, drawn.commitment)
    assert answer == json.loads(json.dumps(sealed_impact.draw_impact_answer(4)))
    with pytest.raises(ValueError, match="committed"):
        sealed.open_sealed(drawn.path, "0" * 64)
    current = [drawn.tool.period(0, 1.0, 0.0)[0] for _ in range(60)]
    assert max(current) > 10.0
