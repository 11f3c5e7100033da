"""Dead samples: values that no sensor produces are taken as missing, values that a tool can produce
are kept, and a log in which nothing changes is refused.
"""

import tomllib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.dead_samples import remove_dead_samples
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict

ROWS = 4000
TOML = """
schema = "vgroove.rig/1"
name = "dead samples"
[input]
kind = "duty"
[supply]
voltage_v = 18.0
[motor]
resistance_ohm = 0.19
inductance_h = 100e-6
torque_constant_nm_per_a = 0.0109
inertia_kg_m2 = 1.6e-5
viscous_nm_s_per_rad = 4.5e-6
coulomb_nm = 0.012
[gearbox]
ratio = 5.6
output_inertia_kg_m2 = 6e-5
[mechanism]
kind = "none"
[load]
kind = "none"
[sensors]
log_hz = 1000
hall_pulses_per_rev = 4
hall_timeout_s = 0.05
"""


@pytest.fixture
def rig() -> Rig:
    return rig_from_dict(tomllib.loads(TOML), "made")


@pytest.fixture
def log() -> Log:
    """Two strokes with a rest between them: rounded speeds repeat themselves, the current is 0
    while the bridge is open.
    """
    rng, time_s = np.random.default_rng(3), 1e-3 * np.arange(ROWS)
    duty = 0.6 * np.abs(np.sin(np.pi * time_s / 2.0))
    coast = (np.abs(time_s - 2.0) < 0.1).astype(float)
    speed = np.round(15000.0 * duty / 0.5 * (1.0 + 0.002 * rng.standard_normal(ROWS))) * 0.5
    current = np.round((6.0 + 8.0 * duty + 0.15 * rng.standard_normal(ROWS)) * (coast == 0.0), 1)
    supply = np.round(18.0 - 0.01 * current + 0.02 * rng.standard_normal(ROWS), 2)
    return Log(
        time_s,
        {
            "duty": duty,
            "coast": coast,
            "current_a": current,
            "speed_rpm": speed,
            "supply_v": supply,
        },
        "made",
    )


def missing(log: Log, rig: Rig, name: str) -> np.ndarray:
    """Rows that were taken as missing."""
    return np.flatnonzero(np.isnan(remove_dead_samples(log, rig).columns[name]))


def test_a_log_without_dead_samples_is_returned_unchanged(log: Log, rig: Rig) -> None:
    assert remove_dead_samples(log, rig) is log


@pytest.mark.parametrize("name", ["current_a", "speed_rpm", "supply_v"])
def test_single_zeros_are_missing(log: Log, rig: Rig, name: str) -> None:
    hit = np.array([500, 777, 1200, 3100])
    log.columns[name][hit] = 0.0
    np.testing.assert_array_equal(missing(log, rig, name), hit)
    assert name in remove_dead_samples(log, rig).warnings[-1]


@pytest.mark.parametrize("name", ["current_a", "speed_rpm", "supply_v"])
def test_a_dropped_stretch_is_missing(log: Log, rig: Rig, name: str) -> None:
    log.columns[name][700:900] = 0.0
    assert set(range(701, 900)) <= set(missing(log, rig, name)) <= set(range(700, 900))


@pytest.mark.parametrize("name", ["current_a", "speed_rpm", "supply_v"])
def test_a_frozen_stretch_is_missing(log: Log, rig: Rig, name: str) -> None:
    log.columns[name][400:800] = log.columns[name][400]
    assert set(range(402, 799)) <= set(missing(log, rig, name)) <= set(range(400, 801))


def test_spikes_are_missing(log: Log, rig: Rig) -> None:
    log.columns["current_a"][[600, 1500]] += 60.0
    np.testing.assert_array_equal(missing(log, rig, "current_a"), [600, 1500])


def test_a_spike_at_a_step_of_the_command_is_kept(log: Log, rig: Rig) -> None:
    log.columns["duty"][600:] += 0.3
    log.columns["current_a"][600] += 60.0
    assert 600 not in missing(log, rig, "current_a")


