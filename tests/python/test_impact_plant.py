"""The impact tool as a whole: figures of the reference set, lock-step equal to a log's run, and
`vgroove sim` with it.
"""

import copy
import re
from pathlib import Path

import numpy as np
import pytest

from vgroove import _core as core
from vgroove.plant_alone import scenario_figures, simulate_scenario
from vgroove.rig import Rig, read_rig
from vgroove.scenario import make_plant, read_scenario

ROOT = Path(__file__).resolve().parents[2]
HEIGHT = 2  # event of a step: the hammer passes the height of the lugs (plant/impact/events.hpp)
LOCKED = {"kind": "locked", "stiffness_nm_per_rad": 3000, "damping_nm_s_per_rad": 0.3}
HARD = {
    "kind": "hard_joint",
    "stiffness_nm_per_rad": 3000,
    "damping_nm_s_per_rad": 0.3,
    "slip_slope_nm_per_rad": 0,
    "loosen_ratio": 0.75,
}


def rig_with(load: dict, **values: float) -> Rig:
    """The reference impact rig on another joint, some keys changed."""
    rig = read_rig(ROOT / "rigs/impact_driver.toml")
    object.__setattr__(rig, "load", copy.deepcopy(load))
    return rig.with_values({key.replace("__", "."): value for key, value in values.items()})


def run(
    rig: Rig, duty: float = 1.0, seconds: float = 1.0, mode: str = "reference", **options: object
) -> dict:
    """The tool from rest at constant duty, rows of 1 ms."""
    time_s = np.arange(round(seconds * 1000) + 1) * 1e-3
    log = core.LogInput(time_s, "duty", np.full(time_s.size, duty), load_kind=rig.load["kind"])
    return core.simulate_impact(log, rig.parameters()[None, :], mode=mode, **options)


def settled(out: dict) -> tuple[float, float, float, np.ndarray]:
    """After 0.5 s: blows per minute, standard deviation of the period over its mean, mean current
    in A, and the blows.
    """
    blows = out["blows"][0]
    late = blows[blows["time_s"] > 0.5]
    period = np.diff(late["time_s"][late["kind"] == 0])
    current = float(out["current_a"][0, -500:].mean())
    return 60.0 / period.mean(), period.std() / period.mean(), current, late


# docs/spec/model.md, section 4, last row of the reference set
@pytest.mark.parametrize(
    ("load", "rate", "current"),
    [
        (LOCKED, 2857, 32.3),
        ({**HARD, "run_torque_nm": 60.0}, 3241, 27.5),
        ({**HARD, "run_torque_nm": 6.0}, 2771, 25.5),
    ],
)
@pytest.mark.parametrize("mode", ["reference", "fast"])
def test_blows_and_current_of_the_reference_set(
    load: dict, rate: float, current: float, mode: str
) -> None:
    blows_per_min, spread, mean_a, _ = settled(run(rig_with(load), mode=mode))
    assert blows_per_min == pytest.approx(rate, rel=1e-3)
    assert mean_a == pytest.approx(current, abs=0.05)
    assert spread < 1e-3


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"mechanism__hammer_start_rad": 0.0},
        {"effects__transport_delay__delay_s": 0.0123},
        {"effects__clock_skew__relative": 0.01, "effects__clock_skew__command_clock": 1.0},
        {"effects__clock_skew__relative": -0.01},
        {"effects__speed_lag__time_constant_s": 0.004, "effects__speed_lag__lag_form": 1.0},
        {"effects__cold_grease__nm_s_per_rad": 2e-5, "effects__cold_grease__time_s": 0.5},
    ],
)
@pytest.mark.parametrize("rest", [0, 1, 37, 200, 399])
def test_rows_before_the_first_command_are_those_of_steps(
    rest: int, values: dict[str, float]
) -> None:
    time_s = 0.3 + np.arange(400) * 1e-3
    duty = np.where(np.arange(400) > rest, 0.9, 0.0)
    log = core.LogInput(time_s, "duty", duty, load_kind="locked")
    theta = rig_with(LOCKED).parameters()
    for name, value in values.items():
        theta[core.PARAMETERS.index(name.replace("__", "."))] = value
    skipped, stepped = (
        core.simulate_impact(log, theta[None], mode="fast", history=history)
        for history in (False, True)
    )
    assert skipped["statistics"][0]["steps"] <= stepped["statistics"][0]["steps"]
    for name in ("current_a", "supply_v", "speed_measured_rad_s", "angle_rad", "hammer_mm"):
        scale = np.ptp(stepped[name])
        assert skipped[name] == pytest.approx(stepped[name], abs=2e-3 * scale + 1e-9), name
    assert len(skipped["blows"][0]) == len(stepped["blows"][0])
    late_s = skipped["blows"][0]["time_s"] - stepped["blows"][0]["time_s"]
    assert np.abs(late_s).max(initial=0.0) < 1e-4


