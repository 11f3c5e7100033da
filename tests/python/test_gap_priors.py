"""Priors: on the size of an effect, which decide between sets that predict equally well, and on the
rig's values with a tolerance, which are log-normal; and the bounds of the search, which are no
prior: they are widened where a fit ends at them.
"""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import SCALES, TOOL, Toy
from made_log import MadeLog, drive_log, rig
from vgroove import _core
from vgroove.gap import DiagnosisOptions, diagnose, stages
from vgroove.gap.catalogue import BY_ID, CATALOGUE
from vgroove.gap.catalogue.keys import RELATIVE
from vgroove.gap.fitting.coordinates import WIDER, HypothesisBuilder
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import MAX_NUISANCE_SIGMAS, Coordinate, Hypothesis
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection import search, search_state, single_effects, size_prior
from vgroove.gap.selection.log_content import effect_scales
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RAD_S_PER_RPM

INERTIA = "motor.inertia_kg_m2"
CLOCK, ADDED = BY_ID["clock_skew"], BY_ID["added_inertia"]
CRYSTAL, UNKNOWN = 1e-4, 0.02  # standard deviation of a clock, relative
SLOW_ROW_S, SLOW_LOG_S = 0.03, 12.0  # 20 rows are half of the longest delay that is tried first


class ClockToy(Toy):
    """A toy in which a clock that is 1 % slow looks like 1 % more inertia; of_speed: share of the
    clock's error that scales the measured speed too, which no inertia does.
    """

    of_speed = 0.0

    def _run(self, theta: np.ndarray, commands: np.ndarray, w: np.ndarray) -> np.ndarray:
        theta = theta.copy()
        clock = theta[:, self.index("effects.clock_skew.relative")]
        inertia = theta[:, self.index(INERTIA)]
        theta[:, self.index("effects.added_inertia.kg_m2")] += clock * inertia
        theta[:, self.index("effects.speed_gain.relative")] += self.of_speed * clock
        return super()._run(theta, commands, w)


class SeparableClockToy(ClockToy):
    """A toy whose clock also scales the speed."""

    of_speed = 0.2


def selected(toy: Toy, clock: float) -> search.Selection:
    """Selection between an added inertia and a wrong clock, whose standard deviation is given."""
    scales = SCALES.__class__(**vars(SCALES) | {"clock": clock})
    state = search_state.begin(Engine(toy, scales, {}), [ADDED, CLOCK], DiagnosisOptions())
    return search.select(state)


def named_and_rivals(found: search.Selection) -> tuple[tuple[str, ...], set[str]]:
    return found.best.ids, {i for f in found.rivals for i in f.ids}


# --- sizes of effects ---


def test_a_crystal_prefers_an_added_inertia_to_a_clock_that_is_one_percent_wrong() -> None:
    toy = ClockToy({"effects.added_inertia.kg_m2": 0.01 * 1.8e-5 * 4.0})
    assert named_and_rivals(selected(toy, CRYSTAL)) == (("added_inertia",), set())
    assert named_and_rivals(selected(toy, UNKNOWN)) == (("added_inertia",), {"clock_skew"})


def test_a_prior_never_decides_against_the_data() -> None:
    """The clock predicts better, however implausible it is."""
    toy = SeparableClockToy({"effects.clock_skew.relative": 0.04})
    for clock in (CRYSTAL, UNKNOWN):
        found = selected(toy, clock)
        assert named_and_rivals(found) == (("clock_skew",), set())
        assert size_prior.is_implausible(found.search, found.best) is (clock == CRYSTAL)


