"""Consistency of an effect over the parts of its logs, and which members of a set are established:
estimates against hand calculations, and effects of the catalogue against imitations.
"""

from dataclasses import replace
from types import MethodType, SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gap_toy import SCALES, Toy
from made_log import MadeLog, drive_log, rig
from vgroove import _core
from vgroove.gap import DiagnosisOptions, diagnose
from vgroove.gap.catalogue import BY_ID, CATALOGUE
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Coordinate, Hypothesis
from vgroove.gap.selection import search_state
from vgroove.gap.selection.search_state import ClosedShare, Search
from vgroove.gap.verdict import consistency, established
from vgroove.gap.verdict.consistency import LIMITS, PartSizes
from vgroove.gap.verdict.covariates import Covariates

ONE_SIDED = {"effects.asymmetric_friction.forward_nm": 0.006}
COULOMB = {"effects.coulomb_friction.torque_nm": 0.004}
DRAG = {"effects.quadratic_drag.nm_s2_per_rad2": 6e-9}
TOLERANCE = {"motor.resistance_ohm": 0.02}
TRIED = ("coulomb_friction", "viscous_friction", "current_gain", "added_inertia")
OPTIONS = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in TRIED])


def begun_search(toy: Toy, *ids: str) -> search_state.Search:
    """A search over effects with the fit of each alone."""
    effects = [BY_ID[i] for i in ids]
    state = search_state.begin(Engine(toy, SCALES, TOLERANCE), effects, DiagnosisOptions())
    state.fit_and_keep([state.engine.hypotheses([e])[0] for e in effects])
    return state


@pytest.fixture(scope="module")
def friction() -> search_state.Search:
    """A search on a toy with more Coulomb friction, with the fit of that friction."""
    return begun_search(Toy(COULOMB), "coulomb_friction")


@pytest.fixture(scope="module")
def one_sided() -> search_state.Search:
    """A search on a toy with a friction in one direction alone, fitted as Coulomb friction."""
    return begun_search(Toy(ONE_SIDED), "coulomb_friction")


def covariates(toy: Toy) -> Covariates:
    """Speed and time of each residual."""
    return {"speed": np.tile(toy.measured_rows[1], 3), "time since start": toy.time_s}


def sizes_of(value: list[float], sigma: list[float], power: list[float] | None = None) -> PartSizes:
    weight = np.ones(len(value)) if power is None else np.array(power)
    return PartSizes(np.array(value), np.array(sigma), weight)


# --- sizes in parts ---


@pytest.mark.parametrize(
    ("value", "sigma", "mean", "between"),
    [
        # Q = 2, one degree of freedom, divisor 2 - 2/2 = 1: between^2 = (2 - 1) / 1
        ([1.0, 3.0], [1.0, 1.0], 2.0, 1.0),
        # weights 4, 4, 1: mean 16/9, Q = 7.5556, divisor 9 - 33/9 = 5.3333:
        # between^2 = 5.5556 / 5.3333 = 1.041667; new weights 0.774194 (twice), 0.489796
        ([1.0, 2.0, 4.0], [0.5, 0.5, 1.0], 2.100777, 1.020621),
        # Q = 0.5 is less than its expectation, the two degrees of freedom
        ([0.9, 1.1, 1.0], [0.2, 0.2, 0.2], 1.0, 0.0),
    ],
)
def test_the_scatter_between_parts_is_that_of_dersimonian_and_laird(
    value: list[float], sigma: list[float], mean: float, between: float
) -> None:
    found = sizes_of(value, sigma).scatter_by_information()
    assert found == (pytest.approx(mean, rel=1e-5), pytest.approx(between, rel=1e-5, abs=1e-9))


@pytest.mark.parametrize(
    ("value", "sigma", "constant"),
    [
        ([1.0, 3.0], [1.0, 1.0], True),  # scatter 1 of a mean of 2: just at the limit
        ([1.0, 3.05], [1.0, 1.0], False),
        ([1.0, 2.99], [1.0, 1.0], True),
        ([-1.0, -1.1], [0.1, 0.1], False),
        ([1.0] * 7 + [-0.15], [0.05] * 8, False),  # 3 sigma below 0 in one part
        ([1.0] * 7 + [-0.15], [0.05] * 7 + [0.1], True),  # 1.5 sigma
        ([1.0] * 7 + [-1.0], [0.05] * 7 + [0.3], True),  # of 0.4 % of the information
        ([1.0] * 7 + [-1.0], [0.05] * 7 + [0.08], False),  # of 5.3 %
        ([1.0, 1.02, 0.97, 1.01], [0.02] * 4, True),
    ],
)
def test_a_size_is_constant_if_its_sign_is_kept_and_its_scatter_is_at_most_half(
    value: list[float], sigma: list[float], constant: bool
) -> None:
    found = sizes_of(value, sigma)
    assert found.is_constant() is constant
    scaled = PartSizes(0.6 * found.value, 0.6 * found.sigma, found.power)
    assert scaled.is_constant() is constant


