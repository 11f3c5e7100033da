"""Uncertainty of the model's input: a timer's compare value ran as it is logged, a number that the
logger rounded did not.
"""

from dataclasses import replace

import numpy as np
import pytest

from made_log import rig
from vgroove import _core
from vgroove.gap.residual.input_uncertainty import (
    MeasuredInput,
    full_volt,
    input_sigma,
    on_smooth_ramps,
    one_row_share,
    ramp_sigma,
    winding_response,
)
from vgroove.rig import Rig

STEP = 1.0 / 255.0
FULL = STEP / np.sqrt(12.0)
TIME_S = np.arange(1, 3001) / 500.0
WAVE = 0.55 + 0.25 * np.sin(2.0 * np.pi * 0.9 * TIME_S) * np.sin(2.0 * np.pi * 0.13 * TIME_S)
ROUNDED = np.round(WAVE / STEP) * STEP


def tool() -> Rig:
    return rig(input={"kind": "duty", "slew_per_s": 10.0})


def current_of(command: np.ndarray, delay_rows: int = 0) -> np.ndarray:
    """Current of the nominal tool that the command drives, as its sensor shows it, late by so many
    rows.
    """
    one = tool()
    drive = _core.LogInput(TIME_S - TIME_S[0], "duty", command, slew_per_s=10.0)
    run = _core.simulate_log(
        drive, one.parameters()[None], np.zeros(1, dtype=int), np.zeros((1, 3))
    )
    noise = one.sensors["current_noise_a"] * np.random.default_rng(5).standard_normal(len(TIME_S))
    return np.roll(run["current_a"][0], delay_rows) + noise


def given(current_a: np.ndarray | None) -> MeasuredInput:
    """The rounded command with a measured current."""
    volts = full_volt(tool(), {})
    return MeasuredInput(TIME_S, ROUNDED, current_a=current_a, full_volt=volts)


@pytest.mark.parametrize("delay_rows", [0, 3])
def test_a_command_that_ran_as_logged_has_little_uncertainty(delay_rows: int) -> None:
    assert ramp_sigma(tool(), given(current_of(ROUNDED, delay_rows))) < 0.5 * FULL


def test_a_rounded_column_has_the_uncertainty_of_its_rounding() -> None:
    assert ramp_sigma(tool(), given(current_of(WAVE))) > 0.75 * FULL


def test_without_a_current_or_its_noise_the_uncertainty_is_that_of_rounding() -> None:
    assert ramp_sigma(tool(), given(None)) == pytest.approx(FULL, rel=1e-3)
    silent = rig(input={"kind": "duty", "slew_per_s": 10.0})
    del silent.sensors["current_noise_a"]
    assert ramp_sigma(silent, given(current_of(ROUNDED))) == pytest.approx(FULL, rel=1e-3)


def test_steps_are_no_ramps() -> None:
    stairs = np.interp(
        TIME_S, [0.0, 1.0, 1.004, 2.0, 2.02, 6.0], [0.2, 0.2, 0.204, 0.204, 0.8, 0.8]
    )
    assert not on_smooth_ramps(np.round(stairs / 0.004) * 0.004)[TIME_S > 1.5].any()
    assert on_smooth_ramps(ROUNDED).mean() > 0.8


def test_a_winding_follows_a_constant_and_half_of_one_rows_error() -> None:
    assert np.allclose(winding_response(tool(), 1e-3, np.full(20, 0.7)), 0.7)
    assert one_row_share(tool(), 10.0) == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert one_row_share(tool(), 1e-5) < 0.2


def test_uncertainty_grows_only_where_the_command_changes() -> None:
    stairs = np.where(TIME_S < 3.0, 0.2, WAVE)
    speed, current, _ = input_sigma(
        tool(), MeasuredInput(TIME_S, stairs, full_volt=full_volt(tool(), {}))
    )
    still, moving = TIME_S < 2.9, TIME_S > 3.1
    assert (
        current[moving].min() > 10.0 * max(current[still].max(), 1e-9)
        and speed[moving].min() > speed[still].max()
    )


def test_the_angles_uncertainty_is_that_of_speeds_that_err_together() -> None:
    """A motor driven by many noisy currents, restarted every 0.2 s: the scatter of its angle."""
    rig = tool()
    rig = replace(rig, input={"kind": "current_a"}, sensors=rig.sensors | {"current_noise_a": 0.5})
    step_s, rows, restart_s = 1e-3, 3000, 0.2
    time_s = step_s * np.arange(1, rows + 1)
    given = MeasuredInput(time_s, np.zeros(rows), bridge_closed=np.zeros(rows, bool))
    _, _, angle = input_sigma(rig, given, restart_s)
    rng = np.random.default_rng(5)
    torque = rig.motor["torque_constant_nm_per_a"] * 0.5 * rng.standard_normal((400, rows))
    keep = np.exp(-step_s / restart_s)
    speed = turned = np.zeros(400)
    for k in range(rows):
        turned = keep * (turned + step_s * speed)
        speed = keep * speed + step_s * torque[:, k] / rig.shaft_inertia_kg_m2
    assert angle[-1] == pytest.approx(turned.std(), rel=0.12)