@pytest.mark.parametrize(
    ("effect", "size", "implausible"),
    [
        ("added_inertia", 5.1, False),
        ("added_inertia", 5.3, True),
        ("current_offset", -5.1, False),
        ("current_offset", -5.3, True),
    ],
)
def test_a_size_is_implausible_below_a_hundredth_of_the_density_at_zero(
    effect: str, size: float, implausible: bool
) -> None:
    """Student's t of 3 degrees of freedom: (1 + z^2 / 3)^-2 is 0.01 at z = sqrt(27) = 5.196."""
    toy = Toy({})
    engine = Engine(toy, SCALES, {})
    engine.builder.widening[f"effects.{effect}.{BY_ID[effect].leading.name}"] = 100.0
    one = engine.fit(engine.hypotheses([BY_ID[effect]])[:1], 0)[0]
    plausible = BY_ID[effect].leading.plausible(SCALES)
    one.x = np.array([size * plausible / one.hypothesis.coordinates[0].factors[0]])
    state = SimpleNamespace(problem=toy, engine=engine, contradicts_edge_scale=lambda _: False)
    assert size_prior.is_implausible(state, one) is implausible
    assert search.preference(state, one)[0] is implausible


def test_the_prior_density_of_a_set_is_the_product_over_its_members() -> None:
    """Student's t of 3 degrees of freedom: (1 + 3 / 3)^-2 = 1/4 at z = sqrt(3), 1/16 for two."""
    toy = Toy({})
    engine = Engine(toy, SCALES, {})
    state = SimpleNamespace(problem=toy, engine=engine)
    effects = [ADDED, BY_ID["current_offset"]]
    theta = toy.theta0.copy()
    one = SimpleNamespace(ids=tuple(e.id for e in effects), theta=lambda _: theta)
    assert size_prior.prior_density(state, one) == 1.0
    for effect, density in zip(effects, (0.25, 0.0625), strict=True):
        theta[toy.index(effect.name(effect.leading))] = np.sqrt(3.0) * effect.leading.plausible(
            SCALES
        )
        assert size_prior.prior_density(state, one) == pytest.approx(density)
    theta[:] = 1e90
    assert size_prior.prior_density(state, one) > 0.0  # the odds of two such sets stay finite


def test_the_least_plausible_number_of_an_effect_counts() -> None:
    """supply_droop has two numbers with a plausible size. The prior density of the effect is that
    of the number that is larger in units of its plausible size.
    """
    toy, droop = Toy({}), BY_ID["supply_droop"]
    state = SimpleNamespace(problem=toy, engine=Engine(toy, SCALES, {}))
    theta = toy.theta0.copy()
    one = SimpleNamespace(ids=(droop.id,), theta=lambda _: theta)
    for name, z, density in (("volt_per_coulomb", 1.0, 9 / 16), ("polarisation_ohm", 3.0, 1 / 16)):
        (number,) = (p for p in droop.parameters if p.name == name)
        theta[toy.index(droop.name(number))] = z * number.plausible(SCALES)
        assert size_prior.prior_density(state, one) == pytest.approx(density)


@pytest.mark.parametrize("effect", ["added_inertia", "magnetic_saturation"])
def test_the_size_of_an_effect_that_the_rig_states_is_its_change(effect: str) -> None:
    """The rig's own value is certain, however far from plausible; of a limit the change of its
    reciprocal counts.
    """
    toy, leading = Toy({}), BY_ID[effect].leading
    column, plausible = toy.index(BY_ID[effect].name(leading)), leading.plausible(SCALES)
    state = SimpleNamespace(problem=toy, engine=Engine(toy, SCALES, {}))
    stated, changed = 20.0 * plausible, (20.0 - np.sqrt(3.0)) * plausible
    if leading.neutral != 0.0:
        stated, changed = plausible**2 / stated, plausible**2 / changed
    toy.theta0 = toy.theta0.copy()
    toy.theta0[column] = stated
    theta = toy.theta0.copy()
    one = SimpleNamespace(ids=(effect,), theta=lambda _: theta)
    assert size_prior.prior_density(state, one) == 1.0
    theta[column] = changed
    assert size_prior.prior_density(state, one) == pytest.approx(0.25)


