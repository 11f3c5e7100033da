"""Stepwise selection: from which values a set is fitted, which members are dropped, and when two
further effects are tried together.
"""

from dataclasses import replace
from types import MethodType, SimpleNamespace

import numpy as np
import pytest

from gap_toy import MODELLED, SCALES, Toy
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection import (
    backward,
    candidate_sets,
    extension,
    forward,
    limits,
    search,
    search_state,
)
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search_state import Search

STRIBECK_AND_GAIN = {
    "effects.stribeck_friction.breakaway_nm": 0.01,
    "effects.stribeck_friction.speed_rad_s": 400.0,
    "effects.current_gain.relative": 0.06,
}


def begun_search(toy: Toy) -> search_state.Search:
    """A search with the nominal and retuned fits made."""
    effects = [BY_ID[i] for i in MODELLED]
    return search_state.begin(Engine(toy, SCALES, {}), effects, DiagnosisOptions())


def fit_at(
    state: search_state.Search, numbers: dict[str, float], ids: tuple[str, ...], rounds: int
) -> Fit:
    """Fit of a set, started from parameter values in SI units; others start at 0."""
    h = state.engine.hypotheses([BY_ID[i] for i in ids])[0]
    start = np.array([numbers.get(c.name, 0.0) / c.factors[0] for c in h.coordinates])
    return state.engine.fit([replace(h, start=np.clip(start, h.low, h.high))], rounds)[0]


def test_a_leaner_set_is_fitted_from_the_fuller_sets_values_too() -> None:
    state = begun_search(Toy(STRIBECK_AND_GAIN))
    pair, triple = (
        ("current_gain", "stribeck_friction"),
        ("current_gain", "quadratic_drag", "stribeck_friction"),
    )
    poor = fit_at(state, {"effects.stribeck_friction.speed_rad_s": 5.0}, pair, 0)
    state.fits.update({pair: poor, triple: fit_at(state, STRIBECK_AND_GAIN, triple, 6)})
    assert state.score(poor) > 1.2
    best = backward.backward(state, state.fits[triple])
    assert search_state.key(best.ids) == pair and state.score(best) < 1.05


def test_a_special_case_is_fitted_from_the_values_of_the_general_effect_too() -> None:
    """Its own first fit ended far from the minimum; the general effect would seem to outdo it."""
    truth = {"effects.coulomb_friction.torque_nm": 0.006, "effects.speed_gain.relative": 0.02}
    state = begun_search(Toy(truth))
    special, general = (
        ("coulomb_friction", "speed_gain"),
        ("asymmetric_friction", "speed_gain"),
    )
    poor = fit_at(state, {}, special, 0)
    best = fit_at(
        state,
        {
            "effects.asymmetric_friction.forward_nm": 0.006,
            "effects.asymmetric_friction.backward_nm": 0.006,
            "effects.speed_gain.relative": 0.02,
        },
        general,
        6,
    )
    state.fits.update({special: poor, general: best})
    assert state.outdoes_special_case(best, poor)
    found = candidate_sets.prefer_special_cases(state, best)
    assert search_state.key(found.ids) == special and found.cost < 0.5 * poor.cost


def test_a_member_that_imitates_the_true_one_is_exchanged() -> None:
    truth = {"effects.coulomb_friction.torque_nm": 0.006, "effects.current_gain.relative": -0.08}
    state = begun_search(Toy(truth))
    wrong, pair = ("current_gain", "quadratic_drag"), ("coulomb_friction", "current_gain")
    state.fits[wrong] = fit_at(state, {}, wrong, 6)
    assert state.score(state.fits[wrong]) > 1.2 and pair not in state.fits
    best = search.exchange_members(state, state.fits[wrong])
    assert search_state.key(best.ids) == pair and state.score(best) < 1.05


