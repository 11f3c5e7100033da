"""Decisions on a problem with known answers: none, one effect, pairs, ties, gaps outside the
catalogue; bootstrap intervals; the reported figures.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import FLAGS, MODELLED, SCALES, Toy
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.selection import forward, intervals, limits, search, search_state
from vgroove.gap.selection.candidate_sets import fit_set
from vgroove.gap.selection.model_comparison import (
    Blocks,
    difference_interval,
    fixed_design_bound,
    make_blocks,
    small_sample_factor,
    typical_value_interval,
)
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.parameter_estimate import ParameterEstimate
from vgroove.gap.verdict import decision, effect_findings, established, gap_figures, remainder
from vgroove.gap.verdict.schema import EffectFinding

FLOOR = 1.0


def decided(
    toy: Toy,
    tolerance: dict[str, float] | None = None,
    without: tuple[str, ...] = (),
    one_way: bool = False,
) -> tuple:
    """Search and finding of the diagnosis of a toy problem."""
    kinds = FLAGS - ({"both"} if one_way else set())
    effects = [BY_ID[i] for i in MODELLED if set(BY_ID[i].needs) <= kinds and i not in without]
    engine = Engine(toy, SCALES, tolerance or {})
    selection = search.select(search_state.begin(engine, effects, DiagnosisOptions()))
    covariates = {"speed": np.tile(toy.measured_rows[1], 3), "time": toy.time_s}
    left = remainder.remaining(selection.search, selection.best, covariates)
    return selection.search, decision.decide(selection, left, covariates)


def named(toy: Toy, finding: tuple) -> list[str]:
    """Selected effects."""
    return effect_findings.selected(*finding)


def effects_of(toy: Toy, finding: tuple) -> list[EffectFinding]:
    """The verdict's list of effects, with parameter values as the search made them."""
    state, decided_ = finding
    return effect_findings.effect_findings(
        state, decided_, intervals.estimate_of(state, decided_.best)
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_verdict_on_noise_is_none(seed: int) -> None:
    toy = Toy({}, seed=seed)
    found = decided(toy)
    assert found[1].verdict == "none" and named(toy, found) == []


def test_the_verdict_is_none_where_three_sigma_of_the_tolerance_explain_the_gap() -> None:
    toy = Toy({"motor.resistance_ohm": 0.19 * 1.04})
    found = decided(toy, {"motor.resistance_ohm": 0.02})
    assert found[1].verdict == "none"
    assert found[0].reported_gap(found[0].nominal) > 1.1
    assert intervals.estimate_of(found[0], found[1].best).retuned_parameters()[
        "motor.resistance_ohm"
    ] == pytest.approx(0.19 * 1.04, rel=0.01)


@pytest.mark.parametrize(
    "name,size",
    [
        ("supply_resistance.resistance_ohm", 0.01),
        pytest.param("winding_resistance.relative", 0.08, marks=pytest.mark.proof),
        pytest.param("brush_drop.voltage_v", 0.1, marks=pytest.mark.proof),
        pytest.param("torque_constant.relative", -0.02, marks=pytest.mark.proof),
        ("coulomb_friction.torque_nm", 0.003),
        pytest.param("viscous_friction.nm_s_per_rad", 2e-6, marks=pytest.mark.proof),
        ("quadratic_drag.nm_s2_per_rad2", 3e-9),
        pytest.param("directional_viscous.nm_s_per_rad", 2e-6, marks=pytest.mark.proof),
        ("added_inertia.kg_m2", 1.5e-6),
        pytest.param("current_offset.offset_a", 0.6, marks=pytest.mark.proof),
        pytest.param("current_gain.relative", 0.06, marks=pytest.mark.proof),
        ("transport_delay.delay_s", 0.003),
        pytest.param("asymmetric_friction.forward_nm", 0.004, marks=pytest.mark.proof),
    ],
)
def test_one_effect_is_named(name: str, size: float) -> None:
    toy = Toy({f"effects.{name}": size})
    found = decided(toy)
    assert (found[1].verdict, named(toy, found)) == ("effect", [name.split(".")[0]])
    assert found[0].reported_gap(found[1].best) < 1.02


def test_the_effect_without_which_a_set_leaves_most_is_named_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = Scored(11.0, 11.0, 1.0)
    best = SimpleNamespace(ids=("a", "b", "c"))
    left = {"a": 2.0, "b": 4.0, "c": 2.0}
    monkeypatch.setattr(effect_findings, "fit_without", lambda _, __, member: left[member])
    state.score = float
    finding = SimpleNamespace(best=best, names_effects=True)
    assert effect_findings.selected(state, finding) == ["b", "a", "c"]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 16])
def test_the_interval_of_the_closed_share_holds_for_few_blocks(count: int) -> None:
    """Squared gaps of 25 before and 4 after, which scatter by half from block to block."""
    rows, rng, hits = 20, np.random.default_rng(1), 0
    n = count * rows
    problem = SimpleNamespace(
        log=np.zeros(n, int),
        signal=np.zeros(n, int),
        time_s=(np.arange(n) + 0.5) / rows,
        censored=np.zeros(n, bool),
        judged=np.ones(n, bool),
        squared=lambda residual: residual,
    )
    state = SimpleNamespace(simulated=problem, floor=1.0, seed=0, gap_residual=lambda f: f)
    state.blocks = SimpleNamespace(length_s=1.0)
    state.reported_gap = lambda squares: float(np.sqrt(squares.mean()))
    for _ in range(200):
        before, after = (
            np.repeat(power * rng.lognormal(-0.125, 0.5, count), rows) for power in (25.0, 4.0)
        )
        state.nominal = before
        low, high = gap_figures.closed_interval(state, after)
        hits += low <= (5.0 - 2.0) / (5.0 - 1.0) <= high
    assert hits > 180


def test_what_is_lost_without_a_member_is_that_of_the_fitted_rest() -> None:
    """Of three effects the current gain is worth a fiftieth, though no pair was fitted before."""
    ids = ("coulomb_friction", "current_gain", "winding_resistance")
    hidden = {"coulomb_friction.torque_nm": 0.006, "current_gain.relative": 0.02}
    hidden |= {"winding_resistance.relative": 0.04}
    toy = Toy({f"effects.{name}": value for name, value in hidden.items()})
    state = search_state.begin(Engine(toy, SCALES, {}), [BY_ID[i] for i in ids], DiagnosisOptions())
    state.fit_and_keep([state.engine.hypotheses([BY_ID[i]])[0] for i in ids])
    best = fit_set(state, ids, state.retuned)
    lost = {i: effect_findings.lost_without(state, best, i) for i in ids}
    assert lost["coulomb_friction"] > 0.8 and 0.0 < lost["current_gain"] < 0.1


def test_a_pair_is_named_strongest_first() -> None:
    toy = Toy(
        {"effects.coulomb_friction.torque_nm": 0.00425, "effects.current_gain.relative": -0.0746}
    )
    found = decided(toy)
    assert (found[1].verdict, named(toy, found)) == ("effect", ["coulomb_friction", "current_gain"])
    effects = effects_of(toy, found)
    assert [e.id for e in effects[:2]] == ["coulomb_friction", "current_gain"]
    assert all(e.probability > 0.5 and e.lost_without > 0.0 for e in effects[:2])
    assert all(e.probability < 0.1 for e in effects[2:])


@pytest.mark.parametrize(
    "offset_a,names", [(0.4, ["coulomb_friction", "current_offset"]), (0.12, ["coulomb_friction"])]
)
def test_a_member_within_the_form_error_of_the_others_is_not_named(
    offset_a: float, names: list[str]
) -> None:
    """Both offsets are significant; beside a friction of ten times the noise the small offset may
    be a form error of the friction.
    """
    toy = Toy(
        {"effects.coulomb_friction.torque_nm": 0.012, "effects.current_offset.offset_a": offset_a}
    )
    found = decided(toy)
    pair, alone = (
        found[0].fits[key]
        for key in (("coulomb_friction", "current_offset"), ("coulomb_friction",))
    )
    assert found[0].is_better(pair, alone)
    assert (found[1].verdict, named(toy, found)) == ("effect", names)
    share = (found[0].score(alone) - found[0].score(pair)) / (
        found[0].score(found[0].retuned) - found[0].score(alone)
    )
    assert (share > limits.STEPWISE.max_form_share) == (len(names) == 2)


