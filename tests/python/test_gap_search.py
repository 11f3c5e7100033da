"""Steps of the search for sets of effects: what a set is fitted from, and when the search looks further than one effect."""

from dataclasses import replace

import numpy as np

from gap_toy import MODELLED, SCALES, Toy
from vgroove.gap import search
from vgroove.gap.fit import Engine, Fit
from vgroove.gap.hypotheses import BY_ID

HUMP = {"effects.stribeck_friction.breakaway_nm": 0.01, "effects.stribeck_friction.speed_rad_s": 400.0,
        "effects.current_gain.relative": 0.06}


def begun(toy: Toy) -> search.Search:
    """A search with the nominal and retuned fits made."""
    rows = search.Rows(toy.log, toy.time_s, toy.signal, np.zeros(toy.n, bool), 0.25)
    return search.begin(Engine(toy, SCALES, {}), [BY_ID[i] for i in MODELLED], rows, 0, lambda _: None)


def fit_at(state: search.Search, numbers: dict[str, float], ids: tuple[str, ...], rounds: int) -> Fit:
    """Fit of a set from given numbers (SI)."""
    h = state.engine.hypotheses([BY_ID[i] for i in ids])[0]
    start = np.array([numbers.get(c.name, 0.0) / c.factors[0] for c in h.coordinates])
    return state.engine.fit([replace(h, start=np.clip(start, h.low, h.high))], rounds)[0]


def test_a_leaner_set_starts_again_from_the_fuller_one() -> None:
    state = begun(Toy(HUMP))
    pair, triple = ("current_gain", "stribeck_friction"), ("current_gain", "quadratic_drag", "stribeck_friction")
    astray = fit_at(state, {"effects.stribeck_friction.speed_rad_s": 5.0}, pair, 0)
    state.fits |= {pair: astray, triple: fit_at(state, HUMP, triple, 6)}
    assert state.score(astray) > 1.2
    best = search.backward(state, state.fits[triple])
    assert search.key(best.ids) == pair and state.score(best) < 1.05
