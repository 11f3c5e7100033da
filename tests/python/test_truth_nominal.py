"""With every effect off the generator agrees with the nominal model, integrated by SciPy with an
averaged bridge, to about the noise.
"""

from dataclasses import replace

import numpy as np
import pytest

from truth_helpers import (
    NOISELESS,
    RPM_PER_RAD_S,
    Command,
    columns,
    deviations,
    gap,
    hall_rows,
    nominal_run,
    setting_of,
    simulate,
)

PROFILES = ("staircase", "ramps", "reversals", "load_steps", "hand", "chirp", "crawl")


def logged_command(table: dict[str, np.ndarray]) -> Command:
    """The command by the rows of a log, linear between them."""
    time = np.concatenate([[0.0], table["time_s"]])
    load = table.get("load_nm", np.zeros(len(table["time_s"])))
    return Command(
        time,
        np.concatenate([[0.0], table["duty"]]),
        np.zeros(len(time)),
        time,
        np.concatenate([[0.0], load]),
    )


@pytest.mark.parametrize("profile", PROFILES)
def test_effect_free_run_is_the_nominal_model(profile: str) -> None:
    setting = setting_of(profile)
    run, _, _, sensors = simulate(setting, NOISELESS)
    model = nominal_run(setting.rig, logged_command(columns(setting, NOISELESS)), run.time_s)
    found = deviations(run, model, sensors, sensors)
    limits = {"current_a": 0.15, "supply_v": 0.15, "speed_rpm": 0.9}
    assert not {
        name: gap({name: values})
        for name, values in found.items()
        if gap({name: values}) > limits[name]
    }


def test_supply_resistance_of_the_rig_is_the_nominal_model() -> None:
    setting = setting_of("staircase", supply_resistance_ohm=0.05)
    run, _, _, sensors = simulate(setting, NOISELESS)
    model = nominal_run(setting.rig, logged_command(columns(setting, NOISELESS)), run.time_s)
    found = deviations(run, model, sensors, sensors)
    assert gap({"supply_v": found["supply_v"]}) < 0.3
    assert gap(found) < 0.6
    assert np.min(run.supply_v) < 17.7


def test_log_of_an_effect_free_run_has_a_gap_of_about_one() -> None:
    setting = setting_of("staircase")
    table = columns(setting, {})
    run, _, _, sensors = simulate(setting, {})
    model = nominal_run(setting.rig, logged_command(table), run.time_s)
    found = deviations(run, model, sensors, sensors)  # its speed carries the edges' jitter already
    found["current_a"] = (table["current_a"] - model.current_a) / np.hypot(0.15, 0.1 / 12**0.5)
    found["supply_v"] = (table["supply_v"] - model.supply_v) / np.hypot(0.02, 0.02 / 12**0.5)
    assert 0.93 < gap(found) < 1.1


def test_comparison_detects_a_resistance_off_by_half_a_percent() -> None:
    setting = setting_of("staircase")
    run, _, _, sensors = simulate(setting, NOISELESS)
    wrong = replace(setting.rig, resistance_ohm=setting.rig.resistance_ohm * 1.005)
    model = nominal_run(wrong, logged_command(columns(setting, NOISELESS)), run.time_s)
    assert gap(deviations(run, model, sensors, sensors)) > 0.8


def test_speed_column_is_one_pitch_over_the_last_edge_period_and_falls() -> None:
    setting = setting_of("stop_and_go")
    run, _, _, sensors = simulate(setting, NOISELESS)
    speed, at, period = hall_rows(run, sensors)
    fresh = ~np.isnan(at)
    turning = fresh & (np.abs(run.speed_rad_s) > 300.0)
    assert np.max(np.abs(np.abs(speed[turning]) * period[turning] - np.pi / 2)) < 1e-9
    last = np.searchsorted(run.edge_s, run.time_s, side="right") - 1
    since_edge = run.time_s - run.edge_s[np.maximum(last, 0)]
    late = (last >= 1) & (since_edge > 1e-6) & (speed != 0.0)
    assert np.all(np.abs(speed[late]) <= np.pi / 2 / since_edge[late] + 1e-9)
    assert np.all(speed[(last >= 0) & (since_edge > sensors.hall_timeout_s)] == 0.0)


def test_counting_speed_of_an_encoder_follows_the_shaft() -> None:
    setting = setting_of("staircase")
    sensors = replace(setting.rig.sensors, hall_pulses_per_rev=64)
    setting = replace(
        setting,
        rig=replace(setting.rig, sensors=sensors),
        tool=replace(setting.tool, sensors=sensors),
    )
    run, _, _, sensors = simulate(setting, NOISELESS)
    speed = hall_rows(run, sensors)[0]
    fast = np.abs(run.speed_rad_s) > 200.0
    assert np.sqrt(np.mean((speed[fast] - run.speed_rad_s[fast]) ** 2)) * RPM_PER_RAD_S < 60.0
