"""Widening of the standard deviations where even the best model stays far above the noise of the
sensors (discrepancy.rescale): by how much, of which signals, and that fits stay consistent.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import SCALES, Toy, assert_consistent
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.selection import search, search_state
from vgroove.gap.selection.discrepancy import rescale
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search_state import COMPARISON, Search

COULOMB = {"effects.coulomb_friction.torque_nm": 0.004}
EFFECTS = ("coulomb_friction", "current_gain", "viscous_friction")
FAR_A = 6.0  # amplitude of an oscillation of the measured current, 40 sigma
TOLERANCE = {"motor.resistance_ohm": 0.02}


def begun_search(toy: Toy, tolerance: dict[str, float] | None = None) -> Search:
    """A search with the fit of each effect alone."""
    effects = [BY_ID[i] for i in EFFECTS]
    engine = Engine(toy, SCALES, TOLERANCE if tolerance is None else tolerance)
    state = search_state.begin(engine, effects, DiagnosisOptions())
    state.fit_and_keep([engine.hypotheses([e])[0] for e in effects])
    return state


def factors(state: Search) -> list[float]:
    """Factor on the standard deviation of each signal."""
    scale = np.broadcast_to(state.engine.discrepancy, (state.problem.n,))
    found = [np.unique(scale[state.problem.signal == k]) for k in range(3)]
    assert all(len(one) == 1 for one in found)
    return [float(one[0]) for one in found]


def test_near_the_noise_nothing_is_widened() -> None:
    state = begun_search(Toy(COULOMB))
    assert rescale(state) is state and factors(state) == [1.0, 1.0, 1.0]
    assert state.floor_power == 1.0


def test_a_signal_far_from_the_noise_is_widened_and_no_other() -> None:
    """The factor is the 95 % quantile of what the best fit leaves over that of unit noise, divided
    by far_from_noise.
    """
    toy = Toy(COULOMB, oscillation_a=FAR_A)
    state = begun_search(toy)
    best = state.fits[("coulomb_friction",)]
    left = np.abs(best.out_of_fold[toy.signal == 0])
    wanted = np.quantile(left, 0.95) / 1.96 / COMPARISON.far_from_noise
    found = factors(rescale(state))
    assert found == [pytest.approx(wanted), 1.0, 1.0] and found[0] > 5.0


@pytest.mark.parametrize(("amplitude_a", "widened"), [(0.3, False), (1.5, True)])
def test_a_discrepancy_below_the_limit_does_not_widen(amplitude_a: float, widened: bool) -> None:
    """Two sigma of an oscillation give a quantile of about 1.7 times that of noise."""
    state = rescale(begun_search(Toy(COULOMB, oscillation_a=amplitude_a)))
    assert (factors(state)[0] > 1.0) is widened


def test_after_widening_the_noise_leaves_less_than_one() -> None:
    state = rescale(begun_search(Toy(COULOMB, oscillation_a=FAR_A)))
    factor = factors(state)[0]
    assert state.floor_power == pytest.approx((factor**-2.0 + 2.0) / 3.0, rel=0.01)
    np.testing.assert_allclose(
        state.floor_by_column, [factor**-2.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0], rtol=0.01
    )
    assert state.floor_by_column.sum() == pytest.approx(state.floor_power)


@pytest.mark.parametrize("tolerance", [{}, TOLERANCE], ids=["trusted", "retuned"])
def test_the_fits_are_consistent_after_widening(tolerance: dict[str, float]) -> None:
    state = rescale(begun_search(Toy(COULOMB, oscillation_a=FAR_A), tolerance))
    for one in {id(f): f for f in (state.nominal, state.retuned, *state.fits.values())}.values():
        assert_consistent(state, one)


def test_the_retuned_fit_is_still_predicted_by_simulation_after_widening() -> None:
    after = rescale(begun_search(Toy(COULOMB, oscillation_a=FAR_A), TOLERANCE))
    retuned = after.retuned
    assert retuned.exact
    held = retuned.out_of_fold.copy()
    retuned.exact = False
    predict_held_out(after.engine, [retuned])
    np.testing.assert_allclose(held, retuned.out_of_fold)


def test_the_columns_of_the_nuisance_parameters_are_widened_once() -> None:
    before = begun_search(Toy(COULOMB, oscillation_a=FAR_A))
    columns = np.array(before.engine.nuisance_columns)
    after = rescale(before)
    scale = np.broadcast_to(after.engine.discrepancy, (after.problem.n,))
    np.testing.assert_allclose(after.engine.nuisance_columns, columns / scale[:, None], rtol=1e-5)


def test_widening_twice_is_widening_once() -> None:
    once = rescale(begun_search(Toy(COULOMB, oscillation_a=FAR_A)))
    residual = once.fits[("coulomb_friction",)].residual.copy()
    twice = rescale(once)
    np.testing.assert_array_equal(twice.engine.discrepancy, once.engine.discrepancy)
    np.testing.assert_array_equal(twice.fits[("coulomb_friction",)].residual, residual)


def test_the_reported_gap_is_in_sigmas_of_the_sensors() -> None:
    before = begun_search(Toy(COULOMB, oscillation_a=FAR_A))
    nominal, fitted = (
        before.reported_gap(f) for f in (before.nominal, before.fits[("coulomb_friction",)])
    )
    scores = [before.score(f) for f in before.fits.values()]
    after = rescale(before)
    assert after.reported_gap(after.nominal) == pytest.approx(nominal)
    # fitted again under the wider standard deviation
    assert after.reported_gap(after.fits[("coulomb_friction",)]) == pytest.approx(fitted, rel=1e-3)
    assert max(after.score(f) for f in after.fits.values()) < max(scores)


@pytest.mark.parametrize("amplitude_a", [0.5, FAR_A])
def test_every_fit_of_a_finished_search_is_consistent(amplitude_a: float) -> None:
    """The search widens again after each effect that it adds."""
    truth = COULOMB | {"effects.current_gain.relative": 0.1}
    engine = Engine(Toy(truth, oscillation_a=amplitude_a), SCALES, TOLERANCE)
    effects = [BY_ID[i] for i in EFFECTS]
    found = search.select(search_state.begin(engine, effects, DiagnosisOptions()))
    state = found.search
    fits = (found.best, state.nominal, state.retuned, *state.fits.values())
    for one in {id(f): f for f in fits}.values():
        assert_consistent(state, one)
    assert found.best.ids == () or state.fits[search_state.key(found.best.ids)] is found.best


@pytest.mark.parametrize(("coulomb_nm", "gain"), [(0.02, 0.06), (0.03, 0.1), (0.02, -0.06)])
def test_fits_are_minima_under_the_standard_deviations_that_they_are_compared_with(
    coulomb_nm: float, gain: float
) -> None:
    """A wrong motor constant that the catalogue of the search lacks keeps the best set far from the
    noise. Fitted once more, that set gains nothing on itself.
    """
    hidden = {"coulomb_friction.torque_nm": coulomb_nm, "torque_constant.relative": gain}
    toy = Toy({f"effects.{name}": value for name, value in hidden.items()})
    effects = [BY_ID["coulomb_friction"], BY_ID["viscous_friction"], BY_ID["current_offset"]]
    found = search.select(search_state.begin(Engine(toy, SCALES, {}), effects, DiagnosisOptions()))
    state, best = found.search, found.best
    assert best.ids and max(state.engine.discrepancy) > 1.0
    (again,) = state.engine.fit([replace(best.hypothesis, start=best.x)], COMPARISON.max_rounds)
    predict_held_out(state.engine, [again])
    assert state.is_tied(best, again) and not state.is_better(again, best)
    assert state.score(again) == pytest.approx(state.score(best), rel=0.01)


def test_costs_are_compared_under_one_huber_threshold() -> None:
    """Under its own, larger threshold the fit with the smaller residuals costs more."""
    state = begun_search(Toy(COULOMB))
    one = state.fits[("coulomb_friction",)]
    worse = replace(one, residual=1.01 * one.residual, delta=0.1 * one.delta)
    worse.cost = state.engine.cost(worse, worse.x, worse.residual)
    assert worse.cost < one.cost
    assert state.engine.closest([worse, one]) == [one, worse]
