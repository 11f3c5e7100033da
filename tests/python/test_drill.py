"""The drill driver has the figures of docs/spec/model.md, section 7, and agrees with an independent
integration within 1e-6 of a signal's largest value.
"""

import numpy as np
import pytest

from drill_reference import Drill, run
from vgroove import _core

RPM = 30.0 / np.pi
LOW, HIGH = {}, {"gearbox.ratio": 8.75, "load.torque_nm": 2.0}
# Parameter steps of section 7: shaft damping in N m s/rad, w_brk in rad/s
STEPS = {1: (0.02, 0.1), 2: (0.2, 0.1), 3: (2.0, 5.0)}


def parameters(
    gear: dict[str, float], pulse: bool, step: int = 1, **more: float
) -> dict[str, float]:
    damping, w_brk = STEPS[step]
    return (
        gear
        | {
            "mechanism.pulse": float(pulse),
            "mechanism.shaft_damping_nm_s_per_rad": damping,
            "load.breakaway_rad_s": w_brk,
        }
        | more
    )


def within(rows: dict, start: float, end: float) -> np.ndarray:
    return (rows["time_s"] >= start) & (rows["time_s"] <= end)


@pytest.mark.parametrize(
    ("gear", "free", "low", "high", "mean", "peak"),
    [(LOW, 491, 296, 394, 19, 37), (HIGH, 1768, 980, 1342, 22, 42)],
)
def test_figures_of_section_7(
    gear: dict, free: float, low: float, high: float, mean: float, peak: float
) -> None:
    rows = _core.simulate_drill(parameters(gear, True), row_s=1e-4)
    speed = rows["speed_rad_s"] / gear.get("gearbox.ratio", 31.5) * RPM
    run_up, idle, load = within(rows, 0.05, 0.29), within(rows, 1.0, 2.0), within(rows, 2.2, 3.0)
    assert speed[idle].mean() == pytest.approx(free, abs=1)
    assert rows["current_a"][idle].mean() == pytest.approx(1.8, abs=0.05)
    assert rows["current_a"][run_up].max() == pytest.approx(10.0 if gear is LOW else 11.0, abs=0.5)
    assert (speed[load].min(), speed[load].max()) == (
        pytest.approx(low, abs=1),
        pytest.approx(high, abs=1),
    )
    assert rows["current_a"][load].mean() == pytest.approx(mean, abs=0.6)
    assert rows["current_a"][load].max() == pytest.approx(peak, abs=0.5)


@pytest.mark.parametrize("gear", [LOW, HIGH], ids=["low", "high"])
def test_pulse_mode_begins_at_15_a_and_ends_within_0_2_s_after_the_load(gear: dict) -> None:
    rows = _core.simulate_drill(parameters(gear, True))
    at = dict(zip(rows["marks"]["mark"], rows["marks"]["time_s"], strict=True))
    begins = rows["time_s"] == at["pulse mode begins"]
    assert rows["current_a"][begins] == pytest.approx([15.0], abs=1e-6)
    assert np.max(rows["current_a"][rows["time_s"] < at["pulse mode begins"]]) < 15.0
    assert 3.0 < at["normal again"] < 3.2
    assert at["pulse mode begins"] > 2.0
    assert np.all(rows["control"][within(rows, at["normal again"] + 1e-4, 4.0)] == 0.0)
    drives = [
        t
        for t, mark in zip(rows["marks"]["time_s"], rows["marks"]["mark"], strict=True)
        if mark == "drive begins"
    ]
    np.testing.assert_allclose(np.diff(drives), 0.1, atol=1e-9)


@pytest.mark.parametrize(
    "gear", [LOW, pytest.param(HIGH, marks=pytest.mark.proof)], ids=["low", "high"]
)
@pytest.mark.parametrize(("pulse", "step"), [(False, 1), (True, 1), (True, 3)])
def test_agrees_with_scipy(gear: dict, pulse: bool, step: int) -> None:
    agree(gear, pulse, step, 30.0)


@pytest.mark.parametrize("step", [1, 3])
def test_agrees_with_scipy_where_the_clutch_slips(step: int) -> None:
    agree(LOW, False, step, 4.0)


def agree(gear: dict, pulse: bool, step: int, clutch: float) -> None:
    """Motor speed, chuck speed and current agree within 1e-6 of their largest values."""
    rows = _core.simulate_drill(
        parameters(gear, pulse, step, **{"mechanism.clutch_nm": clutch}), row_s=1e-3, tolerance=1e-9
    )
    damping, w_brk = STEPS[step]
    low = gear is LOW
    drill = Drill(
        n=31.5 if low else 8.75,
        load=6.0 if low else 2.0,
        pulse=pulse,
        damping=damping,
        w_brk=w_brk,
        clutch=clutch,
    )
    other = run(drill, rows["time_s"])
    for name, values in other.items():
        assert not np.isnan(values).any()
        assert np.abs(rows[name] - values).max() <= 1e-6 * np.abs(values).max(), name


def test_later_parameter_steps_need_fewer_solver_steps() -> None:
    """Section 7: parameter steps 2 and 3 raise the shaft's damping, step 3 widens the friction
    law's transition; a variable-step solver then needs fewer steps.
    """
    steps = [
        _core.simulate_drill(parameters(LOW, True, step), tolerance=1e-6)["steps"]["length_s"]
        for step in STEPS
    ]
    assert len(steps[0]) > 1.2 * len(steps[1]) > 1.44 * len(steps[2])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"motor.resistance": 1.0}, "unknown parameter motor.resistance"),
        ({"mechanism.clutch_nm": 0.0}, "clutch_nm must be"),
        ({"drive.duty": 1.1}, "drive.duty"),
        ({"load.breakaway_ratio": 0.9}, "breakaway_ratio"),
    ],
)
def test_bad_parameters_are_named(wrong: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        _core.simulate_drill(wrong)


@pytest.mark.parametrize(
    "request_", [{"solver": "ode45"}, {"solver": "rk4"}, {"duration_s": 0.0}, {"tolerance": 1.0}]
)
def test_bad_requests_are_refused(request_: dict) -> None:
    with pytest.raises(ValueError):
        _core.simulate_drill({}, **request_)
