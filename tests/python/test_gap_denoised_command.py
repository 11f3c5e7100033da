"""A measured command: its noise is removed, its steps, ramps and quantisation stay, and the stated
error is the true one.
"""

import numpy as np
import pytest

from vgroove.gap.cleaning.denoised_command import denoise_command, straight_means
from vgroove.gap.cleaning.sensor_noise import command_noise_sigma, high_frequency_sigma

HOLDS = np.concatenate(
    [
        np.zeros(300),
        np.full(300, 6.0),
        np.linspace(6.0, 12.0, 300),
        np.full(300, 12.0),
        np.full(400, 3.0),
    ]
)
LEVEL_V = 18.0 / 255.0


def slewed(rows_per_ramp: int, level_v: float = LEVEL_V) -> np.ndarray:
    """Plateaus of 400 rows and ramps between them, quantised to the levels of a timer."""
    ends = np.random.default_rng(2).uniform(0.0, 18.0, 12)
    parts = [
        np.concatenate([np.full(400, a), np.linspace(a, b, rows_per_ramp)])
        for a, b in zip(ends, ends[1:], strict=False)
    ]
    return np.round(np.concatenate(parts) / level_v) * level_v


def noisy(clean: np.ndarray, sigma: float) -> np.ndarray:
    return np.round(clean + sigma * np.random.default_rng(1).standard_normal(len(clean)), 3)


def test_a_noisy_command_keeps_its_steps_and_slopes() -> None:
    found = denoise_command(noisy(HOLDS, 0.05)).values - HOLDS
    inner = np.r_[100:200, 400:500, 1000:1100, 1300:1500]
    # 0.05 over the root of 200 rows, the windows' ends included
    assert np.sqrt(np.mean(found[inner] ** 2)) < 0.007
    assert found[np.r_[10:290, 310:590, 910:1190]].std() < 0.5 * 0.05
    assert abs(found[610:890].mean()) < 0.005  # a slope stays where it is
    assert np.abs(found)[[298, 299, 300, 301]].max() < 0.2  # a step of 6 V stays a step


@pytest.mark.parametrize(
    "clean", [HOLDS, slewed(60), slewed(400), np.round(HOLDS / 0.07) * 0.07, np.full(500, 3.0)]
)
def test_a_command_without_noise_stays_as_it_is(clean: np.ndarray) -> None:
    found = denoise_command(clean)
    assert found.values is clean and found.noise_v == 0.0 and found.fast_v == 0.0


@pytest.mark.parametrize("limit_v", [0.0, 7.4])
def test_a_command_at_its_limit_keeps_the_controllers_scatter(limit_v: float) -> None:
    """A controller at its limit holds its command exactly: the scatter elsewhere is its own."""
    scatter = 0.002 * np.random.default_rng(1).standard_normal(620)
    driven = 3.0 * np.sin(7.0 * 0.005 * np.arange(620)) + scatter
    command = np.concatenate([driven, np.full(570, limit_v)])
    assert command_noise_sigma(command) > 0.0
    found = denoise_command(command)
    assert found.values is command and found.noise_v == 0.0 and found.fast_v == 0.0


def test_few_steps_between_long_holds_are_no_noise() -> None:
    """Most rows repeat the one before: only the steps scatter."""
    assert command_noise_sigma(np.repeat([0.0, 7.0, 0.0, 11.0, 0.0], 700)) == 0.0


@pytest.mark.parametrize(
    "clean, sigma",
    [
        (HOLDS, 0.05),
        (slewed(60), 0.02),
        (slewed(150), 0.02),
        (slewed(60, 0.14), 0.02),
        (slewed(400), 0.05),
    ],
)
@pytest.mark.parametrize("rows", [1, 10, 40])
def test_the_stated_error_is_the_true_one(clean: np.ndarray, sigma: float, rows: int) -> None:
    """The stated RMS error of the denoised command, of single rows and of means over `rows` rows (a
    time constant of the shaft), is the true one.
    """
    found = denoise_command(noisy(clean, sigma))
    error = np.convolve(found.values - clean, np.full(rows, 1.0 / rows), mode="valid")
    stated = np.sqrt(
        np.mean(
            found.noise_v**2 / (found.averaged + rows - 1.0) + np.asarray(found.fast_v) ** 2 / rows
        )
    )
    assert 0.6 < stated / np.sqrt(np.mean(error**2)) < 1.7


def test_a_curve_is_followed() -> None:
    t = np.arange(4000) / 1000.0
    clean = 9.0 + 5.0 * np.sin(2.0 * np.pi * (0.3 + 0.5 * t) * t)
    found = denoise_command(noisy(clean, 0.02))
    error = found.values - clean
    assert np.sqrt(np.mean(error**2)) < 0.02  # no worse than as it was logged
    assert np.abs(np.convolve(error, np.full(50, 0.02), mode="valid")).max() < 0.02


def test_a_window_ends_before_the_bend() -> None:
    clean = np.concatenate([np.zeros(200), 0.02 * np.arange(200)])
    mean, averaged = straight_means(noisy(clean, 0.02), 0.02)
    assert averaged[150] > 60 and abs(mean[150]) < 0.01
    assert averaged[199] < 20 and abs(mean[199]) < 0.06


@pytest.mark.parametrize(("hold", "most"), [(400, 0.021), (16, 0.03), (10, 0.042)])
def test_steps_that_follow_closely_are_hardly_taken_for_noise(hold: int, most: float) -> None:
    random = np.random.default_rng(4)
    levels = np.repeat(random.uniform(-10.0, 10.0, 8000 // hold), hold)
    assert 0.019 < high_frequency_sigma(levels + 0.02 * random.standard_normal(8000)) < most
