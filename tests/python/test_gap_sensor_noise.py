"""The filter whose residual is taken as the sensors' noise."""

import numpy as np
import pytest
from scipy.signal import savgol_coeffs, savgol_filter

from vgroove.gap.cleaning.sensor_noise import (
    FILTER_ORDER,
    FILTER_ROWS,
    SHORT_ORDER,
    SHORT_ROWS,
    high_frequency_sigma,
    high_pass_residual,
    residual_power_share,
)

FILTERS = [(FILTER_ROWS, FILTER_ORDER), (SHORT_ROWS, SHORT_ORDER)]


@pytest.mark.parametrize(("window", "order"), FILTERS)
@pytest.mark.parametrize("rows", [FILTER_ROWS, FILTER_ROWS + 1, 200])
def test_the_filter_is_the_one_of_savitzky_and_golay(window: int, order: int, rows: int) -> None:
    values = 100.0 + np.cumsum(np.random.default_rng(rows).normal(size=rows))
    expected = values - savgol_filter(values, window, order)
    assert high_pass_residual(values, window, order) == pytest.approx(expected, abs=1e-11)
    share = 1.0 - savgol_coeffs(window, order)[window // 2]
    assert residual_power_share(window, order) == pytest.approx(share, rel=1e-12)


@pytest.mark.parametrize(("window", "order"), FILTERS)
def test_repeated_values_leave_exactly_nothing(window: int, order: int) -> None:
    values = np.repeat([3.3, 1e6 / 7.0, -0.1], 40)
    residual = high_pass_residual(values, window, order)
    away = np.ones(len(values), bool)
    for step in (40, 80):
        away[step - window // 2 : step + window // 2] = False
    assert not residual[away].any()
    assert residual[~away].all()


def test_a_column_shorter_than_the_window_is_refused() -> None:
    with pytest.raises(ValueError, match="mismatch"):
        high_pass_residual(np.arange(FILTER_ROWS - 1.0))


def test_white_noise_on_a_cubic_has_its_own_standard_deviation() -> None:
    place = np.linspace(-1.0, 1.0, 4000)
    noise = np.random.default_rng(5).normal(0.0, 0.7, place.size)
    assert high_frequency_sigma(50.0 * place**3 + noise) == pytest.approx(0.7, rel=0.05)