def test_of_a_limit_small_values_are_odd() -> None:
    """A saturation acts at small currents where its limit is small."""
    effect = BY_ID["magnetic_saturation"]
    plausible = effect.leading.plausible(SCALES)
    assert effect.leading.implausibility(plausible, SCALES, 0.0) == pytest.approx(1.0)
    assert effect.leading.implausibility(0.1 * plausible, SCALES, 0.0) == pytest.approx(10.0)
    assert effect.leading.implausibility(10.0 * plausible, SCALES, 0.0) == pytest.approx(0.1)


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.id)
def test_the_typical_size_of_an_effect_is_plausible(effect: object) -> None:
    if effect.leading.plausible is None or effect.leading.neutral != 0.0:
        return
    size = effect.leading.size(SCALES)
    assert effect.leading.plausible(SCALES) > 0.0
    assert effect.leading.implausibility(size, SCALES, 0.0) < 5.0
    equal = ((-size, 0.0), (2.0 * size, size), (0.0, -size))
    if effect.leading.key == RELATIVE:  # half of a value is as plausible as twice of it
        inverse = 1.0 / (1.0 + size) - 1.0
        equal = ((inverse, 0.0), (2.0 * size + size**2, size), (0.0, inverse))
    for other, stated in equal:
        same = effect.leading.implausibility(size, SCALES, 0.0)
        assert effect.leading.implausibility(other, SCALES, stated) == pytest.approx(same)


@pytest.mark.parametrize(("sensors", "clock"), [({}, UNKNOWN), ({"clock_ppm": 100}, CRYSTAL)])
def test_the_rig_states_how_far_the_clock_may_be_wrong(
    sensors: dict[str, float], clock: float
) -> None:
    log = drive_log(rig(), seconds=1.0, levels=[(0.1, 0.5)])
    assert effect_scales(load_problem([log], rig(sensors=sensors))).clock == pytest.approx(clock)


# --- tolerances ---


def nuisance(sigma: float) -> HypothesisBuilder:
    return HypothesisBuilder(Toy({}), SCALES, {INERTIA: sigma})


@pytest.mark.parametrize("sigma", [0.01, 0.1, 0.4, 2.0])
def test_a_value_with_a_tolerance_stays_positive_within_three_sigma(sigma: float) -> None:
    builder = nuisance(sigma)
    (one,) = builder.nuisance()
    assert (one.low, one.high) == (-MAX_NUISANCE_SIGMAS, MAX_NUISANCE_SIGMAS) == (-3.0, 3.0)
    (hypothesis,) = builder.hypotheses([], builder.nuisance(), np.zeros(1))
    x = np.array([[-3.0], [-1.0], [0.0], [1.0], [3.0]])
    values = hypothesis.theta(builder.problem.theta0, x)[:, builder.problem.index(INERTIA)]
    assert np.all(values > 0.0) and values[2] == TOOL["motor"]["inertia_kg_m2"]
    # the relative standard deviation of a log-normal value whose logarithm has this one
    log_sigma = np.log(values[3] / values[2])
    assert np.sqrt(np.expm1(log_sigma**2)) == pytest.approx(sigma)
    assert values[0] * values[4] == pytest.approx(values[2] ** 2)


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.03])
def test_a_small_tolerance_is_linear_to_first_order(sigma: float) -> None:
    builder = nuisance(sigma)
    (hypothesis,) = builder.hypotheses([], builder.nuisance(), np.zeros(1))
    x = np.linspace(-3.0, 3.0, 7)[:, None]
    values = hypothesis.theta(builder.problem.theta0, x)[:, builder.problem.index(INERTIA)]
    linear = TOOL["motor"]["inertia_kg_m2"] * (1.0 + sigma * x[:, 0])
    np.testing.assert_allclose(values, linear, rtol=1.1 * (3.0 * sigma) ** 2 / 2.0 + 1e-9)


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_an_inertia_known_to_forty_percent_is_retuned(factor: float) -> None:
    """A linear form would be negative at three sigma."""
    toy = Toy({INERTIA: factor * TOOL["motor"]["inertia_kg_m2"]})
    engine = Engine(toy, SCALES, {INERTIA: 0.4})
    retuned = engine.fit(engine.hypotheses([]))[0]
    value = retuned.theta(toy.theta0)[toy.index(INERTIA)]
    assert value == pytest.approx(factor * TOOL["motor"]["inertia_kg_m2"], rel=0.01)