def test_frequent_spikes_are_kept(log: Log, rig: Rig) -> None:
    log.columns["current_a"][5::20] += 60.0
    assert len(missing(log, rig, "current_a")) == 0


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["current_a"].__setitem__(slice(1950, 2050), 0.0),  # open bridge
        lambda c: c["speed_rpm"].__setitem__(slice(1980, 2020), 0.0),  # standstill
        # a clipped sensor stands at its limit
        lambda c: c.__setitem__("current_a", np.minimum(c["current_a"], 9.0)),
        lambda c: c["speed_rpm"].__setitem__(slice(20, 60), 150.0),  # a slow shaft between edges
        lambda c: c["speed_rpm"].__setitem__(
            800, 0.5 * c["speed_rpm"][800]
        ),  # an edge that was missed
    ],
)
def test_values_that_a_tool_can_produce_are_kept(
    log: Log, rig: Rig, change: Callable[[dict], None]
) -> None:
    change(log.columns)
    assert remove_dead_samples(log, rig) is log


def test_a_sensor_that_repeats_itself_while_nothing_moves_is_kept(log: Log, rig: Rig) -> None:
    for name, value in (
        ("duty", 0.5),
        ("current_a", 10.0),
        ("speed_rpm", 12500.0),
        ("supply_v", 17.9),
    ):
        ramp = np.concatenate(
            [np.linspace(0.0, 1.0, 1000), np.ones(2000), np.linspace(1.0, 0.0, 1000)]
        )
        log.columns[name] = value * ramp + (name == "supply_v") * (1.0 - ramp) * 18.0
    log.columns["coast"][:] = 0.0
    assert remove_dead_samples(log, rig) is log


def test_a_log_in_which_nothing_changes_is_refused(log: Log, rig: Rig) -> None:
    for name in ("current_a", "speed_rpm", "supply_v"):
        log.columns[name][:] = log.columns[name][0]
    with pytest.raises(VgrooveError, match="no measured column changes"):
        remove_dead_samples(log, rig)


@pytest.mark.parametrize("with_coast", [True, False])
def test_a_current_of_0_is_dropped_only_where_the_bridge_is_not_open(
    with_coast: bool, rig: Rig
) -> None:
    """Pulse mode: the bridge is open for two of ten rows, in which the current is 0."""
    rng, rows = np.random.default_rng(2), np.arange(600)
    open_rows = rows % 10 < 2
    current = np.where(open_rows, 0.0, 19.0 + 0.5 * rng.standard_normal(600))
    columns = {"duty": np.ones(600), "current_a": current, "speed_rpm": 6000.0 + rows % 7}
    if with_coast:
        columns["coast"] = open_rows.astype(float)
    found = remove_dead_samples(Log(0.01 * rows, columns, "pulses"), rig)
    missing = np.isnan(found["current_a"])
    assert not missing.any() if with_coast else missing[open_rows].mean() > 0.9


@pytest.mark.parametrize("stops", [True, False])
def test_a_slowly_logged_shaft_may_rest_where_nothing_drives_it(stops: bool, rig: Rig) -> None:
    rows = np.arange(240)
    rest = rows % 16 < 8
    duty = np.where(rest, 0.0, 0.6) if stops else np.full(240, 0.6)
    columns = {"duty": duty, "speed_rpm": np.where(rest, 0.0, 9212.0 - rows % 5)}
    stated = replace(rig, sensors={"log_hz": 4.0})
    found = remove_dead_samples(Log(0.25 * rows, columns, "start and stop"), stated)
    removed = np.isnan(found["speed_rpm"])[rest].mean()
    assert removed == 0.0 if stops else removed > 0.9


@pytest.mark.parametrize("flag", ["coast", "duty"])
def test_a_speed_that_drops_to_0_for_a_row_of_a_run_down_is_removed(flag: str, rig: Rig) -> None:
    """No shaft stops and starts within a small part of its time constant."""
    rows = np.arange(4000)
    driven = rows % 1000 < 500
    speed = np.where(driven, 8000.0, 8000.0 * np.exp(-(rows % 1000 - 500) / 2000.0)) + rows % 7
    dropped = rows[50::67]
    speed[dropped] = 0.0
    columns = {"duty": np.where(driven | (flag == "coast"), 0.6, 0.0), "speed_rpm": speed}
    if flag == "coast":
        columns["coast"] = (~driven).astype(float)
    stated = replace(rig, sensors={"log_hz": 1000.0})
    found = remove_dead_samples(Log(1e-3 * rows, columns, "run down"), stated)
    assert np.array_equal(np.flatnonzero(np.isnan(found["speed_rpm"])), dropped)
