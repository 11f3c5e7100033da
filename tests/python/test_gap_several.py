"""Several logs of one tool diagnosed together; the run that is proposed where one log leaves a tie;
the covariates of a gap and of its remainder.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from made_log import MadeLog, drive_log, rig
from vgroove import _core
from vgroove.gap import diagnose
from vgroove.gap.next_run.experiment_design import propose
from vgroove.gap.next_run.menu import MENU, feasible_profiles, profile_named, time_grid
from vgroove.gap.simulate import compute_gap
from vgroove.gap.verdict import correlates
from vgroove.units import TURN_RAD


def every_second(made: MadeLog) -> MadeLog:
    """The same run logged at half the rate; means are means of two rows."""
    columns = {name: values[::2].copy() for name, values in made.columns.items()}
    for name in ("current_a", "supply_v"):
        values = made.columns[name]
        columns[name][1:] = 0.5 * (values[1:-1:2] + values[2::2])
    return MadeLog(made.time_s[::2], columns, "half rate")


def test_logs_of_different_length_rate_and_columns_are_diagnosed_together() -> None:
    tool = rig(effects={"coulomb_friction": {"torque_nm": 0.003}})
    long, short = (
        drive_log(tool),
        every_second(
            drive_log(tool, seed=2, seconds=3.0, levels=[(0.2, 0.9), (1.0, 0.3), (2.0, 0.6)])
        ),
    )
    angle = _core.simulate_log(
        _core.LogInput(short.time_s, "duty", short.columns["duty"], slew_per_s=6.0),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )["angle_rad"][0]
    short = replace(
        short, columns=short.columns | {"position_rad": np.round(angle / 0.001) * 0.001}
    )
    found = diagnose([long, short], rig())
    verdict = found.as_dict()
    assert (verdict["verdict"], verdict["selected"]) == ("effect", ["coulomb_friction"])
    torque = verdict["effects"][0]["parameters"]["torque_nm"]
    assert (
        torque["value"] == pytest.approx(0.003, rel=0.03)
        and torque["ci95"][0] < 0.003 < torque["ci95"][1]
    )
    assert [held[-1][1] for held in verdict["gap"]["held_out_s"]] == pytest.approx([6.0, 3.0])
    assert set(verdict["gap"]["by_signal"]) == {
        "current_a",
        "supply_v",
        "speed_rpm",
        "position_rad",
    }
    again = compute_gap(found.corrected_rig(), [long, short])[0]
    assert again["gap"] == pytest.approx(verdict["gap"]["after"], rel=0.01)
    top = verdict["where"]["by_correlate"][0]
    assert top["share"] > 0.2 and top["signal"] in ("speed_rpm", "current_a", "position_rad")


def test_only_runs_that_the_tool_can_perform_are_proposed() -> None:
    names = {c.name for c in feasible_profiles(has_duty=False, has_load=False, both_ways=False)}
    assert names == {"staircase", "stall pulse", "slow sweep", "hold at heat", "fast ramps"}
    assert {c.name for c in feasible_profiles(has_duty=True, has_load=True, both_ways=True)} == {
        c.name for c in MENU
    }
    for profile in MENU:
        share = profile.command(time_grid(1e-3))
        assert share.shape == (4000,) and np.abs(share).max() <= 1.0 and share[0] == 0.0


@pytest.mark.parametrize(
    ("correlate", "torque", "name"),
    [
        ("current", 0.5, "load steps"),
        ("current", 0.0, "staircase"),
        ("sign of speed", 0.5, "staircase"),
        (None, 0.5, "staircase"),
    ],
)
def test_for_an_unlisted_gap_the_run_of_its_correlate_is_proposed(
    correlate: str | None, torque: float, name: str
) -> None:
    log = MadeLog(
        np.arange(3.0), {"duty": np.array([0.0, 0.5, 1.0]), "load_nm": np.full(3, torque)}
    )
    problem = SimpleNamespace(rig=rig(load={"kind": "torque"}), logs=[log])
    finding = SimpleNamespace(
        verdict="unlisted", remainder=SimpleNamespace(best_correlate=correlate)
    )
    proposed = propose(problem, None, finding)
    assert proposed.profile == name and proposed.points == profile_named(name).points()


def test_a_smooth_curve_gains_what_depends_on_the_covariate() -> None:
    rng = np.random.default_rng(1)
    speed, cluster = rng.uniform(-100.0, 100.0, 4000), np.arange(4000) // 50
    noise = rng.standard_normal(4000)
    bent = noise + 2.0 * np.abs(speed) / 100.0
    covariate = correlates.Covariate("speed", speed)
    assert correlates.cross_validated_gain(bent, covariate, cluster) == pytest.approx(
        1.0 - 1.0 / np.mean(bent**2), abs=0.03
    )
    assert correlates.cross_validated_gain(noise, covariate, cluster) < 0.01
    x, y = correlates.smooth_curve(bent, covariate)
    assert np.interp([-80.0, 0.0, 80.0], x, y) == pytest.approx([1.6, 0.05, 1.6], abs=0.3)
    assert correlates.describe_curve(x, y, covariate) == "grows with speed"


def test_a_covariate_that_is_mostly_constant_has_a_smooth_curve() -> None:
    rng = np.random.default_rng(4)
    crowded = 3e-7 * np.concatenate([1e-5 * rng.standard_normal(1200), rng.uniform(-1.0, 1.0, 400)])
    x, y = correlates.smooth_curve(
        2e7 * crowded + 0.1 * rng.standard_normal(1600), correlates.Covariate("speed", crowded)
    )
    assert np.all(np.diff(x) > 1e-4 * np.ptp(x))
    assert np.interp([-2e-7, 0.0, 2e-7], x, y) == pytest.approx([-4.0, 0.0, 4.0], abs=0.2)


@pytest.mark.parametrize("turned_rad", [0.03, 0.3, 3.0, 6.28318])
def test_a_part_of_a_turn_has_a_smooth_curve(turned_rad: float) -> None:
    """The spline is fitted to the points of one turn and to copies of them one turn before and one
    turn after. Points that almost coincide, where copies adjoin or in a log of a small angle, would
    make the fit singular.
    """
    angle = turned_rad * np.random.default_rng(5).beta(0.5, 0.5, 3000)
    covariate = correlates.Covariate("angle", angle, TURN_RAD)
    x, y = correlates.smooth_curve(np.sin(angle), covariate)
    inside = np.quantile(angle, [0.2, 0.5, 0.8])
    assert np.interp(inside, x, y) == pytest.approx(np.sin(inside), abs=0.05)


def test_a_spectral_line_is_found_and_noise_has_none() -> None:
    rng = np.random.default_rng(2)
    time_s, noise = np.sort(rng.uniform(0.0, 6.0, 5000)), rng.standard_normal(5000)
    assert correlates.spectral_line(noise, time_s) is None
    assert correlates.spectral_line(
        noise + 0.7 * np.sin(2.0 * np.pi * 50.0 * time_s), time_s
    ) == pytest.approx(50.0, abs=0.1)
    angle = 300.0 * time_s
    found = correlates.spectral_covariates(
        noise + 0.7 * np.sin(0.37 * angle), time_s, angle, 1.0, np.zeros(5000, int)
    )
    assert [d.name for d in found if "0.37" in d.name] == ["output angle, 0.37 periods a turn"]
