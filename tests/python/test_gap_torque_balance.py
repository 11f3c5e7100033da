"""The torque balance along the measured motion: its torques are those of a calculation by hand, it
is 0 for the true parameters, an effect without torque does not bring it to 0, and it is used where
the forward simulation of a noisy, slow driving column predicts nothing.
"""

from dataclasses import replace
from types import MethodType, SimpleNamespace

import numpy as np
import pytest

from made_log import MadeLog, drive_log, rig
from vgroove import _core
from vgroove.gap import DiagnosisOptions, diagnose, stages
from vgroove.gap.catalogue import BY_ID, CATALOGUE
from vgroove.gap.fitting.covariance import white_noise_half_widths
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem
from vgroove.gap.residual.torque_balance import (
    GAIN,
    NET_TORQUE,
    BalanceProblem,
    balance_problem,
    measured_motion,
)
from vgroove.gap.selection import comparison, search_state
from vgroove.gap.selection.comparison import BALANCE as TORQUE_BALANCE
from vgroove.gap.selection.comparison import (
    FORWARD,
    comparison_of,
    effects_in_balance,
    forward_simulation_fails,
    mean_interval_width,
    reference_fit,
    reference_fits_with_one_more,
)
from vgroove.gap.selection.log_content import effect_scales
from vgroove.gap.selection.search_state import Search
from vgroove.gap.simulate import compute_gap
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RAD_S_PER_RPM

ROW_S, ROWS, SPEED_RPM = 2e-3, 1000, 3000.0
TIME_S = ROW_S * np.arange(ROWS)
ENCODER = {"hall_pulses_per_rev": 0, "speed_lsb_rpm": 0.0, "speed_noise_rpm": 1.0}
ENCODER |= {"current_noise_a": 0.03, "current_lsb_a": 0.0}
LEVEL = {"current_a": 2.0, "voltage_v": 6.0, "duty": 0.33}
# the motor of tests/data/real/robotino_m1_current, 4 rows a second
SLOW_ROW_S, SLOW_ROWS, SLOW_NOISE_A = 0.25, 240, 0.03
SLOW_MOTOR = {
    "resistance_ohm": 5.95,
    "inductance_h": 0.0089,
    "torque_constant_nm_per_a": 0.0514,
    "inertia_kg_m2": 1.4629e-06,
    "viscous_nm_s_per_rad": 2.5841e-05,
    "coulomb_nm": 0.0,
}
FRICTIONS = ("coulomb_friction", "viscous_friction")
WITH_INERTIA = (*FRICTIONS, "added_inertia")
ONLY_FRICTIONS, ONLY_WITH_INERTIA = (
    DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in ids])
    for ids in (FRICTIONS, WITH_INERTIA)
)


def tool_of(kind: str, **effects: dict[str, float]) -> Rig:
    """The impact driver's motor with a speed column of small noise, driven by a column."""
    data = rig(sensors=ENCODER, effects=effects).as_dict()
    return rig_from_dict(data | {"input": {"kind": kind}}, "the test's rig")


def simulated_log(tool: Rig, command: np.ndarray, row_s: float = ROW_S) -> MadeLog:
    """A log without noise of a tool from rest."""
    kind, time_s = tool.input["kind"], row_s * np.arange(len(command))
    rows = _core.simulate_log(
        _core.LogInput(time_s, kind, command, load_kind=tool.load["kind"]),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    columns = {kind: command, "speed_rpm": rows["speed_measured_rad_s"][0] / RAD_S_PER_RPM}
    if kind != "current_a":
        columns["current_a"] = rows["current_a"][0]
    return MadeLog(time_s, columns)


def gentle(kind: str) -> np.ndarray:
    """A command (ROWS,) without steps, in one direction."""
    wave = 1.0 + 0.3 * np.sin(2.0 * np.pi * TIME_S)
    return LEVEL[kind] * wave * np.minimum(1.0, 0.3 + TIME_S if kind == "current_a" else TIME_S)


def balance_of(log: MadeLog, tool: Rig) -> BalanceProblem:
    """The torque balance of a log."""
    found = balance_problem(load_problem([log], tool))
    assert found is not None
    return found


def torque_rms(problem: BalanceProblem, **values: float) -> float:
    """RMS of the torque residuals, in sigmas, with parameters `effects.<id>.<name>` given as
    id__name.
    """
    theta = problem.theta0.copy()
    for name, value in values.items():
        theta[problem.index("effects." + name.replace("__", "."))] = value
    of_torque = problem.signal == [s.column for s in problem.signals].index("torque_nm")
    return float(np.sqrt(np.mean(problem.residuals(theta)[0][of_torque] ** 2)))


def held_log(kind: str, sign: float) -> MadeLog:
    """A command and a speed that are constant, but for a speed error below its noise: a constant
    column would be refused as a dead sensor.
    """
    speed = sign * SPEED_RPM + 1e-3 * (np.arange(ROWS) % 7)
    columns = {kind: np.full(ROWS, sign * LEVEL[kind]), "speed_rpm": speed}
    return MadeLog(TIME_S, columns)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["current_a", "voltage_v"])