@pytest.mark.parametrize("drag,named_alone", [(2e-8, True), (4e-8, False)])
def test_a_friction_law_that_corrects_another_is_not_named_if_a_rival_law_does_as_well(
    drag: float, named_alone: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair, other = (
        ("quadratic_drag", "viscous_friction"),
        SimpleNamespace(ids=("viscous_friction", "stribeck_friction")),
    )
    monkeypatch.setattr(
        search, "tied_rivals", lambda _, best: [other] if search_state.key(best.ids) == pair else []
    )
    state = decided(
        Toy(
            {
                "effects.viscous_friction.nm_s_per_rad": 1e-5,
                "effects.quadratic_drag.nm_s2_per_rad2": drag,
            }
        )
    )[0]
    best, found = search.drop_doubtful_members(state, state.fits[pair])
    alone = state.fits[("viscous_friction",)]
    share = (state.score(alone) - state.score(state.fits[pair])) / (
        state.score(state.retuned) - state.score(alone)
    )
    assert (
        share > limits.STEPWISE.min_share_of_tied_member
        and (share < limits.STEPWISE.max_friction_form_share) is named_alone
    )
    assert (best, found) == ((alone, []) if named_alone else (state.fits[pair], [other]))


@pytest.mark.parametrize(
    "others,interchangeable",
    [
        ([("viscous_friction", "stribeck_friction")], ["quadratic_drag"]),
        ([("viscous_friction", "cold_grease")], []),
        ([], []),
        ([("viscous_friction", "stribeck_friction"), ("viscous_friction", "winding_heating")], []),
    ],
)
def test_only_friction_laws_are_interchangeable(
    others: list[tuple[str, ...]], interchangeable: list[str]
) -> None:
    rivals = [SimpleNamespace(ids=ids) for ids in others]
    assert (
        search.interchangeable_friction_laws(
            SimpleNamespace(ids=("viscous_friction", "quadratic_drag")), rivals
        )
        == interchangeable
    )
    assert (
        search.interchangeable_friction_laws(
            SimpleNamespace(ids=("current_gain", "quadratic_drag")), rivals
        )
        == []
    )


def test_the_probability_of_an_effect_of_a_partial_verdict_is_bounded() -> None:
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.006})
    state, finding = decided(toy)
    assert {e.id: e.probability for e in effects_of(toy, (state, finding))}[
        "coulomb_friction"
    ] > effect_findings.PROBABILITY.max_partial
    partial = replace(finding, verdict="partial")
    chance = {e.id: e.probability for e in effects_of(toy, (state, partial))}
    assert chance["coulomb_friction"] == effect_findings.PROBABILITY.max_partial == 0.85


def test_the_evidence_of_a_named_effect_states_the_comparison_and_its_gaps() -> None:
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.006})
    state, finding = decided(toy)
    found = effects_of(toy, (state, finding))
    evidence = found[0].evidence
    assert (evidence.comparison, evidence.floor) == ("forward simulation", 1.0)
    assert evidence.before == pytest.approx(np.sqrt(state.score(state.retuned)))
    assert evidence.after == pytest.approx(np.sqrt(state.score(finding.best)))
    assert evidence.before > 2.0 > 1.05 > evidence.after
    assert all(one.evidence is None for one in found[1:])
    unnamed = effects_of(toy, (state, replace(finding, verdict="unlisted")))
    assert all(one.evidence is None for one in unnamed)


def test_a_gap_outside_the_catalogue_is_unlisted() -> None:
    toy = Toy({}, oscillation_a=1.0)
    found = decided(toy)
    assert found[1].verdict == "unlisted" and named(toy, found) == []
    assert found[1].remainder.significant


def test_without_the_true_effect_the_gap_is_unlisted() -> None:
    toy = Toy({"effects.transport_delay.delay_s": 0.006})
    found = decided(toy, without=("transport_delay",))
    assert found[1].verdict == "unlisted"


def test_equivalent_effects_are_listed_and_the_verdict_stays_effect() -> None:
    toy = Toy({"effects.winding_resistance.relative": 0.1})
    found = decided(toy)
    assert found[1].verdict == "effect"
    listed = effect_findings.indistinguishable(*found, FLAGS)
    assert [(o.id, o.instead_of) for o in listed] == [("bridge_resistance", "winding_resistance")]


def test_sets_that_differ_by_chance_are_tied() -> None:
    """The difference is the same in every block, so that the bootstrap alone would find it
    significant.
    """
    search_of, _ = decided(Toy({"effects.coulomb_friction.torque_nm": 0.004}))[:2]
    one = search_of.fits[("coulomb_friction",)]
    for squares, tied in ((2.0, True), (6.0, False)):
        rows = np.where(
            search_of.blocks.tested, squares / np.count_nonzero(search_of.blocks.tested), 0.0
        )
        other = replace(one, out_of_fold=np.sqrt(one.out_of_fold**2 + rows))
        assert search_of.is_tied(other, one) is tied


@pytest.mark.parametrize(
    ("discrepancy", "lost", "tied"),
    [(1.0, 0.01, False), (1.5, 0.01, True), (1.5, 0.04, True), (1.5, 0.06, False)],
)
def test_a_small_difference_is_a_form_error_where_the_models_discrepancy_is_the_unit(
    discrepancy: float, lost: float, tied: bool
) -> None:
    """The difference is the same in every block, so that the bootstrap alone would find it
    significant.
    """
    search_of, _ = decided(Toy({"effects.coulomb_friction.torque_nm": 0.004}))[:2]
    one = search_of.fits[("coulomb_friction",)]
    engine = search_of.engine.with_discrepancy(np.full(search_of.problem.n, discrepancy))
    state = replace(search_of, engine=engine)
    other = replace(one, out_of_fold=np.sqrt(one.out_of_fold**2 + lost))
    assert state.is_tied(other, one) is tied


def test_a_true_tie_is_ambiguous() -> None:
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.004}, still_speed=True)
    found = decided(toy, one_way=True)
    assert found[1].verdict == "ambiguous"
    rivals = {i for f in found[1].rivals for i in f.ids} | set(found[1].best.ids)
    assert {"coulomb_friction", "viscous_friction"} <= rivals
    chance = {e.id: e.probability for e in effects_of(toy, found)}
    assert max(chance.values()) < 0.9


def test_of_tied_sets_the_smaller_and_likelier_is_preferred() -> None:
    engine = Engine(Toy({}), SCALES, {})
    inertia, clock, compliance = (
        engine.fit(engine.hypotheses([BY_ID[i]])[:1], 0)[0]
        for i in ("added_inertia", "clock_skew", "coupler_compliance")
    )
    for alike in (True, False):
        state = SimpleNamespace(
            problem=engine.problem,
            engine=engine,
            contradicts_edge_scale=lambda one: False,
            equal_up_to_chance=lambda one, other, alike=alike: alike,
        )
        assert search.is_preferred(state, inertia, clock) == alike and search.is_preferred(
            state, clock, compliance
        )
        assert not search.is_preferred(state, clock, inertia) and not search.is_preferred(
            state, compliance, clock
        )


