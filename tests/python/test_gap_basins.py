"""A squared gap that is a staircase over the amplitude and phase of a ripple: the pattern search
leaves the step on which the fit ended.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import SCALES, Toy
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.cross_validation import predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual.restart_angles import RestartAngles
from vgroove.gap.selection import basins, search_state
from vgroove.gap.selection.options import DiagnosisOptions

TREAD = 0.06  # width of a step, in the true ripple
SWING = 3.0 * np.exp(1j)  # the true ripple in its size: amplitude and phase


class Staircase(Toy):
    """Residuals that are constant but for jumps: the shaft breaks away at other teeth the farther
    the ripple is from the true one.
    """

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """Noise, plus in every row the number of steps between a ripple and the true one (B, n)."""
        torque, phase = (
            np.atleast_2d(theta)[:, self.index(f"effects.cogging_torque.{name}")]
            for name in ("torque_nm", "phase_rad")
        )
        size = BY_ID["cogging_torque"].parameters[0].size(SCALES)
        away = np.abs(torque / size * np.exp(1j * phase) - SWING) / np.abs(SWING)
        noise = np.random.default_rng(1).standard_normal(self.n)
        return noise + np.floor(away / TREAD)[:, None]


def ended_at(swing: complex) -> tuple[search_state.Search, Fit]:
    """A search with a cogging fit that ended with a given amplitude and phase."""
    toy = Staircase({})
    engine = Engine(toy, SCALES, {})
    state = search_state.begin(engine, [BY_ID["cogging_torque"]], DiagnosisOptions())
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
def test_the_lowest_step_is_found_from_a_higher_one(swing: complex) -> None:
    state, ended = ended_at(swing)
    found = basins.deepest_minimum(state, ended)
    assert state.score(ended) > 5.0 and state.score(found) < 1.05
    assert state.fits[("cogging_torque",)] is found and found.exact


def test_no_neighbours_of_a_fit_that_leaves_no_gap_are_tried() -> None:
    state, ended = ended_at(SWING)
    runs = state.engine.calls
    assert basins.deepest_minimum(state, ended) is ended and state.engine.calls == runs


def test_only_the_ripples_amplitudes_move_within_their_bounds() -> None:
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
