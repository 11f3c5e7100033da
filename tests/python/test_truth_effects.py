"""Every effect of the generator is visible, in the signals and with the sign of its physics."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from truth_helpers import (
    BY_ID,
    CATALOGUE,
    FIRST,
    NOISELESS,
    OUTSIDE,
    Run,
    Setting,
    columns,
    effect_params,
    setting_of,
    simulated_once,
    speed_column,
    steady,
    top_speed,
    visibility,
    visible_limit,
)
from truth_helpers import simulate_once as simulate

SENSORS = {
    "current_gain": "i",
    "current_offset": "i",
    "current_lag": "i",
    "current_saturation": "i",
    "u_mains_hum": "i",
    "supply_gain": "v",
    "speed_gain": "w",
    "speed_lag": "w",
    "hall_eccentricity": "w",
    "hall_dropout": "w",
}
PROFILE = {"load": "load_steps", "two_way": "reversals", "slow": "crawl", "": "staircase"}


@pytest.fixture(autouse=True, scope="module")
def equal_runs_are_shared() -> Iterator[None]:
    with simulated_once():
        yield


def pair(effect_id: str, part: float) -> tuple[Setting, Run, Run]:
    """(setting, effect-free run, run with the effect at a part of its largest plausible size)."""
    effect = BY_ID[effect_id]
    setting = setting_of(PROFILE[effect.needs])
    params = effect_params(setting, effect_id, part * effect.top(setting.rig))
    return setting, simulate(setting, NOISELESS)[0], simulate(setting, params | NOISELESS)[0]


def mean_speed(run: Run) -> float:
    return float(np.mean(np.abs(run.speed_rad_s)))


def mean_current(run: Run) -> float:
    return float(np.mean(np.abs(run.current_a)))


@pytest.mark.parametrize("effect_id", [effect.id for effect in (*CATALOGUE, *OUTSIDE)])
def test_effect_can_be_seen_and_grows_with_its_size(effect_id: str) -> None:
    effect = BY_ID[effect_id]
    setting = setting_of(PROFILE[effect.needs], seconds=4.0)
    reference = simulate(setting, NOISELESS)[0]
    top = effect.top(setting.rig)
    large, small = (
        visibility(setting, reference, effect_id, 0.7 * top),
        visibility(setting, reference, effect_id, 1e-4 * top),
    )
    assert large > 1.0
    assert small < 0.7 * large


@pytest.mark.parametrize("effect_id", sorted(SENSORS))
def test_sensor_effect_does_not_change_the_tool(effect_id: str) -> None:
    _, without, with_it = pair(effect_id, 0.5)
    assert np.array_equal(without.speed_rad_s, with_it.speed_rad_s)
    assert np.array_equal(without.current_a, with_it.current_a) == (SENSORS[effect_id] != "i")
    assert np.array_equal(without.supply_v, with_it.supply_v) == (SENSORS[effect_id] != "v")


SLOWER = (
    "supply_resistance",
    "winding_resistance",
    "bridge_resistance",
    "brush_drop",
    "coulomb_friction",
    "viscous_friction",
    "quadratic_drag",
    "cold_grease",
    "winding_heating",
    "dead_time",
    "supply_droop",
)
MORE_CURRENT = ("coulomb_friction", "viscous_friction", "quadratic_drag", "cold_grease")


@pytest.mark.parametrize("effect_id", SLOWER)
def test_losses_of_voltage_or_torque_make_the_tool_slower(effect_id: str) -> None:
    _, without, with_it = pair(effect_id, 0.5)
    assert mean_speed(with_it) < 0.9995 * mean_speed(without)


@pytest.mark.parametrize("effect_id", MORE_CURRENT)
def test_friction_raises_the_current(effect_id: str) -> None:
    _, without, with_it = pair(effect_id, 0.5)
    assert mean_current(with_it) > 1.02 * mean_current(without)


def steady_speeds() -> dict[str, Callable[[], tuple[float, float]]]:
    """Effect -> (measured, expected) where the steady state gives the size in closed form; the
    reference tool at duty 0.6, where no other is given.
    """
    base, v, r, k = steady(0.6), 18.0, 0.19, 0.0109
    friction = 0.012 + 4.5e-6 * base["speed_rad_s"]

    def solved(volts: float, ohm: float, gain: float, dry: float, viscous: float) -> float:
        return (volts - ohm * dry / gain) / (gain + ohm * viscous / gain)

    def speed(**params: float) -> float:
        return steady(0.6, **params)["speed_rad_s"]

    return {
        "nominal": lambda: (base["speed_rad_s"], solved(0.6 * v, r, k, 0.012, 4.5e-6)),
        "winding_resistance": lambda: (
            speed(resistance_ohm=0.3),
            solved(0.6 * v, 0.3, k, 0.012, 4.5e-6),
        ),
        "bridge_resistance": lambda: (
            speed(bridge_resistance_ohm=0.11),
            solved(0.6 * v, 0.3, k, 0.012, 4.5e-6),
        ),
        "torque_constant": lambda: (
            speed(torque_constant_nm_per_a=0.012),
            solved(0.6 * v, r, 0.012, 0.012, 4.5e-6),
        ),
        "coulomb_friction": lambda: (speed(coulomb_nm=0.03), solved(0.6 * v, r, k, 0.03, 4.5e-6)),
        "viscous_friction": lambda: (
            speed(viscous_nm_s_per_rad=2e-5),
            solved(0.6 * v, r, k, 0.012, 2e-5),
        ),
        "forward_nm": lambda: (speed(forward_nm=0.01), solved(0.6 * v, r, k, 0.022, 4.5e-6)),
        "backward_nm": lambda: (speed(backward_nm=0.01), solved(0.6 * v, r, k, 0.012, 4.5e-6)),
        "dead_time": lambda: (
            speed(dead_time_s=5e-7),
            solved(0.6 * v - 2 * 5e-7 * 20000 * v, r, k, 0.012, 4.5e-6),
        ),
        "brush_drop": lambda: (
            steady(1.0, brush_drop_v=0.8)["speed_rad_s"],
            solved(v - 0.8 * (1 - np.exp(-1.85 / 0.25)), r, k, 0.012, 4.5e-6),
        ),
        "friction": lambda: (base["friction_nm"] + 4.5e-6 * base["speed_rad_s"], friction),
    }


@pytest.mark.parametrize("name", sorted(steady_speeds()))
def test_steady_speed_is_what_the_equation_gives(name: str) -> None:
    measured, expected = steady_speeds()[name]()
    assert measured == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("share", "sign"), [(0.5, 0.0), (0.8, 0.0), (1.25, 1.0), (2.0, 1.0)])
def test_dead_time_has_no_effect_while_the_current_changes_sign_between_the_edges(
    share: float, sign: float
) -> None:
    """The mean current is `share` of the height of the current ripple: dead time acts by the sign
    of the current at the two edges, not by the mean sign over the ripple.
    """
    duty, v, r, k, dead_s = 128 / 255, 18.0, 0.19, 0.0109, 4e-7
    current = share * duty * (1.0 - duty) * v / (2.0 * 1e-4 * 20000.0)
    friction_nm = k * current - 4.5e-6 * duty * v / k
    w = steady(duty, 1.6, dead_time_s=dead_s, coulomb_nm=friction_nm)["speed_rad_s"]
    drawn = (friction_nm + 4.5e-6 * w) / k
    loss_share = (duty * v - r * drawn - k * w) / (2.0 * dead_s * 20000.0 * v)
    assert loss_share == pytest.approx(sign, abs=0.1)


def test_directional_friction_turns_with_the_direction() -> None:
    plain = steady(0.6)["speed_rad_s"]
    forward = steady(0.6, directional_viscous_nm_s=4e-6)["speed_rad_s"]
    backward = steady(-0.6, directional_viscous_nm_s=4e-6)["speed_rad_s"]
    assert forward < plain < -backward
    assert steady(-0.6, backward_nm=0.01)["speed_rad_s"] > -plain * 0.99


def test_supply_resistance_drops_the_bus_by_the_bus_current() -> None:
    setting = setting_of("staircase")
    run = simulate(setting, {"supply_resistance_ohm": 0.1} | NOISELESS)[0]
    duty = columns(setting, NOISELESS)["duty"]
    row = np.argmax(run.speed_rad_s)
    assert 18.0 - run.supply_v[row] == pytest.approx(0.1 * duty[row] * run.current_a[row], rel=0.01)


def test_inertia_slows_the_run_up_and_nothing_else() -> None:
    assert (
        steady(0.6, seconds=0.03, inertia_kg_m2=3e-5)["speed_rad_s"]
        < 0.75 * steady(0.6, seconds=0.03)["speed_rad_s"]
    )
    assert steady(0.6, seconds=1.5, inertia_kg_m2=3e-5)["speed_rad_s"] == pytest.approx(
        steady(0.6, seconds=1.5)["speed_rad_s"], rel=1e-4
    )


def test_heat_raises_resistance_by_copper_and_cools() -> None:
    setting, _, _ = pair("winding_heating", 0.5)
    run = simulate(
        setting, {"heating_kelvin_per_joule": 1.0, "heating_cooling_s": 0.2} | NOISELESS
    )[0]
    assert np.max(run.winding_kelvin) > 3.0
    assert run.winding_kelvin[-1] < 0.8 * np.max(run.winding_kelvin)


def test_transport_delay_shifts_the_run_by_its_length() -> None:
    setting = setting_of("ramps")
    without = simulate(setting, NOISELESS)[0]
    late = simulate(setting, {"transport_delay_s": 0.01} | NOISELESS)[0]
    assert np.max(np.abs(late.speed_rad_s[10:] - without.speed_rad_s[:-10])) < 0.01 * top_speed(
        setting.rig
    )
    assert np.max(np.abs(late.speed_rad_s - without.speed_rad_s)) > 0.02 * top_speed(setting.rig)


def test_current_gain_offset_and_limit_are_exact() -> None:
    setting = setting_of("staircase")
    plain = simulate(setting, NOISELESS)[0].current_a
    changed = simulate(setting, {"current_gain": 0.1, "current_offset_a": -0.5} | NOISELESS)[
        0
    ].current_a
    assert np.allclose(changed, 1.1 * plain - 0.5, atol=1e-9)
    assert np.max(
        simulate(setting, {"current_limit_a": 2.0} | NOISELESS)[0].current_a
    ) == pytest.approx(2.0)


def test_lost_edges_halve_single_speeds() -> None:
    setting = setting_of("staircase")
    run, _, _, sensors = simulate(setting, {"hall_dropout": 0.03} | NOISELESS)
    speed = speed_column(run, sensors)
    fast = np.abs(run.speed_rad_s) > 500.0
    ratio = speed[fast] / run.speed_rad_s[fast]
    assert 0.005 < np.mean((ratio > 0.45) & (ratio < 0.55)) < 0.2


def test_fast_clock_gives_later_time_stamps() -> None:
    setting = setting_of("ramps")
    table, skewed = columns(setting, NOISELESS), columns(setting, NOISELESS | {"clock_skew": 0.03})
    moving = np.argmax(np.abs(table["duty"]) > 0.05)
    assert np.argmax(np.abs(skewed["duty"]) > 0.05) >= moving
    assert np.array_equal(table["time_s"], skewed["time_s"])
    assert not np.array_equal(table["duty"], skewed["duty"])


@pytest.mark.parametrize("effect_id", FIRST)
def test_visible_limit_has_visibility_one(effect_id: str) -> None:
    setting = setting_of(PROFILE[BY_ID[effect_id].needs], seconds=4.0)
    limit = visible_limit(setting, effect_id)
    assert limit is not None
    assert visibility(setting, simulate(setting, NOISELESS)[0], effect_id, limit) == pytest.approx(
        1.0, abs=0.06
    )