def test_the_net_torque_at_a_held_speed_is_that_of_the_equation_of_motion(
    kind: str, sign: float
) -> None:
    tool = tool_of(kind)
    problem, motor = balance_of(held_log(kind, sign), tool), tool.motor
    constant, speed = motor["torque_constant_nm_per_a"], sign * SPEED_RPM * RAD_S_PER_RPM
    current = sign * LEVEL[kind]
    if kind == "voltage_v":
        current = (current - constant * speed) / motor["resistance_ohm"]
    friction = sign * motor["coulomb_nm"] + motor["viscous_nm_s_per_rad"] * speed
    net = problem.simulate(problem.theta0)[0][NET_TORQUE][0, 1:] / ROW_S
    np.testing.assert_allclose(net, constant * current - friction, rtol=1e-4)


@pytest.mark.parametrize("inductance", [-0.9, 0.0, 2.0])
def test_the_torque_of_a_unit_of_the_column_is_that_of_the_steady_motor(inductance: float) -> None:
    """Whatever the winding's time constant: an inductance is no error of the torque."""
    for kind, unit in (("current_a", 1.0), ("voltage_v", 1.0 / 0.19)):
        problem = balance_of(held_log(kind, 1.0), tool_of(kind))
        theta = problem.theta0.copy()
        theta[problem.index("effects.inductance.relative")] = inductance
        gain = problem.simulate(theta)[0][GAIN][0, 1:] / ROW_S
        np.testing.assert_allclose(gain, 0.0109 * unit, rtol=1e-3)


def test_spans_in_which_the_command_changes_its_sign_have_the_gain_of_the_motor() -> None:
    signs = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
    data = tool_of("current_a").as_dict()
    tool = rig_from_dict(
        data | {"sensors": data["sensors"] | {"speed_noise_rpm": 30.0}}, "the test's rig"
    )
    log = simulated_log(tool, 2.0 * signs + 0.5 * np.sin(2.0 * np.pi * TIME_S))
    problem = balance_of(log, tool)
    assert problem.rows_per_span % 2 == 0  # as many rows of one sign as of the other
    assert np.isfinite(problem.residuals(problem.theta0)).all()
    gain = problem.runs[0].channels[0]._mean(problem.simulate(problem.theta0)[0], GAIN)
    np.testing.assert_allclose(gain, 0.0109, rtol=1e-3)


@pytest.mark.parametrize(
    ("kind", "sigmas"), [("current_a", 1e-3), ("voltage_v", 0.1), ("duty", 0.1)]
)
def test_the_balance_of_a_noiseless_log_is_zero_for_the_true_parameters(
    kind: str, sigmas: float
) -> None:
    extra = {"coulomb_friction": {"torque_nm": 0.004}}
    log = simulated_log(tool_of(kind, **extra), gentle(kind))
    problem = balance_of(log, tool_of(kind))
    assert torque_rms(problem, coulomb_friction__torque_nm=0.004) < sigmas
    assert torque_rms(problem) > 20.0 * sigmas


