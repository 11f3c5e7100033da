"""The impact mechanism of the plant against its second opinion (impact_reference.py and .json), and that opinion itself."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import impact_reference as reference

FILE = json.loads(reference.RESULTS.read_text())
PLACE = {name: place for place, name in enumerate(FILE["columns"])}
LIVE_S = 0.06


def column(case: str, name: str) -> np.ndarray:
    return np.array(FILE["cases"][case]["rows"])[:, PLACE[name]]


def contacts(case: str, *kinds: int) -> np.ndarray:
    """Rows of contact_columns of the kinds asked for."""
    return np.array([c for c in FILE["cases"][case]["contacts"] if c[2] in kinds])


def settled_period_s(case: str) -> float:
    times = contacts(case, reference.BLOW)[:, 0]
    return float(np.mean(np.diff(times[len(times) // 2 :])))


def settled_current_a(case: str) -> float:
    """Mean over whole periods: the last half of the run, in which the current repeats."""
    times = contacts(case, reference.BLOW)[:, 0]
    first, last = times[len(times) // 2], times[-1]
    charge = np.interp([first, last], column(case, "time_s"), column(case, "charge_as"))
    return float((charge[1] - charge[0]) / (last - first))


def test_file_holds_the_cases_of_the_script() -> None:
    assert FILE["cases"].keys() == reference.CASES.keys()
    assert [c.changes for c in reference.CASES.values()] == [c["changes"] for c in FILE["cases"].values()]
    assert FILE["columns"] == reference.COLUMNS


@pytest.mark.parametrize(
    ("case", "method"), [("slip_60", "DOP853"), ("slope_700", "LSODA"), ("slip_6", "DOP853"), ("locked_duty_0.5", "LSODA")]
)
def test_file_is_what_another_method_gives(case: str, method: str) -> None:
    """Radau made the file; explicit Runge-Kutta and LSODA run its first blows again."""
    live = reference.simulate(reference.CASES[case].tool(), LIVE_S, method, row_s=reference.ROW_S)
    kept, rows = [c for c in FILE["cases"][case]["contacts"] if c[0] < LIVE_S], np.array(FILE["cases"][case]["rows"])
    assert [(c.lug, c.kind) for c in live.contacts] == [(c[1], c[2]) for c in kept]
    np.testing.assert_allclose([c.time_s for c in live.contacts], [c[0] for c in kept], rtol=0, atol=1e-9)
    np.testing.assert_allclose([c.approach_rad_s for c in live.contacts], [c[3] for c in kept], rtol=1e-5, atol=1e-4)
    scale = np.max(np.abs(rows), axis=0) + 1e-12
    np.testing.assert_allclose(np.array(live.rows) / scale, rows[: len(live.rows)] / scale, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("case", "blows_per_min", "current_a", "within"),
    [("locked", 2857, 32.3, 1e-3), ("slope_700", 2857, 32.3, 1e-3), ("slip_60", 3241, 27.5, 2e-3), ("slip_6", 2771, 25.5, 1e-3)],
)
def test_reference_shows_the_table_of_physics(case: str, blows_per_min: float, current_a: float, within: float) -> None:
    assert 60.0 / settled_period_s(case) == pytest.approx(blows_per_min, rel=within)
    assert settled_current_a(case) == pytest.approx(current_a, abs=0.2)


def test_reference_shows_peaks_travel_and_free_speed() -> None:
    assert contacts("slope_700", reference.BLOW)[-5:-1, 4] == pytest.approx(144.0, abs=0.5)
    assert FILE["cases"]["slope_700"]["hammer_mm"] == pytest.approx(10.9, abs=0.05)
    assert column("free", "speed_rad_s")[-1] / 5.6 * 30 / math.pi == pytest.approx(2813, abs=0.5)
    assert column("free", "current_a")[-1] == pytest.approx(1.8, abs=0.05)


def test_reference_loses_synchronism_as_physics_says() -> None:
    def touches_per_lug(case: str) -> float:
        lugs = contacts(case, reference.BLOW, reference.REPEAT)[:, 1]
        settled = lugs[lugs >= 4]
        return len(settled[settled < settled[-1]]) / len(set(settled[settled < settled[-1]]))

    periods = np.diff(contacts("locked_duty_0.7", reference.BLOW)[6:, 0])
    assert np.std(periods) / np.mean(periods) == pytest.approx(0.24, abs=0.01)
    assert touches_per_lug("locked_duty_0.5") == pytest.approx(2.0, abs=0.01)
    assert touches_per_lug("locked_duty_0.3") == pytest.approx(3.0, abs=0.3)
