"""simulate_log as an interface: equal bytes, restarts, missing samples, delays, ranges, and its
speed over real time.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import plant_reference as ref
from test_plant_reference import EFFECTS, drive_log, plant_run, theta_of
from vgroove import _core as core
from vgroove.rig import read_rig

ROOT = Path(__file__).resolve().parents[2]
RNG_SEED = 11


def long_log(seconds: float = 6.0) -> core.LogInput:
    """1 kHz, slewed duty of an 8-bit command, load steps."""
    time_s = np.arange(1, int(1000 * seconds) + 1) / 1000.0
    duty = np.clip(1.2 * np.sin(2.5 * time_s) * np.sin(0.7 * time_s + 1.0), -1.0, 1.0)
    duty = np.round(255 * duty) / 255
    load = np.where(np.sin(9.0 * time_s) > 0.3, 0.6, 0.0)
    return core.LogInput(time_s, "duty", duty, 8.0, None, load, None, "torque")


def batch_theta(count: int) -> np.ndarray:
    rng = np.random.default_rng(RNG_SEED)
    names = [
        None,
        "coulomb_friction",
        "stribeck_friction",
        "brush_drop",
        "supply_droop",
        "coupler_compliance",
        "transport_delay",
    ]
    rows = []
    for n in range(count):
        name = names[n % len(names)]
        tool = ref.Tool(r=0.19 * rng.uniform(0.9, 1.1), tc=0.012 * rng.uniform(0.8, 1.2))
        tool.effects = {} if name is None else {name: EFFECTS[name]}
        rows.append(theta_of(tool))
    return np.array(rows)


def test_parameters_are_named_once_and_neutral() -> None:
    names, neutral = core.PARAMETERS, core.parameter_defaults()
    assert len(names) == len(set(names)) == neutral.size
    assert neutral[names.index("effects.magnetic_saturation.saturation_a")] == np.inf
    assert neutral[names.index("gearbox.ratio")] == 1.0


@pytest.mark.parametrize("least_lanes", [0, 2, 8])
def test_results_do_not_depend_on_batch_threads_or_vectors(least_lanes: int) -> None:
    log, theta = long_log(0.6), batch_theta(37)
    starts, state0 = np.array([0, 250]), np.array([[0.0, 0.0, 0.0], [5.0, 300.0, 1.0]])
    together = core.simulate_log(log, theta, starts, state0, 2, least_lanes=least_lanes)
    single_thread = core.simulate_log(log, theta[::-1].copy(), starts, state0, 1)
    for name, column in together.items():
        assert column.tobytes() == single_thread[name][::-1].tobytes(), name
        for row in (0, 5, 36):
            alone = core.simulate_log(log, theta[row : row + 1], starts, state0, 1)
            assert alone[name][0].tobytes() == column[row].tobytes(), (name, row)


def test_starts_reset_fast_states_and_leave_rows_before_the_first_empty() -> None:
    log, theta = long_log(0.5), theta_of(ref.Tool())[None, :]
    out = core.simulate_log(
        log, theta, np.array([100, 300]), np.array([[3.0, 200.0, 7.0], [-1.0, 50.0, 2.0]]), 1
    )
    assert np.all(np.isnan(out["current_a"][0, :100])) and np.all(
        np.isfinite(out["current_a"][0, 100:])
    )
    assert out["current_a"][0, [100, 300]].tolist() == [3.0, -1.0]
    assert out["speed_rad_s"][0, [100, 300]].tolist() == [200.0, 50.0]
    assert out["angle_rad"][0, [100, 300]].tolist() == [7.0, 2.0]


def test_restart_at_the_state_of_the_run_changes_nothing() -> None:
    theta, at = theta_of(ref.Tool())[None, :], 300
    log = core.LogInput(np.arange(1, 501) / 1000.0, "current_a", np.full(500, 4.0))
    free = core.simulate_log(log, theta, np.array([0]), np.zeros((1, 3)), 1)
    state = np.array([[4.0, free["speed_rad_s"][0, at], free["angle_rad"][0, at]]])
    again = core.simulate_log(log, theta, np.array([at]), state, 1)
    assert np.allclose(again["angle_rad"][0, at:], free["angle_rad"][0, at:], rtol=1e-9)


@pytest.mark.parametrize(
    "name,slow",
    [
        ("winding_heating", True),
        ("supply_droop", True),
        ("cold_grease", True),
        ("current_lag", False),
    ],
)
def test_slow_states_continue_at_later_starts(name: str, slow: bool) -> None:
    log = long_log(1.0)
    theta = theta_of(ref.Tool(effects={name: EFFECTS[name]}))[None, :]
    state = np.array([[5.0, 300.0, 0.0]])
    through = core.simulate_log(log, theta, np.array([0, 800]), np.concatenate([state, state]), 1)[
        "current_a"
    ][0, 805]
    cold_log = core.simulate_log(log, theta, np.array([800]), state, 1)["current_a"][0, 805]
    if name == "cold_grease":  # its time counts from the log's first row, also for a later start
        assert through == pytest.approx(cold_log, rel=1e-9)
    elif slow:
        assert abs(through - cold_log) > 1e-3
    else:
        assert through == pytest.approx(cold_log, abs=1e-9)


def test_missing_command_and_load_hold_the_last_value() -> None:
    time_s = np.arange(1, 201) / 1000.0
    duty, load = np.full(200, 0.5), np.full(200, 0.3)
    given = theta_of(ref.Tool())[None, :], np.array([0]), np.zeros((1, 3)), 1
    whole = core.simulate_log(
        core.LogInput(time_s, "duty", duty, None, None, load, None, "torque"), *given
    )
    duty[50:60], load[80] = np.nan, np.nan
    with_gaps = core.simulate_log(
        core.LogInput(time_s, "duty", duty, None, None, load, None, "torque"), *given
    )
    assert whole["current_a"].tobytes() == with_gaps["current_a"].tobytes()


def test_pure_delay_of_the_speed_sensor() -> None:
    lag = {"time_constant_s": 0.0034, "lag_form": 1.0}
    log = drive_log()
    plain = plant_run(ref.Tool(), log, (0.0, 40.0, 1.0))
    late = plant_run(ref.Tool(effects={"speed_lag": lag}), log, (0.0, 40.0, 1.0))
    assert np.allclose(late["speed_rad_s"], plain["speed_rad_s"])
    rows = np.flatnonzero(log.time_s > 0.0034)
    angle = np.interp(log.time_s[rows] - 0.0034, log.time_s, plain["angle_rad"])
    # np.interp is linear between rows of up to 9 ms, the plant's angle is a curve: at most 1 rad
    assert np.max(np.abs(late["angle_measured_rad"][rows] - angle)) < 1.0
    steady = core.LogInput(np.arange(0, 2001) / 1000.0, "voltage_v", np.full(2001, 9.0))
    out = core.simulate_log(
        steady,
        theta_of(ref.Tool(effects={"speed_lag": lag}))[None, :],
        np.array([0]),
        np.zeros((1, 3)),
        1,
    )
    behind = out["angle_rad"][0, -1] - out["angle_measured_rad"][0, -1]
    assert behind == pytest.approx(0.0034 * out["speed_rad_s"][0, -1], rel=1e-6)


@pytest.mark.parametrize("skew", [0.0, 0.02])
def test_a_speed_sensor_that_averages_shows_the_turned_angle_over_its_window(skew: float) -> None:
    effects = {"speed_lag": {"time_constant_s": 0.0034, "lag_form": 2.0}}
    if skew:
        effects["clock_skew"] = {"relative": skew}
    time_s = np.arange(0, 1001) / 1000.0
    log = core.LogInput(time_s, "voltage_v", np.where(time_s < 0.5, 9.0, 4.0))
    theta = theta_of(ref.Tool(effects=effects))[None, :]
    out = core.simulate_log(log, theta, np.array([0]), np.array([[0.0, 30.0, 0.0]]), 1)
    angle, back = out["angle_rad"][0], 0.0068 * (1.0 + skew)
    # before the start the shaft has the speed of the start
    early = np.interp(time_s - back, time_s, angle)
    early = np.where(time_s < back, 30.0 * (time_s - back) / (1.0 + skew), early)
    mean = (angle - early) / 0.0068
    np.testing.assert_allclose(out["speed_measured_rad_s"][0], mean, rtol=2e-3, atol=0.5)
    np.testing.assert_allclose(out["angle_measured_rad"][0], angle, rtol=1e-9)


def test_rest_is_exact_up_to_the_coulomb_torque() -> None:
    tool = ref.Tool()
    volts = tool.tc / tool.k * tool.r
    time_s = np.arange(0, 501) / 1000.0
    theta = theta_of(tool)[None, :]
    for factor, moves in ((0.9999, False), (-0.9999, False), (1.001, True)):
        log = core.LogInput(time_s, "voltage_v", np.full(501, factor * volts))
        out = core.simulate_log(log, theta, np.array([0]), np.zeros((1, 3)), 1)
        assert (out["angle_rad"][0, -1] != 0.0) == moves
        assert (out["speed_rad_s"][0, -1] != 0.0) == moves


@pytest.mark.parametrize(
    "key,value",
    [
        ("motor.inductance_h", 0.0),
        ("motor.inertia_kg_m2", -1.0),
        ("gearbox.ratio", 0.0),
        ("motor.coulomb_nm", np.nan),
    ],
)
def test_impossible_values_are_refused_by_name(key: str, value: float) -> None:
    theta = theta_of(ref.Tool())
    theta[core.PARAMETERS.index(key)] = value
    with pytest.raises(ValueError, match=key.split(".")[1].split("_")[0]):
        core.simulate_log(long_log(0.1), theta[None, :], np.array([0]), np.zeros((1, 3)), 1)


def test_bad_shapes_and_times_are_refused() -> None:
    theta = theta_of(ref.Tool())[None, :]
    with pytest.raises(ValueError, match="increase"):
        core.simulate_log(
            core.LogInput(np.array([0.0, 1.0, 1.0]), "duty", np.zeros(3)),
            theta,
            np.array([0]),
            np.zeros((1, 3)),
            1,
        )
    with pytest.raises(ValueError, match="starts"):
        core.simulate_log(long_log(0.1), theta, np.array([5, 5]), np.zeros((2, 3)), 1)
    with pytest.raises(ValueError, match="state0"):
        core.simulate_log(long_log(0.1), theta, np.array([0]), np.zeros((2, 3)), 1)
    with pytest.raises(ValueError, match="duty, voltage_v or current_a"):
        core.LogInput(np.array([0.0, 1.0]), "volts", np.zeros(2))


def speed_figure(effects: dict[str, dict[str, float]], lanes: int, threads: int) -> float:
    """Simulated time of all lanes over processor time, the largest of nine runs. Processor time
    hardly depends on what else the machine does.
    """
    log = long_log(30.0)
    theta = np.repeat(theta_of(ref.Tool(effects=effects))[None, :], lanes, axis=0)
    theta[:, core.PARAMETERS.index("motor.resistance_ohm")] *= np.linspace(0.95, 1.05, lanes)
    best = np.inf
    for _ in range(9):
        begun = time.process_time()
        core.simulate_log(log, theta, np.array([0]), np.zeros((1, 3)), threads)
        best = min(best, time.process_time() - begun)
    return 30.0 * lanes / best


def test_speed_figure(record_property: pytest.FixtureRequest) -> None:
    """pytest -s prints the figures. The limit is far below them, so that a busy machine passes."""
    single = speed_figure({}, 1, 1)
    batch = speed_figure({}, 32, 2)
    print(  # noqa: T201
        f"\nsimulate_log, 1 kHz: one lane {single:,.0f} x real time, "
        f"32 lanes on 2 threads {batch:,.0f} x per core"
    )
    assert single > 1500.0
    assert batch > 0.5 * single


@pytest.mark.parametrize(
    ("effect", "least_rad_s"),
    [
        ({"gear_backlash": {"play_rad": 0.2}}, 50.0),
        (
            {
                "coupler_compliance": {
                    "stiffness_nm_per_rad": 1.0,
                    "damping_ratio": 0.05,
                    "inertia_kg_m2": 0.0,
                }
            },
            30.0,
        ),
    ],
)
def test_the_inertia_of_a_pendulum_is_an_output_side(effect: dict, least_rad_s: float) -> None:
    """The limit of a vanishing inertia of the gearbox is that of none."""
    time_s = np.arange(0.0, 1.5, 1e-3)
    log = core.LogInput(
        time_s, "duty", 0.3 * np.sign(np.sin(8.0 * time_s + 0.1)), load_kind="pendulum"
    )

    def speed(output_kg_m2: float, effects: dict) -> np.ndarray:
        rig = read_rig(ROOT / "rigs/pendulum.toml").with_effects(effects)
        rig = rig.with_values({"gearbox.output_inertia_kg_m2": output_kg_m2})
        theta = rig.parameters()[None, :]
        return core.simulate_log(log, theta, np.array([0]), np.zeros((1, 3)), 1)["speed_rad_s"][0]

    without, limit = speed(0.0, effect), speed(1e-9, effect)
    assert np.allclose(without, limit, atol=0.5)
    assert np.max(np.abs(without - speed(0.0, {}))) > least_rad_s
