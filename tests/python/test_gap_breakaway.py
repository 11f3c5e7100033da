"""Speed uncertainty from pre-sliding friction after a rest: where it applies, its size, and that
the residuals are uncorrelated whatever the gained speed was.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vgroove.gap.residual.breakaway import (
    SpeedRecord,
    breakaway_sigma_rad_s,
    breakaways,
    widen_after_breakaway,
)
from vgroove.gap.residual.channels import AngleChannel, RowChannel
from vgroove.gap.residual.local_polynomial import Observations
from vgroove.gap.residual.shared_errors import SharedErrors
from vgroove.rig import Rig, read_rig
from vgroove.units import RPM_PER_RAD_S

TIME = np.arange(1, 401) * 5e-3
# rad/s; starts at 0.2 s, reverses at 1.05 s
SPEED = np.interp(
    TIME,
    [0.0, 0.2, 0.5, 0.9, 1.1, 1.4, 1.5, 2.0],
    [0.0, 0.0, 300.0, 300.0, -100.0, -100.0, 0.0, 0.0],
)


def seen(noise: float = 0.0) -> Observations:
    return Observations(
        TIME - 5e-3,
        TIME,
        SPEED + noise * np.random.default_rng(1).normal(size=len(TIME)),
        np.full(len(TIME), 0.5),
    )


def speeds(sigma: np.ndarray) -> RowChannel:
    count = len(TIME)
    return RowChannel(
        "speed_rpm",
        "rpm",
        np.arange(count),
        TIME,
        np.zeros(count),
        sigma,
        np.arange(count) % 7 == 3,
        key="speed",
    )


def residual(channel: RowChannel, error: np.ndarray) -> np.ndarray:
    """Residuals (B, n) where the model is off by errors (B, n) of the signal."""
    return (channel.measured - channel.compared({"speed": -error})) / channel.sigma


@pytest.fixture
def rig() -> Rig:
    rig = read_rig(Path(__file__).resolve().parents[2] / "rigs/impact_driver_drive.toml")
    return replace(rig, input={"kind": "current_a"}, motor=rig.motor | {"coulomb_nm": 0.01})


@pytest.fixture
def opened(rig: Rig) -> RowChannel:
    sigma = np.random.default_rng(2).uniform(0.5, 4.0, len(TIME))
    record = SpeedRecord(seen(0.5), 0.0, False)
    return widen_after_breakaway((speeds(sigma),), record, rig, np.array([0.0, 0.42, 0.8, 1.3]))[0]


def test_a_shaft_breaks_away_where_it_starts_and_where_it_reverses() -> None:
    for noise in (0.0, 0.5):  # noise at rest is no reversal
        instants, acceleration = breakaways(SpeedRecord(seen(noise), 0.0, False))
        assert instants == pytest.approx([0.2, 1.05], abs=0.011)
        assert acceleration == pytest.approx([1000.0, 2000.0], rel=0.2)
    assert (
        len(breakaways(SpeedRecord(seen(), 0.0, True))[0]) == 1
    )  # a log that begins in motion has no start


@pytest.mark.parametrize("acceleration", [300.0, 2000.0, 15000.0])
def test_the_gained_speed_is_that_of_a_friction_that_builds_up_over_a_small_angle(
    rig: Rig, acceleration: float
) -> None:
    inertia, coulomb, dt = rig.shaft_inertia_kg_m2, rig.motor["coulomb_nm"], 1e-6
    speed = angle = 0.0
    for _ in range(int(30e-3 / dt)):  # Dahl's friction, which builds up over 0.8 mrad
        speed += dt * (acceleration + coulomb / inertia * np.exp(-angle / 8e-4))
        angle += dt * speed
    gained = speed - 30e-3 * acceleration
    assert 0.2 < gained / breakaway_sigma_rad_s(rig, np.array([acceleration]))[0] < 2.0


def test_the_offset_lasts_up_to_the_next_restart_and_censored_samples_have_none(
    opened: RowChannel,
) -> None:
    held = opened.shared.loadings[:, 0] > 0.0
    expected = (TIME > 0.2) & (TIME < 0.42) | (TIME > 1.05) & (TIME < 1.3)
    unlike = TIME[held != (expected & ~opened.censored)]
    assert len(unlike) <= 2  # at 0.2 and 1.05 s the speed is within the noise of a rest
    assert np.all(np.minimum(np.abs(unlike - 0.2), np.abs(unlike - 1.05)) < 0.011)


def test_residuals_with_an_unknown_shared_offset_are_uncorrelated(opened: RowChannel) -> None:
    white = residual(opened, np.diag(opened.sigma)).T  # r' = white @ r
    group, loadings = opened.shared.group, opened.shared.loadings[:, 0]
    shared = np.stack([np.where(group == p, loadings, 0.0) for p in np.unique(group)])
    assert white @ (np.eye(len(TIME)) + shared.T @ shared) @ white.T == pytest.approx(
        np.eye(len(TIME)), abs=1e-9
    )


def test_a_likely_offset_is_removed_and_an_unlikely_one_stays(opened: RowChannel) -> None:
    offset_rpm = opened.shared.loadings[:, 0] * opened.sigma
    first = (opened.shared.group == 0) & (offset_rpm > 0.0)
    left = [
        residual(opened, np.where(first, factor * offset_rpm, 0.0)[None])[0]
        for factor in (1.0, 100.0)
    ]
    assert np.sum(left[0] ** 2) < 1.0 and np.sum(left[1] ** 2) > 1e3
    assert not np.any(left[0][~first])


def test_with_a_voltage_as_input_there_is_no_offset(rig: Rig) -> None:
    channel = speeds(np.ones(len(TIME)))
    driven = replace(rig, input={"kind": "voltage_v"})
    record = SpeedRecord(seen(), 0.0, False)
    assert widen_after_breakaway((channel,), record, driven, np.zeros(1))[0] is channel
    widened = widen_after_breakaway((channel,), record, rig, np.zeros(1))[0]
    assert widened.shared.loadings.max() < RPM_PER_RAD_S * 5.0  # sigma of the samples is 1 rpm


def test_an_angle_is_off_by_the_gained_speed_times_the_time_since_the_breakaway(rig: Rig) -> None:
    count, sigma = len(TIME), 0.25
    angle = AngleChannel(
        "position_rad",
        "rad",
        np.arange(count),
        TIME,
        np.zeros(count),
        np.full(count, sigma),
        np.zeros(count, bool),
        shared=SharedErrors(np.zeros(count, int), np.ones((count, 1))),
    )
    record, restarts = SpeedRecord(seen(), 0.0, False), np.array([0.0, 0.42, 1.3])
    widened = widen_after_breakaway((angle,), record, rig, restarts)[0].shared.loadings
    (first, _), acceleration = breakaways(record)
    gained = breakaway_sigma_rad_s(rig, acceleration)[0]
    after = (TIME >= first) & (TIME < 0.42)
    assert np.all(widened[:, 0] == 1.0) and not widened[TIME < first, 1].any()
    assert widened[after, 1] == pytest.approx(gained * (TIME[after] - first) / sigma)
