"""Steps of the search for sets of effects: what a set is fitted from, and when the search looks
further than one effect.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import MODELLED, SCALES, Toy
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.fit import Engine, Fit
from vgroove.gap.selection import extension, search, search_state

HUMP = {
    "effects.stribeck_friction.breakaway_nm": 0.01,
    "effects.stribeck_friction.speed_rad_s": 400.0,
    "effects.current_gain.relative": 0.06,
}


def begun(toy: Toy) -> search_state.Search:
    """A search with the nominal and retuned fits made."""
    rows = search_state.Rows(toy.log, toy.time_s, toy.signal, np.zeros(toy.n, bool), 0.25)
    return search_state.begin(
        Engine(toy, SCALES, {}), [BY_ID[i] for i in MODELLED], rows, 0, lambda _: None
    )


def fit_at(
    state: search_state.Search, numbers: dict[str, float], ids: tuple[str, ...], rounds: int
) -> Fit:
    """Fit of a set from given numbers (SI)."""
    h = state.engine.hypotheses([BY_ID[i] for i in ids])[0]
    start = np.array([numbers.get(c.name, 0.0) / c.factors[0] for c in h.coordinates])
    return state.engine.fit([replace(h, start=np.clip(start, h.low, h.high))], rounds)[0]


def test_a_leaner_set_starts_again_from_the_fuller_one() -> None:
    state = begun(Toy(HUMP))
    pair, triple = (
        ("current_gain", "stribeck_friction"),
        ("current_gain", "quadratic_drag", "stribeck_friction"),
    )
    astray = fit_at(state, {"effects.stribeck_friction.speed_rad_s": 5.0}, pair, 0)
    state.fits |= {pair: astray, triple: fit_at(state, HUMP, triple, 6)}
    assert state.score(astray) > 1.2
    best = search.backward(state, state.fits[triple])
    assert search_state.key(best.ids) == pair and state.score(best) < 1.05


def test_a_member_that_stands_in_for_the_true_one_is_exchanged() -> None:
    truth = {"effects.coulomb_friction.torque_nm": 0.006, "effects.current_gain.relative": -0.08}
    state = begun(Toy(truth))
    wrong, pair = ("current_gain", "quadratic_drag"), ("coulomb_friction", "current_gain")
    state.fits[wrong] = fit_at(state, {}, wrong, 6)
    assert state.score(state.fits[wrong]) > 1.2 and pair not in state.fits
    best = search.exchanged(state, state.fits[wrong])
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
def test_what_enters_none_of_the_others_equations_works_elsewhere(
    others: tuple[str, ...], member: str, elsewhere: bool
) -> None:
    scored = SimpleNamespace(score=lambda one: one.left, level=lambda: 1.0)
    leaner = SimpleNamespace(ids=others, left=3.0)
    for left, larger_part in ((1.9, True), (2.1, False)):
        best = SimpleNamespace(ids=(*others, member), left=left)
        assert search.works_elsewhere(scored, best, leaner) is (elsewhere and larger_part)


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
    """Retuning leaves 104, the first effect 4: a hundredth of what it closes is enough in equations
    that its form does not reach.
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
        level=lambda: 1.0,
        retuned=fit_of(),
        least_gain=lambda one: 0.1,
        by_signal=lambda one, clip: np.array([one.left]),
    )
    monkeypatch.setattr(
        search, "without", lambda _, best, i: fit_of(*(j for j in best.ids if j != i))
    )
    assert (
        search.trimmed(state, fit_of(first, "supply_resistance"), search.FORM_SHARE).ids
        == (first, "supply_resistance")
    ) is kept


@pytest.mark.parametrize(("second", "named"), [("coulomb_friction", True), ("current_gain", False)])
def test_what_a_form_leaves_lies_where_the_effect_shows(second: str, named: bool) -> None:
    """Beside a large offset of the current a small friction, which the speed shows too, is no form
    of it; a small gain may be.
    """
    small = {
        "coulomb_friction": {"effects.coulomb_friction.torque_nm": 0.002},
        "current_gain": {"effects.current_gain.relative": 0.04},
    }
    truth = {"effects.current_offset.offset_a": 1.2} | small[second]
    state = begun(Toy(truth))
    pair = search_state.key(("current_offset", second))
    state.fits[pair] = fit_at(state, truth, pair, 6)
    alone = state.add([state.engine.hypotheses([BY_ID["current_offset"]])[0]])[0]
    assert state.better(state.fits[pair], alone)
    assert state.score(alone) - state.score(state.fits[pair]) < search.FORM_SHARE * (
        state.score(state.retuned) - state.score(alone)
    )
    assert search.trimmed(state, state.fits[pair], search.FORM_SHARE) is (
        state.fits[pair] if named else alone
    )


class Stepped:
    """A search whose sets have given squared gaps; a set is better by `worth`, and only if its step
    is significant.
    """

    def __init__(self, gaps: list[float], significant: dict[int, bool]) -> None:
        self.sets = [
            SimpleNamespace(ids=tuple("abcde"[:size]), gap=gap) for size, gap in enumerate(gaps)
        ]
        self.retuned, self.significant = self.sets[0], significant

    def ranked(self, size: int) -> list[SimpleNamespace]:
        return self.sets[size : size + 1]

    def add(self, _: list[SimpleNamespace]) -> None:
        """All are fitted."""

    def score(self, one: SimpleNamespace) -> float:
        return one.gap

    def better(
        self, fuller: SimpleNamespace, leaner: SimpleNamespace, worth: float = search_state.WORTH
    ) -> bool:
        steps = len(fuller.ids) - len(leaner.ids)
        return leaner.gap - fuller.gap > worth and (steps > 1 or self.significant[len(fuller.ids)])

    def least_gain(self, leaner: SimpleNamespace) -> float:
        return search_state.WORTH

    def level(self) -> float:
        return 1.0

    def visible(self, one: SimpleNamespace) -> bool:
        return True

    leaves_a_gap = search_state.Search.leaves_a_gap