@pytest.mark.parametrize("ratio", [1.0, 5.6])
def test_a_pendulum_is_part_of_the_inertia_of_the_balance(ratio: float) -> None:
    """Most of the inertia at the shaft is the pendulum's, mass times length squared. The rig states
    it by [load] alone: gearbox.output_inertia_kg_m2 does not contain it.
    """
    pendulum = {"kind": "pendulum", "mass_kg": 4e-3, "length_m": 0.2, "zero_rad": 0.3}
    data = tool_of("current_a").as_dict() | {"load": pendulum}
    gear = {"ratio": ratio, "output_inertia_kg_m2": 1e-6}
    tool = rig_from_dict(data | {"gearbox": gear}, "the test's rig")
    of_pendulum = 4e-3 * 0.2**2 / ratio**2
    rotor = tool.motor["inertia_kg_m2"] + 1e-6 / ratio**2
    assert tool.shaft_inertia_kg_m2 == pytest.approx(rotor + of_pendulum)
    problem = balance_of(simulated_log(tool, gentle("current_a")), tool)
    assert torque_rms(problem) < 1e-2
    assert torque_rms(problem, added_inertia__kg_m2=-0.5 * of_pendulum) > 1.0


def test_the_balance_grows_with_an_added_inertia_of_any_size() -> None:
    """In proportion to it, also where it exceeds that of the held shaft: no inertia hides the
    torque.
    """
    tool = tool_of("current_a")
    problem = balance_of(simulated_log(tool, gentle("current_a")), tool)
    large = 1e3 * tool.shaft_inertia_kg_m2
    once, more = (torque_rms(problem, added_inertia__kg_m2=k * large) for k in (1.0, 1e6))
    assert more == pytest.approx(1e6 * once, rel=1e-3)


@pytest.mark.parametrize("kind", ["current_a", "duty"])
def test_rows_that_are_instants_have_the_same_balance(kind: str) -> None:
    """The same run, each command written into the row before and held from there on."""
    log = simulated_log(tool_of(kind), gentle(kind))
    column = log.columns[kind]
    shifted = log.columns | {kind: np.concatenate([column[1:], column[-1:]])}
    after = tool_of(kind).as_dict() | {"input": {"kind": kind, "hold": "after"}}
    instants = balance_of(MadeLog(log.time_s, shifted), rig_from_dict(after, "instants"))
    plain = balance_of(log, tool_of(kind))
    for theta in (plain.theta0, 1.1 * plain.theta0):
        np.testing.assert_allclose(
            instants.residuals(theta)[0], plain.residuals(theta)[0], atol=1e-3, rtol=1e-3
        )


def noisy_encoder_log(noise_rad: float) -> tuple[MadeLog, np.ndarray]:
    """A log with a speed and an angle of this noise, and the true speed (rows,) in rad/s."""
    tool, command = tool_of("voltage_v"), gentle("voltage_v")
    log = simulated_log(tool, command)
    drive = _core.LogInput(TIME_S, "voltage_v", command, load_kind="none")
    true = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), np.zeros((1, 3)))
    noise = noise_rad * np.random.default_rng(0).standard_normal(ROWS)
    angle = true["angle_rad"][0] + noise
    return MadeLog(TIME_S, {**log.columns, "position_rad": angle}), true["speed_rad_s"][0]


@pytest.mark.parametrize(
    ("name", "value"), [("speed_gain.relative", 0.05), ("speed_lag.time_constant_s", 0.01)]
)
def test_errors_of_the_speed_sensor_do_not_change_the_motion_of_an_encoder(
    name: str, value: float
) -> None:
    log, _ = noisy_encoder_log(2e-4)
    problem = balance_of(log, tool_of("voltage_v"))
    theta = problem.theta0.copy()
    theta[problem.index(f"effects.{name}")] = value
    plain, with_error = problem.residuals(np.stack([problem.theta0, theta]))
    np.testing.assert_allclose(plain, with_error, atol=1e-5)  # lanes round differently
    effects = effects_in_balance(problem, list(CATALOGUE))
    assert not {"speed_gain", "speed_lag"} & {e.id for e in effects}


def test_the_standard_deviations_of_an_encoders_speeds_are_those_of_their_errors() -> None:
    log, true = noisy_encoder_log(2e-3)
    run = load_problem([log], tool_of("voltage_v")).runs[0]
    motion = measured_motion(run, tool_of("voltage_v"))
    mean = 0.5 * (true[1:] + true[:-1])
    for error, sigma in (
        (motion.speed[1:-1] - true[1:-1], motion.sigma),
        (motion.mean_speed[1:] - mean, motion.mean_sigma),
    ):
        assert np.std(error) == pytest.approx(sigma, rel=0.08)