@pytest.mark.parametrize(
    ("value", "sigma", "power", "mean", "between"),
    [
        # squares of the deviations 1 and 1, less 0.36
        ([1.0, 3.0], [0.6, 0.6], [1.0, 1.0], 2.0, 0.8),
        # mean 16/9; squares of the deviations 49/81, 4/81, 400/81, less 1/4, 1/4, 1: the weighted
        # mean is (115/81 - 65/81 + 319/81) / 9 = 41/81
        ([1.0, 2.0, 4.0], [0.5, 0.5, 1.0], [4.0, 4.0, 1.0], 16.0 / 9.0, (41.0 / 81.0) ** 0.5),
        # less than the standard deviations explain
        ([0.9, 1.1, 1.0], [0.2, 0.2, 0.2], [1.0, 1.0, 1.0], 1.0, 0.0),
        # a part in which the effect makes a hundredth of its squared gap: 0.01 * 0.99 * 2^2
        ([1.0, -1.0], [0.0, 0.0], [99.0, 1.0], 0.98, 0.0396**0.5),
    ],
)
def test_the_scatter_by_power_is_weighted_by_the_gap_that_the_effect_makes(
    value: list[float], sigma: list[float], power: list[float], mean: float, between: float
) -> None:
    found = sizes_of(value, sigma, power).scatter_by_power()
    assert found == (pytest.approx(mean, rel=1e-9), pytest.approx(between, rel=1e-9, abs=1e-9))


@given(st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(0.01, 10.0)), min_size=2, max_size=6))
def test_cutting_a_part_in_two_changes_no_scatter_by_power(
    parts: list[tuple[float, float]],
) -> None:
    """Two parts with half of the squared gap each count as much as the one that they replace."""
    value, power = map(list, zip(*parts, strict=True))
    whole = sizes_of(value, [0.0] * len(value), power).scatter_by_power()
    halves = [power[0] / 2.0, *power[1:], power[0] / 2.0]
    cut = sizes_of([*value, value[0]], [0.0] * len(halves), halves).scatter_by_power()
    assert cut == pytest.approx(whole, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("value", "power", "constant"),
    [
        ([1.0, 3.0], [1.0, 1.0], True),  # scatter 1 of a mean of 2: just at the limit
        ([0.95, 3.05], [1.0, 1.0], False),
        ([1.0, -1.0], [1.0, 0.05], True),  # 4.8 % of the gap contradict the sign
        ([1.0, -1.0], [1.0, 0.055], False),  # 5.2 %
        ([1.0, 3.0], [1.0, 0.05], True),
        ([0.45, 0.5], [1.0, 1.0], False),  # not the size in all rows
    ],
)
def test_a_size_is_constant_by_power_if_parts_that_change_make_little_of_the_gap(
    value: list[float], power: list[float], constant: bool
) -> None:
    assert sizes_of(value, [0.01, 0.01], power).is_constant_by_power() is constant


@pytest.mark.parametrize(
    ("pooled", "largest", "blocks", "kept"),
    [
        (0.49, 0.5, 1.0, True),
        (0.49, 0.49, 1.0, False),
        (0.49, 0.5, 3.5, False),  # blocks count where one signal alone shows the larger part
        (0.5, 0.5, 3.5, True),
    ],
)
def test_an_effect_that_closes_the_larger_part_may_change_where_it_makes_little_of_the_gap(
    friction: search_state.Search,
    monkeypatch: pytest.MonkeyPatch,
    pooled: float,
    largest: float,
    blocks: float,
    kept: bool,
) -> None:
    """One regime of little gap contradicts the sign; blocks: size in half of the blocks, 1 in the
    others.
    """
    best = friction.fits[("coulomb_friction",)]
    regimes = sizes_of([1.0, -1.0, 1.0], [0.05] * 3, [1.0, 0.01, 1.0])
    in_blocks = sizes_of([1.0, blocks], [0.05] * 2, [1.0, 1.0])

    def sizes(search: Search, _best: object, _slope: object, part: np.ndarray) -> PartSizes:
        return in_blocks if part is search.blocks.cluster else regimes

    monkeypatch.setattr(consistency, "part_sizes", sizes)
    closed = ClosedShare(pooled, np.array([largest]))
    assert consistency.keeps_its_size(friction, best, "coulomb_friction", closed) is kept


@pytest.mark.parametrize(
    ("mean", "constant"), [(0.49, False), (0.51, True), (1.0, True), (1.99, True), (2.01, False)]
)
def test_the_mean_of_the_parts_is_that_of_all_rows_up_to_a_factor_of_two(
    mean: float, constant: bool
) -> None:
    assert sizes_of([mean, mean], [0.01, 0.02]).is_constant() is constant


def test_a_true_effect_has_a_size_of_one_in_every_part(friction: search_state.Search) -> None:
    best = friction.fits[("coulomb_friction",)]
    slope = consistency.size_response(friction, best, "coulomb_friction")
    divisions = list(consistency.partitions(friction))
    assert [len(np.unique(part)) for part in divisions] == [LIMITS.time_parts, 2, 1]
    for part in divisions:
        found = consistency.part_sizes(friction, best, slope, part)
        assert np.all(np.abs(found.value - 1.0) < 4.0 * found.sigma)
        assert np.all(found.sigma < 0.05) and found.is_constant()
    assert consistency.keeps_its_size(
        friction, best, "coulomb_friction", ClosedShare(0.1, np.array([0.1]))
    )


@pytest.mark.parametrize("coulomb_nm", [0.0135, 0.0145, 0.0155, 0.017])
def test_a_true_effect_keeps_its_size_beside_a_tolerated_value_at_its_limit(
    coulomb_nm: float,
) -> None:
    """The tool's Coulomb friction lies 4 to 14 of its tolerance's sigmas above the rig's 0.012, so
    that the fit ends at three. In all rows together the viscous friction has the size 1.
    """
    effect = BY_ID["viscous_friction"]
    toy = Toy({"effects.viscous_friction.nm_s_per_rad": 2e-6, "motor.coulomb_nm": coulomb_nm})
    engine = Engine(toy, SCALES, {"motor.coulomb_nm": 0.03})
    search = search_state.begin(engine, [effect], DiagnosisOptions())
    (best,) = search.fit_and_keep(engine.hypotheses([effect]))
    assert best.x[1] == best.hypothesis.high[1]
    slope = consistency.size_response(search, best, effect.id)
    whole = consistency.part_sizes(search, best, slope, np.zeros(toy.n, int))
    assert whole.value == pytest.approx([1.0], abs=0.01)
    by_time = consistency.part_sizes(search, best, slope, next(consistency.partitions(search)))
    assert by_time.is_constant()