@pytest.mark.parametrize("sigma", [0.01, 0.1, 0.4, 1.0])
@pytest.mark.parametrize(
    ("key", "effect"),
    [
        (INERTIA, "added_inertia"),
        ("motor.resistance_ohm", "bridge_resistance"),
        ("motor.coulomb_nm", "coulomb_friction"),
        ("motor.viscous_nm_s_per_rad", "viscous_friction"),
    ],
)
def test_an_effect_leaves_some_of_a_value_wherever_its_tolerance_ends(
    key: str, effect: str, sigma: float
) -> None:
    tool = rig(tolerance={key: sigma})
    log = drive_log(rig(), seconds=0.5, levels=[(0.1, 0.5)])
    problem = load_problem([log], tool)
    builder = HypothesisBuilder(problem, effect_scales(problem), tool.tolerance)
    (hypothesis, *_) = builder.hypotheses([BY_ID[effect]], builder.nuisance(), np.zeros(1))
    (theta,) = hypothesis.theta(problem.theta0, hypothesis.low[None, :])
    added = theta[problem.index(BY_ID[effect].name(BY_ID[effect].leading))]
    assert added < 0.0 <= theta[problem.index(key)] * (1.0 + 1e-9) + added
    problem.residuals(theta)


def test_a_log_with_an_inertia_known_to_forty_percent_is_diagnosed() -> None:
    tool = rig(tolerance={INERTIA: 0.4})
    log = drive_log(
        rig(motor={"inertia_kg_m2": 0.6e-5}), seconds=2.0, levels=[(0.2, 0.8), (1.0, 0.3)]
    )
    only = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id != "coulomb_friction"])
    verdict = diagnose([log], tool, only)
    assert verdict.verdict == "none"
    assert verdict.retuned_parameters[INERTIA] == pytest.approx(0.6e-5, rel=0.05)


# --- bounds of the search ---


def coordinate(physical: str, low: float = -2.0) -> Coordinate:
    return Coordinate("a", (0,), (1.0,), 0.0, low, 3.0, physical=physical)


@pytest.mark.parametrize(
    ("physical", "low", "at_low", "at_high"),
    [
        ("", -2.0, True, True),
        ("low", -2.0, False, True),
        ("high", -2.0, True, False),
        ("both", -2.0, False, False),
        ("low", 0.0, False, True),
    ],
)
def test_only_bounds_of_the_search_count_as_bounds(
    physical: str, low: float, at_low: bool, at_high: bool
) -> None:
    one = coordinate(physical, low)
    assert one.ends_at_search_bound(low) is at_low
    assert one.ends_at_search_bound(3.0) is at_high
    assert not one.ends_at_search_bound(1.0)


