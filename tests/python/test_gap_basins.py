"""Pattern search on a squared gap that is piecewise constant over the amplitude and phase of a
ripple: it finds the lowest value from a fit that ended on a higher one.
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

# distance over which the residuals are constant, in amplitudes of the true ripple
STEP_WIDTH = 0.06
TRUE_RIPPLE = 3.0 * np.exp(1j)  # amplitude exp(i phase), amplitude in typical sizes of the effect


class Staircase(Toy):
    """Residuals that are constant but for jumps, the larger the farther the ripple is from the true
    one, as those of a shaft that breaks away from other cogging positions.
    """

    def residuals(self, theta: np.ndarray, angles: RestartAngles | None = None) -> np.ndarray:
        """Noise plus the number of jumps between a ripple and the true one (B, n)."""
        torque, phase = (
            np.atleast_2d(theta)[:, self.index(f"effects.cogging_torque.{name}")]
            for name in ("torque_nm", "phase_rad")
        )
        size = BY_ID["cogging_torque"].parameters[0].size(SCALES)
        distance = np.abs(torque / size * np.exp(1j * phase) - TRUE_RIPPLE) / np.abs(TRUE_RIPPLE)
        noise = np.random.default_rng(1).standard_normal(self.n)
        return noise + np.floor(distance / STEP_WIDTH)[:, None]


def ended_at(ripple: complex) -> tuple[search_state.Search, Fit]:
    """A search with a cogging fit that ended at a ripple amplitude exp(i phase), and that fit."""
    toy = Staircase({})
    engine = Engine(toy, SCALES, {})
    state = search_state.begin(engine, [BY_ID["cogging_torque"]], DiagnosisOptions())
    h = state.engine.hypotheses([BY_ID["cogging_torque"]])[0]
    at = next(i for i, c in enumerate(h.coordinates) if c.role == "cosine")
    start = h.start.copy()
    start[at : at + 2] = ripple.real, ripple.imag
    ended = state.fits[("cogging_torque",)] = state.engine.fit([replace(h, start=start)], 0)[0]
    predict_held_out(state.engine, [ended])
    return state, ended


@pytest.mark.parametrize("factor", [1.35, 0.7, np.exp(0.5j), 1.2 * np.exp(-0.3j)])
def test_the_lowest_gap_is_found_from_a_higher_one(factor: complex) -> None:
    state, ended = ended_at(TRUE_RIPPLE * factor)
    found = basins.deepest_minimum(state, ended)
    assert state.score(ended) > 5.0 and state.score(found) < 1.05
    assert state.fits[("cogging_torque",)] is found and found.exact


def test_no_neighbours_of_a_fit_that_leaves_no_gap_are_tried() -> None:
    state, ended = ended_at(TRUE_RIPPLE)
    runs = state.engine.calls
    assert basins.deepest_minimum(state, ended) is ended and state.engine.calls == runs


def test_only_the_ripples_amplitudes_move_within_their_bounds() -> None:
    _, ended = ended_at(TRUE_RIPPLE)
    at = next(i for i, c in enumerate(ended.hypothesis.coordinates) if c.role == "cosine")
    points = basins.ripple_neighbours(ended, 0.2)
    np.testing.assert_array_equal(
        np.delete(points, [at, at + 1], axis=1),
        np.tile(np.delete(ended.x, [at, at + 1]), (len(points), 1)),
    )
    factor = (points[:, at] + 1j * points[:, at + 1]) / complex(*ended.x[at : at + 2])
    assert np.abs(factor - 1.0).max() == pytest.approx(0.2 * np.sqrt(2.0))
    assert not len(
        basins.ripple_neighbours(
            replace(ended, hypothesis=replace(ended.hypothesis, coordinates=()), x=np.zeros(0)), 0.2
        )
    )
