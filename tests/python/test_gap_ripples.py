"""Ripple of the speed at a restart: the part of an oscillation that a smooth curve through measured
speeds lacks, with an open and a closed bridge.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vgroove.gap.residual.local_polynomial import LOCAL_FIT, LocalFit, Observations, local_fits
from vgroove.gap.residual.restarts import Restarts
from vgroove.gap.residual.speed_ripple import (
    SpeedRipple,
    add_speed_ripple,
    torque_response,
    unsmoothed_part,
)

VALUES = {
    "motor.inertia_kg_m2": 1.6e-5,
    "gearbox.output_inertia_kg_m2": 6e-5,
    "gearbox.ratio": 5.6,
    "motor.resistance_ohm": 0.19,
    "motor.inductance_h": 1e-4,
    "motor.torque_constant_nm_per_a": 0.0109,
    "motor.viscous_nm_s_per_rad": 4.5e-6,
    "effects.added_inertia.kg_m2": 2e-6,
    "load.mass_kg": 2e-3,
    "load.length_m": 0.3,
    "effects.cogging_torque.torque_nm": 0.0,
    "effects.cogging_torque.periods_per_rev": 3.0,
    "effects.cogging_torque.phase_rad": 0.4,
    "effects.gear_eccentricity.torque_nm": 0.0,
    "effects.gear_eccentricity.phase_rad": 1.1,
    "effects.hall_eccentricity.amplitude_rad": 0.0,
    "effects.hall_eccentricity.phase_rad": 0.7,
}
NAMES = list(VALUES)
SPEED, SLOPE, INSTANT_S = 700.0, -900.0, 0.1


def local_fit(observed: Observations, time_s: float) -> LocalFit:
    """The fit at one instant."""
    return local_fits(observed, np.array([time_s]))[0]


def value(name: str) -> float:
    return VALUES[name]


def pitches(
    ripple: float, periods: float, phase: float, of_sensor: float
) -> tuple[Observations, float, float]:
    """Edge periods, 4 a turn, of a shaft that slows down and whose speed (of_sensor = 0) or whose
    sensor (of_sensor = 1) oscillates; true speed and angle at INSTANT_S.
    """
    fine = np.arange(0.0, 0.2, 1e-6)
    mean = SPEED + SLOPE * (fine - INSTANT_S)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (mean[1:] + mean[:-1]) * 1e-6)])
    # ripple of the angle, whose derivative is the ripple of the speed
    shift = ripple / (periods * SPEED) * np.sin(periods * angle + phase)
    edges = np.interp(np.arange(np.pi / 2.0, angle[-1] - 1.0, np.pi / 2.0), angle + shift, fine)
    value = (np.pi / 2.0) / np.diff(edges)
    at = int(INSTANT_S * 1e6)
    true = mean[at] + (1.0 - of_sensor) * ripple * np.cos(periods * angle[at] + phase)
    return (
        Observations(edges[:-1], edges[1:], value, np.full(len(value), 0.05)),
        float(true),
        float(angle[at]),
    )


@pytest.mark.parametrize("of_sensor", [0.0, 1.0])
@pytest.mark.parametrize("periods, ripple", [(1.0 / 5.6, 0.4), (1.0, 0.6), (2.0, 1.5), (3.0, 2.0)])
def test_a_restart_has_the_speed_of_the_shaft(
    periods: float, ripple: float, of_sensor: float
) -> None:
    errors, plain = [], []
    for phase in np.arange(8) * np.pi / 4.0:
        observed, true, angle = pitches(ripple, periods, phase, of_sensor)
        found = local_fit(observed, INSTANT_S)
        restarts = Restarts(
            np.array([100]),
            np.array([[0.0, found.value, angle]]),
            np.array([[0.0, found.slope]]),
            np.array([[0.0, found.curvature]]),
            smoothing=(found.smoothing,),
        )
        one = SpeedRipple(periods, np.array([ripple]), np.array([phase]), of_shaft=of_sensor == 0.0)
        errors.append(found.value + unsmoothed_part(restarts, one)[0] - true)
        plain.append(found.value - true)
    assert np.std(errors) < 0.1 * ripple
    assert np.std(plain) > 3.0 * np.std(errors) or np.std(plain) < 0.05 * ripple


@pytest.mark.parametrize("of_sensor", [0.0, 1.0])
@pytest.mark.parametrize("ripple", [3.0, 20.0])
def test_a_large_ripple_of_the_turn_leaves_a_state_to_restart_from(
    ripple: float, of_sensor: float
) -> None:
    for phase in np.arange(8) * np.pi / 4.0:
        observed, true, angle = pitches(ripple, 1.0, phase, of_sensor)
        counted = replace(observed, pitch=np.arange(len(observed.value)) % 4, pitches_per_rev=4)
        found = local_fit(counted, INSTANT_S)
        assert found.sigmas < LOCAL_FIT.max_sigmas < local_fit(observed, INSTANT_S).sigmas
        restarts = Restarts(
            np.array([100]),
            np.array([[0.0, found.value, angle]]),
            np.array([[0.0, found.slope]]),
            np.array([[0.0, found.curvature]]),
            smoothing=(found.smoothing,),
        )
        one = SpeedRipple(1.0, np.array([ripple]), np.array([phase]), of_shaft=of_sensor == 0.0)
        assert found.value + unsmoothed_part(restarts, one)[0] == pytest.approx(
            true, abs=0.03 * ripple
        )


def test_no_pattern_is_fitted_where_a_pitch_of_the_turn_has_no_observation() -> None:
    observed, _, _ = pitches(20.0, 1.0, 0.3, 1.0)
    three = replace(observed, pitch=np.arange(len(observed.value)) % 3, pitches_per_rev=4)
    assert local_fit(three, INSTANT_S) == local_fit(observed, INSTANT_S)


@pytest.mark.parametrize("rate", [60.0, 900.0, -2500.0])
@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("load", ["none", "pendulum"])
def test_torque_response_is_that_of_shaft_and_winding(rate: float, closed: bool, load: str) -> None:
    """A pendulum of 2 g at 0.3 m is most of the inertia."""
    pendulum = 2e-3 * 0.3**2 if load == "pendulum" else 0.0
    inertia = 1.6e-5 + 2e-6 + (6e-5 + pendulum) / 5.6**2

    def slope(t: float, state: np.ndarray) -> list[float]:
        current, speed = state
        return [
            closed * (-0.0109 * speed - 0.19 * current) / 1e-4,
            (0.0109 * current - 4.5e-6 * speed - 0.01 * np.sin(rate * t)) / inertia,
        ]

    period = 2.0 * np.pi / abs(rate)
    start_s = period * np.ceil((0.6 if closed else 0.0) / period)
    t = start_s + np.linspace(0.0, period, 400, endpoint=False)
    speed = solve_ivp(
        slope, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=period / 40.0, rtol=1e-8, atol=1e-10
    ).y[1]
    found = 2.0 * np.mean((speed - speed.mean()) * np.exp(-1j * rate * t)) / 0.01
    run = SimpleNamespace(
        restarts=SimpleNamespace(rows=np.array([5])),
        bridge_closed=np.full(10, closed),
        driving=SimpleNamespace(more={"load_kind": load}),
    )
    assert torque_response(value, run, np.array([rate]))[0] == pytest.approx(found, rel=0.02)


@pytest.mark.parametrize("viscous", [4.5e-6, 0.0])
def test_a_start_at_rest_and_a_parameter_set_without_ripple_stay_as_measured(
    viscous: float,
) -> None:
    observed, _, angle = pitches(1.5, 2.0, 0.3, 0.0)
    found = local_fit(observed, INSTANT_S)
    measured = np.array([[0.0, 0.0, 0.0], [0.0, found.value, angle]])
    made_of = (local_fit(observed, -1.0).smoothing, found.smoothing)
    restarts = Restarts(
        np.array([0, 100]), measured, np.zeros((2, 2)), np.zeros((2, 2)), smoothing=made_of
    )
    run = SimpleNamespace(
        restarts=restarts,
        bridge_closed=np.zeros(200, dtype=bool),
        driving=SimpleNamespace(more={"load_kind": "none"}),
    )
    problem = SimpleNamespace(index=NAMES.index)
    plain = np.array([VALUES[name] for name in NAMES])
    with_cogging = plain.copy()
    with_cogging[NAMES.index("effects.cogging_torque.torque_nm")] = 0.01
    with_cogging[NAMES.index("motor.viscous_nm_s_per_rad")] = viscous
    states = add_speed_ripple(
        problem, run, np.array([plain, with_cogging]), np.repeat(measured[None], 2, axis=0)
    )
    assert np.array_equal(states[0], measured)
    assert np.array_equal(states[1, 0], measured[0]) and states[1, 1, 1] != measured[1, 1]