@pytest.mark.parametrize(
    ("coulomb_nm", "viscous", "tolerance"), [(0.01225, 2e-7, 0.01), (0.0121, 1e-7, 0.003)]
)
def test_tolerated_values_keep_their_prior_around_the_rig_in_a_part(
    coulomb_nm: float, viscous: float, tolerance: float
) -> None:
    """Around the fitted value, 1.2 and 1.8 sigmas away, the size in all rows would be 0.93 and
    0.87.
    """
    effect = BY_ID["viscous_friction"]
    hidden = {"effects.viscous_friction.nm_s_per_rad": viscous, "motor.coulomb_nm": coulomb_nm}
    toy = Toy(hidden)
    engine = Engine(toy, SCALES, {"motor.coulomb_nm": tolerance})
    search = search_state.begin(engine, [effect], DiagnosisOptions())
    (best,) = search.fit_and_keep(engine.hypotheses([effect]))
    slope = consistency.size_response(search, best, effect.id)
    whole = consistency.part_sizes(search, best, slope, np.zeros(toy.n, int))
    assert whole.value == pytest.approx([1.0], abs=0.01)


def test_the_sizes_of_an_imitation_change_from_part_to_part(one_sided: search_state.Search) -> None:
    """A friction in one direction alone, fitted as Coulomb friction."""
    best = one_sided.fits[("coulomb_friction",)]
    part = next(consistency.partitions(one_sided))
    slope = consistency.size_response(one_sided, best, "coulomb_friction")
    found = consistency.part_sizes(one_sided, best, slope, part)
    assert found.value.min() < 0.1 and found.value.max() > 1.4
    assert not consistency.keeps_its_size(
        one_sided, best, "coulomb_friction", ClosedShare(0.4, np.array([0.4]))
    )


def test_the_parts_of_time_are_contiguous_and_about_equal(friction: search_state.Search) -> None:
    part, toy = next(consistency.partitions(friction)), friction.problem
    for signal in range(3):
        assert np.all(np.diff(part[toy.signal == signal]) >= 0)
    counts = np.bincount(part)
    assert counts.max() <= 1.01 * counts.min()


