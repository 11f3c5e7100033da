"""An angle as the only sensor whose noise hides speeds and accelerations from row to row: what is
compared, how precisely, and what is found with it.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made_log import MadeLog, held_run
from vgroove.gap import diagnose
from vgroove.gap.residual.coarse_angle import AngleSamples, angle_samples
from vgroove.gap.residual.loading import load_problem, with_clip
from vgroove.gap.residual.problem import Problem
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.gap.residual.shared_errors import SharedErrors
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

VOLT, NM_PER_A, OHM, TIME_CONSTANT_S = 12.0, 0.6, 5.0, 0.03
ROW_S, FINE = 0.003, 8
STEP_RAD = 1.3 * VOLT / NM_PER_A * ROW_S  # of the sensor: at top speed it turns 0.8 steps a row
LEVELS = ((0.1, 12.0), (0.42, -8.0), (0.71, 5.0), (0.98, 12.0), (1.31, -12.0))
END_S = 1.6
TOLERANCE = {
    "motor.resistance_ohm": 0.2,
    "motor.inertia_kg_m2": 0.3,
    "motor.torque_constant_nm_per_a": 0.1,
}


def servo(effects: dict[str, dict[str, float]] | None = None, **motor: float) -> Rig:
    """Rig of a geared motor whose only sensor is an angle with the resolution STEP_RAD. effects:
    parameters of the effects that are switched on, by id; motor: values that replace nominal ones.
    """
    values = {
        "resistance_ohm": OHM,
        "inductance_h": 2e-4 * OHM,
        "torque_constant_nm_per_a": NM_PER_A,
        "inertia_kg_m2": TIME_CONSTANT_S * NM_PER_A**2 / OHM,
        "viscous_nm_s_per_rad": 0.0,
        "coulomb_nm": 0.0,
    }
    return rig_from_dict(
        {
            "schema": "vgroove.rig/1",
            "input": {"kind": "voltage_v", "hold": "after"},
            "motor": values | motor,
            "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
            "mechanism": {"kind": "none"},
            "load": {"kind": "none"},
            "sensors": {"log_hz": 1.0 / ROW_S, "position_lsb_rad": STEP_RAD},
            "tolerance": TOLERANCE,
            "effects": effects or {},
        },
        "a servo",
    )


def servo_log(tool: Rig, first_rad: float = 0.3 * STEP_RAD) -> MadeLog:
    """Log of a tool with rounded-down angles; first_rad: its angle at the start."""
    time_s = ROW_S * np.arange(round(END_S / ROW_S) + 1)
    switched, levels = np.array(LEVELS).T
    command = np.append(0.0, levels)[np.searchsorted(switched, time_s, side="right")]
    angle = held_run(tool, command, ROW_S, FINE)["angle_rad"][::FINE]
    reading = np.floor((angle + first_rad) / STEP_RAD) * STEP_RAD
    return MadeLog(time_s, {"voltage_v": command, "position_rad": reading})


def gap_of(tool: Rig, log: MadeLog) -> float:
    problem = load_problem([log], tool)
    return problem.gap(problem.residuals(problem.theta0)[0])


@pytest.mark.parametrize("first_rad", STEP_RAD * np.array([0.0, 0.25, 0.5, 0.99]))
def test_a_tool_that_equals_its_rig_leaves_the_noise_of_rounding(first_rad: float) -> None:
    assert 0.6 < gap_of(servo(), servo_log(servo(), first_rad)) < 1.1


@pytest.mark.parametrize(
    ("tool", "least"),
    [
        (servo(inertia_kg_m2=1.1 * TIME_CONSTANT_S * NM_PER_A**2 / OHM), 1.5),
        (servo(torque_constant_nm_per_a=1.05 * NM_PER_A), 2.0),
        (servo({"transport_delay": {"delay_s": ROW_S}}), 1.5),
    ],
)
def test_a_small_difference_is_a_gap(tool: Rig, least: float) -> None:
    """Mean speeds over spans of 50 ms, as of a finer encoder, would leave 0.7 to 1.1."""
    assert gap_of(servo(), servo_log(tool)) > least


def test_the_angle_counts_from_each_restart() -> None:
    problem = load_problem([servo_log(servo())], servo())
    assert [s.unit for s in problem.signals] == ["rad"] and len(problem.angles.by_log[0]) > 3
    known, theta = problem.angles.by_log[0], problem.theta0
    moved = RestartAngles((known + np.arange(len(known)),))
    assert problem.residuals(theta, moved) == pytest.approx(problem.residuals(theta), abs=1e-6)


@pytest.mark.parametrize("changes_per_s", [12.0, 25.0, 60.0])
def test_a_slow_motion_has_restarts_too(changes_per_s: float) -> None:
    volt = changes_per_s * STEP_RAD * NM_PER_A
    time_s = ROW_S * np.arange(2000)
    angle = volt / NM_PER_A * (time_s - TIME_CONSTANT_S * (1.0 - np.exp(-time_s / TIME_CONSTANT_S)))
    command = np.full(len(time_s), volt)
    reading = np.floor(angle / STEP_RAD) * STEP_RAD
    problem = load_problem(
        [MadeLog(time_s, {"voltage_v": command, "position_rad": reading})], servo()
    )
    assert problem.signals[0].unit == "rad" and len(problem.angles.by_log[0]) > 12


def test_nothing_is_compared_across_missing_readings() -> None:
    log = servo_log(servo())
    angle = log.columns["position_rad"].copy()
    angle[(log.time_s > 0.5) & (log.time_s < 1.05)] = np.nan
    columns = log.columns | {"position_rad": angle}
    problem = load_problem([MadeLog(log.time_s, columns)], servo())
    assert not np.any((problem.time_s > 0.5) & (problem.time_s < 1.05))
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.1


def speed_error_left(problem: Problem, sigmas: float) -> float:
    """Sum of squared residuals after the measured speed at each restart is raised by `sigmas` times
    its standard deviation.
    """
    (run,) = problem.runs
    measured = run.restarts.measured.copy()
    measured[:, 1] += sigmas * run.restarts.speed_sigma
    moved = replace(run, restarts=replace(run.restarts, measured=measured))
    return float(np.sum(replace(problem, runs=(moved,)).residuals(problem.theta0) ** 2))


def test_an_error_of_the_speed_at_a_restart_is_no_gap() -> None:
    problem = load_problem([servo_log(servo())], servo())
    exact, likely, unlikely = (speed_error_left(problem, k) for k in (0.0, 1.0, 30.0))
    restarts = len(problem.runs[0].restarts.rows)
    assert likely - exact < 3.0 * restarts and unlikely > 10.0 * likely


@pytest.mark.parametrize(
    ("effects", "named"),
    [
        ({}, []),
        ({"transport_delay": {"delay_s": 0.007}}, ["transport_delay"]),
        ({"coulomb_friction": {"torque_nm": 0.12}}, ["coulomb_friction"]),
        ({"quadratic_drag": {"nm_s2_per_rad2": 4e-4}}, ["quadratic_drag"]),
    ],
    ids=lambda value: next(iter(value), "none") if isinstance(value, dict) else "",
)
def test_effects_are_named_from_such_an_angle_alone(
    effects: dict[str, dict[str, float]], named: list[str]
) -> None:
    """The tool differs from its rig within the tolerances besides."""
    tool = servo(effects, resistance_ohm=1.1 * OHM, torque_constant_nm_per_a=0.95 * NM_PER_A)
    verdict = diagnose([servo_log(tool)], servo())
    assert verdict.verdict == ("effect" if named else "none") and verdict.selected == named


def test_an_error_of_the_restart_speed_is_no_gap_in_the_current_beside_the_angle() -> None:
    log = servo_log(servo())
    current = held_run(servo(), log.columns["voltage_v"], ROW_S, FINE)["current_a"]
    means = np.append(current[:1], current[1:].reshape(-1, FINE).mean(axis=1))
    noisy = means + 0.02 * np.random.default_rng(3).standard_normal(len(means))
    rig = replace(servo(), sensors=servo().sensors | {"current_noise_a": 0.02})
    problem = load_problem([MadeLog(log.time_s, log.columns | {"current_a": noisy})], rig)
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.3


@pytest.mark.parametrize(
    "effects",
    [
        {"winding_resistance": {"relative": 1.0}},
        {"viscous_friction": {"nm_s_per_rad": 0.05}},
        {"torque_constant": {"relative": 0.2}},
        {"transport_delay": {"delay_s": 0.003}},
    ],
)
@pytest.mark.parametrize("heavier", [1.0, 1.3])
def test_a_rig_that_states_an_effect_has_the_gap_of_the_fit_to_it(
    heavier: float, effects: dict[str, dict[str, float]]
) -> None:
    """`vgroove sim` with the corrected rig prints what `gap diagnose` printed, also where the tool
    differs in its inertia besides.
    """
    inertia = heavier * TIME_CONSTANT_S * NM_PER_A**2 / OHM
    log = servo_log(servo(effects, inertia_kg_m2=inertia))
    fitted, stated = load_problem([log], servo()), load_problem([log], servo(effects))
    theta = fitted.theta0.copy()
    for effect, values in effects.items():
        for name, value in values.items():
            theta[fitted.index(f"effects.{effect}.{name}")] = value
    clip = {s.column: c for s, c in zip(fitted.signals, fitted.clip, strict=True)}
    stated = with_clip(stated, clip)
    gap = fitted.gap(fitted.residuals(theta)[0])
    assert stated.gap(stated.residuals(stated.theta0)[0]) == pytest.approx(gap, rel=1e-6)


def test_one_fast_log_of_several_decides_for_none() -> None:
    """All logs of a tool are compared in one way: the same signal has one unit."""
    slow, fast = servo_log(servo()), servo_log(servo())
    finer = 0.02 * STEP_RAD
    turn = np.cumsum(np.full(len(fast.time_s), 0.9 * STEP_RAD))
    columns = fast.columns | {"position_rad": np.round(turn / finer) * finer}
    problem = load_problem([slow, MadeLog(fast.time_s, columns)], servo())
    assert len({c.unit for run in problem.runs for c in run.channels}) == 1


AMPERE, TURN_S, ENCODER_RAD = 2.0, 0.45, 0.02


def axis(noise_a: float = 0.0, **motor: float) -> Rig:
    """Rig of a motor that is driven by a current and accelerates by 60 rad/s^2 at AMPERE. noise_a:
    stated noise of the current, A; motor: values that replace nominal ones.
    """
    given_motor = servo().motor | {"inertia_kg_m2": NM_PER_A * AMPERE / 60.0} | motor
    rig = replace(servo(), input={"kind": "current_a", "hold": "after"}, motor=given_motor)
    sensors = {"log_hz": 1.0 / ROW_S, "position_lsb_rad": ENCODER_RAD}
    return replace(rig, sensors=sensors | ({"current_noise_a": noise_a} if noise_a else {}))


def axis_log(tool: Rig) -> MadeLog:
    """Log of an axis that is driven to and fro."""
    time_s = ROW_S * np.arange(round(4.0 / ROW_S) + 1)
    command = AMPERE * np.sign(np.sin(2.0 * np.pi * time_s / TURN_S + 0.4))
    angle = held_run(tool, command, ROW_S, FINE)["angle_rad"][::FINE]
    reading = np.floor(angle / ENCODER_RAD) * ENCODER_RAD
    return MadeLog(time_s, {"current_a": command, "position_rad": reading})


@pytest.mark.parametrize(("noise_a", "unit"), [(0.0, "rad"), (0.01, "rad"), (2.0, "rad/s^2")])
def test_the_angle_of_a_current_driven_axis_is_compared_itself_where_it_errs_most(
    noise_a: float, unit: str
) -> None:
    problem = load_problem([axis_log(axis())], axis(noise_a))
    assert [s.unit for s in problem.signals] == [unit]
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.1


def test_a_noise_that_changes_the_readings_is_no_rounding() -> None:
    log = axis_log(axis())
    rng = np.random.default_rng(1)
    noisy = log.columns["position_rad"] + ENCODER_RAD * rng.standard_normal(len(log.time_s))
    reading = np.round(noisy / ENCODER_RAD) * ENCODER_RAD
    problem = load_problem([replace(log, columns=log.columns | {"position_rad": reading})], axis())
    assert problem.signals[0].unit == "rad/s^2"


def test_a_noise_of_the_current_that_the_rig_does_not_state_is_seen_in_its_column() -> None:
    log = axis_log(axis())
    noise = 0.5 * np.random.default_rng(2).standard_normal(len(log.time_s))
    columns = log.columns | {"current_a": log.columns["current_a"] + noise}
    assert load_problem([replace(log, columns=columns)], axis()).signals[0].unit == "rad/s^2"


def test_beside_a_speed_the_angle_of_a_current_driven_axis_is_its_acceleration() -> None:
    log = axis_log(axis())
    speed = np.gradient(log.columns["position_rad"], log.time_s) * RPM_PER_RAD_S
    problem = load_problem([replace(log, columns=log.columns | {"speed_rpm": speed})], axis())
    assert [s.unit for s in problem.signals] == ["rpm", "rad/s^2"]


def test_a_friction_of_a_current_driven_axis_is_named_from_its_angle_alone() -> None:
    """Its second differences show less than the noise of rounding."""
    tool = axis(viscous_nm_s_per_rad=0.008)
    verdict = diagnose([axis_log(tool)], axis())
    assert (verdict.verdict, verdict.selected) == ("effect", ["viscous_friction"])


@dataclass(frozen=True)
class Seen:
    """Errors of the samples of a drawn motion (k,), rad, and the samples."""

    error_rad: np.ndarray
    samples: AngleSamples


def seen_of_a_motion(seed: int, step: float, steps_a_row: float, rows: int, slowest: float) -> Seen:
    """A motion with a speed between slowest and 1 times steps_a_row, linear between six drawn
    values, read every 4 ms by a sensor with the resolution step, rad.
    """
    rng = np.random.default_rng(seed)
    time_s = 0.004 * np.arange(rows)
    knots = rng.uniform(slowest, 1.0, 6) * steps_a_row * step / 0.004
    fine_s = np.linspace(0.0, time_s[-1], 40 * rows)
    speed = np.interp(fine_s, np.linspace(0.0, time_s[-1], 6), knots)
    true = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine_s))])
    reading = np.round(np.interp(time_s, fine_s, true) / step) * step
    samples = angle_samples(time_s, reading, step / np.sqrt(12.0), step)
    return Seen(samples.angle_rad - np.interp(samples.time_s, fine_s, true), samples)


@given(
    seed=st.integers(0, 2**32 - 1),
    step=st.floats(1e-3, 10.0),
    steps_a_row=st.floats(0.05, 3.0),
    rows=st.integers(30, 200),
    slowest=st.sampled_from([0.2, -1.0]),
)
@settings(deadline=None, max_examples=100)
def test_samples_lie_near_the_true_angle(
    seed: int, step: float, steps_a_row: float, rows: int, slowest: float
) -> None:
    """To within half a step plus the motion in half a row; with reversals of the motion or not."""
    seen = seen_of_a_motion(seed, step, steps_a_row, rows, slowest)
    assert np.all(np.diff(seen.samples.time_s) > 0.0) and np.all(seen.samples.sigma_rad > 0.0)
    assert np.all(np.abs(seen.error_rad) < 0.51 * step + steps_a_row * step * 0.5)


@pytest.mark.parametrize("slowest", [0.2, -1.0])
@pytest.mark.parametrize("rows", [30, 200])
def test_the_standard_deviation_of_a_sample_is_that_of_its_error(slowest: float, rows: int) -> None:
    """Over 300 drawn motions; a bit large, since the speed within a row is estimated upwards."""
    steps_a_row = np.random.default_rng(4).uniform(0.05, 3.0, 300)
    drawn = [seen_of_a_motion(k, 1.0, s, rows, slowest) for k, s in enumerate(steps_a_row)]
    ratio = np.concatenate([seen.error_rad / seen.samples.sigma_rad for seen in drawn])
    assert 0.45 < np.mean(ratio**2) < 0.85 and np.mean(np.abs(ratio) > 3.0) < 0.002


def test_a_rest_is_seen_and_a_reading_that_never_changes_gives_no_change() -> None:
    time_s = 0.01 * np.arange(100)
    seen = angle_samples(time_s, np.zeros(100), 0.1, 0.1 * np.sqrt(12.0))
    assert len(seen.row) == 18 and np.all(np.diff(seen.time_s) == pytest.approx(0.05, abs=0.011))
    assert not seen.angle_rad.any() and np.all(seen.sigma_rad == 0.1)


@given(seed=st.integers(0, 2**32 - 1), unknown=st.booleans())
@settings(deadline=None, max_examples=40)
def test_shared_errors_are_whitened(seed: int, unknown: bool) -> None:
    """Residuals of covariance 1 + S S' have covariance 1 afterwards; an unknown error leaves
    nothing along its direction whatever its size.
    """
    rng = np.random.default_rng(seed)
    group = np.sort(rng.integers(0, 4, 30))
    loadings, weight = rng.uniform(-3.0, 3.0, (30, 2)), rng.uniform(0.5, 2.0, 30)
    onto, back = SharedErrors(group, loadings, weight if unknown else None).projections()
    white = np.eye(30) - (back @ onto).toarray()
    same = group[:, None] == group
    covariance = np.eye(30) + same * (loadings @ loadings.T)
    expected = np.eye(30)
    if unknown:
        assert white @ np.where(group == group[0], weight, 0.0) == pytest.approx(0.0, abs=1e-9)
        size = np.sqrt(np.bincount(group, weights=weight**2)[group])
        expected -= same * np.outer(weight / size, weight / size)
    assert white @ covariance @ white.T == pytest.approx(expected, abs=1e-6)