@pytest.mark.parametrize("kind", ["current_a", "voltage_v"])
@pytest.mark.parametrize(
    "removed",
    [{"torque_constant__relative": -0.95}, {"magnetic_saturation__saturation_a": 0.05}],
    ids=["constant", "saturation"],
)
def test_an_effect_that_removes_the_torque_does_not_close_the_balance(
    kind: str, removed: dict[str, float]
) -> None:
    """Without division by the torque of a unit of the column a motor without torque would balance
    any motion at nearly constant speed.
    """
    extra = {"coulomb_friction": {"torque_nm": 0.02}}
    problem = balance_of(simulated_log(tool_of(kind, **extra), 2.0 * gentle(kind)), tool_of(kind))
    assert torque_rms(problem, **removed) > torque_rms(problem) > 1.0


def slow_rig() -> Rig:
    """A motor driven by a measured current, 4 rows a second."""
    return rig_from_dict(
        {
            "schema": "vgroove.rig/1",
            "input": {"kind": "current_a"},
            "supply": {"voltage_v": 24.0},
            "motor": SLOW_MOTOR,
            "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 1e-9},
            "mechanism": {"kind": "none"},
            "load": {"kind": "none"},
            "sensors": {"log_hz": 4, "current_noise_a": SLOW_NOISE_A, "speed_lsb_rpm": 3.4},
        },
        "a slow logger",
    )