def test_an_effect_that_no_division_shows_twice_must_close_nearly_all(
    friction: search_state.Search,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best, whole = friction.fits[("coulomb_friction",)], np.zeros(friction.problem.n, int)
    monkeypatch.setattr(consistency, "partitions", lambda _: iter([whole]))
    for largest, kept in ((0.91, True), (0.89, False)):
        closed = ClosedShare(0.5, np.array([largest]))
        assert consistency.keeps_its_size(friction, best, "coulomb_friction", closed) is kept


def test_a_part_in_which_the_effect_does_not_act_does_not_count(
    friction: search_state.Search,
) -> None:
    """Rows without a response give no size."""
    best = friction.fits[("coulomb_friction",)]
    part = (friction.problem.time_s > 3.0).astype(int)
    slope = np.where(part == 1, 0.0, consistency.sensitivity(best, "coulomb_friction"))
    assert len(consistency.part_sizes(friction, best, slope, part).value) == 1


def test_the_response_to_a_size_is_the_derivative_of_a_smooth_effect(
    friction: search_state.Search,
) -> None:
    best = friction.fits[("coulomb_friction",)]
    found = consistency.size_response(friction, best, "coulomb_friction")
    assert np.array_equal(found, consistency.sensitivity(best, "coulomb_friction"))


@pytest.mark.parametrize("state", ["friction", "one_sided"])
def test_the_response_to_a_size_is_the_whole_effect_where_the_derivative_is_another(
    state: str, request: pytest.FixtureRequest
) -> None:
    """The derivative is replaced by noise. The regression in each part then returns the size of
    all rows, whether the effect is there or not; with the whole effect the size is the same in all
    parts only if it is there.
    """
    search = request.getfixturevalue(state)
    best, rng = search.fits[("coulomb_friction",)], np.random.default_rng(4)
    other = replace(best, jacobian=1e3 * rng.normal(size=best.jacobian.shape))
    part = next(consistency.partitions(search))
    derivative = consistency.sensitivity(other, "coulomb_friction")
    assert np.allclose(consistency.part_sizes(search, other, derivative, part).value, 1.0, atol=0.1)
    retuned = replace(other, jacobian=best.jacobian.copy())
    retuned.jacobian[:, 0] = other.jacobian[:, 0]
    whole = consistency.size_response(search, retuned, "coulomb_friction")
    found = consistency.part_sizes(search, retuned, whole, part)
    assert found.is_constant() is (state == "friction")


def test_the_sensitivity_of_a_ripple_is_along_its_amplitude() -> None:
    """Of a periodic effect both amplitudes scale together."""
    cosine, sine = (
        Coordinate(f"effects.cogging_torque.{name}", (0,), (1.0,), 0.0, -1.0, 1.0, role=role)
        for name, role in (("torque_nm", "cosine"), ("phase_rad", "sine"))
    )
    other = Coordinate("effects.cogging_torque.periods_per_rev", (1,), (1.0,), 0.0, 0.0, 9.0)
    best = SimpleNamespace(
        hypothesis=SimpleNamespace(coordinates=(cosine, sine, other)),
        x=np.array([2.0, 3.0, 5.0]),
        jacobian=np.array([[1.0, 10.0, 100.0]]),
        residual=np.zeros(1),
    )
    np.testing.assert_allclose(consistency.sensitivity(best, "cogging_torque"), [32.0])


@pytest.mark.parametrize(
    ("losses", "little"), [([0.0], True), ([-9.0], True), ([-11.0], False), ([-3.0] * 4, False)]
)
def test_the_parts_that_lose_may_lose_a_tenth_of_what_the_others_gain(
    losses: list[float], little: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains = np.array([60.0, 40.0, *losses])
    blocks = SimpleNamespace(tested=np.ones(len(gains), bool), cluster=np.arange(len(gains)))
    monkeypatch.setattr(consistency, "partitions", lambda _: iter([np.arange(len(gains))]))
    with_it = SimpleNamespace(out_of_fold=np.full(len(gains), 4.0))
    without = SimpleNamespace(out_of_fold=np.sqrt(16.0 + gains))
    state = SimpleNamespace(blocks=blocks)
    assert consistency.loses_little(state, with_it, without) is little


@pytest.mark.parametrize(("scatter", "little"), [(20.0, False), (60.0, True)])
def test_a_part_loses_only_what_stands_above_the_scatter_of_its_blocks(
    scatter: float, little: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four blocks lose 100 together; twice the standard deviation of their sum is 2 scatter."""
    deviation = scatter * 0.75**0.5 / 2.0
    gains = np.array([400.0, *(-25.0 + deviation * np.array([1.0, -1.0, 1.0, -1.0]))])
    blocks = SimpleNamespace(tested=np.ones(5, bool), cluster=np.arange(5))
    monkeypatch.setattr(consistency, "partitions", lambda _: iter([np.array([0, 1, 1, 1, 1])]))
    with_it = SimpleNamespace(out_of_fold=np.full(5, 4.0))
    without = SimpleNamespace(out_of_fold=np.sqrt(16.0 + np.maximum(gains, -15.9)))
    monkeypatch.setattr(
        consistency,
        "clipped_squares",
        lambda residual, _: gains if residual is without.out_of_fold else np.zeros(5),
    )
    assert consistency.loses_little(SimpleNamespace(blocks=blocks), with_it, without) is little


# --- significance of a size ---


def sized(
    slope: np.ndarray, size: float, noise: np.ndarray, block: np.ndarray
) -> tuple[SimpleNamespace, SimpleNamespace]:
    """A search and a fit at size 1 of an effect that is present with another size."""
    name = BY_ID["coulomb_friction"].name(BY_ID["coulomb_friction"].leading)
    friction = Coordinate(name, (0,), (1.0,), 0.0, -1.0, 1.0)
    best = SimpleNamespace(
        hypothesis=Hypothesis(("coulomb_friction",), (friction,), np.ones(1)),
        x=np.ones(1),
        jacobian=slope[:, None],
        residual=noise + (1.0 - size) * slope,
    )
    blocks = SimpleNamespace(
        tested=np.ones(len(slope), bool), cluster=block, series=(np.arange(len(slope)),)
    )
    return SimpleNamespace(blocks=blocks), best


@pytest.mark.parametrize("blocks", [8, 30])
def test_an_absent_effect_is_significant_in_at_most_one_of_a_hundred_fits(blocks: int) -> None:
    """With noise of heavy tails whose power differs from block to block."""
    rng, found = np.random.default_rng(7), 0
    block = np.repeat(np.arange(blocks), 40)
    for _ in range(1500):
        power = rng.exponential(size=blocks)[block]
        noise = power * rng.standard_t(3, size=len(block))
        slope = 0.1 * rng.normal(size=blocks)[block] + 0.1
        found += consistency.is_significant_size(
            *sized(slope, 0.0, noise, block), "coulomb_friction"
        )
    assert found <= 0.01 * 1500


@pytest.mark.parametrize(
    ("shown_in", "alike", "significant"),
    [(12, True, True), (1, True, False), (1, False, True)],
)
def test_a_size_that_one_correlation_time_alone_shows_is_not_significant(
    shown_in: int, alike: bool, significant: bool
) -> None:
    """What the fit leaves is equal in the 40 rows of a block (`alike`), or independent. One block
    proves nothing in the first case, and 40 rows prove the size in the second.
    """
    block, rng = np.repeat(np.arange(12), 40), np.random.default_rng(2)
    slope = np.where(block < shown_in, 1.0, 1e-3)
    noise = 0.2 * (np.repeat(rng.normal(size=12), 40) if alike else rng.normal(size=480))
    assert (
        consistency.is_significant_size(*sized(slope, 1.0, noise, block), "coulomb_friction")
        is significant
    )


@pytest.mark.parametrize(
    ("turns", "periods", "count"), [(0.1, np.inf, 1.0), (4.0, 3.0, 10.0), (4.0, np.inf, 46.0)]
)
def test_a_period_that_was_selected_from_many_must_be_more_significant(
    turns: float, periods: float, count: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Periods from 0.5 a turn, of which MIN_PERIODS fit into 4 turns, to 12, the largest start, or
    to what the rows resolve.
    """
    scales = replace(SCALES, turns=turns, periods=periods)
    search = SimpleNamespace(
        engine=SimpleNamespace(scales=scales),
        blocks=None,
        block_losses=lambda one: one,
        gains_share=lambda best, without: True,
    )
    level = consistency.significance(search, "cogging_torque")
    assert 1.0 - level == pytest.approx(0.01 / count)
    for other in ("coulomb_friction", "gear_eccentricity"):
        assert consistency.significance(search, other) == 0.99
    asked: list[float] = []
    monkeypatch.setattr(
        established, "difference_interval", lambda _, gain, at: asked.append(at) or (1.0, 2.0)
    )
    assert established.gains_enough(search, 1.0, 3.0, "cogging_torque")
    assert asked == [level]


def test_a_size_that_is_significant_alone_may_be_the_best_of_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """About four standard deviations."""
    block, rng = np.repeat(np.arange(12), 40), np.random.default_rng(2)
    search, best = sized(np.ones(480), 1.0, 5.5 * rng.normal(size=480), block)
    assert consistency.is_significant_size(search, best, "coulomb_friction")
    monkeypatch.setattr(consistency, "significance", lambda *_: 1.0 - 1e-7)
    assert not consistency.is_significant_size(search, best, "coulomb_friction")


# --- flexible corrections ---


def test_hat_functions_are_piecewise_linear_over_the_quantiles() -> None:
    value = np.concatenate([np.random.default_rng(1).exponential(size=500), [np.nan] * 5])
    hats = consistency.hat_functions(value)
    assert hats.shape == (505, LIMITS.knots - 1)
    assert np.all((hats >= 0.0) & (hats <= 1.0)) and not hats[500:].any()
    assert np.all(hats[:500].sum(axis=1) <= 1.0 + 1e-12)
    knots = np.quantile(value[:500], np.linspace(0.0, 1.0, LIMITS.knots))
    np.testing.assert_allclose(
        hats[:500] @ knots[1:] + knots[0] * (1 - hats[:500].sum(axis=1)), value[:500]
    )
    assert consistency.hat_functions(np.full(9, 2.0)).shape == (9, 0)


def test_columns_of_noise_gain_nothing_and_a_column_in_the_residual_gains_its_power() -> None:
    toy = Toy(COULOMB, oscillation_a=0.3)
    state = begun_search(toy, "coulomb_friction")
    best = state.fits[("coulomb_friction",)]
    noise = np.random.default_rng(3).normal(size=(toy.n, 4))
    assert abs(consistency.further_gain(state, best, noise)) < 10.0 * 4 / toy.n
    wave = (toy.signal == 0) * np.sin(2.0 * np.pi * 7.3 * toy.time_s)
    power = 0.5 * (0.3 / 0.15) ** 2 / 3.0  # of one signal of three
    for scale in (1.0, 1e6):
        gain = consistency.further_gain(state, best, scale * wave[:, None])
        assert gain == pytest.approx(power, rel=0.05)
    assert consistency.further_gain(state, best, np.zeros((toy.n, 2))) == pytest.approx(
        0.0, abs=1e-6
    )


def test_a_column_of_the_fit_itself_gains_nothing(friction: search_state.Search) -> None:
    best = friction.fits[("coulomb_friction",)]
    own = consistency.sensitivity(best, "coulomb_friction")[:, None]
    assert abs(consistency.further_gain(friction, best, own)) < 1e-3


def test_an_imitation_gains_with_a_size_that_depends_on_speed() -> None:
    true, false = Toy(DRAG), Toy(ONE_SIDED)
    gains = []
    for toy, name in ((true, "quadratic_drag"), (false, "coulomb_friction")):
        state = begun_search(toy, name)
        best = state.fits[(name,)]
        gain = state.score(state.retuned) - state.score(best)
        gains.append(consistency.varying_gain(state, best, name, covariates(toy)) / gain)
    assert gains[0] < 0.01 and gains[1] > LIMITS.max_varying_gain


def test_the_correction_of_the_subsystem_gains_where_another_of_its_effects_is_at_work() -> None:
    toy = Toy(COULOMB | {"effects.quadratic_drag.nm_s2_per_rad2": 2e-9})
    state = begun_search(toy, "coulomb_friction", "quadratic_drag", "current_gain")
    best = state.fits[("coulomb_friction",)]
    assert consistency.subsystem_gain(state, best, "coulomb_friction") > 0.1
    alone = begun_search(Toy(COULOMB), "coulomb_friction", "quadratic_drag", "current_gain")
    assert (
        consistency.subsystem_gain(alone, alone.fits[("coulomb_friction",)], "coulomb_friction")
        < 0.01
    )


# --- members ---

RULES = (
    "significant",
    "keeps_size",
    "needs_its_period",
    "loses_little",
    "complete",
    "constant",
    "inside_bounds",
)


def test_a_true_effect_is_established_and_an_imitation_is_not() -> None:
    for truth, holds in ((COULOMB, True), (ONE_SIDED, False)):
        toy = Toy(truth)
        state = begun_search(toy, "coulomb_friction", "current_gain")
        best = state.fits[("coulomb_friction",)]
        found = established.Member(state, best, "coulomb_friction", covariates(toy))
        assert found.established is holds and found.gain > 1.0
        named = established.established_set(state, best, covariates(toy))
        assert named.ids == (("coulomb_friction",) if holds else ())


def test_a_rival_needs_a_significant_gain_a_kept_size_and_its_period_only() -> None:
    needed = {"significant", "keeps_size", "needs_its_period", "inside_bounds"}
    assert member().is_rival
    for rule in RULES:
        assert member(without=rule).is_rival is (rule not in needed)


def test_the_members_by_which_a_rival_differs_are_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {"a": False, "b": True, "c": True, "d": False}
    monkeypatch.setattr(
        established,
        "Member",
        lambda search, fit, effect_id, _: SimpleNamespace(is_rival=counts[effect_id]),
    )
    best = SimpleNamespace(ids=("a", "c"))
    for ids, holds in ((("a", "b"), True), (("b",), True), (("a", "d"), False), (("d",), False)):
        rival = SimpleNamespace(ids=ids)
        assert established.is_established_rival(SimpleNamespace(), rival, best, {}) is holds


@pytest.mark.parametrize(
    ("holds", "named"),
    [
        ({"b"}, ("b",)),  # a part of the selected set
        ({"a", "b", "c"}, ("a", "b", "c")),
        ({"b", "c"}, ("b", "c")),  # no part of it
        ({"d"}, ("d",)),
        (set(), ()),
    ],
)
def test_the_best_of_all_fitted_sets_whose_members_are_established_is_named(
    holds: set[str], named: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The selected set has the members a and b."""
    left = {"": 9.0, "a": 8.0, "b": 6.0, "d": 4.5, "a b": 3.0, "b c": 5.0, "a b c": 4.0}
    fits = {tuple(k.split()): SimpleNamespace(ids=tuple(k.split())) for k in left}

    def score(one: SimpleNamespace) -> float:
        return left[" ".join(one.ids)]

    state = SimpleNamespace(
        fits=fits,
        retuned=fits[()],
        score=score,
        ranked=lambda: sorted(fits.values(), key=score),
        without=frozenset(),
    )

    def member(search: object, one: SimpleNamespace, effect_id: str, _: object) -> SimpleNamespace:
        return SimpleNamespace(id=effect_id, established=set(one.ids) == holds, gain=1.0)

    monkeypatch.setattr(established, "Member", member)
    monkeypatch.setattr(established, "may_be_established", lambda *_: True)
    monkeypatch.setattr(established, "can_grow", lambda *_: False)
    monkeypatch.setattr(established, "replaces", lambda *_: True)
    monkeypatch.setattr(established, "single_sufficient", lambda _, one, __: one)
    monkeypatch.setattr(established, "fewer_sufficient", lambda _, one, __: one)
    monkeypatch.setattr(
        established,
        "fit_without",
        lambda _, one, gone: fits[tuple(i for i in one.ids if i != gone)],
    )
    found = established.established_set(state, fits[("a", "b")], {})
    assert found.ids == named


def test_every_rule_is_needed() -> None:
    assert member().established
    assert not any(member(without=rule).established for rule in RULES)


@pytest.mark.parametrize(
    ("further", "left", "closed", "minor"),
    [
        (3.4, 10.0, 0.0, True),  # 0.34 of the gain
        (3.6, 10.0, 0.0, False),
        (9.0, 10.0, 0.75, True),  # 0.9 of what is left is 0.3 of what is closed
        (9.0, 10.0, 0.70, False),
        (9.0, 2.0, 0.75, True),  # no more than all that is left
        (9.0, 0.0, 0.75, True),
        (9.0, -0.1, 0.70, False),
        (9.0, 10.0, -0.5, False),
    ],
)
def test_a_further_gap_is_minor_as_a_share_of_the_comparison_or_of_the_reported_gap(
    further: float, left: float, closed: float, minor: bool
) -> None:
    """The comparison clips large errors: of a gain of 10 it shows no more than that."""
    state = SimpleNamespace(
        excess_power=lambda _: left,
        closed_far_share=lambda *_: closed,
    )
    found = established.Member(state, SimpleNamespace(), "a", {})
    vars(found).update(gain=10.0, without=SimpleNamespace())
    assert found._is_minor(further, 0.35) is minor


def member(without: str = "") -> established.Member:
    """A member that fulfils every rule but one."""
    found = established.Member(SimpleNamespace(), SimpleNamespace(), "a", {})
    vars(found).update({rule: rule != without for rule in RULES})
    return found


@pytest.mark.parametrize(
    ("gains", "enough"),
    [
        # of 30 per row that retuning leaves above the noise
        ([1.1, 1.1, 1.1], True),
        ([0.9, 0.9, 0.9], False),
        ([0.0, 0.0, 1.9], True),  # a tenth of one signal alone
        ([0.0, 0.0, 0.9], False),
    ],
)
def test_a_member_must_gain_a_tenth_pooled_or_in_one_signal(
    gains: list[float], enough: bool
) -> None:
    best = np.array([2.0, 2.0, 2.0])
    assert gains_state(best, np.array(gains)).gains_share("best", "without") is enough


@pytest.mark.parametrize(
    ("gain", "enough"),
    [(0.30, True), (0.12, True), (0.08, False)],
)
def test_a_member_that_closes_half_of_what_the_others_leave_gains_enough(
    gain: float, enough: bool
) -> None:
    """The set leaves 0.1 above the noise in each signal, 0.1 + gain without the member; a tenth of
    what retuning leaves is 1 in each.
    """
    best = np.full(3, 1.0 / 3.0 + 0.1)
    state = gains_state(best, np.full(3, gain))
    assert state.gains_share("best", "without") is enough


@pytest.mark.parametrize(
    ("near", "gains", "enough"),
    [
        ("", [0.5, 0.5, 0.5], False),
        ("", [49.0, 49.0, 49.0], True),  # of 950 that the other set closes
        ("", [47.0, 47.0, 47.0], False),
        ("", [0.0, 0.0, 49.0], True),  # in one signal alone
        # near the noise the fitted comparison decides alone
        ("best", [0.5, 0.5, 0.5], True),
        ("without", [0.5, 0.5, 0.5], True),
    ],
)
def test_far_from_the_noise_a_set_must_gain_more_than_the_form_error_of_another(
    near: str, gains: list[float], enough: bool
) -> None:
    """Retuning leaves 1,000 in each signal of the reported gap, of which the fitted comparison
    clips all but 10; the form error is 0.05 of what the other set closes.
    """
    best = np.full(3, 1.0 / 3.0 + 0.1)
    state = gains_state(best, np.full(3, 0.1))
    reported = {
        "retuned": np.full(3, 1000.0 + 1.0 / 3.0),
        "best": best,
        "without": best + np.array(gains),
    }
    state.reported_loss_by_column = lambda one: reported[one]
    state.reported_gap = lambda one: float(np.sqrt(reported[one].sum()))
    state.is_far_from_noise = lambda one: one != near
    assert state.gains_over_form_error("best", "without") is enough
    # here the sizes decide also where the better set ends near the noise
    assert state.leaves_far_gap_of("without", "best") is (enough and not near)
    assert not state.leaves_far_gap_of("best", "without")


@pytest.mark.parametrize(
    ("left", "gains", "closed"),
    [
        ([0.5, 0.5, 0.5], [0.5, 0.5, 0.5], 0.5),
        ([1.0, 1.0, 0.1], [0.0, 0.0, 0.9], 0.9),  # of one signal alone
        ([1.0, 1.0, 0.001], [0.0, 0.0, 0.009], 0.009 / 2.01),  # no visible gap there
    ],
)
def test_the_share_that_a_member_closes_is_that_of_the_signal_in_which_it_closes_most(
    left: list[float], gains: list[float], closed: float
) -> None:
    """left: squared gap above the noise that the set leaves in each signal."""
    state = gains_state(1.0 / 3.0 + np.array(left), np.array(gains))
    assert state.closed_share("best", "without").largest == pytest.approx(closed)


def test_the_size_of_a_member_is_judged_by_the_share_that_it_closes(
    friction: search_state.Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A true effect closes all that the retuned model leaves above the noise."""
    judged: list[ClosedShare] = []
    monkeypatch.setattr(consistency, "keeps_its_size", lambda *given: judged.append(given[3]))
    best = friction.fits[("coulomb_friction",)]
    assert established.Member(friction, best, "coulomb_friction", {}).keeps_size is None
    assert judged[0].pooled == pytest.approx(1.0, abs=0.05)
    assert judged[0].largest >= judged[0].pooled


@pytest.mark.parametrize(
    ("found", "tied", "better", "far", "replaced"),
    [
        ((), True, False, False, True),
        (("a",), True, True, False, False),
        (("a",), False, False, False, False),
        (("a",), False, True, False, True),
        (("a", "c"), False, False, False, True),
        (("a",), True, False, True, True),
    ],
)
def test_an_established_set_replaces_the_empty_one_and_any_that_it_betters(
    found: tuple[str, ...], tied: bool, better: bool, far: bool, replaced: bool
) -> None:
    """far: whether the other set leaves a gap far above the noise of which this one closes nearly
    all.
    """
    state = SimpleNamespace(
        is_tied=lambda *_: tied, is_better=lambda *_: better, closes_far_gap=lambda *_: far
    )
    sets = (SimpleNamespace(ids=ids) for ids in (("a", "b"), found))
    assert established.replaces(state, *sets) is replaced


PAIR = ("coulomb_friction", "added_inertia")


@pytest.mark.parametrize(
    ("singles", "gains", "holds", "tied", "named"),
    [
        (["speed_gain"], True, True, "", PAIR),
        (["speed_gain"], False, True, "", ("speed_gain",)),
        (["speed_gain"], False, False, "", PAIR),
        # a member, or a general form of one: the other effect is established beside it
        (["coulomb_friction"], False, True, "", PAIR),
        (["stribeck_friction"], False, True, "", PAIR),
        (["speed_gain", "added_inertia"], False, True, "", ("speed_gain",)),
        (["speed_gain", "added_inertia"], False, True, "added_inertia", PAIR),
    ],
)
def test_a_single_other_effect_is_named_where_several_gain_little(
    singles: list[str],
    gains: bool,
    holds: bool,
    tied: str,
    named: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two effects that follow the error of form of one other, each needed beside the other."""
    both, *ranked = (SimpleNamespace(ids=ids) for ids in (PAIR, *((i,) for i in singles)))
    state = SimpleNamespace(
        ranked=lambda _: ranked,
        gains_over_form_error=lambda *_: gains,
        is_tied=lambda one, _: one.ids == (tied,),
    )
    monkeypatch.setattr(established, "is_established", lambda *_: holds)
    monkeypatch.setattr(established, "fit_set", lambda _, __, known: known)
    assert established.single_sufficient(state, both, {}).ids == named


@pytest.mark.parametrize(
    ("gap", "score", "count", "holds", "near", "named"),
    [
        (3.1, 5.9, 2, True, "", "ax"),
        (3.1, 6.1, 2, True, "", "abc"),  # predicts far worse in the fitted comparison
        (3.1, 5.9, 5, True, "", "abc"),  # as many parameters
        (3.3, 5.9, 2, True, "", "abc"),  # a larger reported gap
        (3.1, 5.9, 2, False, "", "abc"),  # not established
        # near the noise the fitted comparison decides
        (3.1, 5.9, 2, True, "abc", "abc"),
        (3.1, 5.9, 2, True, "ax", "abc"),
        # another comparison is judged, or whitened residuals
        (3.1, 5.9, 2, True, "gap_problem", "abc"),
        (3.1, 5.9, 2, True, "unwhitened", "abc"),
    ],
)
def test_fewer_effects_that_leave_no_larger_reported_gap_are_named(
    gap: float,
    score: float,
    count: int,
    holds: bool,
    near: str,
    named: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def a_set(ids: str, parameters: int) -> SimpleNamespace:
        return SimpleNamespace(ids=tuple(ids), hypothesis=SimpleNamespace(count=parameters))

    pair = a_set("ax", count)
    state = SimpleNamespace(
        gap_problem=near if near == "gap_problem" else None,
        unwhitened=near if near == "unwhitened" else None,
        ranked=lambda size: [pair] if size == 2 else [],
        score=lambda one: score if one is pair else 4.0,
        reported_gap=lambda one: gap if one is pair else 3.2,
        is_far_from_noise=lambda one: "".join(one.ids) != near,
    )
    monkeypatch.setattr(established, "fit_set", lambda _, __, known: known)
    monkeypatch.setattr(established, "is_established", lambda *_: holds)
    assert "".join(established.fewer_sufficient(state, a_set("abc", 5), {}).ids) == named


def test_a_general_form_of_a_single_effect_does_not_keep_the_set_that_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A Stribeck friction beside others follows what a Coulomb friction explains alone."""
    several, *ranked = (
        SimpleNamespace(ids=ids)
        for ids in (
            ("stribeck_friction", "speed_gain"),
            ("stribeck_friction",),
            ("coulomb_friction",),
        )
    )
    state = SimpleNamespace(
        ranked=lambda _: ranked,
        gains_over_form_error=lambda *_: False,
        is_tied=lambda *_: True,
    )
    monkeypatch.setattr(established, "is_established", lambda *_: True)
    monkeypatch.setattr(established, "fit_set", lambda _, __, known: known)
    assert established.single_sufficient(state, several, {}).ids == ("coulomb_friction",)


def gains_state(best: np.ndarray, gains: np.ndarray) -> SimpleNamespace:
    """A search with the squared gaps (3,) of the signals that a set leaves, and that it leaves
    without a member, by gains more; retuning leaves 10 above the noise in each.
    """
    left = {"retuned": np.full(3, 10.0 + 1.0 / 3.0), "best": best, "without": best + gains}
    state = SimpleNamespace(
        loss_by_column=lambda one: left[one],
        floor_by_column=np.full(3, 1.0 / 3.0),
        floor_power=1.0,
        retuned="retuned",
        gap_problem=None,
        sample_shares=np.full(3, 1.0 / 3.0),
    )
    for method in (
        Search.is_substantial,
        Search.gains_share,
        Search.gains_over_form_error,
        Search.leaves_far_gap_of,
        Search._gain_exceeds_form_error,
        Search.closed_share,
    ):
        setattr(state, method.__name__, MethodType(method, state))
    return state


def test_a_number_at_a_bound_of_the_search_is_not_established() -> None:
    toy = Toy(COULOMB)
    state = begun_search(toy, "coulomb_friction")
    best = state.fits[("coulomb_friction",)]
    assert not search_state.ends_at_bound(best, "coulomb_friction")
    at_bound = replace(best, x=best.hypothesis.high.copy())
    assert search_state.ends_at_bound(at_bound, "coulomb_friction")
    assert not search_state.ends_at_bound(at_bound, "viscous_friction")


def test_a_set_with_a_number_at_a_bound_of_the_search_is_not_selected() -> None:
    toy = Toy(COULOMB)
    state = begun_search(toy, "coulomb_friction")
    best = state.fits[("coulomb_friction",)]
    assert state.ranked(1) == [best]
    state.fits[best.ids] = replace(best, x=best.hypothesis.high.copy())
    assert state.ranked(1) == []


def loaded_log() -> MadeLog:
    """A log of a tool with a load that comes and goes, and that neither rig nor catalogue has."""
    plain = drive_log(rig(), seconds=3.0)
    time_s, duty = plain.time_s, plain.columns["duty"]
    loaded = ((time_s > 0.9) & (time_s < 1.6)) | (time_s > 2.5)
    rows = _core.simulate_log(
        _core.LogInput(
            time_s, "duty", duty, load_kind="torque", load_nm=0.25 * loaded, slew_per_s=6.0
        ),
        rig().parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    rng = np.random.default_rng(2)
    current = rows["current_a"][0] + 0.15 * rng.standard_normal(len(time_s))
    supply = rows["supply_v"][0] + 0.02 * rng.standard_normal(len(time_s))
    speed = rows["speed_rad_s"][0] * 30.0 / np.pi
    return MadeLog(
        time_s, {"duty": duty, "current_a": current, "supply_v": supply, "speed_rpm": speed}
    )


def test_a_load_outside_the_catalogue_is_not_named_as_friction() -> None:
    sensors = {"hall_pulses_per_rev": 0, "speed_noise_rpm": 2.0}
    verdict = diagnose([loaded_log()], rig(sensors=sensors), OPTIONS)
    assert (verdict.verdict, verdict.selected) == ("unlisted", [])
    assert verdict.gap.before > 3.0 and verdict.unexplained.significant


def test_a_friction_of_the_catalogue_is_named() -> None:
    log = drive_log(rig(effects={"coulomb_friction": {"torque_nm": 0.01}}), seconds=3.0)
    verdict = diagnose([log], rig(), OPTIONS)
    assert (verdict.verdict, verdict.selected) == ("effect", ["coulomb_friction"])
    assert verdict.effects[0].evidence.comparison == "forward simulation"
