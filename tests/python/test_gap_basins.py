"""A gap that is a staircase over a ripple's amplitude and phase: the fit looks around the step on
which it ended.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import SCALES, Toy
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.fit import Engine, Fit
from vgroove.gap.selection import basins, search_state

TREAD = 0.06  # width of a step, in the true ripple
SWING = 3.0 * np.exp(1j)  # the true ripple in its size: amplitude and phase


class Staircase(Toy):
    """Flat but for jumps: a shaft that breaks away elsewhere the farther the ripple is from the
    true one.
    """

    def residuals(self, theta: np.ndarray) -> np.ndarray:
        """Noise, and as much in every row as there are steps up to a ripple (B, n)."""
        torque, phase = (
            np.atleast_2d(theta)[:, self.index(f"effects.cogging_torque.{name}")]
            for name in ("torque_nm", "phase_rad")
        )
        size = BY_ID["cogging_torque"].parameters[0].size(SCALES)
        away = np.abs(torque / size * np.exp(1j * phase) - SWING) / np.abs(SWING)
        noise = np.random.default_rng(1).standard_normal(self.n)
        return noise + np.floor(away / TREAD)[:, None]


def ended_at(swing: complex) -> tuple[search_state.Search, Fit]:
    """A search with the fit of a cogging that ended with an amplitude and phase."""
    toy = Staircase({})
    rows = search_state.Rows(toy.log, toy.time_s, toy.signal, np.zeros(toy.n, bool), 0.25)
    state = search_state.begin(
        Engine(toy, SCALES, {}), [BY_ID["cogging_torque"]], rows, 0, lambda _: None
    )
    h = state.engine.hypotheses([BY_ID["cogging_torque"]])[0]
    at = next(i for i, c in enumerate(h.coordinates) if c.role == "cosine")
    start = h.start.copy()
    start[at : at + 2] = swing.real, swing.imag
    ended = state.fits[("cogging_torque",)] = state.engine.fit([replace(h, start=start)], 0)[0]
    predict_held_out(state.engine, [ended])
    return state, ended


@pytest.mark.parametrize(
    "swing", [SWING * 1.35, SWING * 0.7, SWING * np.exp(0.5j), SWING * 1.2 * np.exp(-0.3j)]
)
def test_the_lowest_step_is_found_from_one_on_which_the_fit_ended(swing: complex) -> None:
    state, ended = ended_at(swing)
    found = basins.deepest_minimum(state, ended)
    assert state.score(ended) > 5.0 and state.score(found) < 1.05
    assert state.fits[("cogging_torque",)] is found and found.exact


def test_a_fit_that_leaves_no_gap_is_not_looked_around() -> None:
    state, ended = ended_at(SWING)
    runs = state.engine.calls
    assert basins.deepest_minimum(state, ended) is ended and state.engine.calls == runs


def test_only_the_ripples_numbers_move_within_their_bounds() -> None:
    _, ended = ended_at(SWING)
    at = next(i for i, c in enumerate(ended.hypothesis.coordinates) if c.role == "cosine")
    points = basins.ripple_neighbours(ended, 0.2)
    np.testing.assert_array_equal(
        np.delete(points, [at, at + 1], axis=1),
        np.tile(np.delete(ended.x, [at, at + 1]), (len(points), 1)),
    )
    swing = (points[:, at] + 1j * points[:, at + 1]) / complex(*ended.x[at : at + 2])
    assert np.abs(swing - 1.0).max() == pytest.approx(0.2 * np.sqrt(2.0))
    assert not len(
        basins.ripple_neighbours(
            replace(ended, hypothesis=replace(ended.hypothesis, coordinates=()), x=np.zeros(0)), 0.2
        )
    )
