"""Residuals without their correlation in time (fitting/whitening.py, discrepancy.whitened): the
filters, that fits stay consistent, and that an effect is found below slow model errors.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from gap_toy import SCALES, SIGMA, Toy, assert_consistent
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.fitting.whitening import (
    MAX_ORDER,
    Whitening,
    autocovariance,
    prediction_error_filter,
    whitening_of,
)
from vgroove.gap.selection import search_state
from vgroove.gap.selection.candidate_sets import fit_set
from vgroove.gap.selection.comparison import comparison_of
from vgroove.gap.selection.discrepancy import rescale, whitened
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search import Selection, select, select_whitened
from vgroove.gap.selection.search_state import Search, key
from vgroove.gap.verdict import decision

ROWS = 20000
# Of a correlation: four standard errors of an estimate, and what the criterion of Schwarz ignores
CORRELATION_ERROR = (4.0 + np.sqrt(np.log(ROWS))) / np.sqrt(ROWS)
COULOMB = {"effects.coulomb_friction.torque_nm": 0.004}


def autoregressive(rng: np.random.Generator, poles: tuple[float, ...]) -> np.ndarray:
    """A series (ROWS,) of real poles, driven by white noise."""
    return lfilter([1.0], np.poly(poles), rng.standard_normal(ROWS))


@given(pole=st.floats(-0.97, 0.97), seed=st.integers(0, 2**16))
def test_the_filter_of_a_first_order_series_holds_its_pole(pole: float, seed: int) -> None:
    value = autoregressive(np.random.default_rng(seed), (pole,))
    taps = prediction_error_filter(value)
    assert np.linalg.norm(taps) == pytest.approx(1.0)
    taps = np.append(taps / taps[0], [0.0, 0.0])
    assert taps[1] == pytest.approx(-pole, abs=CORRELATION_ERROR)


@given(poles=st.tuples(st.floats(0.5, 0.95), st.floats(-0.9, 0.5)), seed=st.integers(0, 2**16))
def test_filtered_residuals_are_uncorrelated(poles: tuple[float, float], seed: int) -> None:
    value = autoregressive(np.random.default_rng(seed), poles)
    left = lfilter(prediction_error_filter(value), [1.0], value)[MAX_ORDER:]
    rho = autocovariance(left, 6)
    assert np.all(np.abs(rho[1:] / rho[0]) < CORRELATION_ERROR)


@given(poles=st.tuples(st.floats(0.5, 0.97), st.floats(-0.9, 0.9)), seed=st.integers(0, 2**16))
def test_slow_poles_leave_less_than_a_third_of_the_correlation(
    poles: tuple[float, float], seed: int
) -> None:
    """The worst of 8,000 drawn series left 0.24."""
    value = autoregressive(np.random.default_rng(seed), poles)
    left = lfilter(prediction_error_filter(value), [1.0], value)[MAX_ORDER:]
    rho = autocovariance(left, 6)
    assert np.all(np.abs(rho[1:] / rho[0]) < 0.3)


def test_two_slow_poles_leave_a_tenth_of_the_correlation() -> None:
    """The series itself has 0.997 between neighbouring rows."""
    value = autoregressive(np.random.default_rng(1977), (0.9375, 0.875))
    left = lfilter(prediction_error_filter(value), [1.0], value)[MAX_ORDER:]
    rho = autocovariance(left, 2)
    assert abs(rho[1] / rho[0]) < 0.15


def test_white_noise_is_kept_as_it_is() -> None:
    """The order is chosen by a criterion, not by MAX_ORDER."""
    found = [
        len(prediction_error_filter(np.random.default_rng(k).standard_normal(ROWS)))
        for k in range(20)
    ]
    assert np.median(found) == 1.0 and max(found) <= 3


@pytest.mark.parametrize(
    "value", [np.zeros(0), np.ones(1), np.zeros(300), np.arange(9.0), np.full(9, 1e-200)]
)
def test_series_that_show_no_correlation_are_kept(value: np.ndarray) -> None:
    np.testing.assert_array_equal(prediction_error_filter(value), [1.0])


@pytest.mark.parametrize("value", [np.ones(400), np.sin(0.01 * np.arange(4000.0))])
def test_filters_of_predictable_series_are_finite(value: np.ndarray) -> None:
    taps = prediction_error_filter(value)
    assert np.isfinite(taps).all() and len(taps) <= MAX_ORDER + 1


def test_series_are_filtered_apart_and_other_rows_kept() -> None:
    rng = np.random.default_rng(3)
    rows = np.arange(0, 900, 3), np.arange(1, 900, 3)
    residual = rng.standard_normal((2, 900))
    whitening = Whitening(rows, (np.array([1.0, -0.5]), np.array([1.0])))
    out = whitening.apply(residual)
    first = residual[:, rows[0]]
    np.testing.assert_allclose(out[:, rows[0]][:, 1:], first[:, 1:] - 0.5 * first[:, :-1])
    np.testing.assert_array_equal(out[:, 1::3], residual[:, 1::3])
    np.testing.assert_array_equal(out[:, 2::3], residual[:, 2::3])
    np.testing.assert_allclose(whitening.apply(residual[1]), out[1])
    assert [len(t) for t in whitening_of(rows, residual[0]).taps] == [1, 1]


def wandering(hidden: dict[str, float], size: float, ids: tuple[str, ...], seed: int = 5) -> Search:
    """A search on a toy whose speed has slow errors of so many sigma, after the fit of each effect
    alone.
    """
    toy = Toy(hidden)
    slow = lfilter([1.0], [1.0, -0.99], np.random.default_rng(seed).standard_normal(toy.n // 3))
    toy.measured_rows[1] += SIGMA["speed_rpm"] * size * slow / np.std(slow)
    effects = [BY_ID[i] for i in ids]
    engine = Engine(toy, SCALES, {"motor.resistance_ohm": 0.02})
    state = search_state.begin(engine, effects, DiagnosisOptions())
    state.fit_and_keep([engine.hypotheses([e])[0] for e in effects])
    return rescale(state)


@pytest.fixture(scope="module")
def far_search() -> Search:
    """A search that ends far from the noise, with two effects of which the first closes more."""
    both = COULOMB | {"effects.current_gain.relative": 0.05}
    return wandering(both, 20.0, ("coulomb_friction", "current_gain"))


def test_near_the_noise_and_for_statistics_nothing_is_whitened() -> None:
    near = wandering(COULOMB, 0.3, ("coulomb_friction",))
    assert whitened(near) is near
    far = wandering(COULOMB, 20.0, ("coulomb_friction",))
    far.problem.is_whitened = True
    assert whitened(far) is far


def test_fits_and_residuals_agree_after_whitening() -> None:
    state = wandering(COULOMB, 20.0, ("coulomb_friction", "current_gain", "viscous_friction"))
    reported = state.reported_gap(state.fits[("coulomb_friction",)])
    other = whitened(state)
    assert comparison_of(state) == "forward simulation"
    assert comparison_of(other) == "forward simulation, prewhitened"
    for one in (other.nominal, other.retuned, *other.fits.values()):
        assert_consistent(other, one)
    residual = other.fits[("coulomb_friction",)].residual[state.problem.signal == 1]
    rho = autocovariance(residual, 2)
    assert rho[1] / rho[0] < 0.2
    assert other.reported_gap(other.fits[("coulomb_friction",)]) == reported


@pytest.mark.parametrize("seed", [5, 6])
def test_an_effect_below_slow_model_errors_is_selected(seed: int) -> None:
    """A delay acts at the edges of the command; slow errors of the speed hide it only where rows
    count as independent.
    """
    hidden = COULOMB | {"effects.transport_delay.delay_s": 0.0025}
    ids = ("coulomb_friction", "transport_delay", "current_gain", "viscous_friction")
    selection = select(wandering(hidden, 10.0, ids, seed))
    found = select_whitened(selection.search)
    assert selection.best.ids == ("coulomb_friction",)
    assert found is not None and set(found.best.ids) == {"coulomb_friction", "transport_delay"}


@pytest.mark.parametrize(
    ("plain", "in_whitened", "named"),
    [
        (("coulomb_friction",), ("coulomb_friction", "current_gain"), 2),
        (("coulomb_friction",), ("current_gain",), 1),  # leaves a larger reported gap
        (("current_gain",), ("coulomb_friction",), 2),
        (("coulomb_friction",), ("coulomb_friction",), 1),
        (("coulomb_friction", "current_gain"), ("coulomb_friction",), 1),
        ((), ("coulomb_friction",), 1),
        (("coulomb_friction",), (), 1),
        (("coulomb_friction",), ("asymmetric_friction",), 1),  # which only generalises it
    ],
)
def test_whitened_residuals_replace_an_established_set_by_no_smaller_one(
    plain: tuple[str, ...],
    in_whitened: tuple[str, ...],
    named: int,
    far_search: Search,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """named: 1 for the set in the residuals as they are, 2 for that in whitened ones."""
    state = far_search
    ids = {False: plain, True: in_whitened}

    def established(search: Search, best: Fit, _: object) -> Fit:
        wanted = ids[search.unwhitened is not None]
        return fit_set(search, wanted, best) if wanted else search.retuned

    monkeypatch.setattr(decision, "established_set", established)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found = decision.established_part(Selection(state, state.retuned, []), {})
    assert found.best.ids == ids[named == 2]
    assert (found.search is state) is (named == 1)
    assert_consistent(state, found.best)
    assert all(state.fits[key(f.ids)] is f for f in found.rivals)


@pytest.mark.parametrize("unknown", [False, True])
def test_whitened_residuals_name_no_member_whose_reported_size_may_be_none(
    unknown: bool, far_search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whitened residuals establish a second member of known size; its interval from the residuals
    as they are, which is reported, contains 0 or not.
    """
    more = ("coulomb_friction", "current_gain")

    def established(search: Search, best: Fit, _: object) -> Fit:
        return fit_set(search, more[:1] if search is far_search else more, best)

    def sizes(search: Search, one: Fit) -> list[str]:
        return ["current_gain"] if unknown and search is far_search and len(one.ids) > 1 else []

    monkeypatch.setattr(decision, "established_set", established)
    monkeypatch.setattr(decision, "unknown_sizes", sizes)
    found = decision.established_part(Selection(far_search, far_search.retuned, []), {})
    assert found.best.ids == (more[:1] if unknown else more)


