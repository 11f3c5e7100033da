"""Restarts of the model: a restart from its own states changes neither its motion nor that of the
output side, which no sensor measures.
"""

import numpy as np
import pytest

from made_log import MadeLog, drive_log, rig
from vgroove import _core
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.loading import load_problem, with_clip

BASE = {
    "supply.voltage_v": 18.0,
    "motor.resistance_ohm": 0.19,
    "motor.inductance_h": 1e-4,
    "motor.torque_constant_nm_per_a": 0.0109,
    "motor.inertia_kg_m2": 1.6e-5,
    "motor.viscous_nm_s_per_rad": 4.5e-6,
    "motor.coulomb_nm": 0.012,
    "gearbox.ratio": 5.6,
    "gearbox.output_inertia_kg_m2": 2.4e-4,
}
COUPLER = {
    "coupler_compliance.stiffness_nm_per_rad": 0.02,
    "coupler_compliance.damping_ratio": 0.1,
    "coupler_compliance.inertia_kg_m2": 1e-7,
}


def theta_of(effects: dict[str, float]) -> np.ndarray:
    """Parameter vector (1, P) of the base drive with effects."""
    theta = np.array(_core.parameter_defaults(), dtype=float)
    for name, value in {**BASE, **{f"effects.{k}": v for k, v in effects.items()}}.items():
        theta[list(_core.PARAMETERS).index(name)] = value
    return theta[None, :]


@pytest.mark.parametrize(
    "effects",
    [
        {},
        COUPLER,
        {"gear_backlash.play_rad": 0.1},
        {"winding_heating.kelvin_per_joule": 0.2, "winding_heating.cooling_s": 2.0},
    ],
)
def test_a_restart_from_the_models_own_states_changes_nothing(effects: dict[str, float]) -> None:
    t = np.arange(1, 1201) * 1e-3
    duty = np.where(t % 0.2 < 0.1, 0.7, 0.45)
    theta, rest = theta_of(effects), np.zeros((1, 3))
    drive = _core.LogInput(t, "duty", duty)
    whole = _core.simulate_log(drive, theta, np.array([0]), rest, threads=1)
    rows = np.array([0, 330, 655, 901])
    at_row = np.stack(
        [
            [0.0, 0.0, 0.0],
            *(
                [
                    instant_current(theta, t, duty, r),
                    whole["speed_rad_s"][0, r],
                    whole["angle_rad"][0, r],
                ]
                for r in rows[1:]
            ),
        ]
    )
    again = _core.simulate_log(drive, theta, rows, at_row, threads=1)
    between = np.setdiff1d(np.arange(len(t)), rows)
    assert (
        np.abs(again["speed_rad_s"] - whole["speed_rad_s"]).max()
        < 2e-3 * np.abs(whole["speed_rad_s"]).max()
    )
    assert (
        np.abs(again["current_a"] - whole["current_a"])[:, between].max()
        < 0.02 * np.abs(whole["current_a"]).max()
    )


def instant_current(theta: np.ndarray, t: np.ndarray, duty: np.ndarray, row: int) -> float:
    """Current at the end of a row: the mean over a row of 1 us that is inserted there."""
    times = np.insert(t, row, t[row] - 1e-6)
    drive = _core.LogInput(times, "duty", np.insert(duty, row, duty[row]))
    return float(
        _core.simulate_log(drive, theta, np.array([0]), np.zeros((1, 3)), threads=1)["current_a"][
            0, row + 1
        ]
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_angles_at_restarts_count_from_the_rest_before_the_first_edge(seed: int) -> None:
    tool = rig(sensors={"hall_pulses_per_rev": 2})
    made = drive_log(tool, seed=seed, seconds=3.0)
    run = load_problem([made], tool).runs[0]
    drive = _core.LogInput(made.time_s, "duty", made.columns["duty"], slew_per_s=6.0)
    angle = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), np.zeros((1, 3)))[
        "angle_rad"
    ][0]
    assert len(run.restarts.rows) > 6
    assert np.abs(run.restarts.measured[:, 2] - angle[run.restarts.rows]).max() < 0.1


def test_a_nominal_model_far_from_the_count_shifts_no_angle() -> None:
    made, heavy = drive_log(rig(), seconds=3.0), rig(motor={"inertia_kg_m2": 1.6e-3})
    rows = load_problem([made], heavy).runs[0].restarts
    plain = load_problem([made], rig()).runs[0].restarts
    assert np.array_equal(rows.rows, plain.rows)
    apart = rows.measured[1:, 2] - plain.measured[1:, 2]
    assert np.ptp(apart) < 1e-6 and abs(apart[0]) < np.pi


def test_a_restart_in_a_clipped_current_starts_from_the_true_current() -> None:
    tool, limit = rig(), 3.0
    triangle = [(0.05 + 0.5 * k, 1.0 - k % 2) for k in range(8)]
    made = drive_log(tool, seconds=4.0, levels=triangle, noise=False, slew_per_s=2.0)
    clipped = MadeLog(
        made.time_s, made.columns | {"current_a": np.clip(made.columns["current_a"], -limit, limit)}
    )
    problem = load_problem([clipped], tool)
    theta = problem.theta0.copy()
    theta[problem.index("effects.current_saturation.limit_a")] = limit
    held = np.abs(problem.runs[0].restarts.measured[:, 0]) > 0.99 * limit
    speeds = problem.signal == [s.column for s in problem.signals].index("speed_rpm")
    assert np.count_nonzero(held) > 4
    near = with_clip(problem, {s.column: MIN_CLIP_SIGMAS for s in problem.signals})
    assert near.gap(problem.residuals(theta)[0], speeds) < 1.0