@pytest.mark.parametrize(
    ("effect", "widened"), [("current_offset", True), ("clock_skew", False), ("speed_gain", True)]
)
def test_a_bound_at_which_a_fit_ends_is_widened_unless_it_is_a_range(
    effect: str, widened: bool
) -> None:
    """The range of the clock's error is that of docs/spec/gap.md, section 3."""
    engine = Engine(Toy({}), SCALES, {INERTIA: 0.1})
    (hypothesis, *_) = engine.hypotheses([BY_ID[effect]])
    one = engine.fit([hypothesis], 0)[0]
    one.x = hypothesis.high.copy()
    assert engine.builder.widen(one) is widened
    (again, *_) = engine.hypotheses([BY_ID[effect]])
    assert again.high[0] == pytest.approx(hypothesis.high[0] * (WIDER if widened else 1.0))
    np.testing.assert_array_equal(again.high[1:], hypothesis.high[1:])  # of the nuisance parameter
    one.x = 0.5 * hypothesis.high
    assert not engine.builder.widen(one)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize(
    ("effect", "widened"), [("gear_eccentricity", True), ("hall_eccentricity", False)]
)
def test_either_part_of_an_amplitude_at_its_bound_widens_the_amplitude(
    effect: str, widened: bool, number: int
) -> None:
    """Amplitude times cosine and sine of the phase are fitted, within the same bounds. A wheel that
    is more eccentric would run backwards.
    """
    engine = Engine(Toy({}), SCALES, {})
    (hypothesis, *_) = engine.hypotheses([BY_ID[effect]])
    one = engine.fit([hypothesis], 0)[0]
    one.x = 0.5 * hypothesis.high
    assert not engine.builder.widen(one)
    one.x[number] = hypothesis.low[number]
    assert engine.builder.widen(one) is widened
    (again, *_) = engine.hypotheses([BY_ID[effect]])
    factor = WIDER if widened else 1.0
    np.testing.assert_allclose(again.high, factor * hypothesis.high)
    np.testing.assert_allclose(again.low, factor * hypothesis.low)


@pytest.mark.parametrize(
    ("effect", "stated", "low"),
    [("quadratic_drag", 3e-9, 0.0), ("speed_gain", -0.04, -0.5), ("speed_gain", -0.7, -0.7)],
)
def test_of_a_size_that_the_rig_states_the_change_is_fitted(
    effect: str, stated: float, low: float
) -> None:
    """The fit starts at the rig's value. A drag coefficient of 0 is a limit of physics, also where
    the rig states a positive one.
    """
    toy, name = Toy({}), BY_ID[effect].name(BY_ID[effect].leading)
    toy.theta0 = toy.theta0.copy()
    toy.theta0[toy.index(name)] = stated
    builder = HypothesisBuilder(toy, SCALES, {}, frozenset({effect}))
    (hypothesis,) = builder.hypotheses([BY_ID[effect]], (), np.zeros(0))
    (coordinate,) = hypothesis.coordinates
    x = np.array([hypothesis.start, hypothesis.start + 1.0, hypothesis.low])
    values = hypothesis.theta(toy.theta0, x)[:, toy.index(name)]
    assert hypothesis.start == [0.0]
    expected = [stated, stated + BY_ID[effect].leading.size(SCALES), low]
    np.testing.assert_allclose(values, expected, atol=1e-20)
    assert coordinate.ends_at_search_bound(coordinate.low) is (low != 0.0)


@pytest.mark.parametrize("effect", ["torque_constant", "winding_resistance", "current_gain"])
def test_a_relative_size_is_widened_to_no_factor_of_zero(effect: str) -> None:
    """A fit that ends there ends at a bound of the search, so that it is not selected."""
    builder = HypothesisBuilder(Toy({}), SCALES, {})
    for _ in range(3):
        (hypothesis, *_) = builder.hypotheses([BY_ID[effect]], (), np.zeros(0))
        (coordinate,) = hypothesis.coordinates
        low = coordinate.low * coordinate.factors[0]
        assert coordinate.ends_at_search_bound(coordinate.low) and -0.951 < low < 0.0
        builder.widen(SimpleNamespace(hypothesis=hypothesis, x=np.array([coordinate.low])))
    assert low == pytest.approx(-0.95)