def test_peaks_and_travel_on_the_locked_joint() -> None:
    out = run(rig_with(LOCKED))
    late = settled(out)[3]
    assert late["peak_torque_nm"].max() == pytest.approx(144.0, rel=0.01)
    trace = run(rig_with(LOCKED), trace_s=np.linspace(0.6, 0.7, 5001))["trace"]
    assert trace["hammer_m"].max() == pytest.approx(10.9e-3, abs=0.05e-3)


def test_no_load() -> None:
    out = run(rig_with({**HARD, "run_torque_nm": 0.3, "slip_slope_nm_per_rad": 0}), seconds=1.0)
    free = run(rig_with({"kind": "none"}))
    assert free["speed_rad_s"][0, -300:].mean() / 5.6 * 30 / np.pi == pytest.approx(2813, abs=1)
    assert free["current_a"][0, -300:].mean() == pytest.approx(1.8, abs=0.05)
    assert out["current_a"][0, -300:].mean() > free["current_a"][0, -300:].mean()


# Soft joint: its damping is above the critical one, and the anvil creeps back without oscillation.
WOOD = {
    "kind": "wood_screw",
    "start_nm": 1.4,
    "end_nm": 19.0,
    "turns": 21.0,
    "seat_nm": 40.0,
    "seat_deg": 90.0,
    "stripped_ratio": 0.35,
    "from_turns": 8.0,
    "loosen_ratio": 0.6,
}


@pytest.mark.parametrize(
    ("stiffness", "damping"), [(110.0, 0.3), (300.0, 0.5), (60.0, 0.2), (900.0, 0.3)]
)
def test_an_anvil_that_nothing_touches_does_not_shorten_the_steps(
    stiffness: float, damping: float
) -> None:
    joint = {**WOOD, "stiffness_nm_per_rad": stiffness, "damping_nm_s_per_rad": damping}
    out = run(rig_with(joint), mode="fast", history=True)
    steps = out["history"]
    # steps from the rise above the lugs to the way down: no event but those at both ends
    events = np.flatnonzero(steps["event"] >= 0)
    above = np.all(steps["event"][np.stack([events[:-1], events[1:]])] == HEIGHT, axis=0)
    counts = np.diff(events)[above & (np.diff(steps["time_s"][events]) > 5e-3)]
    assert len(counts) > 30
    assert counts.max() <= 12


@pytest.mark.parametrize(("stiffness", "damping"), [(110.0, 0.3), (300.0, 0.5), (900.0, 0.3)])
def test_a_soft_joint_is_followed_as_by_the_reference_mode(
    stiffness: float, damping: float
) -> None:
    rig = rig_with({**WOOD, "stiffness_nm_per_rad": stiffness, "damping_nm_s_per_rad": damping})
    fast, reference = (run(rig, seconds=0.3, mode=mode) for mode in ("fast", "reference"))
    late, exact = fast["blows"][0], reference["blows"][0]
    assert len(late) == len(exact) > 10
    assert late["kind"].tolist() == exact["kind"].tolist()
    assert np.abs(late["time_s"] - exact["time_s"]).max() < 2e-5
    counted = exact["kind"] < 2
    peaks = late["peak_torque_nm"] / exact["peak_torque_nm"] - 1.0
    assert np.abs(peaks[counted]).max() < 1e-4
    assert np.abs(peaks).max() < 0.01
    turned = reference["head_rad"][0]
    assert fast["head_rad"][0] == pytest.approx(turned, abs=2e-4 * turned[-1])


@pytest.mark.parametrize("inertia", [0.0, 2e-6, 4e-6])
@pytest.mark.parametrize(("coupler", "ratio"), [(2000.0, 0.05), (6000.0, 0.3), (2e4, 0.05)])
@pytest.mark.parametrize(("stiffness", "damping"), [(110.0, 0.3), (2500.0, 0.36)])
def test_a_light_body_behind_a_coupler_does_not_shorten_the_steps(
    stiffness: float, damping: float, coupler: float, ratio: float, inertia: float
) -> None:
    joint = {**WOOD, "stiffness_nm_per_rad": stiffness, "damping_nm_s_per_rad": damping}
    effect = {"stiffness_nm_per_rad": coupler, "damping_ratio": ratio, "inertia_kg_m2": inertia}
    theta = rig_with(joint).parameters()
    for name, value in effect.items():
        theta[core.PARAMETERS.index(f"effects.coupler_compliance.{name}")] = value
    time_s = np.arange(301) * 1e-3
    log = core.LogInput(time_s, "duty", np.ones(301), load_kind=joint["kind"])
    fast, reference = (
        core.simulate_impact(log, theta[None], mode=mode) for mode in ("fast", "reference")
    )
    assert fast["statistics"][0]["steps"] < 45 * 300
    late, exact = fast["blows"][0], reference["blows"][0]
    late, exact = late[late["kind"] == 0], exact[exact["kind"] == 0]
    assert len(late) == len(exact) > 5
    assert np.abs(late["time_s"] - exact["time_s"]).max() < 5e-5
    assert late["peak_torque_nm"] == pytest.approx(exact["peak_torque_nm"], rel=1e-3)
    assert fast["head_rad"][0, -1] == pytest.approx(reference["head_rad"][0, -1], rel=5e-4)