# Squared gaps of the sets of 0, 1, 2, ... effects; whether the second alone is significant; how
# many are found. The least gap: 1.21. Two may not be what the first's form leaves, a tenth of what
# it closes, and must close the larger part of the rest.
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
def test_two_further_effects_are_looked_for_while_a_gap_is_left(
    gaps: list[float], second: bool, found: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = Stepped(gaps, {1: True, 2: second, 3: True})
    monkeypatch.setattr(search, "simplest", lambda _, best, base=None: best)
    monkeypatch.setattr(search, "rescale", lambda _: None)
    monkeypatch.setattr(search, "deepest_minimum", lambda _, best: best)
    monkeypatch.setattr(search, "distinct", lambda promised: promised)
    monkeypatch.setattr(search, "extensions", lambda state, base: state.ranked(len(base.ids) + 1))
    monkeypatch.setattr(
        search, "grow", lambda state, base: next(iter(state.ranked(len(base.ids) + 1)), None)
    )
    assert len(search.forward(state).ids) == found


@pytest.mark.parametrize(
    ("special", "base", "named"),
    [
        (4.40, 4.45, "asymmetric_friction"),
        (4.30, 4.45, "coulomb_friction"),
        (4.40, None, "coulomb_friction"),
    ],
)
def test_a_special_case_that_gains_nothing_over_the_base_takes_no_place(
    special: float, base: float | None, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The general effect is not significantly better, in so few blocks; but the special one would
    end the growth of the set.
    """

    def fit_of(left: float, *ids: str) -> SimpleNamespace:
        return SimpleNamespace(ids=ids, left=left)

    state = SimpleNamespace(
        score=lambda one: one.left,
        least_gain=lambda one: 0.1,
        better=lambda fuller, leaner, worth: False,
        effects=[BY_ID["coulomb_friction"], BY_ID["asymmetric_friction"]],
    )
    monkeypatch.setattr(search, "fit_set", lambda _, ids, near: fit_of(special, *ids))
    found = search.simplest(
        state,
        fit_of(3.0, "speed_gain", "asymmetric_friction"),
        None if base is None else fit_of(base, "speed_gain"),
    )
    assert found.ids == ("speed_gain", named)


def test_an_effect_of_many_starts_begins_anew_beside_another() -> None:
    """Where it ended alone it may have done another effect's work: kept to those numbers it gains
    little beside the other.
    """
    state, stribeck = begun(Toy(HUMP)), BY_ID["stribeck_friction"]
    gain = state.engine.fit(state.engine.hypotheses([BY_ID["current_gain"]]))[0]
    state.engine.remember(
        fit_at(state, {"effects.stribeck_friction.speed_rad_s": 5.0}, ("stribeck_friction",), 0)
    )
    kept = extension.starts_beside(state, gain, stribeck)
    assert len(kept) == 1 and len(extension.starts_beside(state, gain, stribeck, anew=True)) == 3
    astray = min(
        extension.first_order(state, gain, one).held.std()
        for one in extension.differenced(state, gain, kept)
    )
    found = extension.restarted_extensions(state, gain)
    assert [one.ids for one in found] == [("current_gain", "stribeck_friction")]
    assert found[0].held.std() < 0.9 * astray


def test_what_comes_near_the_best_goes_on_until_it_has_converged() -> None:
    state = begun(Toy(HUMP))
    near, far = (
        fit_at(state, {"effects.stribeck_friction.speed_rad_s": 200.0}, ids, 0).hypothesis
        for ids in (("current_gain", "stribeck_friction"), ("winding_resistance",))
    )
    brief = state.engine.fit([near, far], 1)
    assert all(one.moving for one in brief) and state.near(brief) == brief[:1]
    found = state.add([near, far], 1)
    assert (
        found[0].cost
        == state.engine.fit([near], search_state.CONVERGED)[0].cost
        < brief[0].cost - 100.0
    )
    assert not found[0].moving and found[1].moving and found[1].cost == brief[1].cost


def test_a_set_is_fitted_in_each_of_its_forms() -> None:
    """A lag and a delay, the logger's clock and the command's: no slope leads from one form to
    another, whichever the related fit has.
    """
    state = begun(Toy({}))
    state.effects.append(BY_ID["speed_lag"])
    related = state.engine.hypotheses([BY_ID["current_gain"], BY_ID["speed_lag"]])[-1]
    near = state.engine.fit([replace(related, start=np.full(len(related.start), 0.5))], 0)[0]
    tried = search.started(state, ["speed_lag", "clock_skew"], near)
    assert len({h.fixed for h in tried}) == len(tried) == 4 and all(
        h.start[0] == 0.5 for h in tried
    )
    assert (
        len(search.distinct([near, near, replace(near, hypothesis=replace(related, fixed=()))]))
        == 2
    )