def slow_log(coulomb_nm: float, viscous: float, seed: int = 1) -> MadeLog:
    """A steady speed of either sign in each 2 s, at the current that it requires with more friction
    than the rig states; the measured current has noise.
    """
    rng, k = np.random.default_rng(seed), SLOW_MOTOR["torque_constant_nm_per_a"]
    speed = np.repeat(
        rng.choice([-1.0, 1.0], SLOW_ROWS // 8) * rng.uniform(20, 120, SLOW_ROWS // 8), 8
    )
    friction = coulomb_nm * np.sign(speed)
    friction += (viscous + SLOW_MOTOR["viscous_nm_s_per_rad"]) * speed
    current = friction / k + SLOW_NOISE_A * rng.standard_normal(SLOW_ROWS)
    rpm = np.round(speed / RAD_S_PER_RPM / 3.4 + 0.3 * rng.standard_normal(SLOW_ROWS)) * 3.4
    return MadeLog(SLOW_ROW_S * np.arange(SLOW_ROWS), {"current_a": current, "speed_rpm": rpm})


@pytest.mark.parametrize(
    ("coulomb_nm", "viscous", "named", "size"),
    [(0.009, 0.0, "coulomb_friction", 0.009), (0.0, 9e-5, "viscous_friction", 9e-5)],
)
def test_a_slow_noisy_current_tells_coulomb_from_viscous_friction(
    coulomb_nm: float, viscous: float, named: str, size: float
) -> None:
    verdict = diagnose([slow_log(coulomb_nm, viscous)], slow_rig(), ONLY_FRICTIONS)
    assert (verdict.verdict in ("effect", "partial"), verdict.selected) == (True, [named])
    found = verdict.effects[0]
    (value,) = found.parameters.values()
    assert value.value == pytest.approx(size, rel=0.15)
    assert value.ci95[0] < size < value.ci95[1]
    assert found.evidence is not None and found.evidence.after < 0.5 * found.evidence.before


def test_a_slow_noisy_current_is_compared_in_the_torque_balance() -> None:
    problem = load_problem([slow_log(0.009, 0.0)], slow_rig())
    search = stages.begin_search(problem, ONLY_FRICTIONS)
    assert comparison_of(search) == TORQUE_BALANCE
    assert isinstance(search.problem, BalanceProblem) and search.simulated is problem
    assert search.gap_residual(search.nominal).shape == (problem.n,)


def test_the_gap_of_a_balance_is_that_of_the_forward_simulation() -> None:
    """Before and after the correction it is what `vgroove sim` computes."""
    log = slow_log(0.009, 0.0)
    verdict = diagnose([log], slow_rig(), ONLY_FRICTIONS)
    assert verdict.effects[0].evidence.comparison == TORQUE_BALANCE
    assert set(verdict.gap.by_signal) == {"speed_rpm"}
    before, refit = (
        compute_gap(tool, [log])[0]["gap"] for tool in (slow_rig(), verdict.corrected_rig())
    )
    assert verdict.gap.before == pytest.approx(before, rel=1e-3)
    assert verdict.gap.refit == pytest.approx(refit, rel=0.01)
    signal = verdict.gap.by_signal["speed_rpm"]
    assert signal.after_share < signal.before_share


@pytest.mark.parametrize("kind", ["duty", "voltage_v", "current_a"])
def test_a_fast_log_stays_in_the_forward_simulation(kind: str) -> None:
    """A thousand rows a second, of a tool with more friction than its rig states."""
    extra = {"coulomb_friction": {"torque_nm": 0.004}}
    log = simulated_log(tool_of(kind, **extra), gentle(kind), row_s=1e-3)
    noise = np.random.default_rng(1).standard_normal(ROWS)
    log.columns["speed_rpm"] = log.columns["speed_rpm"] + ENCODER["speed_noise_rpm"] * noise
    search = stages.begin_search(load_problem([log], tool_of(kind)), ONLY_FRICTIONS)
    assert comparison_of(search) == FORWARD and search.simulated is search.problem


def test_the_forward_simulation_fails_where_the_driving_column_makes_the_speed_uncertain() -> None:
    """Of the slow log the noise of the current is a speed of the order of the signal; of a fast log
    with the same friction it is not.
    """
    slow = begin(slow_log(0.009, 0.0), slow_rig())
    extra = {"coulomb_friction": {"torque_nm": 0.004}}
    tool = tool_of("duty")
    fast = begin(simulated_log(tool_of("duty", **extra), gentle("duty"), row_s=1e-3), tool)
    assert forward_simulation_fails(slow, slow.problem, reference_fit(slow))
    assert not forward_simulation_fails(fast, fast.problem, reference_fit(fast))


def begin(
    log: MadeLog, tool: Rig, ids: tuple[str, ...] = FRICTIONS, restart_s: float | None = None
) -> Search:
    """A new search for the effects `ids`, which compares the log with the forward simulation."""
    problem = load_problem([log], tool, restart_s)
    engine = Engine(problem, effect_scales(problem), {})
    return search_state.begin(engine, [BY_ID[i] for i in ids], ONLY_FRICTIONS)


def compared_by(log: MadeLog, tool: Rig) -> str:
    """The comparison in which frictions and an inertia are looked for."""
    return comparison_of(stages.begin_search(load_problem([log], tool), ONLY_WITH_INERTIA))


def test_a_wrong_inertia_is_no_failure_of_the_forward_simulation() -> None:
    """A sinusoidal current drives a motor of which the rig states 0.22 of the true inertia. Its
    model predicts worse than the constant 0, also with fitted frictions.
    """
    true = tool_of("current_a")
    log = simulated_log(true, 10.0 * np.sin(2.0 * np.pi * 8.0 * TIME_S))
    motor = {**true.motor, "inertia_kg_m2": 0.22 * true.motor["inertia_kg_m2"]}
    stated = rig_from_dict(true.as_dict() | {"motor": motor}, "the test's rig")
    search = begin(log, stated, WITH_INERTIA)
    assert forward_simulation_fails(search, search.problem, reference_fit(search))
    assert compared_by(log, stated) == FORWARD
    verdict = diagnose([log], stated, ONLY_WITH_INERTIA)
    assert (verdict.verdict, verdict.selected) == ("effect", ["added_inertia"])
    (value,) = verdict.effects[0].parameters.values()
    assert value.value == pytest.approx(0.78 * true.motor["inertia_kg_m2"], rel=0.02)


def test_an_implausible_inertia_does_not_hide_a_failure() -> None:
    """A load that the log does not hold cancels nearly all of the current. With a heavy rotor a
    simulation predicts the speed at a restart 0.25 s before, whatever the current.
    """
    tool = tool_of("current_a")
    moving = 3.0 * (TIME_S < 0.3) + 0.5 * np.sin(np.pi * TIME_S)
    log = simulated_log(tool, moving)
    noise = 0.03 * np.random.default_rng(1).standard_normal(ROWS)
    log.columns["current_a"] = 40.0 + 20.0 * np.sin(1.4 * np.pi * TIME_S) + noise
    search = begin(log, tool, WITH_INERTIA, restart_s=0.25)
    heavy = reference_fit(search, WITH_INERTIA)
    assert forward_simulation_fails(search, search.problem, reference_fit(search))
    assert not forward_simulation_fails(search, search.problem, heavy)
    assert list(reference_fits_with_one_more(search, [])) == []
    assert compared_by(log, tool) == TORQUE_BALANCE
    with_weight = DiagnosisOptions(
        without=[e.id for e in CATALOGUE if e.id not in (*WITH_INERTIA, "gear_eccentricity")]
    )
    begun = stages.begin_search(load_problem([log], tool), with_weight)
    assert comparison_of(begun) == TORQUE_BALANCE


@pytest.mark.parametrize("weight", [True, False])
def test_where_the_simulation_fails_for_want_of_a_weight_alone_it_is_kept(
    weight: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the weight among the fitted effects the forward simulation is valid, and its confidence
    interval of the friction is narrower than that of the torque balance.
    """
    tool = tool_of("current_a")
    pendulum = {"kind": "pendulum", "mass_kg": 0.3, "length_m": 0.2}
    true = rig_from_dict(tool.as_dict() | {"load": pendulum}, "with its weight")
    gear = tool.gearbox | {"output_inertia_kg_m2": tool.gearbox["output_inertia_kg_m2"] + 0.012}
    stated = rig_from_dict(tool.as_dict() | {"gearbox": gear}, "without its weight")
    log = simulated_log(true, 8.0 * np.sin(1.4 * np.pi * TIME_S))
    search = begin(log, stated, (*FRICTIONS, "gear_eccentricity"))
    (one,) = reference_fits_with_one_more(search, [])
    assert search.score(one) < 0.01 * search.score(reference_fit(search))
    monkeypatch.setattr(
        comparison, "forward_simulation_fails", lambda *a: not (weight and len(a[2].ids) == 3)
    )
    options = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in one.ids])
    begun = stages.begin_search(load_problem([log], stated), options)
    assert (comparison_of(begun) == FORWARD) is weight


@pytest.mark.parametrize("in_balance", [True, False])
def test_where_the_simulation_fails_for_an_effect_that_the_balance_lacks_it_is_kept(
    in_balance: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command acts late, which a torque balance over few rows cannot show, although it gives
    the frictions narrower confidence intervals.
    """
    late = tool_of("current_a", transport_delay={"delay_s": 0.02})
    log, stated = simulated_log(late, gentle("current_a")), tool_of("current_a")
    ids = (*FRICTIONS, "transport_delay")
    options = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in ids])
    monkeypatch.setattr(
        comparison, "forward_simulation_fails", lambda *a: "transport_delay" not in a[2].ids
    )
    monkeypatch.setattr(
        comparison,
        "effects_in_balance",
        lambda _, effects: [e for e in effects if in_balance or e.id != "transport_delay"],
    )
    monkeypatch.setattr(
        comparison,
        "mean_interval_width",
        lambda search, _: np.inf if search.gap_problem is None else 1.0,
    )
    begun = stages.begin_search(load_problem([log], stated), options)
    assert (comparison_of(begun) == FORWARD) is not in_balance
    assert {e.id for e in begun.effects} == set(ids)