@pytest.mark.parametrize("effect", ["inductance", "winding_resistance", "joint_stiffness"])
def test_a_relative_size_is_widened_by_no_larger_factor_upwards(effect: str) -> None:
    builder, high = HypothesisBuilder(Toy({}), SCALES, {}), 0.0
    for _ in range(4):
        (hypothesis, *_) = builder.hypotheses([BY_ID[effect]], (), np.zeros(0))
        (coordinate,) = hypothesis.coordinates
        high = coordinate.high * coordinate.factors[0]
        assert coordinate.ends_at_search_bound(coordinate.high) and 0.0 < high < 19.001
        builder.widen(SimpleNamespace(hypothesis=hypothesis, x=np.array([coordinate.high])))
    assert high == pytest.approx(19.0)


@pytest.mark.parametrize(
    ("effect", "at", "again"),
    [
        ("clock_skew", "high", 0),  # a range of docs/spec/gap.md, section 3
        ("torque_constant", "low", 1),  # from -0.5 to -0.95, no further
        ("torque_constant", "high", single_effects.STARTS.max_widenings),
    ],
)
def test_an_effect_is_fitted_again_only_where_its_bound_moves(
    effect: str, at: str, again: int
) -> None:
    """Each fit ends at its bound again."""
    engine = Engine(Toy({}), SCALES, {})
    fits: dict[tuple[str, ...], SimpleNamespace] = {}
    rounds: list[int] = []

    def fit_and_keep(hypotheses: list[Hypothesis], most_rounds: int) -> None:
        rounds.append(most_rounds)
        for h in hypotheses:
            fits[h.ids] = SimpleNamespace(ids=h.ids, hypothesis=h, x=getattr(h, at).copy())

    fit_and_keep([next(iter(engine.hypotheses([BY_ID[effect]])))], 0)
    state = SimpleNamespace(
        engine=engine, effects=[BY_ID[effect]], fits=fits, fit_and_keep=fit_and_keep
    )
    single_effects.refit_at_wider_bounds(state)
    assert len(rounds) == 1 + again


@pytest.mark.parametrize("duration_s", [0.02, 0.4, 3.0, 600.0])
@pytest.mark.parametrize(
    ("effect", "name", "low", "high"),
    [
        ("cold_grease", "time_s", 0.1, np.inf),
        ("winding_heating", "cooling_s", 0.5, np.inf),
        ("winding_heating", "kelvin_per_joule", 0.0, 25.0),
        # 1.8e-5 kg m2 at 10 rad/s
        ("coupler_compliance", "stiffness_nm_per_rad", 1.8e-3, np.inf),
    ],
)
def test_bounds_of_physics_hold_in_any_log(
    effect: str, name: str, low: float, high: float, duration_s: float
) -> None:
    """Times and sizes scale with the log, also where fits end at their bounds, up to these. A fit
    that ends there has found no size.
    """
    builder = HypothesisBuilder(Toy({}), replace(SCALES, duration=duration_s), {})
    for _ in range(6):
        (hypothesis, *_) = builder.hypotheses([BY_ID[effect]], (), np.zeros(0))
        one = next(c for c in hypothesis.coordinates if c.name.endswith(name))
        least, most = one.low * one.factors[0], one.high * one.factors[0]
        assert low * (1.0 - 1e-3) <= least < most <= high * (1.0 + 1e-9)
        for x in (hypothesis.low, hypothesis.high):
            builder.widen(SimpleNamespace(hypothesis=hypothesis, x=x))
    if low > 0.0:
        assert least == pytest.approx(low, rel=1e-3) and one.ends_at_search_bound(one.low)
    assert one.ends_at_search_bound(one.high)


def slow_tool(delay_s: float = 0.0) -> Rig:
    """A voltage-driven tool, 33 rows a second."""
    tool = rig(
        sensors={
            "hall_pulses_per_rev": 0,
            "speed_noise_rpm": 5.0,
            "speed_lsb_rpm": 0.0,
            "log_hz": 33,
        },
        effects={"transport_delay": {"delay_s": delay_s}} if delay_s else {},
    ).as_dict()
    return rig_from_dict(tool | {"input": {"kind": "voltage_v"}}, "a slow logger")