@pytest.mark.parametrize(
    ("others", "member", "elsewhere"),
    [
        (("current_saturation", "load_dependent_friction"), "supply_resistance", True),
        (("brush_drop",), "supply_resistance", False),
        (("coulomb_friction",), "torque_constant", False),
        (("transport_delay",), "winding_heating", True),
        (("speed_gain",), "current_gain", True),
        (("supply_resistance",), "supply_gain", False),
        (("speed_gain",), "speed_lag", False),
        (("clock_skew",), "added_inertia", False),
        (("transport_delay",), "inductance", False),
    ],
)
def test_an_effect_in_equations_that_the_others_do_not_reach_acts_elsewhere(
    others: tuple[str, ...], member: str, elsewhere: bool
) -> None:
    scored = SimpleNamespace(score=lambda one: one.left)
    leaner = SimpleNamespace(ids=others, left=3.0)
    for left, larger_part in ((1.9, True), (2.1, False)):
        best = SimpleNamespace(ids=(*others, member), left=left)
        assert backward.acts_elsewhere(scored, best, leaner) is (elsewhere and larger_part)


@pytest.mark.parametrize(
    ("first", "gain", "kept"),
    [
        ("current_saturation", 3.0, True),
        ("current_saturation", 0.9, False),
        ("brush_drop", 3.0, False),
        ("brush_drop", 5.1, True),
    ],
)
def test_a_small_effect_in_other_equations_is_kept(
    first: str, gain: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Retuning leaves a squared gap of 104, the first effect 4: a member in equations that the
    first effect does not enter must gain a hundredth of what the first closes, other members more.
    """
    left = {
        "": 104.0,
        first: 4.0,
        "supply_resistance": 90.0,
        f"{first} supply_resistance": 4.0 - gain,
    }

    def fit_of(*ids: str) -> SimpleNamespace:
        return SimpleNamespace(ids=ids, left=left[" ".join(ids)])

    state = SimpleNamespace(
        score=lambda one: one.left,
        retuned=fit_of(),
        min_gain=lambda one: 0.1,
        loss_by_column=lambda one: np.array([one.left]),
    )
    monkeypatch.setattr(
        backward, "fit_without", lambda _, best, i: fit_of(*(j for j in best.ids if j != i))
    )
    assert (
        backward.drop_form_corrections(
            state, fit_of(first, "supply_resistance"), limits.STEPWISE.max_form_share
        ).ids
        == (first, "supply_resistance")
    ) is kept


@pytest.mark.parametrize(("second", "named"), [("coulomb_friction", True), ("current_gain", False)])
def test_a_form_error_is_confined_to_the_signals_in_which_the_effect_is_large(
    second: str, named: bool
) -> None:
    """Beside a large offset of the current a small friction is no form error of the offset, because
    it changes the speed too; a small gain of the current may be one.
    """
    small = {
        "coulomb_friction": {"effects.coulomb_friction.torque_nm": 0.002},
        "current_gain": {"effects.current_gain.relative": 0.04},
    }
    truth = {"effects.current_offset.offset_a": 1.2} | small[second]
    state = begun_search(Toy(truth))
    pair = search_state.key(("current_offset", second))
    state.fits[pair] = fit_at(state, truth, pair, 6)
    alone = state.fit_and_keep([state.engine.hypotheses([BY_ID["current_offset"]])[0]])[0]
    assert state.is_better(state.fits[pair], alone)
    assert state.score(alone) - state.score(state.fits[pair]) < limits.STEPWISE.max_form_share * (
        state.score(state.retuned) - state.score(alone)
    )
    assert backward.drop_form_corrections(
        state, state.fits[pair], limits.STEPWISE.max_form_share
    ) is (state.fits[pair] if named else alone)


class Stepped:
    """A search whose sets of 0, 1, 2, ... effects have given squared gaps; a set is better if it
    gains more than `share` and the step to its size is significant.
    """

    gap_problem = None
    may_have_gap = True

    def __init__(self, gaps: list[float], significant: dict[int, bool]) -> None:
        self.sets = [
            SimpleNamespace(ids=tuple("abcde"[:size]), gap=gap) for size, gap in enumerate(gaps)
        ]
        self.retuned, self.significant = self.sets[0], significant

    def ranked(self, size: int) -> list[SimpleNamespace]:
        return self.sets[size : size + 1]

    def fit_and_keep(self, _: list[SimpleNamespace]) -> None:
        """Nothing to do: all sets are fitted."""

    def score(self, one: SimpleNamespace) -> float:
        return one.gap

    def is_better(
        self,
        fuller: SimpleNamespace,
        leaner: SimpleNamespace,
        share: float = search_state.COMPARISON.min_gain,
    ) -> bool:
        steps = len(fuller.ids) - len(leaner.ids)
        return leaner.gap - fuller.gap > share and (steps > 1 or self.significant[len(fuller.ids)])

    def min_gain(self, leaner: SimpleNamespace) -> float:
        return search_state.COMPARISON.min_gain

    def closes_visible_gap(self, one: SimpleNamespace) -> bool:
        return True

    engine = SimpleNamespace(discrepancy=np.ones(1))
    leaves_gap = search_state.Search.leaves_gap
    excess_power = search_state.Search.excess_power


def test_no_set_is_selected_where_no_column_shows_a_gap() -> None:
    state = Stepped([9.0, 4.0, 2.0], {1: True, 2: True})
    state.may_have_gap = False
    assert forward.forward(state) == (state, state.retuned)


# Squared gaps of the sets of 0, 1, 2, ... effects; whether the second step is significant; how
# many effects are found. The smallest visible gap is 1.21. Two further effects are tried if the set
# leaves more than a tenth of what it closes (form errors) and if they close the larger part of it.
@pytest.mark.parametrize(
    ("gaps", "second", "found"),
    [
        ([9.0, 4.0, 2.0, 1.0], True, 3),
        ([9.0, 4.0, 2.0, 1.0], False, 3),
        ([2.0, 1.20, 1.1, 1.0], False, 1),
        ([2.0, 1.22, 1.1, 1.0], False, 3),
        ([2.0, 1.30, 1.24, 1.21], False, 1),
        ([9.0, 4.0, 3.96, 1.0], False, 1),
        ([9.0, 4.0, 3.94, 1.0], False, 3),
        ([9.0, 4.0, 2.0], False, 1),
        ([20.0, 2.70, 1.5, 1.0], False, 1),
        ([20.0, 2.75, 1.5, 1.0], False, 3),
        ([9.0, 4.0, 3.0, 2.51], False, 1),
        ([9.0, 4.0, 3.0, 2.49], False, 3),
    ],
)
def test_two_further_effects_are_tried_while_a_gap_is_left(
    gaps: list[float], second: bool, found: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = Stepped(gaps, {1: True, 2: second, 3: True})
    monkeypatch.setattr(forward, "prefer_special_cases", lambda _, best, base=None: best)
    monkeypatch.setattr(forward, "rescale", lambda state: state)
    monkeypatch.setattr(forward, "deepest_minimum", lambda _, best: best)
    monkeypatch.setattr(forward, "distinct_hypotheses", lambda fits: fits)
    monkeypatch.setattr(forward, "extensions", lambda state, base: state.ranked(len(base.ids) + 1))
    monkeypatch.setattr(
        forward, "grow", lambda state, base: next(iter(state.ranked(len(base.ids) + 1)), None)
    )
    assert len(forward.forward(state)[1].ids) == found


def test_two_further_effects_of_which_every_fit_ends_at_a_bound_are_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = Stepped([9.0, 4.0, 3.94, 1.0], {1: True, 2: False, 3: True})
    base, larger, both = (state.ranked(size)[0] for size in (1, 2, 3))
    monkeypatch.setattr(forward, "extensions", lambda *_: [both])
    monkeypatch.setattr(forward, "distinct_hypotheses", lambda fits: fits)
    monkeypatch.setattr(state, "ranked", lambda size: [])
    assert forward.add_two(state, base, larger) is None


@pytest.mark.parametrize(
    ("left", "enough"),
    [
        # of 10 per signal that retuning leaves above a floor of 0.3
        ([0.3, 0.3, 0.3], False),
        ([1.2, 1.2, 1.2], False),
        ([1.4, 0.3, 0.3], True),  # in one signal alone
        ([1.3, 1.3, 1.3], True),
    ],
)
def test_a_set_of_the_torque_balance_is_extended_while_a_member_can_be_established(
    left: list[float], enough: bool
) -> None:
    """An established member gains a tenth of what retuning leaves; a forward simulation is extended
    down to the noise.
    """
    losses = {"base": np.array(left), "retuned": np.full(3, 10.3)}
    state = SimpleNamespace(
        gap_problem="the forward simulation",
        loss_by_column=lambda one: losses[one],
        floor_by_column=np.full(3, 0.3),
        sample_shares=np.full(3, 1.0 / 3.0),
        retuned="retuned",
    )
    state.is_substantial = MethodType(Search.is_substantial, state)
    assert forward.leaves_enough(state, "base") is enough
    state.gap_problem = None
    assert forward.leaves_enough(state, "base")


@pytest.mark.parametrize(
    ("larger", "discrepancy", "grows"),
    [(9.5, 1.0, True), (9.5, 3.0, False), (9.1, 3.0, False), (8.9, 3.0, True)],
)
def test_far_from_the_noise_a_member_must_close_a_tenth_of_what_is_left(
    larger: float, discrepancy: float, grows: bool
) -> None:
    """Ten are left, of which 0.5 are noise."""
    scores = {"base": 10.0, "larger": larger}
    state = SimpleNamespace(
        score=lambda one: scores[one],
        floor_power=0.5,
        engine=SimpleNamespace(discrepancy=np.array([1.0, discrepancy])),
    )
    assert forward.gains_enough_to_grow(state, "larger", "base") is grows


@pytest.mark.parametrize(
    ("special", "base", "named"),
    [
        (4.40, 4.45, "asymmetric_friction"),
        (4.30, 4.45, "coulomb_friction"),
        (4.40, None, "coulomb_friction"),
    ],
)
def test_a_special_case_that_gains_nothing_over_the_base_does_not_replace_the_general_effect(
    special: float, base: float | None, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The general effect is not significantly better than its special case in so few blocks; but
    with the special case the set would not be better than the base, and growth would end.
    """

    def fit_of(left: float, *ids: str) -> SimpleNamespace:
        return SimpleNamespace(ids=ids, left=left)

    state = SimpleNamespace(
        score=lambda one: one.left,
        min_gain=lambda one: 0.1,
        outdoes_special_case=lambda general, special: False,
        effects=[BY_ID["coulomb_friction"], BY_ID["asymmetric_friction"]],
    )
    monkeypatch.setattr(candidate_sets, "fit_near", lambda _, ids, near: fit_of(special, *ids))
    found = candidate_sets.prefer_special_cases(
        state,
        fit_of(3.0, "speed_gain", "asymmetric_friction"),
        None if base is None else fit_of(base, "speed_gain"),
    )
    assert found.ids == ("speed_gain", named)


@pytest.mark.parametrize(
    ("special", "better", "likely", "outdone"),
    [
        (6.4, False, True, True),  # closes 0.1 of what the general effect closes, in few blocks
        (6.4, False, False, False),  # the general effect may be better by chance
        (4.9, False, True, True),  # less than half
        (4.7, False, True, False),  # more than half
        (4.7, True, True, True),
    ],
)
def test_a_special_case_that_closes_little_does_not_replace_a_general_effect_of_few_blocks(
    special: float, better: bool, likely: bool, outdone: bool
) -> None:
    """The squared gap is 6.6 without effects and 3.0 with the general effect."""
    state = SimpleNamespace(
        retuned=6.6,
        score=lambda left: left,
        is_better=lambda general, leaner, share: better,
        is_likely_better=lambda general, leaner, share: likely,
    )
    found = search_state.Search.outdoes_special_case(state, 3.0, special)
    assert found is outdone


def test_an_effect_of_many_starts_is_restarted_beside_another() -> None:
    """Fitted alone, the Stribeck friction may converge to values that imitate another effect;
    started from those values beside that effect it gains little, so its other starts are tried.
    """
    state, stribeck = begun_search(Toy(STRIBECK_AND_GAIN)), BY_ID["stribeck_friction"]
    gain = state.engine.fit(state.engine.hypotheses([BY_ID["current_gain"]]))[0]
    state.engine.remember(
        fit_at(state, {"effects.stribeck_friction.speed_rad_s": 5.0}, ("stribeck_friction",), 0)
    )
    kept = extension.starts_beside(state, gain, stribeck)
    assert len(kept) == 1 and len(extension.starts_beside(state, gain, stribeck, restart=True)) == 3
    poor = min(
        extension.first_order(state, gain, one).out_of_fold.std()
        for one in extension.differentiate_added(state, gain, kept)
    )
    found = extension.restarted_extensions(state, gain)
    assert [one.ids for one in found] == [("current_gain", "stribeck_friction")]
    assert found[0].out_of_fold.std() < 0.9 * poor


def test_fits_near_the_best_are_continued_to_convergence() -> None:
    state = begun_search(Toy(STRIBECK_AND_GAIN))
    near, far = (
        fit_at(state, {"effects.stribeck_friction.speed_rad_s": 200.0}, ids, 0).hypothesis
        for ids in (("current_gain", "stribeck_friction"), ("winding_resistance",))
    )
    brief = state.engine.fit([near, far], 1)
    assert all(one.improving for one in brief) and state.near_best(brief) == brief[:1]
    found = state.fit_and_keep([near, far], 1)
    assert (
        found[0].cost
        == state.engine.fit([near], search_state.COMPARISON.max_rounds)[0].cost
        < brief[0].cost - 100.0
    )
    assert not found[0].improving and found[1].improving and found[1].cost == brief[1].cost


def test_a_fit_near_the_best_is_simulated_though_its_prediction_is_poor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The prediction to first order fails where the folds' steps are long; the fit itself is as
    good as the best one.
    """
    state = begun_search(Toy({"effects.coulomb_friction.torque_nm": 0.006}))
    (true,) = state.engine.hypotheses([BY_ID["coulomb_friction"]])[:1]
    (other,) = state.engine.hypotheses([BY_ID["viscous_friction"]])[:1]
    plain = Engine.predict_first_order

    def poor_of_the_true_one(self: Engine, one: Fit, *more: np.ndarray) -> np.ndarray:
        found = plain(self, one, *more)
        return found + 30.0 if one.ids == ("coulomb_friction",) else found

    monkeypatch.setattr(Engine, "predict_first_order", poor_of_the_true_one)
    found = state.fit_and_keep([true, other])
    assert found[0].exact and state.score(found[0]) < 1.1 < state.score(found[1])


def test_a_set_is_fitted_in_each_of_its_forms() -> None:
    """speed_lag is a lag, a delay or a mean, clock_skew is of the logger's or the command's clock.
    No gradient leads from one form to another, so all six combinations are fitted, whichever the
    related fit has.
    """
    state = begun_search(Toy({}))
    state.effects.append(BY_ID["speed_lag"])
    related = state.engine.hypotheses([BY_ID["current_gain"], BY_ID["speed_lag"]])[-1]
    near = state.engine.fit([replace(related, start=np.full(len(related.start), 0.5))], 0)[0]
    tried = candidate_sets.hypotheses_near(state, ["speed_lag", "clock_skew"], near)
    assert len({h.fixed for h in tried}) == len(tried) == 6 and all(
        h.start[0] == 0.5 for h in tried
    )
    assert (
        len(
            candidate_sets.distinct_hypotheses(
                [near, near, replace(near, hypothesis=replace(related, fixed=()))]
            )
        )
        == 2
    )