@pytest.mark.parametrize(("duty", "hits"), [(0.5, 2), (0.3, 3)])
def test_at_low_duty_each_lug_is_hit_more_than_once(duty: float, hits: int) -> None:
    late = settled(run(rig_with(LOCKED), duty))[3]
    counted = late[late["kind"] < 2]
    per_lug = [int(np.sum(counted["lug"] == lug)) for lug in np.unique(counted["lug"])[1:-1]]
    assert set(per_lug) == {hits}


def test_synchronism_is_lost_at_duty_0_7_and_at_20_5_v() -> None:
    assert settled(run(rig_with(LOCKED), 0.7))[1] == pytest.approx(0.24, abs=0.01)
    late = settled(run(rig_with({**HARD, "run_torque_nm": 60.0}, supply__voltage_v=20.5)))[3]
    assert np.mean(late["engaged_m"]) == pytest.approx(0.5 * 4.5e-3, rel=0.25)


@pytest.mark.parametrize(
    "load",
    [
        LOCKED,
        {**HARD, "run_torque_nm": 60.0},
        {**HARD, "run_torque_nm": 0.3, "slip_slope_nm_per_rad": 700},
    ],
)
def test_lock_step_gives_the_rows_of_the_log(load: dict) -> None:
    rig = rig_with(load)
    rows = run(rig, mode="fast", seconds=0.3)
    plant = core.ImpactPlant(rig.parameters(), load_kind=load["kind"])
    for row in range(1, 301):
        at = plant.advance(1e-3, 1.0)
        for name in (
            "current_a",
            "supply_v",
            "speed_rad_s",
            "anvil_angle_rad",
            "head_rad",
            "hammer_mm",
            "housing_nm",
        ):
            assert getattr(at, name) == pytest.approx(rows[name][0, row], rel=1e-3, abs=1e-3), (
                name,
                row,
            )


def test_a_pwm_period_at_a_time_is_the_same_tool() -> None:
    rig = rig_with({**HARD, "run_torque_nm": 60.0})
    plant = make_plant(rig, 1)
    edges = 0
    for _ in range(round(0.5 / core.PERIOD_S)):
        edges += len(plant.period(False, 1.0, 0.0, 0.0)[2])
    rows = run(rig, seconds=0.5)
    assert plant.head_rad == pytest.approx(rows["head_rad"][0, -1], rel=1e-3)
    assert edges == pytest.approx(4 * plant.angle_rad / (2 * np.pi), abs=1.01)
    blows = plant.blows()
    assert np.allclose(blows["time_s"], rows["blows"][0]["time_s"][: len(blows)], atol=20e-6)


def test_a_scenario_of_an_impact_rig_is_simulated() -> None:
    log = simulate_scenario(read_scenario(ROOT / "scenarios/impact_hard_joint.toml"))
    figures = scenario_figures(log)
    assert figures["blows"] > 40 and 140 < figures["torque_peak_nm"] < 150
    assert {
        "anvil_torque_nm",
        "anvil_angle_rad",
        "hammer_mm",
        "head_rad",
        "housing_nm",
        "arm_rad",
    } <= set(log.columns)
    assert (
        log["head_rad"][-1] == pytest.approx(figures["head_end_rad"])
        and np.ptp(log["housing_nm"]) > 1.0
    )


def test_results_do_not_depend_on_batch_or_threads() -> None:
    theta = np.array(
        [rig_with({**HARD, "run_torque_nm": nm}).parameters() for nm in (20.0, 40.0, 60.0)]
    )
    time_s = np.arange(201) * 1e-3
    log = core.LogInput(time_s, "duty", np.ones(201), load_kind="hard_joint")
    together = core.simulate_impact(log, theta, mode="fast", threads=2)
    for row in range(3):
        alone = core.simulate_impact(log, theta[row : row + 1], mode="fast")
        assert alone["blows"][0].tobytes() == together["blows"][row].tobytes()
        for name in ("current_a", "head_rad", "housing_nm"):
            assert alone[name][0].tobytes() == together[name][row].tobytes(), name