def steps(time_s: np.ndarray) -> np.ndarray:
    """Voltages (rows,) that change at random every 16 rows."""
    levels = np.random.default_rng(4).uniform(2.0, 14.0, len(time_s) // 16 + 1)
    return np.repeat(levels, 16)[: len(time_s)]


def wave(time_s: np.ndarray) -> np.ndarray:
    """A voltage (rows,) whose period is much longer than any delay."""
    return 8.0 + 4.0 * np.sin(2.0 * np.pi * time_s / 8.0)


def delayed_log(delay_s: float, command: Callable[[np.ndarray], np.ndarray]) -> MadeLog:
    """A log of the tool, with a delay that its rig lacks."""
    rng, time_s = np.random.default_rng(5), np.arange(0.0, SLOW_LOG_S, SLOW_ROW_S)
    voltage, tool = command(time_s), slow_tool(delay_s)
    rows = _core.simulate_log(
        _core.LogInput(time_s, "voltage_v", voltage),
        tool.parameters()[None],
        np.array([0]),
        np.zeros((1, 3)),
    )
    speed = rows["speed_measured_rad_s"][0] / RAD_S_PER_RPM + 5.0 * rng.standard_normal(len(time_s))
    return MadeLog(time_s, {"voltage_v": voltage, "speed_rpm": speed})


def test_a_delay_of_twenty_rows_of_a_slow_logger_is_found() -> None:
    """It lies beyond the 0.1 s that bound the delay of a fast logger."""
    tried = ("transport_delay", "coulomb_friction")
    options = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in tried])
    delay_s = 20 * SLOW_ROW_S
    verdict = diagnose([delayed_log(delay_s, steps)], slow_tool(), options)
    assert verdict.selected[:1] == ["transport_delay"]
    found = verdict.effects[0].parameters["delay_s"].value
    assert found == pytest.approx(delay_s, abs=0.2 * SLOW_ROW_S)


def test_a_delay_beyond_the_first_bound_widens_it() -> None:
    """The first bound is 32 rows, 0.96 s."""
    delay_s = 1.2
    problem = load_problem([delayed_log(delay_s, wave)], slow_tool())
    tried = ("transport_delay", "coulomb_friction")
    options = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in tried])
    state = stages.begin_search(problem, options)
    assert BY_ID["transport_delay"].leading.high(state.engine.scales) == pytest.approx(0.96)
    one = stages.select(state).search.fits[("transport_delay",)]
    (delay, *_) = one.hypothesis.coordinates
    assert one.x[0] * delay.factors[0] == pytest.approx(delay_s, abs=SLOW_ROW_S)
    assert not delay.ends_at_search_bound(float(one.x[0]))


@pytest.mark.parametrize(
    ("size", "parameters", "excluded"),
    [(1.4, 1, False), (1.6, 1, True), (1.6, 2, True), (1.6, 0, False), (-1.6, 1, True)],
)
def test_the_prior_excludes_a_tied_rival_by_odds_of_more_than_three(
    size: float, parameters: int, excluded: bool
) -> None:
    """Student's t of 3 degrees of freedom: (1 + z^2 / 3)^-2 is 1/3 at z = 1.482. A rival of fewer
    parameters than the set, which has one, is not excluded.
    """
    toy = Toy({})
    state = SimpleNamespace(problem=toy, engine=Engine(toy, SCALES, {}))
    theta = toy.theta0.copy()
    theta[toy.index(ADDED.name(ADDED.leading))] = size * ADDED.leading.plausible(SCALES)
    best, rival = (
        SimpleNamespace(ids=ids, theta=lambda _, t=t: t, hypothesis=SimpleNamespace(count=count))
        for ids, t, count in (((), theta, 1), ((ADDED.id,), theta, parameters))
    )
    assert size_prior.prior_excludes(state, rival, best) is excluded