@pytest.mark.parametrize(
    ("resonance_rad_s", "least"), [(150.0, True), (400.0, True), (900.0, False)]
)
def test_a_reference_fit_takes_the_best_of_many_starts(resonance_rad_s: float, least: bool) -> None:
    """A resonance is reached from starts near it alone: from that of least cost, or from the first
    one.
    """
    ids, inertia = (*FRICTIONS, "coupler_compliance"), 5.4e-6
    coupler = {"damping_ratio": 0.1, "inertia_kg_m2": inertia}
    coupler["stiffness_nm_per_rad"] = resonance_rad_s**2 * inertia
    command = 1.0 + 6.0 * np.sign(np.sin(2.0 * np.pi * (2.0 if least else 9.0) * TIME_S))
    log = simulated_log(tool_of("current_a", coupler_compliance=coupler), command)
    search = begin(log, tool_of("current_a"), ids)
    (start, *_) = search.engine.hypotheses([BY_ID[i] for i in ids])
    (first,) = search.engine.fit([start], search_state.COMPARISON.max_rounds)
    found = reference_fit(search, ids)
    assert found.cost < 0.01 * first.cost if least else found.cost == first.cost


def test_a_log_that_is_never_driven_has_no_torque_balance() -> None:
    log = simulated_log(tool_of("current_a"), np.zeros(ROWS))
    log.columns["speed_rpm"] = 3000.0 * np.exp(-TIME_S)
    assert balance_problem(load_problem([log], tool_of("current_a"))) is None


