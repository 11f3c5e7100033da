"""Fits of hypotheses: steps within bounds, recovered parameters, nuisance parameters under their
priors, coverage of confidence intervals.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import SCALES, Toy, fit_of
from vgroove.gap.catalogue import BY_ID, CATALOGUE, available, contains, equivalents
from vgroove.gap.fitting.covariance import (
    Covariance,
    interval_half_widths,
    region_excludes_zero,
    sandwich_covariance,
)
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Coordinate, Hypothesis
from vgroove.gap.fitting.steps import (
    BOUND_SLACK,
    RIDGE,
    RIDGE_SHARE,
    bounded_step,
    difference_steps,
)
from vgroove.gap.residual.batches import split_by_size, split_by_structure
from vgroove.gap.selection.intervals import Estimate

TORQUE = "effects.coulomb_friction.torque_nm"
STRIBECK_SPEED = {"effects.stribeck_friction.speed_rad_s": 200.0}


def value(toy: Toy, one: object, name: str) -> float:
    """A fitted flat parameter."""
    return float(one.hypothesis.theta(toy.theta0, one.x[None, :])[0, toy.index(name)])


def test_bounded_step_is_the_constrained_minimum() -> None:
    normal, gradient = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-3.0, -3.0])
    np.testing.assert_allclose(
        bounded_step(normal, gradient, np.full(2, -9.0), np.full(2, 9.0)), [1.0, 1.0], rtol=1e-6
    )
    np.testing.assert_allclose(
        bounded_step(normal, gradient, np.full(2, -9.0), np.array([0.4, 9.0])),
        [0.4, 1.3],
        rtol=1e-6,
    )


def test_a_bounded_step_ends_within_the_bounds_to_the_last_bit() -> None:
    """The second number leaves its bound by less than what counts as a violation there. A delay of
    -1e-17 s is outside the plant's range.
    """
    low, high = np.full(2, -1.0), np.full(2, 9.0)
    beyond = (1.0 + RIDGE_SHARE + RIDGE) * (1.0 + 0.5 * BOUND_SLACK)
    step = bounded_step(np.eye(2), np.array([5.0, beyond]), low, high)
    assert np.array_equal(step, low)


@pytest.mark.parametrize(
    ("x", "low", "high", "step"),
    [
        (0.0, -1.0, 1.0, 0.1),
        (1.0, -1.0, 1.0, -0.1),
        (0.01, 0.0, 0.05, 0.04),
        (0.04, 0, 0.05, -0.04),
    ],
)
def test_a_difference_step_stays_within_the_bounds(
    x: float, low: float, high: float, step: float
) -> None:
    number = Coordinate("one", (0,), (1.0,), 0.0, low, high, step=0.1)
    h = Hypothesis(("one",), (number,), np.zeros(1))
    np.testing.assert_allclose(difference_steps(h, np.array([x])), [step], rtol=1e-12)


def test_a_change_of_a_stated_size_ends_at_zero_to_the_last_bit() -> None:
    """The sum of a stated size and of the change that takes it back to 0 may be rounded to -1e-17,
    which the plant would refuse as a negative size.
    """
    for stated in np.random.default_rng(1).uniform(0.0, 1.0, 200):
        number = Coordinate("one", (0,), (0.04,), 0.0, -stated, 1.0, stated=stated)
        points = np.nextafter(-stated, [[-1.0], [-stated], [1.0]])
        found = Hypothesis(("one",), (number,), np.zeros(1)).theta(np.zeros(1), points)
        assert np.all(found >= 0.0) and np.all(found < 1e-15)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("winding_resistance.relative", 0.1),
        ("coulomb_friction.torque_nm", 0.004),
        ("current_offset.offset_a", -0.8),
        ("transport_delay.delay_s", 0.006),
        ("added_inertia.kg_m2", 2e-6),
        ("supply_resistance.resistance_ohm", 0.01),
        ("stribeck_friction.breakaway_nm", 0.02),
    ],
)
def test_the_size_of_an_effect_is_recovered(name: str, size: float) -> None:
    toy = Toy(
        {f"effects.{name}": size}
        | ({"effects.stribeck_friction.speed_rad_s": 80.0} if "stribeck" in name else {})
    )
    _, best = fit_of(toy, name.split(".")[0])
    assert value(toy, best, f"effects.{name}") == pytest.approx(size, rel=0.05)
    assert toy.gap(best.out_of_fold) < 1.02


def test_no_hypothesis_gives_no_fit() -> None:
    assert Engine(Toy({}), SCALES, {}).fit([]) == []


def test_outliers_do_not_move_the_fit() -> None:
    toy = Toy({TORQUE: 0.004})
    rng = np.random.default_rng(5)
    hit = rng.integers(0, toy.measured_rows.shape[1], 200)
    toy.measured_rows[1, hit] += 4000.0
    _, best = fit_of(toy, "coulomb_friction")
    assert value(toy, best, TORQUE) == pytest.approx(0.004, rel=0.05)


def test_nuisance_parameters_stay_within_three_sigma_of_their_logarithm() -> None:
    """The prior is log-normal with the relative standard deviation that the rig states."""
    toy = Toy({"motor.resistance_ohm": 0.19 * 1.15})
    engine, _ = fit_of(toy, tolerance={"motor.resistance_ohm": 0.02})
    retuned = engine.fit(engine.hypotheses([]))[0]
    assert value(toy, retuned, "motor.resistance_ohm") == pytest.approx(
        0.19 * np.exp(3.0 * np.sqrt(np.log(1.0 + 0.02**2))), rel=1e-6
    )
    free, _ = fit_of(toy, tolerance={"motor.resistance_ohm": 0.2})
    assert value(toy, free.fit(free.hypotheses([]))[0], "motor.resistance_ohm") == pytest.approx(
        0.19 * 1.15, rel=0.01
    )


def test_a_number_without_information_in_a_folds_rows_keeps_the_step_of_all_rows() -> None:
    """Two coordinates: the first shifts all rows, the second the rows of one fold; on the rows of
    the other folds it acts so little that their noise alone would determine it.
    """
    toy = Toy({"effects.current_offset.offset_a": 0.5})
    engine, one = fit_of(toy, "current_offset", "current_gain")
    test, noise = engine.problem.folds[1][1], np.random.default_rng(2).normal(size=toy.n)
    one.jacobian, one.residual = one.jacobian.copy(), noise
    one.jacobian[:, 0] = 1.0
    one.jacobian[:, 1] = np.where(test, 1.0, 1e-4 * np.random.default_rng(3).normal(size=toy.n))
    whole, apart = engine.steps(one)
    assert np.abs(apart[1] - whole)[1] < 0.1
    assert apart[0][0] == pytest.approx(-noise[engine.problem.folds[0][0]].mean(), abs=0.01)


@pytest.mark.proof
def test_intervals_cover_the_true_value() -> None:
    inside = 0
    for seed in range(40):
        toy = Toy({TORQUE: 0.004}, seed=seed)
        engine, best = fit_of(toy, "coulomb_friction")
        cluster = (toy.time_s / 0.05).astype(int)
        spread = (
            np.sqrt(sandwich_covariance(best, engine.train, cluster).total[0, 0])
            * best.hypothesis.coordinates[0].factors[0]
        )
        inside += abs(value(toy, best, TORQUE) - 0.004) < 1.96 * spread
    assert 34 <= inside <= 40


def test_asymmetry_beside_coulomb_friction_is_one_number() -> None:
    engine = Engine(Toy({}), SCALES, {})
    single = engine.hypotheses([BY_ID["asymmetric_friction"]])[0]
    beside = engine.hypotheses([BY_ID["coulomb_friction"], BY_ID["asymmetric_friction"]])[0]
    assert (single.count, beside.count) == (2, 2)
    theta = beside.theta(engine.problem.theta0, np.array([[0.0, 1.0]]))[0]
    forward, backward = (
        theta[engine.problem.index(f"effects.asymmetric_friction.{s}_nm")]
        for s in ("forward", "backward")
    )
    assert forward == -backward != 0.0


def test_phase_and_amplitude_come_from_sine_and_cosine() -> None:
    engine = Engine(Toy({}), SCALES, {})
    h = engine.hypotheses([BY_ID["gear_eccentricity"]])[0]
    theta = h.theta(engine.problem.theta0, np.array([[0.3, 0.4]]))[0]
    size = h.coordinates[0].factors[0]
    assert theta[engine.problem.index("effects.gear_eccentricity.torque_nm")] == pytest.approx(
        0.5 * size
    )
    assert theta[engine.problem.index("effects.gear_eccentricity.phase_rad")] == pytest.approx(
        np.arctan2(0.4, 0.3)
    )


def test_available_effects_follow_from_what_a_log_holds() -> None:
    full = frozenset({"rows", "motion"}) | frozenset(
        {"duty", "voltage", "current", "speed", "supply", "both", "load", "edges", "output"}
    )
    impact = {e.id for e in CATALOGUE if e.subsystem in ("mechanism", "load")}
    missing = {e.id for e in CATALOGUE} - {e.id for e in available(full)}
    assert missing == {"bridge_resistance"} | impact and len(impact) == 9
    assert impact <= {e.id for e in available(full | {"impact"})}
    force = {e.id for e in available(frozenset({"current_input", "position", "both"}))}
    assert not force & {
        "winding_resistance",
        "brush_drop",
        "current_gain",
        "current_offset",
        "supply_gain",
        "speed_gain",
    }
    assert {"coulomb_friction", "asymmetric_friction", "torque_constant"} <= force
    assert "winding_resistance" not in {
        e.id for e in available(full, frozenset({"winding_resistance"}))
    }
    assert "asymmetric_friction" not in {e.id for e in available(full - {"both"})}


def test_classes_and_special_cases() -> None:
    assert equivalents("winding_resistance", frozenset()) == ("bridge_resistance",)
    assert equivalents("torque_constant", frozenset({"current_input"})) == ("current_gain",)
    assert contains(("asymmetric_friction",), ("coulomb_friction",))
    assert not contains(("coulomb_friction",), ("asymmetric_friction",))
    assert contains(("stribeck_friction", "current_gain"), ("current_gain", "coulomb_friction"))
    assert not contains(("viscous_friction", "current_gain"), ("current_gain", "coulomb_friction"))


def test_differences_of_positive_numbers_are_relative() -> None:
    """The usual difference step of 0.1 would exceed a stiffness whose scaled value is 0.05: a
    positive parameter gets a step of a tenth of its value instead.
    """
    from vgroove.gap.fitting.hypothesis import Coordinate

    stiffness = Coordinate("k", (0,), (1.0,), 0.0, 0.01, 900.0, 0.1)
    torque = Coordinate("t", (0,), (1.0,), 0.0, -1.0, 1.0, 0.1)
    assert stiffness.step_at(0.05) == pytest.approx(0.005) and stiffness.step_at(20.0) == 0.1
    assert torque.step_at(0.05) == 0.1


def test_intervals_are_wider_where_folds_disagree() -> None:
    """Half widths include the scatter over long clusters and over folds, not the noise alone."""
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.003})
    engine = Engine(toy, SCALES, {})
    one = engine.fit(engine.hypotheses([BY_ID["coulomb_friction"]]))[0]
    short = np.unique(np.floor(toy.time_s / 0.05), return_inverse=True)[1]
    of_noise = 1.96 * np.sqrt(np.diag(sandwich_covariance(one, engine.train, short).total))
    assert np.all(interval_half_widths(engine, one, [short]) >= of_noise)
    # blocks of every fourth number in which the effect has another size
    disturbed = one.residual + 3.0 * one.jacobian[:, 0] * np.where(
        toy.block % 4 == 0, 0.05, -0.05 / 3.0
    )
    moved = type(one)(one.hypothesis, one.x, disturbed, one.jacobian, one.cost, 1e9)
    assert (
        interval_half_widths(engine, moved, [short])[0]
        > 2.0 * interval_half_widths(engine, one, [short])[0]
    )


def test_the_jackknife_takes_the_steps_that_were_simulated() -> None:
    """A fold's first-order step that raises the cost of the fold's rows is shortened; the interval
    is that of the shortened steps.
    """
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.003})
    engine = Engine(toy, SCALES, {})
    one = engine.fit(engine.hypotheses([BY_ID["coulomb_friction"]]))[0]
    first_order = engine.steps_without(one)
    predict_held_out(engine, [one])
    assert engine.steps_without(one) == pytest.approx(first_order, abs=1e-3 * abs(one.x[0]))
    one.fold_steps = 0.1 * one.fold_steps
    assert engine.steps_without(one) == pytest.approx(0.1 * first_order, abs=1e-3 * abs(one.x[0]))


@pytest.mark.parametrize(
    "sizes,expected",
    [([], []), ([3], [1]), ([2, 2, 2], [2, 1]), ([9, 1, 1], [1, 2]), ([0, 0, 5], [3])],
)
def test_split_by_size_respects_the_limit_and_keeps_every_item(
    sizes: list[int], expected: list[int]
) -> None:
    parts = list(split_by_size(sizes, 4))
    assert [part.stop - part.start for part in parts] == expected
    assert [n for part in parts for n in range(len(sizes))[part]] == list(range(len(sizes)))


@pytest.mark.parametrize("most", [1, 8, 20])
def test_split_by_structure_keeps_every_set_and_whole_lanes(most: int) -> None:
    kind = np.array([0, 1, 2, 0, 1] * 5)
    parts = split_by_structure(np.eye(3, dtype=bool)[kind], most)
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(25))
    lanes = sum(-(-int(np.count_nonzero(kind[part] == k)) // 8) for part in parts for k in range(3))
    assert lanes == 5  # 10, 10 and 5 sets, eight at a time


def linear_fit(columns: np.ndarray, true: np.ndarray, seed: int) -> tuple[object, object, list]:
    """Test doubles of an engine and of a fit by least squares, and one clustering in 20 rows each.
    The model is linear: columns (n, p) times values (p,), whose true ones are given, and white
    noise of unit variance.
    """
    noise = np.random.default_rng(seed).standard_normal(len(columns))
    x = np.linalg.lstsq(columns, columns @ true + noise, rcond=None)[0]
    coordinates = SimpleNamespace(prior=np.zeros(len(true)))
    one = SimpleNamespace(
        x=x,
        jacobian=columns,
        residual=columns @ x - columns @ true - noise,
        delta=1e6,
        hypothesis=coordinates,
    )
    engine = SimpleNamespace(train=np.ones(len(columns), bool), steps_without=lambda _: [])
    return engine, one, [np.arange(len(columns)) // 20]


def test_numbers_that_are_determined_together_are_known_although_no_interval_is() -> None:
    rng = np.random.default_rng(3)
    base = rng.standard_normal(400)
    columns = np.stack([base, base + 0.02 * rng.standard_normal(400)], axis=1)
    engine, one, clusters = linear_fit(columns, np.array([0.5, 0.5]), 4)
    widths = interval_half_widths(engine, one, clusters)
    assert np.all(np.abs(one.x) < widths)
    assert region_excludes_zero(engine, one, clusters, [0, 1])
    assert not region_excludes_zero(engine, one, clusters, [0])


@pytest.mark.parametrize("seed", range(6))
def test_the_region_of_one_number_is_its_interval(seed: int) -> None:
    columns = np.random.default_rng(seed).standard_normal((200, 2))
    engine, one, clusters = linear_fit(columns, np.array([0.14, 0.0]), seed)
    is_known = np.abs(one.x) > interval_half_widths(engine, one, clusters)
    assert [region_excludes_zero(engine, one, clusters, [k]) for k in (0, 1)] == list(is_known)


def test_too_few_clusters_exclude_nothing() -> None:
    columns = np.random.default_rng(1).standard_normal((40, 2))
    engine, one, clusters = linear_fit(columns, np.array([50.0, 50.0]), 1)
    assert not region_excludes_zero(engine, one, clusters, [0, 1])


def test_a_stated_prior_needs_no_degrees_of_freedom() -> None:
    """Two numbers of which the rows determine the sum, one with a prior: the prior of the second
    makes the uncertainty of the first, which the scatter over two clusters does not determine.
    """
    columns = np.ones((40, 2)) * np.array([1.0, 5.0])
    engine, one, clusters = linear_fit(columns[:, :1], np.array([30.0]), 1)
    one.jacobian, one.x = columns, np.array([30.0, 0.0])
    one.hypothesis.prior = np.array([0.0, 1.0])
    covariance = sandwich_covariance(one, engine.train, clusters[0])
    assert covariance.freedom == 1 and covariance.freedom_of([0]) > 1e3
    assert interval_half_widths(engine, one, clusters)[0] == pytest.approx(1.96 * 5.0, rel=0.02)
    assert region_excludes_zero(engine, one, clusters, [0])


def test_a_certain_number_lends_no_degrees_of_freedom_to_another() -> None:
    mixed = Covariance(np.diag([1.0, 0.0]), np.diag([0.0, 1e-12]), 1)
    assert mixed.freedom_of([0]) == mixed.freedom_of([0, 1]) == pytest.approx(1.0)
    assert mixed.freedom_of([1]) > 1e5


@pytest.mark.parametrize("least", [0.0, -1e-320, 1e-320, 1e-300])
def test_numbers_that_do_not_vary_leave_the_degrees_of_freedom_finite(least: float) -> None:
    """If the fit of every fold ends at a parameter's bound, the variance of the parameter is 0, or,
    by rounding errors, tiny or negative.
    """
    scattered = np.diag([2.0, least])
    scattered[0, 1] = scattered[1, 0] = 1e-170 if least else 0.0
    covariance = Covariance(scattered, np.zeros((2, 2)), 3)
    found = [covariance.freedom_of(places) for places in ([0], [1], [0, 1])]
    assert found == pytest.approx([3.0, 3.0, 3.0])
    assert np.all(np.isfinite(covariance.half_widths))
    # variances that rounding made negative, beside a covariance that is left
    lost = Covariance(np.array([[-1e-3, 10.0], [10.0, -1e-3]]), np.zeros((2, 2)), 3)
    assert lost.freedom_of([0, 1]) == 3.0 and not lost.half_widths.any()


@pytest.mark.parametrize(("spread", "known"), [(0.0, True), (0.1, True), (0.5, False)])
def test_the_scatter_over_folds_counts_for_a_region(spread: float, known: bool) -> None:
    """Of a value of 1 over four folds; a number at a limit of physics does not scatter at all."""
    columns = 100.0 * np.random.default_rng(2).standard_normal((200, 1))
    engine, one, clusters = linear_fit(columns, np.array([1.0]), 2)
    steps = spread * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    engine.steps_without = lambda _: steps
    assert region_excludes_zero(engine, one, clusters, [0]) is known
    assert bool(abs(one.x[0]) > interval_half_widths(engine, one, clusters)[0]) is known


def test_a_size_is_judged_with_the_other_numbers_of_its_effect_held() -> None:
    """Stribeck friction that acts at one speed only: its size and its speed are known together."""
    toy = Toy({"effects.stribeck_friction.breakaway_nm": 0.02} | STRIBECK_SPEED)
    engine, one = fit_of(toy, "stribeck_friction")
    blocks = np.unique(toy.block, return_inverse=True)[1]
    estimate = Estimate(engine, one, (blocks,))
    name = "effects.stribeck_friction.breakaway_nm"
    assert estimate.excludes_zero("stribeck_friction", [name])
    held = one.holding([1])
    assert [c.name for c in held.hypothesis.coordinates] == [name]
    assert held.x[0] == one.x[0] and held.jacobian.shape == (toy.n, 1)
    assert one.holding([]) is one
    assert estimate.excludes_zero("stribeck_friction", [])  # nothing was fitted