@pytest.mark.parametrize("tools", [1, 41, 43])
def test_columns_of_a_block_in_large_pages_are_those_of_one_tool(tools: int) -> None:
    """Just below and just above 16 MiB for 13 columns of 3,901 rows, from which on a block lies in
    large pages; the columns outlive the result that holds them.
    """
    time_s = np.arange(3901) * 1e-5
    log = core.LogInput(time_s, "duty", np.ones(3901), load_kind="hard_joint")
    theta = np.tile(rig_with({**HARD, "run_torque_nm": 60.0}).parameters(), (tools, 1))
    one = core.simulate_impact(log, theta[:1], mode="fast")
    speed, arm = (
        core.simulate_impact(log, theta, mode="fast", threads=2)[name]
        for name in ("speed_rad_s", "arm_rad")
    )
    assert np.array_equal(speed, np.tile(one["speed_rad_s"], (tools, 1)))
    assert np.array_equal(arm, np.tile(one["arm_rad"], (tools, 1)))


@pytest.mark.parametrize(
    "load", [LOCKED, {**HARD, "run_torque_nm": 60.0}, {**HARD, "run_torque_nm": 6.0}]
)
def test_fixed_steps_give_the_blows_of_the_reference(load: dict) -> None:
    rig = rig_with(load)
    kept, fixed = (run(rig, mode=mode) for mode in ("reference", "fixed"))
    expected_s, found_s = (
        out["blows"][0]["time_s"][out["blows"][0]["kind"] == 0] for out in (kept, fixed)
    )
    assert len(expected_s) == len(found_s)
    np.testing.assert_allclose(found_s, expected_s, rtol=0, atol=2e-4)
    np.testing.assert_allclose(fixed["speed_rad_s"], kept["speed_rad_s"], rtol=0, atol=0.01 * 1677)


def test_a_fixed_step_that_is_too_long_is_refused() -> None:
    rig = rig_with(LOCKED, mechanism__anvil_inertia_kg_m2=5e-7)
    with pytest.raises(RuntimeError, match="too long"):
        run(rig, mode="fixed", step_s=1e-3)


def test_random_tools_end_and_keep_their_energy() -> None:
    """Every key of mechanism and motor up to threefold either way; those that no mechanism can have
    are refused with a message.
    """
    rng = np.random.default_rng(4)
    names = [
        n
        for n, key in enumerate(core.PARAMETERS)
        if key.startswith(("mechanism.", "motor."))
        and key.split(".")[1]
        not in (
            "lug_count",
            "hammer_start_rad",
            "contact_exponent",
            "friction_static",
            "friction_kinetic",
        )
    ]
    time_s, done = np.arange(201) * 1e-3, 0
    for _ in range(40):
        theta = rig_with({**HARD, "run_torque_nm": 40.0}).parameters()
        theta[names] *= 3.0 ** rng.uniform(-1.0, 1.0, len(names))
        log = core.LogInput(
            time_s, "duty", np.full(201, rng.uniform(0.3, 1.0)), load_kind="hard_joint"
        )
        try:
            energy = core.simulate_impact(log, theta[None, :], energy=True)["energy"]
        except ValueError as refused:
            assert re.match(r"(plant parameter out of range: )?mechanism\.", str(refused))
            continue
        spent = sum(energy[name] for name in energy if name.startswith("loss_"))
        rest = energy["work_in"] - spent - (energy["stored"] - energy["stored"][0])
        assert np.max(np.abs(rest)) < 1e-6 * energy["work_in"].max()
        done += 1
    assert done > 20


def test_impossible_steps_times_and_intervals_are_refused() -> None:
    rig = rig_with(LOCKED)
    for step_s in (0.0, -1e-5, float("nan")):
        with pytest.raises(ValueError, match="step_s"):
            run(rig, mode="fixed", seconds=0.01, step_s=step_s)
        with pytest.raises(ValueError, match="step_s"):
            core.ImpactPlant(rig.parameters(), load_kind="locked", mode="fixed", step_s=step_s)
    for times in ([0.002, 0.001], [0.001, float("nan")]):
        with pytest.raises(ValueError, match="trace_s"):
            run(rig, seconds=0.01, trace_s=np.array(times))
    plant = core.ImpactPlant(rig.parameters(), load_kind="locked")
    for seconds, duty in ((0.0, 1.0), (-1e-3, 1.0), (1e-3, float("nan")), (float("inf"), 1.0)):
        with pytest.raises(ValueError, match="advance"):
            plant.advance(seconds, duty)