# preference: plausible, number of parameters, number of less likely effects
@pytest.mark.parametrize(
    ("one", "best", "odds", "preferred"),
    [
        ((False, 1, 1), (False, 1, 0), 3.1, True),  # the likelier size decides
        ((False, 1, 0), (False, 1, 1), 0.32, False),
        ((False, 1, 1), (False, 1, 0), 2.9, False),  # neither size is clearly likelier
        ((False, 1, 0), (False, 1, 1), 0.35, True),
        ((False, 1, 0), (False, 2, 0), 0.1, True),  # fewer parameters decide first
        ((False, 2, 0), (False, 1, 0), 10.0, False),
        ((True, 1, 0), (False, 2, 0), 10.0, False),  # a doubtful set is never preferred
    ],
)
def test_the_prior_odds_of_tied_sets_decide_from_a_factor_of_three_on(
    one: tuple, best: tuple, odds: float, preferred: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    density = {"one": 0.05 * odds, "best": 0.05}
    order = {"one": one, "best": best}
    monkeypatch.setattr(search, "prior_density", lambda _, name: density[name])
    monkeypatch.setattr(search, "preference", lambda _, name: order[name])
    for alike in (True, False):
        state = SimpleNamespace(equal_up_to_chance=lambda *_, alike=alike: alike)
        by_rarity = one[:2] == best[:2] and 1.0 / search.MIN_PRIOR_ODDS < odds < 3.0
        assert search.is_preferred(state, "one", "best") is (preferred and (alike or not by_rarity))


@pytest.mark.parametrize(
    "scale, named",
    [
        (1.0, "added_inertia"),
        (1.0052, "clock_skew"),
        (1.002, "added_inertia"),
        (0.995, "added_inertia"),
    ],
)
def test_a_scale_error_of_the_edges_prefers_the_set_that_explains_it(
    scale: float, named: str
) -> None:
    toy = Toy({})
    engine = Engine(toy, SCALES, {})
    toy.runs = [SimpleNamespace(edge_scale=scale)]
    inertia, clock = (
        engine.fit(engine.hypotheses([BY_ID[i]])[:1], 0)[0] for i in ("added_inertia", "clock_skew")
    )
    state = search_state.Search(engine, [], None, inertia, inertia)
    skewed = replace(clock, x=np.array([0.005 / clock.hypothesis.coordinates[0].factors[0]]))
    assert min((inertia, skewed), key=lambda one: search.preference(state, one)).ids == (named,)
    assert not state.contradicts_edge_scale(skewed) or scale < 1.004


def test_closed_figures() -> None:
    assert gap_figures.closed_share(1.05, 1.0, 1.0) is None
    assert gap_figures.closed_share(3.0, 1.0, 1.0) == 1.0
    assert gap_figures.closed_share(3.0, 2.0, 1.0) == pytest.approx(0.5)
    assert gap_figures.closed_share(3.0, 4.0, 1.0) == 0.0


class Scored:
    """A search reduced to squared gaps; a fit is its own squared gap."""

    def __init__(self, nominal: float, retuned: float, best: float) -> None:
        self.nominal, self.retuned, self.best = nominal, named_gap(retuned, 0), best
        self.engine = SimpleNamespace(discrepancy=np.ones(3))
        self.fits: dict[tuple[str, ...], float] = {}

    def score(self, one: float) -> float:
        return one

    def reported_score(self, one: float) -> float:
        return one

    def reported_gap(self, one: float) -> float:
        return float(np.sqrt(self.reported_score(one)))

    # shares that an effect closes of the gaps of two columns, before and after retuning
    before_retuning = after_retuning = (0.0, 0.0)

    def closed_share(self, fuller: float, leaner: float) -> search_state.ClosedShare:
        before = leaner is self.nominal
        shares = self.before_retuning if before else self.after_retuning
        return search_state.ClosedShare(0.0, np.array(shares))

    equal_up_to_chance = search_state.Search.equal_up_to_chance
    equal_up_to_form_error = search_state.Search.equal_up_to_form_error
    floor_power = 1.0

    def contradicts_edge_scale(self, one: float) -> bool:
        return False

    min_gain, loss_bound = search_state.Search.min_gain, search_state.Search.loss_bound
    is_likely_better, closes_large_gap = (
        search_state.Search.is_likely_better,
        search_state.Search.closes_large_gap,
    )
    leaves_gap_in_most_draws = search_state.Search.leaves_gap_in_most_draws
    is_far_from_noise = search_state.Search.is_far_from_noise
    reported_share = search_state.Search.reported_share
    closed_reported_share = search_state.Search.closed_reported_share
    leaves_most_of_far_gap = search_state.Search.leaves_most_of_far_gap
    closed_far_share = search_state.Search.closed_far_share
    closes_far_gap = search_state.Search.closes_far_gap
    unwhitened = None
    closes_reported_gap = search_state.Search.closes_reported_gap
    is_substantial = search_state.Search.is_substantial
    sample_shares = reported_floor_by_column = np.ones(1)

    def reported_loss_by_column(self, one: float) -> np.ndarray:
        return np.array([self.reported_score(one)])

    without: frozenset[str] = frozenset()
    floor = floor_power = FLOOR
    gap_problem = None
    may_have_gap = True
    problem = SimpleNamespace(sigma_is_bound=False, is_whitened=True)
    progress = staticmethod(lambda _: None)


def structure(significant: bool) -> remainder.Remainder:
    """A remainder without a correlate."""
    return remainder.Remainder(significant, None, 0.0, None)


def selected(state: Scored, best: float) -> search.Selection:
    """A selection without rivals."""
    return search.Selection(state, best, [])


class Named(float):
    """A squared gap that is also a fit with effect ids."""

    ids: tuple[str, ...] = ()


def named_gap(after: float, count: int) -> Named:
    one = Named(after)
    one.ids = tuple("abcd"[:count])
    return one


# A set of several effects is doubtful if it leaves more than the smallest visible gap (10 % above
# the noise: 1.21), and more than 0.08 (two effects) or 0.05 of the gap.
@pytest.mark.parametrize(
    ("count", "retuned", "after", "doubtful"),
    [
        (2, 9.0, 1.62, False),
        (2, 9.0, 1.66, True),
        (1, 9.0, 1.66, False),
        (2, 15.0, 1.66, False),
        (3, 11.0, 1.52, True),
        (3, 11.0, 1.48, False),
        (2, 3.0, 1.20, False),
        (2, 3.0, 1.22, True),
    ],
)
def test_several_effects_that_leave_a_visible_gap_approximate_another(
    count: int, retuned: float, after: float, doubtful: bool
) -> None:
    state, best = Scored(retuned, retuned, after), named_gap(after, count)
    assert decision.approximates_other_effect(state, best) is doubtful


# One effect must close 0.7 of the squared gap before retuning (docs/spec/gap.md, section 5) and the
# larger part of what retuning leaves; two must close 0.85 of what retuning leaves.
@pytest.mark.parametrize(
    ("count", "nominal", "retuned", "after", "doubtful"),
    [
        (1, 11.0, 11.0, 3.9, False),
        (1, 11.0, 11.0, 4.1, True),
        (1, 11.0, 3.0, 1.9, False),
        (1, 11.0, 3.0, 2.1, True),
        (2, 11.0, 11.0, 2.4, False),
        (2, 11.0, 11.0, 2.6, True),
        (2, 11.0, 3.0, 1.4, True),
    ],
)
def test_a_set_that_closes_too_little_is_doubtful(
    count: int, nominal: float, retuned: float, after: float, doubtful: bool
) -> None:
    state, best = Scored(nominal, retuned, after), named_gap(after, count)
    assert decision.closes_too_little(state, best) is doubtful


# after, reported: squared gap over all blocks and over the judged blocks. Over all blocks the
# effect must close the larger part of what retuning leaves.
@pytest.mark.parametrize(
    ("after", "reported", "doubtful"),
    [(4.1, 4.1, True), (4.1, 3.9, False), (5.9, 3.9, False), (6.1, 3.9, True)],
)
def test_one_effect_closes_enough_over_the_judged_blocks_or_over_all(
    after: float, reported: float, doubtful: bool
) -> None:
    state, best = Scored(11.0, 11.0, after), named_gap(after, 1)
    state.reported_score = lambda one: reported if one is best else one
    assert decision.closes_too_little(state, best) is doubtful


# An error of one sensor closes nothing in the columns of the others. Both shares are those of one
# column; two effects must close enough of all columns.
@pytest.mark.parametrize(
    ("count", "before", "after", "doubtful"),
    [
        (1, (0.71, 0.0), (0.51, 0.0), False),
        (1, (0.69, 0.0), (0.51, 0.0), True),
        (1, (0.71, 0.0), (0.49, 0.0), True),
        (1, (0.71, 0.0), (0.0, 0.51), True),
        (2, (0.99, 0.99), (0.99, 0.99), True),
    ],
)
def test_one_effect_closes_enough_in_one_column(
    count: int, before: tuple[float, float], after: tuple[float, float], doubtful: bool
) -> None:
    state = Scored(11.0, 11.0, 6.0)
    state.before_retuning, state.after_retuning = before, after
    assert decision.closes_too_little(state, named_gap(6.0, count)) is doubtful


@pytest.mark.parametrize(
    ("retuned", "after", "seen"),
    [(1.09**2, 1.0, False), (1.11**2, 1.0, True), (1.0, 0.85**2, True), (1.0, 0.95**2, False)],
)
def test_an_effect_that_closes_no_visible_gap_is_not_named(
    retuned: float, after: float, seen: bool
) -> None:
    assert (
        search_state.Search.closes_visible_gap(Scored(retuned, retuned, after), named_gap(after, 1))
        is seen
    )


@pytest.mark.parametrize(
    ("rival", "members", "counts"),
    [
        (("a",), True, False),  # a part of the set
        (("a", "c"), True, True),
        (("a", "c"), False, False),
    ],
)
def test_a_rival_has_another_member_that_may_be_present(
    rival: tuple[str, ...], members: bool, counts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(established, "Member", lambda *_: SimpleNamespace(is_rival=members))
    one, best = SimpleNamespace(ids=rival), SimpleNamespace(ids=("a", "b"))
    assert established.is_established_rival(None, one, best, {}) is counts


def test_intervals_over_few_blocks_are_wider() -> None:
    # Student's t for 5 degrees of freedom
    assert small_sample_factor(6, 0.99) == pytest.approx(4.032 / 2.576 * np.sqrt(6 / 5), rel=1e-3)
    assert small_sample_factor(1000, 0.95) == pytest.approx(1.0, abs=0.002)
    time_s = np.arange(600) * 1e-3
    none = np.zeros(600, int)
    rows = SimpleNamespace(log=none, signal=none, time_s=time_s, censored=none == 1)
    blocks = make_blocks(rows, np.ones(600, bool), 0.1, 0)
    low, high = difference_interval(blocks, np.array([3.0, 0.2, 2.0, 0.1, 0.3, 3.0]) * 100.0, 0.99)
    assert low < 0.0 < 2.0 < high  # six blocks of one sign are not significant at 99 %


def blocks_of(count: int, rows: int = 10) -> Blocks:
    """`count` blocks of as many rows each."""
    time_s = np.arange(count * rows) * 1e-3
    none = np.zeros(count * rows, int)
    timed = SimpleNamespace(log=none, signal=none, time_s=time_s + 5e-7, censored=none == 1)
    return make_blocks(timed, none == 0, rows * 1e-3, 0)


@pytest.mark.parametrize("count", [6, 8, 14, 60])
@pytest.mark.parametrize("law", ["normal", "laplace", "standard_cauchy"])
def test_differences_of_zero_mean_are_seldom_significant(count: int, law: str) -> None:
    blocks, rng = blocks_of(count), np.random.default_rng(1)
    trials = getattr(rng, law)(size=(300, count))
    passed = [typical_value_interval(blocks, trial, 0.9)[0] > 0.0 for trial in trials]
    assert np.mean(passed) < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 300)


def test_a_few_large_gains_among_small_ones_of_their_sign_are_significant() -> None:
    gains = np.array([97.0, 22, 190, -5, 72, -5, 4149, 1971, 174, 3723, 52, 24, 3, 5])
    assert difference_interval(blocks_of(14), gains, 0.99)[0] > 0.0
    one = np.array([97.0, -22, 190, -85, 72, -95, 9149, -71, -74, -123, 52, 24, -30, 5])
    assert difference_interval(blocks_of(14), one, 0.99)[0] < 0.0  # one block alone


def test_models_that_differ_in_few_blocks_far_beyond_the_noise_are_distinguished() -> None:
    blocks, left = blocks_of(18, 100), np.random.default_rng(3).normal(size=1800)
    apart = np.zeros(1800)
    apart[900:930] = 5.0
    for distance, distinguished in ((apart, True), (0.05 * apart, False), (0.0 * apart, False)):
        sums = np.bincount(blocks.cluster, weights=(left + distance) ** 2 - left**2)
        assert difference_interval(blocks, sums)[0] <= 0.0
        assert (fixed_design_bound(blocks, left + distance, left) > 0.0) is distinguished


def test_rivals_must_differ_by_the_minimum_effect_size() -> None:
    state = Scored(4.0, 4.0, 1.0)
    state.blocks, noise = blocks_of(18, 1000), np.random.default_rng(3).normal(size=18000)
    state.block_losses = lambda one: np.bincount(state.blocks.cluster, weights=one.out_of_fold**2)
    best, part = named_gap(1.0, 1), np.arange(18000) < 3000
    best.out_of_fold = noise
    for distance, tied in ((2.0, False), (0.4, True)):
        one = named_gap(1.0, 1)
        one.out_of_fold = noise + distance * part
        assert fixed_design_bound(state.blocks, one.out_of_fold, best.out_of_fold) > 0.0
        assert search_state.Search.is_tied(state, one, best) is tied


@pytest.mark.parametrize(
    ("distances", "better"),
    [
        ([0.4, 3.0, 0.6, 5.0, 0.5, 0.8, 1.0], True),
        ([0.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0], False),
        ([0.1] * 7, False),
        ([0.0, 6.0, 0.0, 3.5, 0.0, 0.0, 0.0], True),
        ([0.0, 6.0, 0.0, 1.0, 0.0, 0.0, 0.0], False),
    ],
)
def test_a_gain_in_few_blocks_of_a_short_log_counts_unless_it_is_in_one_block(
    distances: list[float], better: bool
) -> None:
    state, noise = Scored(4.0, 4.0, 1.0), np.random.default_rng(3).normal(size=700)
    state.blocks = blocks_of(7, 100)
    state.block_losses = lambda one: np.bincount(state.blocks.cluster, weights=one.out_of_fold**2)
    fuller, leaner = named_gap(1.0, 2), named_gap(4.0, 1)
    fuller.out_of_fold, leaner.out_of_fold = noise, noise + np.repeat(distances, 100)
    assert (
        difference_interval(
            state.blocks,
            state.block_losses(leaner) - state.block_losses(fuller),
            search_state.COMPARISON.significance,
        )[0]
        <= 0.0
        or not better
    )
    assert search_state.Search.is_better(state, fuller, leaner) is better


@pytest.mark.parametrize("alike", [False, True])
@pytest.mark.parametrize("share", [0.1, 0.3, 1.0])
def test_the_fixed_design_bound_seldom_exceeds_the_true_loss(alike: bool, share: float) -> None:
    """Two models differ in a share of the blocks; the noise is independent in each row, or
    (`alike`) equal in all rows of a block.
    """
    blocks, rng, over = blocks_of(30), np.random.default_rng(5), []
    for _ in range(300):
        apart = np.repeat(rng.normal(size=30) * (np.arange(30) < 30 * share), 10)
        left = np.repeat(rng.normal(size=30), 10) if alike else rng.normal(size=300)
        over.append(fixed_design_bound(blocks, left + apart, left) > float(apart @ apart) / 300)
    assert np.mean(over) < 0.025 + 3.0 * np.sqrt(0.025 * 0.975 / 300)


@pytest.mark.parametrize(
    ("above", "stands"),
    [
        ([30.0] * 20, True),
        ([1.0] * 20, False),
        ([590.0] + [0.0] * 19, False),
        ([610.0] + [0.0] * 19, True),
        ([200.0] * 4 + [0.0] * 16, True),
    ],
)
def test_an_excess_in_one_block_is_no_remainder_near_the_noise(
    above: list[float], stands: bool
) -> None:
    state = Scored(1.0, 1.0, 1.0 + sum(above) / 200.0)
    state.blocks, state.block_losses = blocks_of(20), lambda one: 10.0 + np.array(above)
    assert remainder.stands_above_noise(state, named_gap(state.best, 0)) is stands


@pytest.mark.parametrize(
    ("left", "significant", "verdict"),
    [
        (1.08**2, True, "none"),
        (1.09**2, True, "none"),
        (1.11**2, True, "unlisted"),
        (1.5, False, "none"),
    ],
)
def test_a_remainder_below_the_smallest_visible_gap_is_none(
    left: float, significant: bool, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = Scored(left, left, left)
    monkeypatch.setattr(decision, "established_set", lambda search, *_: search.retuned)
    state.blocks, state.block_losses = blocks_of(20), lambda one: np.full(20, 10.0 * one)
    found = decision.decide(selected(state, named_gap(left, 0)), structure(significant), {})
    assert found.verdict == verdict


@pytest.mark.parametrize(
    ("above", "follows", "verdict"),
    [
        ([4.0] * 20, None, "unlisted"),
        ([20.0] * 4 + [0.0] * 16, None, "none"),
        ([20.0] * 4 + [0.0] * 16, "speed", "unlisted"),
    ],
)
def test_a_remainder_without_correlate_must_be_a_gap_in_most_bootstrap_samples(
    above: list[float], follows: str | None, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The squared gap exceeds the noise by 0.4 of the noise's: in every block, or in four blocks of
    twenty.
    """
    state = Scored(1.4, 1.4, 1.4)
    monkeypatch.setattr(decision, "established_set", lambda search, *_: search.retuned)
    state.blocks, state.block_losses = blocks_of(20), lambda one: 10.0 + np.array(above)
    left = replace(structure(True), best_correlate=follows)
    assert decision.decide(selected(state, named_gap(1.4, 0)), left, {}).verdict == verdict


# Squared gaps: 11 before the fit; `after`: left by the set; `part`: left by its established
# members, None where no member is established. A part that closes less than 0.7 stands if a member
# is established alone.
@pytest.mark.parametrize(
    ("count", "after", "part", "significant", "verdict", "named"),
    [
        (2, 1.9, None, True, "unlisted", 2),
        (2, 1.7, None, True, "effect", 2),
        (2, 1.9, None, False, "effect", 2),
        (1, 5.0, None, True, "unlisted", 1),
        (1, 3.0, None, True, "effect", 1),
        (2, 1.9, 3.0, True, "effect", 1),
        (2, 1.9, 5.0, True, "partial", 1),
        (2, 1.9, 5.0, False, "effect", 2),
        (1, 5.0, 5.0, True, "partial", 1),
        (1, 3.9, 3.9, True, "effect", 1),
        (1, 4.1, 4.1, True, "partial", 1),
    ],
)
def test_of_a_set_that_leaves_a_remainder_the_established_members_are_named(
    count: int,
    after: float,
    part: float | None,
    significant: bool,
    verdict: str,
    named: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = Scored(11.0, 11.0, after)
    left = named_gap(11.0, 0) if part is None else named_gap(part, 1)
    state.fits = {("a",): named_gap(after, 1)}
    monkeypatch.setattr(decision, "established_set", lambda *_: left)
    monkeypatch.setattr(decision, "tied_rivals", lambda *_: [])
    monkeypatch.setattr(decision, "remaining", lambda *_: structure(significant))
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found = decision.decide(selected(state, named_gap(after, count)), structure(significant), {})
    assert (found.verdict, len(found.best.ids)) == (verdict, named)


@pytest.mark.parametrize(
    ("rivals", "established", "excluded", "unknown", "left", "verdict"),
    [
        (True, True, False, "", 5.0, "ambiguous"),
        (True, True, False, "b", 5.0, "partial"),
        (True, True, True, "", 5.0, "partial"),
        (True, False, False, "", 5.0, "partial"),
        (True, False, False, "", 3.0, "effect"),
        (False, True, False, "", 5.0, "partial"),
    ],
)
def test_a_rival_of_a_partial_set_counts_where_it_is_established_and_not_improbable(
    rivals: bool,
    established: bool,
    excluded: bool,
    unknown: str,
    left: float,
    verdict: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state, best, other = Scored(11.0, 11.0, left), named_gap(left, 1), named_gap(left, 2)
    monkeypatch.setattr(decision, "established_set", lambda *_: best)
    monkeypatch.setattr(decision, "is_established_rival", lambda *_: established)
    monkeypatch.setattr(decision, "prior_excludes", lambda *_: excluded)
    with_unknown_sizes(monkeypatch, unknown, left)
    state.fits = {("a",): best}
    choice = search.Selection(state, best, [other] if rivals else [])
    found = decision.decide(choice, structure(True), {})
    assert (found.verdict, found.best) == (verdict, best)
    assert found.rivals == ([other] if verdict == "ambiguous" else [])
    assert found.names_effects


@pytest.mark.parametrize(("unknown", "verdict"), [("a", "ambiguous"), ("b", "partial")])
def test_a_rival_may_share_a_member_whose_size_may_be_none_beside_it(
    unknown: str, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rival holds a member of the named set, a, and b in addition."""
    state, best, other = Scored(11.0, 11.0, 5.0), named_gap(5.0, 1), named_gap(5.0, 2)
    monkeypatch.setattr(decision, "established_set", lambda *_: best)
    monkeypatch.setattr(decision, "is_established_rival", lambda *_: True)
    monkeypatch.setattr(decision, "prior_excludes", lambda *_: False)
    monkeypatch.setattr(decision, "unknown_sizes", lambda _, one: [unknown] if one is other else [])
    state.fits = {("a",): best}
    choice = search.Selection(state, best, [other])
    assert decision.decide(choice, structure(True), {}).verdict == verdict


@pytest.mark.parametrize(("after", "verdict"), [(3.9, "effect"), (4.1, "unlisted")])
def test_a_set_without_established_members_is_named_only_near_the_noise(
    after: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Squared gaps: 40 before the fit; either set closes more than 0.9 of it."""
    state, best = Scored(40.0, 40.0, after), named_gap(after, 1)
    monkeypatch.setattr(decision, "established_set", lambda search, *_: search.retuned)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found = decision.decide(selected(state, best), structure(True), {})
    assert (found.verdict, found.best) == (verdict, best)


@pytest.mark.parametrize(
    ("unknown", "after", "verdict", "named"),
    [
        ("", 1.0, "effect", "ab"),
        ("a", 1.0, "effect", "b"),
        ("a", 15.0, "unlisted", "ab"),  # the other one closes too little
        ("ab", 1.0, "unlisted", "ab"),
    ],
)
def test_a_member_whose_size_may_be_none_is_not_named(
    unknown: str, after: float, verdict: str, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The set leaves 1.0 of 40, its members without the unknown ones `after`."""
    state, best = Scored(40.0, 40.0, 1.0), named_gap(1.0, 2)
    with_unknown_sizes(monkeypatch, unknown, after)
    monkeypatch.setattr(decision, "tied_rivals", lambda *_: [])
    monkeypatch.setattr(decision, "remaining", lambda *_: structure(False))
    found = decision.with_known_sizes(selected(state, best), structure(True), {})
    assert (found.verdict, found.best.ids) == (verdict, tuple(named))


@pytest.mark.parametrize(("retuned", "verdict"), [(1.04, "none"), (1.4, "unlisted")])
def test_a_set_of_unknown_sizes_below_the_noise_is_no_gap(
    retuned: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, best = Scored(retuned, retuned, 0.9), named_gap(0.9, 1)
    with_unknown_sizes(monkeypatch, "a", 0.9)
    assert decision.with_known_sizes(selected(state, best), structure(False), {}).verdict == verdict


@pytest.mark.parametrize(
    ("leaner", "fuller", "closes"),
    [
        (101.0, 10.9, True),  # squared gaps: 90.1 of 100 above the noise
        (101.0, 11.1, False),
        (3.9, 1.0, False),  # less than twice the noise: not far from it
        (4.1, 1.0, True),
    ],
)
def test_nearly_all_of_a_gap_far_from_the_noise(leaner: float, fuller: float, closes: bool) -> None:
    state = Scored(leaner, leaner, fuller)
    assert state.closes_far_gap(fuller, leaner) is closes
    state.gap_problem = SimpleNamespace()  # the balance of torques is compared
    assert not state.closes_far_gap(fuller, leaner)
    state.gap_problem, state.unwhitened = None, SimpleNamespace()
    assert not state.closes_far_gap(fuller, leaner)


@pytest.mark.parametrize(("without", "unknown"), [(15.0, []), (13.0, ["a"])])
def test_a_size_without_which_most_of_a_large_gap_comes_back_is_not_zero(
    without: float, unknown: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Although the linear approximation of its interval contains 0. Of the squared gap above the
    noise, 14 or 12, the set closes 10 or 8; the limit is 0.7.
    """
    state, best = Scored(101.0, 101.0, 5.0), named_gap(5.0, 1)
    monkeypatch.setattr(decision, "estimate_of", lambda *_: None)
    monkeypatch.setattr(decision, "best_estimate", lambda *_: None)
    monkeypatch.setattr(decision, "is_known_size", lambda *_: False)
    monkeypatch.setattr(decision, "BY_ID", {"a": None})
    monkeypatch.setattr(decision, "fit_without", lambda *_: without)
    assert decision.unknown_sizes(state, best) == unknown


def with_unknown_sizes(monkeypatch: pytest.MonkeyPatch, unknown: str, after: float) -> None:
    """Replace two functions of the decision: the sizes of the members named in `unknown` have
    intervals that contain 0, and a set without one of its members leaves the squared gap `after`.
    """

    def without(_: object, one: Named, member: str) -> Named:
        leaner = Named(after)
        leaner.ids = tuple(i for i in one.ids if i != member)
        return leaner

    monkeypatch.setattr(decision, "fit_without", without)
    monkeypatch.setattr(
        decision, "unknown_sizes", lambda _, one: [i for i in one.ids if i in unknown]
    )


@pytest.mark.parametrize(
    ("count", "unknown", "named"),
    [(2, "", "ab"), (2, "a", "b"), (3, "ac", "b"), (2, "ab", ""), (1, "a", "")],
)
def test_of_an_established_set_members_whose_size_may_be_none_are_not_named(
    count: int, unknown: str, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where none is left the gap is unlisted: it is far from the noise."""
    state, best = Scored(40.0, 40.0, 5.0), named_gap(5.0, count)
    with_unknown_sizes(monkeypatch, unknown, 5.0)
    monkeypatch.setattr(decision, "established_set", lambda *_: best)
    monkeypatch.setattr(decision, "tied_rivals", lambda *_: [])
    monkeypatch.setattr(decision, "remaining", lambda *_: structure(True))
    found = decision.decide(selected(state, best), structure(True), {})
    assert found.names_effects is bool(named)
    assert found.best.ids == tuple(named or best.ids)


@pytest.mark.parametrize(("unknown", "named"), [("", 2), ("magnetic_saturation", 1)])
def test_a_special_case_that_takes_a_place_keeps_no_member_of_unknown_size(
    unknown: str, named: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a Coulomb friction the size of the saturation may be 0; beside a Stribeck friction,
    which predicts as well, it is known.
    """
    state, part, special = Scored(40.0, 40.0, 5.0), named_gap(5.0, 2), named_gap(5.0, 2)
    part.ids, special.ids = (
        (friction, "magnetic_saturation") for friction in ("stribeck_friction", "coulomb_friction")
    )
    with_unknown_sizes(monkeypatch, "", 5.0)
    monkeypatch.setattr(
        decision, "unknown_sizes", lambda _, one: [i for i in (unknown,) if i and one is special]
    )
    monkeypatch.setattr(
        decision, "established_rivals", lambda _, one, __: [special] if one is part else []
    )
    found, rivals = decision.leanest_established(selected(state, part), part, {})
    assert found.ids == special.ids[:named] and rivals == []


@pytest.mark.parametrize(
    ("effect", "sizes"),
    [
        ("winding_resistance", {"relative"}),
        ("asymmetric_friction", {"forward_nm", "backward_nm"}),
        ("supply_droop", {"volt_per_coulomb", "polarisation_ohm"}),
        ("cold_grease", {"nm_s_per_rad"}),
        ("cogging_torque", {"torque_nm"}),
        ("wood_knot", {"torque_nm"}),
        # off at infinity
        ("coupler_compliance", {"stiffness_nm_per_rad"}),
        ("magnetic_saturation", {"saturation_a"}),
    ],
)
@pytest.mark.parametrize("excludes", [False, True])
def test_a_size_is_known_where_its_region_excludes_zero(
    effect: str, sizes: set[str], excludes: bool
) -> None:
    asked = []

    def excludes_zero(effect_id: str, names: list[str]) -> bool:
        asked.append((effect_id, {name.rsplit(".", 1)[1] for name in names}))
        return excludes

    estimate = SimpleNamespace(excludes_zero=excludes_zero)
    assert decision.is_known_size(estimate, BY_ID[effect]) is excludes
    assert asked == [(effect, sizes)]


@pytest.mark.parametrize(("interval", "known"), [((0.001, 0.01), True), ((-0.001, 0.01), False)])
def test_a_counted_probability_is_known_by_its_interval(
    interval: tuple[float, float], known: bool
) -> None:
    found = {"probability": ParameterEstimate(0.005, interval, "1")}
    estimate = SimpleNamespace(parameters=lambda _: found)
    assert decision.is_known_size(estimate, BY_ID["hall_dropout"]) is known


# Squared gaps: the retuned model leaves 11 (far from the noise: more than 2 in the gap, 4 squared)
# or 4; every set closes less than 0.7 of it.
@pytest.mark.parametrize(
    ("retuned", "after", "members", "discrepancy", "verdict"),
    [
        (11.0, 5.0, 1, 1.0, "partial"),
        (4.0, 2.5, 1, 1.0, "partial"),
        (4.0, 2.5, 2, 1.0, "unlisted"),  # near the noise, effects that are present close more
        (4.0, 2.5, 2, 1.5, "unlisted"),  # whatever the discrepancy of a signal
    ],
)
def test_established_effects_that_close_too_little_are_unlisted_where_noise_is_the_limit(
    retuned: float,
    after: float,
    members: int,
    discrepancy: float,
    verdict: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state, best = Scored(retuned, retuned, after), named_gap(after, members)
    state.engine.discrepancy[0] = discrepancy
    state.fits = {best.ids: best}
    monkeypatch.setattr(decision, "established_set", lambda *_: best)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found = decision.decide(selected(state, best), structure(True), {})
    assert (found.verdict, found.names_effects) == (verdict, verdict == "partial")


@pytest.mark.parametrize(
    ("gap", "discrepancy", "balance", "limited"),
    [
        (1.99, 1.0, False, True),
        (2.01, 1.0, False, False),
        (1.99, 1.01, False, True),
        (1.99, 1.0, True, False),
    ],
)
def test_noise_is_the_limit_of_a_forward_simulation_near_it(
    gap: float, discrepancy: float, balance: bool, limited: bool
) -> None:
    """balance: whether the torque balance is fitted in place of the forward simulation."""
    state, best = Scored(11.0, 11.0, gap**2), named_gap(gap**2, 1)
    state.engine.discrepancy[2] = discrepancy
    state.gap_problem = SimpleNamespace() if balance else None
    assert bool(decision.is_limited_by_noise(state, best)) is limited


# The sensors' noise has a quarter of the power of noise and model discrepancy together: the
# smallest visible gap is 1.21 / 4 = 0.3025, the smallest remainder 1.15 / 4 = 0.2875.
@pytest.mark.parametrize(
    ("left", "stands", "visible"), [(0.28, False, False), (0.29, True, False), (0.31, True, True)]
)
def test_a_remainder_is_judged_against_the_noise_of_the_sensors(
    left: float, stands: bool, visible: bool
) -> None:
    state, one = Scored(left, left, left), named_gap(left, 0)
    state.floor_power = 0.25
    state.blocks, state.block_losses = blocks_of(20), lambda fit: np.full(20, 10.0 * fit)
    assert remainder.stands_above_noise(state, one) is stands
    assert decision.is_unlisted_gap(state, one, structure(True)) is visible
    assert decision.relative_excess_power(state, one) == pytest.approx(4.0 * left - 1.0)


@pytest.mark.parametrize(("left", "verdict"), [(1.09**2, "none"), (1.11**2, "effect")])
def test_no_established_effect_is_named_without_a_visible_gap(
    left: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, part = Scored(left, left, left), named_gap(1.0, 1)
    state.blocks, state.block_losses = blocks_of(20), lambda one: np.full(20, 10.0 * one)
    monkeypatch.setattr(decision, "established_set", lambda *_: part)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    monkeypatch.setattr(decision, "tied_rivals", lambda *_: [])
    monkeypatch.setattr(decision, "remaining", lambda *_: structure(False))
    found = decision.decide(selected(state, state.retuned), structure(True), {})
    assert (found.verdict, found.best.ids) == (verdict, ("a",) if verdict == "effect" else ())


@pytest.mark.parametrize("seen", [True, False])
def test_a_pair_is_tried_where_no_effect_alone_closes_a_visible_gap(
    seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, one, pair = Scored(2.0, 1.4, 1.0), named_gap(1.35, 1), named_gap(1.0, 2)
    state.ranked = lambda size: [one]
    state.is_better = lambda fuller, leaner: True
    state.closes_visible_gap = lambda fit: fit is pair and seen
    monkeypatch.setattr(forward, "prefer_special_cases", lambda _, best, base=None: best)
    monkeypatch.setattr(forward, "deepest_minimum", lambda _, best: best)
    grown = iter([pair, None])  # no third effect
    monkeypatch.setattr(forward, "grow", lambda *_: next(grown))
    monkeypatch.setattr(forward, "rescale", lambda search: search)
    assert forward.forward(state)[1] is (pair if seen else state.retuned)


# noise of the sensors: 0.5 in the gap, so that the smallest visible gap is 0.05
@pytest.mark.parametrize(("retuned", "seen"), [(0.54**2, False), (0.56**2, True)])
def test_a_gap_is_visible_against_the_noise_of_the_sensors(retuned: float, seen: bool) -> None:
    state = Scored(retuned, retuned, 0.25)
    state.floor_power = 0.25
    assert search_state.Search.closes_visible_gap(state, named_gap(0.25, 1)) is seen


def test_a_set_that_stands_for_an_excluded_effect_is_unlisted_even_if_established(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state, best = Scored(11.0, 11.0, 1.0), named_gap(1.0, 1)
    monkeypatch.setattr(decision, "established_set", lambda *_: best)
    monkeypatch.setattr(decision, "stands_for_excluded", lambda *_: True)
    assert decision.decide(selected(state, best), structure(True), {}).verdict == "unlisted"


@pytest.mark.parametrize("seen", [True, False])
def test_forward_selection_stops_at_an_effect_that_closes_no_visible_gap(
    seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, one = Scored(2.0, 1.1, 1.0), named_gap(1.0, 1)
    state.ranked, state.is_better, state.closes_visible_gap = (
        lambda size: [one],
        lambda fuller, leaner: True,
        lambda fit: seen,
    )
    monkeypatch.setattr(forward, "prefer_special_cases", lambda _, best, base=None: best)
    monkeypatch.setattr(forward, "deepest_minimum", lambda _, best: best)
    monkeypatch.setattr(forward, "grow", lambda *_: None)
    assert forward.forward(state)[1] == (one if seen else state.retuned)


def test_equal_parameter_sets_are_simulated_once() -> None:
    engine = Engine(Toy({}), SCALES, {})
    h = engine.hypotheses([BY_ID["coulomb_friction"]])[0]
    rows = np.stack(
        engine.residuals([(h, np.array([[0.0], [1.0]])), (h, np.array([[1.0], [0.0], [0.0]]))])
    )
    assert engine.calls == 2
    np.testing.assert_array_equal(rows[[0, 1]], rows[[3, 2]])
    np.testing.assert_array_equal(rows[0], rows[4])
    assert not np.array_equal(rows[0], rows[1])


def test_reused_nuisance_columns_lead_to_the_same_fit() -> None:
    tolerance = {
        "motor.resistance_ohm": 0.02,
        "motor.torque_constant_nm_per_a": 0.004,
        "motor.coulomb_nm": 0.05,
    }
    toy = Toy({"effects.added_inertia.kg_m2": 2e-6, "motor.resistance_ohm": 0.19 * 1.03})
    fits = []
    for kept in (False, True):
        engine = Engine(toy, SCALES, tolerance)
        retuned = engine.fit(engine.hypotheses([]))[0]
        predict_held_out(engine, [retuned])
        engine.nuisance_columns = retuned.jacobian if kept else None
        fits.append(engine.fit(engine.hypotheses([BY_ID["added_inertia"]], retuned.x), 12)[0])
        calls = engine.calls
    assert calls < 40
    np.testing.assert_allclose(fits[0].x, fits[1].x, atol=0.02)


@pytest.mark.parametrize(
    ("is_known", "retuned", "expected"),
    [((True, True), 1.2, False), ((True, True), 1.22, True), ((True, False), 0.9, True)],
)
def test_where_the_noise_is_known_a_gap_must_be_visible_in_a_column(
    is_known: tuple[bool, bool], retuned: float, expected: bool
) -> None:
    """Two columns share the rows; the other one is far below the noise."""
    state = SimpleNamespace(
        noise_is_known=np.array(is_known),
        retuned=None,
        floor_by_column=np.array([0.5, 0.5]),
        loss_by_column=lambda _: np.array([0.5 * retuned, 0.2]),
    )
    assert search_state.Search.may_have_gap.func(state) is expected


@pytest.mark.parametrize(
    ("is_bound", "stated", "is_rounding", "known"),
    [
        (False, {"current_noise_a": 0.1}, False, [True, False]),
        (False, {}, True, [False, True]),
        (True, {}, False, [True, True]),
    ],
)
def test_the_noise_of_a_column_is_known_where_the_rig_states_it_or_it_is_a_bound(
    is_bound: bool, stated: dict[str, float], is_rounding: bool, known: list[bool]
) -> None:
    rig = SimpleNamespace(sensors=stated)
    angle = SimpleNamespace(column="position_rad", noise_is_known=is_rounding)
    problem = SimpleNamespace(sigma_is_bound=is_bound, rig=rig, signals=(angle,))
    state = SimpleNamespace(problem=problem, columns=["current_a", "position_rad"])
    assert search_state.Search.noise_is_known.fget(state).tolist() == known


# A set that closes a tenth of a squared gap of 101 far from the noise leaves 91, 0.7 of it 31.
@pytest.mark.parametrize(
    ("is_bound", "after", "verdict"),
    [
        (True, 32.0, "unlisted"),
        (True, 30.0, "effect"),
        (False, 90.0, "partial"),
        (False, 92.0, "unlisted"),
    ],
)
def test_a_named_set_closes_its_share_of_the_reported_gap(
    is_bound: bool, after: float, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, part = Scored(101.0, 101.0, after), named_gap(after, 1)
    state.problem = SimpleNamespace(sigma_is_bound=is_bound, is_whitened=True)
    state.leaves_gap_in_most_draws = lambda one: True
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    monkeypatch.setattr(decision, "established_set", lambda *_: part)
    monkeypatch.setattr(decision, "is_doubtful", lambda *_: False)
    monkeypatch.setattr(decision, "remaining", lambda *_: structure(True))
    monkeypatch.setattr(
        decision, "without_established", lambda *_: SimpleNamespace(verdict="unlisted")
    )
    found = decision.decide(selected(state, part), structure(True), {})
    assert found.verdict == verdict


def test_of_a_reported_gap_that_is_not_visible_a_set_need_close_nothing() -> None:
    for before, closes in ((1.1**2 - 0.01, True), (1.1**2 + 0.01, False)):
        assert Scored(before, before, 1.3).closes_reported_gap(named_gap(1.3, 1)) is closes


def test_a_set_that_another_comparison_shows_leaves_no_larger_reported_gap() -> None:
    state = Scored(101.0, 101.0, 101.0)
    state.gap_problem = state.problem
    for after, closes in ((100.9, True), (101.0, True), (101.1, False)):
        assert state.closes_reported_gap(named_gap(after, 1)) is closes


def test_one_signal_alone_shows_that_a_set_closes_the_reported_gap() -> None:
    state = Scored(101.0, 101.0, 99.0)
    state.sample_shares = state.reported_floor_by_column = np.array([0.5, 0.5])
    one, parts = named_gap(99.0, 1), {True: [98.5, 0.5], False: [98.5, 2.5]}
    state.reported_loss_by_column = lambda fit: np.array(parts[fit is one])
    assert state.closes_reported_gap(one)
    parts[True] = [96.6, 2.4]
    assert not state.closes_reported_gap(one)
    # the other signal loses more than this one gains
    parts[True] = [300.0, 0.5]
    state.reported_score = lambda fit: sum(parts[fit is one])
    assert not state.closes_reported_gap(one)


@pytest.mark.parametrize(
    ("implausible", "after", "less_plausible"),
    [("b", 92.0, True), ("b", 78.0, False), ("", 92.0, False), ("ab", 92.0, False)],
)
def test_implausible_sizes_need_a_tenth_of_the_reported_gap(
    implausible: str, after: float, less_plausible: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The squared reported gap above the noise is 100 without effects and 90 with the smaller set;
    the larger set with implausible values must leave less than 80.
    """
    state, leaner, fuller = Scored(101.0, 101.0, 91.0), named_gap(91.0, 1), named_gap(after, 2)
    names = {id(leaner): "a", id(fuller): "b"}
    monkeypatch.setattr(decision, "is_implausible", lambda _, one: names[id(one)] in implausible)
    assert decision.is_less_plausible(state, fuller, leaner) is less_plausible


def test_a_member_closes_the_larger_part_of_what_the_set_without_it_leaves() -> None:
    state = Scored(101.0, 101.0, 5.0)
    for without, larger in ((9.1, True), (8.9, False)):
        assert decision.closes_larger_part(state, 5.0, without) is larger


# One event: the comparison cuts it off (score 1.05), the reported gap does not.
@pytest.mark.parametrize(("reported", "stands"), [(9.0, True), (3.9, False), (0.5, False)])
def test_a_reported_gap_far_from_the_noise_is_a_remainder(reported: float, stands: bool) -> None:
    state = Scored(17.0, 17.0, 1.05)
    one = named_gap(1.05, 1)
    state.reported_score = lambda fit: reported if fit is one else 17.0
    assert remainder.stands_above_noise(state, one) is stands


@pytest.mark.parametrize(
    ("tied", "named"),
    [
        ([], ("speed_lag", "asymmetric_friction")),
        ([("brush_drop", "speed_lag")], ("speed_lag", "asymmetric_friction")),
        ([("asymmetric_friction",)], ("speed_lag", "asymmetric_friction")),
        (
            [("brush_drop", "speed_lag"), ("coulomb_friction", "speed_lag")],
            ("coulomb_friction", "speed_lag"),
        ),
    ],
)
def test_a_tied_special_case_is_named_in_place_of_its_general_effect(
    tied: list[tuple[str, ...]], named: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    part = SimpleNamespace(ids=("speed_lag", "asymmetric_friction"))
    rivals = [SimpleNamespace(ids=ids) for ids in tied]
    of_special = [SimpleNamespace(ids=("viscous_friction", "speed_lag"))]
    monkeypatch.setattr(
        decision, "established_rivals", lambda _, one, __: rivals if one is part else of_special
    )
    monkeypatch.setattr(decision, "is_likelier", lambda *_: False)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found, left = decision.leanest_established(SimpleNamespace(search=None), part, {})
    assert found.ids == named
    assert left == (rivals if found is part else of_special)


def test_sets_that_would_take_each_others_place_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is likelier than the other; the one reached last is named, the other is its rival."""
    first, second = SimpleNamespace(ids=("brush_drop",)), SimpleNamespace(ids=("speed_lag",))
    others = {first.ids: [second], second.ids: [first]}
    monkeypatch.setattr(decision, "established_rivals", lambda _, one, __: others[one.ids])
    monkeypatch.setattr(decision, "is_likelier", lambda *_: True)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found = decision.leanest_established(SimpleNamespace(search=None), first, {})
    assert found == (second, [first])


@pytest.mark.parametrize(
    ("ids", "tied", "doubtful", "named"),
    [
        # several others in place of the weakest member: it is not named
        ("ab", {"ab": ["ax", "ay"]}, "", "a"),
        ("abc", {"abc": ["abx", "aby"], "ab": ["ax"]}, "", "ab"),
        # near the noise it does not imitate anything: it stays
        ("az", {"az": ["ax", "ay"]}, "", "az"),
        # a single other effect, in one rival or in two: it stays
        ("ab", {"ab": ["ax"]}, "", "ab"),
        ("ab", {"ab": ["ax", "xa"]}, "", "ab"),
        # no other member is established without it
        ("ab", {"ab": ["ax", "ay"]}, "a", "ab"),
        # it closes the larger part of what a leaves: it stays
        ("aB", {"aB": ["ax", "ay"]}, "", "aB"),
        # both may be replaced: b, which gains less, is removed; the last member stays
        ("ab", {"ab": ["ax", "ay", "xb", "yb"], "a": ["x", "y"]}, "", "a"),
        ("a", {"a": ["x", "y", "z"]}, "", "a"),
    ],
)
def test_a_member_that_several_effects_replace_is_not_named_beside_others(
    ids: str,
    tied: dict[str, list[str]],
    doubtful: str,
    named: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def a_set(of: str) -> SimpleNamespace:
        return SimpleNamespace(ids=tuple(of))

    state = SimpleNamespace(score=lambda one: {"a": 1.0}.get("".join(one.ids), 2.0))
    monkeypatch.setattr(
        decision,
        "closes_larger_part",
        lambda _, one, without: "B" in one.ids and "B" not in without.ids,
    )
    monkeypatch.setattr(
        decision,
        "established_rivals",
        lambda _, one, __: [a_set(r) for r in tied.get("".join(one.ids), [])],
    )
    monkeypatch.setattr(
        decision, "fit_without", lambda _, one, i: a_set("".join(one.ids).replace(i, ""))
    )
    monkeypatch.setattr(
        decision,
        "without_doubtful",
        lambda _, one, __: a_set("".join(i for i in one.ids if i not in doubtful)),
    )
    monkeypatch.setattr(decision, "is_likelier", lambda *_: False)
    monkeypatch.setattr(decision, "is_limited_by_noise", lambda _, one: "z" in one.ids)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    found, rivals = decision.without_replaceable(SimpleNamespace(search=state), a_set(ids), {})
    assert "".join(found.ids) == named
    assert ["".join(r.ids) for r in rivals] == tied.get(named, [])


def test_special_cases_of_a_member_do_not_count_as_effects_in_its_place() -> None:
    best = SimpleNamespace(ids=("asymmetric_friction", "speed_lag"))
    rivals = [
        SimpleNamespace(ids=("coulomb_friction", "speed_lag")),
        SimpleNamespace(ids=("asymmetric_friction", "transport_delay")),
        SimpleNamespace(ids=("viscous_friction", "speed_lag")),
    ]
    assert decision.replacements("asymmetric_friction", best, rivals) == {"viscous_friction"}
    assert decision.replacements("speed_lag", best, rivals) == {"transport_delay"}


@pytest.mark.parametrize(
    ("excluded", "doubtful", "leaves_more", "named"),
    [
        ("a", "", False, "b"),
        ("a", "b", False, "a"),
        ("a", "", True, "a"),
        ("b", "", False, "a"),
        ("", "", False, "a"),
    ],
)
def test_a_rival_of_far_more_plausible_sizes_is_named_where_it_is_established(
    excluded: str, doubtful: str, leaves_more: bool, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two sets predict the logs equally well, for example an inertia that is 57 % too large and a
    speed sensor whose gain is 134 % off. The set whose sizes occur more often is named.
    """
    sets = {i: SimpleNamespace(ids=(i,)) for i in "ab"}
    others = {"a": [sets["b"]], "b": [sets["a"]]}
    monkeypatch.setattr(decision, "established_rivals", lambda _, one, __: others[one.ids[0]])
    monkeypatch.setattr(
        decision, "prior_excludes", lambda _, rival, best: rival.ids == (excluded,) != best.ids
    )
    monkeypatch.setattr(decision, "is_established", lambda _, one, __: one.ids != (doubtful,))
    state = SimpleNamespace(leaves_far_gap_of=lambda *_: leaves_more)
    found, _ = decision.leanest_established(SimpleNamespace(search=state), sets["a"], {})
    assert found.ids == (named,)


@pytest.mark.parametrize(
    ("rival", "leaves_more", "counts"),
    [("c", True, False), ("c", False, True), ("ac", True, True), ("ac", False, True)],
)
def test_a_rival_of_fewer_effects_that_leaves_more_of_a_far_gap_does_not_count(
    rival: str, leaves_more: bool, counts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a log of a single start no rival leaves significantly more than the established pair; one
    of its effects alone may leave twice the gap.
    """
    best, other = (SimpleNamespace(ids=tuple(i)) for i in ("ab", rival))
    state = SimpleNamespace(leaves_far_gap_of=lambda leaner, _: leaves_more and leaner is other)
    monkeypatch.setattr(decision, "prior_excludes", lambda *_: False)
    monkeypatch.setattr(decision, "is_established_rival", lambda *_: True)
    monkeypatch.setattr(decision, "unknown_sizes", lambda *_: [])
    selection = SimpleNamespace(search=state, best=best, rivals=[other])
    assert decision.established_rivals(selection, best, {}) == ([other] if counts else [])