@pytest.mark.parametrize("gains", [False, True])
def test_a_general_law_is_named_where_it_gains_its_share(
    gains: bool, far_search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whitened residuals establish an asymmetric friction, the residuals as they are a Coulomb
    friction, which is its special case.
    """

    def established(search: Search, best: Fit, _: object) -> Fit:
        law = "coulomb_friction" if search is far_search else "asymmetric_friction"
        return fit_set(search, (law,), best)

    monkeypatch.setattr(decision, "established_set", established)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    monkeypatch.setattr(decision, "established_rivals", lambda *_: [])
    monkeypatch.setattr(Search, "gains_share", lambda *_: gains)
    monkeypatch.setattr(Search, "reported_gap", lambda *_: 1.0)
    found = decision.established_part(Selection(far_search, far_search.retuned, []), {})
    assert found.best.ids == (("asymmetric_friction",) if gains else ("coulomb_friction",))


@pytest.mark.parametrize("in_whitened", [False, True])
def test_a_tied_special_case_is_the_established_part(
    in_whitened: bool, far_search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the residuals as they are, and in whitened ones where these establish more members."""
    state, more = far_search, ("current_gain",) if in_whitened else ()

    def established(search: Search, best: Fit, _: object) -> Fit:
        return fit_set(
            search, ("asymmetric_friction", *(more if search is not state else ())), best
        )

    def rivals(selection: Selection, part: Fit, _: object) -> list[Fit]:
        if "asymmetric_friction" not in part.ids:
            return []
        return [fit_set(selection.search, ("coulomb_friction", *part.ids[1:]), part)]

    monkeypatch.setattr(decision, "established_set", established)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    monkeypatch.setattr(decision, "established_rivals", rivals)
    found = decision.established_part(Selection(state, state.retuned, []), {})
    assert set(found.best.ids) == {"coulomb_friction", *more}
    assert (found.search is not state) is in_whitened
    assert found.rivals == []
