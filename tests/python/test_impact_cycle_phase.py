"""Where in the impact cycle a shape is wrong: parts of the cycle of known waveforms, and that the
parts of a log's shapes add up to what the regimes had before.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impact_logs import impact_rig, plant_log, ramp
from vgroove.gap.residual.impact.cycle_phase import (
    SECTORS,
    sector_name,
    sector_shares,
    shape_shares,
)
from vgroove.gap.residual.impact.harmonics import fit_harmonics
from vgroove.gap.residual.impact.problem import ImpactProblem
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem

ROW_S = 1e-3
amplitudes = st.lists(
    st.complex_numbers(max_magnitude=10.0, allow_nan=False), min_size=1, max_size=4
)


@pytest.fixture(scope="module")
def problem() -> ImpactProblem:
    found = load_problem([plant_log(impact_rig(), {}, 1, ramp(0.9, 1.5))], impact_rig())
    assert isinstance(found, ImpactProblem)
    return found


def test_a_sine_at_its_peak_has_equal_shares_and_any_sine_equal_ones_half_a_turn_apart() -> None:
    assert sector_shares(np.array([[2.0]]))[0] == pytest.approx([0.25] * SECTORS)
    first, second, third, fourth = sector_shares(np.array([[2.0 - 1.0j]]))[0]
    assert (first, second) == pytest.approx((third, fourth))
    assert first == pytest.approx(0.25 + 0.4 / np.pi, rel=1e-3)


def test_no_waveform_has_equal_shares() -> None:
    assert sector_shares(np.zeros((2, 3), complex)) == pytest.approx(0.25)


@given(amplitudes)
def test_a_quarter_turn_later_each_share_is_that_of_the_next_quarter(harmonics: list) -> None:
    amplitude = np.array([harmonics])
    later = amplitude * np.exp(-0.5j * np.pi * np.arange(1, amplitude.shape[1] + 1))
    shares = sector_shares(amplitude)
    assert shares.sum() == pytest.approx(1.0)
    assert sector_shares(later)[0] == pytest.approx(np.roll(shares[0], 1), abs=1e-9)


@pytest.mark.parametrize("sector", range(SECTORS))
def test_a_pulse_is_found_where_it_is_after_the_peak_of_the_reference(sector: int) -> None:
    """A cycle of 40 ms in rows of 1 ms. The reference is a cosine, the error a pulse in one quarter
    of the cycle.
    """
    hz, rows = 25.0, 160
    t = ROW_S * (np.arange(rows) - 0.5 * (rows - 1))
    cycles = hz * t + 0.3
    reference = np.cos(2.0 * np.pi * cycles)
    centre = (sector + 0.5) / SECTORS
    pulse = np.exp(-0.5 * (((cycles - centre + 0.5) % 1.0 - 0.5) / 0.06) ** 2)
    fit = fit_harmonics(np.stack([reference, pulse])[:, None], np.ones(2), ROW_S, np.array([hz]), 4)
    turn = np.conj(fit.amplitude[0, :, 0]) / np.abs(fit.amplitude[0, :, 0])
    shares = sector_shares(fit.amplitude[1] * turn[:, None] ** np.arange(1, 5))[0]
    assert np.argmax(shares) == sector
    assert shares[sector] > 0.5


def test_the_shares_of_a_log_are_those_of_the_error_of_each_column(problem: ImpactProblem) -> None:
    """An error of the current's second harmonic in phase is large in all quarters alike, one of
    harmonics 1 to 3 in phase around the peak of the reference.
    """
    run = problem.runs[0]
    kept = run.part[run.judged]
    for harmonics, quarters in (((2,), [0.25] * 4), ((1, 2, 3), None)):
        residual = np.zeros(len(kept))
        for k, part in enumerate(run.parts):
            if (part.column, part.kind, part.across) == ("current_a", "shape", False):
                rows = kept == k
                residual[rows] = (part.harmonic in harmonics) / run.sigma[run.judged][rows]
        shares = shape_shares(run, residual)
        shape = np.array([p.column == "current_a" and p.kind == "shape" for p in run.parts])[kept]
        other = np.array([p.kind != "shape" for p in run.parts])[kept]
        assert np.isnan(shares[other]).all()
        if quarters:
            assert shares[shape] == pytest.approx(np.tile(quarters, (shape.sum(), 1)), abs=1e-3)
        else:
            assert np.all(shares[shape][:, [0, 3]] > 0.4)


def test_the_part_of_a_harmonic_across_leads_by_a_quarter_of_its_period(
    problem: ImpactProblem,
) -> None:
    """The error of the current is cos(2 p) - sin(3 p), p the phase: in the first quarter of the
    cycle the mixed product removes (1 + 1/5) / (2 pi) of the mean square.
    """
    run = problem.runs[0]
    kept, residual = run.part[run.judged], np.zeros(int(run.judged.sum()))
    for k, part in enumerate(run.parts):
        if part.column == "current_a" and (part.harmonic, part.across) in ((2, False), (3, True)):
            residual[kept == k] = 1.0 / run.sigma[run.judged][kept == k]
    rows = residual != 0.0
    assert rows.any()
    assert shape_shares(run, residual)[rows][:, 0] == pytest.approx(0.25 - 0.6 / np.pi, abs=1e-3)


def test_the_quarters_add_up_to_the_shape_of_each_place(problem: ImpactProblem) -> None:
    residual = problem.residuals(problem.theta0)[0]
    whole = Problem.power_by_regime(problem, residual, residual**2)
    parts = problem.power_by_regime(residual, residual**2)
    assert sum(parts.values()) == pytest.approx(float(residual @ residual))
    reference = problem.runs[0].reader.reference
    shapes = [name for name in problem.regimes if name.startswith("shape of the cycle")]
    assert any(whole[name] > 0.0 for name in shapes)
    for name in problem.regimes:
        found = [parts.get(f"{name}, {sector_name(k, reference)}", 0.0) for k in range(SECTORS)]
        assert parts[name] + sum(found) == pytest.approx(whole[name])
        assert (parts[name] == 0.0) or name not in shapes