@pytest.mark.parametrize(
    ("nominal", "left", "fails"), [(1.2, 0.6, True), (1.2, 0.4, False), (0.9, 0.6, False)]
)
def test_a_model_worse_than_none_fails_unless_the_reference_effects_explain_it(
    nominal: float, left: float, fails: bool
) -> None:
    """Errors as shares of the measured signal."""
    problem = measured_signals(
        n=8,
        signals=[SimpleNamespace(unit="A", column="speed_rpm", edges=False)],
        signal=np.zeros(8, int),
        censored=np.zeros(8, bool),
        measured=np.full(8, 100.0),
        sigma=np.ones(8),
    )
    fits = [SimpleNamespace(out_of_fold=np.full(8, 100.0 * share)) for share in (nominal, left)]
    assert forward_simulation_fails(SimpleNamespace(nominal=fits[0]), problem, fits[1]) is fails
    uncertain = measured_signals(**vars(problem) | {"sigma": np.full(8, 31.0)})
    exact = [SimpleNamespace(out_of_fold=np.zeros(8))] * 2
    assert forward_simulation_fails(SimpleNamespace(nominal=exact[0]), uncertain, exact[1])
    edges = measured_signals(**vars(uncertain))
    edges.signals = [SimpleNamespace(unit="A", column="speed_rpm", edges=True)]
    assert not forward_simulation_fails(SimpleNamespace(nominal=fits[0]), edges, fits[1])


def test_an_interval_is_at_least_that_of_the_stated_noise() -> None:
    """Residuals far below their standard deviation do not make a comparison precise."""
    log = drive_log(rig(), seconds=2.0, levels=[(0.1, 0.5), (1.0, -0.5)])
    search = begin(log, rig())
    fit = reference_fit(search)
    white = white_noise_half_widths(search.engine, fit)[:2]
    rows = fit.jacobian[search.engine.train]
    covariance = np.linalg.inv(rows.T @ rows + np.diag(fit.hypothesis.prior))
    assert white == pytest.approx(1.96 * np.sqrt(np.diag(covariance))[:2], rel=1e-3)
    silent = replace(fit, residual=np.zeros_like(fit.residual))
    least = float(np.exp(np.mean(np.log(white))))
    assert mean_interval_width(search, silent) >= 0.999 * least


@pytest.mark.parametrize(
    ("rows", "angle", "left_out"),
    [
        (1, True, {"clock_skew", "transport_delay"}),
        (9, True, {"clock_skew", "transport_delay"}),
        (10, True, {"clock_skew"}),
        (10, False, {"clock_skew", "cogging_torque"}),
    ],
)
def test_the_balance_leaves_out_what_it_cannot_show(
    rows: int, angle: bool, left_out: set[str]
) -> None:
    """A clock; a shift in time unless torques are means of ten rows; ripple without an angle."""
    columns = {"position_rad": np.zeros(3)} if angle else {"speed_rpm": np.zeros(3)}
    problem = SimpleNamespace(rows_per_span=rows, logs=[SimpleNamespace(columns=columns)])
    ids = ["coulomb_friction", "clock_skew", "transport_delay", "cogging_torque"]
    found = effects_in_balance(problem, [BY_ID[i] for i in ids])
    assert set(ids) - {e.id for e in found} == left_out


def measured_signals(**fields: object) -> SimpleNamespace:
    """A problem of these fields with the errors by signal of a Problem."""
    problem = SimpleNamespace(**fields)
    for method in (Problem.squared_unclipped, Problem.gap_by_signal, Problem.rms_by_signal):
        setattr(problem, method.__name__, MethodType(method, problem))
    return problem


def test_a_speed_made_from_edges_has_no_torque_balance() -> None:
    """Between edges no motion is measured along which a torque could be computed."""
    log = drive_log(rig(), seconds=1.0, levels=[(0.1, 0.5)])
    assert balance_problem(load_problem([log], rig())) is None
