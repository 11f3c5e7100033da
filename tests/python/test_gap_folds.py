"""Out-of-fold residuals: each block predicted without its own rows, steps that raise the cost
shortened, and the best point around the fit where no part of a step lowers it.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import Toy, fit_of
from vgroove.gap.fitting.cross_validation import MAX_SHORTENINGS, points_around, predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.selection.search_state import held_out_simulation

TORQUE = "effects.coulomb_friction.torque_nm"


def test_a_block_is_predicted_without_its_own_rows() -> None:
    disturbed = Toy({TORQUE: 0.004})
    clean = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")[1]
    shift = 300.0
    _, test = disturbed.folds[2]
    disturbed.measured_rows[1, np.unique(disturbed.row[test])] += shift
    _, moved_fit = fit_of(disturbed, "coulomb_friction")
    moved = (moved_fit.out_of_fold - clean.out_of_fold)[test & (disturbed.signal == 1)]
    np.testing.assert_allclose(moved, shift / 20.0, atol=0.3)


def test_rows_of_a_fold_that_the_fit_lacks_are_simulated_with_the_fit_to_all() -> None:
    """The fit may compare other samples of the logs (a torque balance) than the simulation does: a
    fold of the simulation can then be without samples in the fit, and the other way round.
    """
    toy = Toy({TORQUE: 0.004})
    engine, best = fit_of(toy, "coulomb_friction")
    fold, steps = toy.fold, engine.fold_steps(best)
    assert np.all(np.abs(steps) > 0.0)
    toy.fold = np.where(fold == 3, 9, np.where(fold == 0, 2, fold))
    other, toy.fold = SimpleNamespace(**vars(toy), residuals=toy.residuals), fold
    found = held_out_simulation(engine, best, other)
    points = {9: best.x, 1: best.x + steps[1], 2: best.x + steps[2]}
    for number, x in points.items():
        (row,) = engine.residuals([(best.hypothesis, x[None, :])])
        np.testing.assert_array_equal(found[other.fold == number], row[other.fold == number])


def predicted_with(
    monkeypatch: pytest.MonkeyPatch, engine: Engine, one: Fit, step: np.ndarray
) -> list[np.ndarray]:
    """Predict with this step in every fold; the residuals after each shortened step."""
    one.exact = False
    monkeypatch.setattr(Engine, "fold_steps", lambda _self, _one: np.tile(step, (4, 1)))
    predict_held_out(engine, [one])
    return engine.residuals(
        [(one.hypothesis, one.x + 0.3**k * step) for k in range(MAX_SHORTENINGS + 1)]
    )


def test_a_step_that_raises_the_cost_of_its_training_rows_is_shortened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the model is nonlinear, the step to the fit without one fold may be too long; the
    predictions with it would be too bad.
    """
    engine, best = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")
    beside = engine.fit([replace(best.hypothesis, start=best.x - 0.36)], 0)[0]
    rows = predicted_with(
        monkeypatch, engine, beside, np.full(len(best.x), 0.36 / 0.3**MAX_SHORTENINGS)
    )
    np.testing.assert_allclose(beside.out_of_fold, rows[-1])
    assert not np.allclose(beside.out_of_fold, rows[0])


@pytest.mark.parametrize("off", [-1, 0, 1])
def test_a_fold_without_a_useful_step_takes_the_best_point_around_the_fit(
    monkeypatch: pytest.MonkeyPatch, off: int
) -> None:
    """From a fit one difference step off the best one each fold returns to it, without the rows of
    the block that it predicts.
    """
    engine, best = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")
    step = np.array(
        [c.step_at(float(x)) for c, x in zip(best.hypothesis.coordinates, best.x, strict=True)]
    )
    beside = engine.fit([replace(best.hypothesis, start=best.x + off * step)], 0)[0]
    predicted_with(monkeypatch, engine, beside, np.full(len(best.x), 9.0))
    np.testing.assert_allclose(beside.out_of_fold, best.residual, atol=1e-6)


def test_a_block_does_not_influence_the_point_that_predicts_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A block disturbed so much that a point beside the fit has the lower cost over all rows: the
    other folds take it, the block's own fold does not.
    """
    toy = Toy({TORQUE: 0.004})
    engine, best = fit_of(toy, "coulomb_friction")
    _, test = toy.folds[1]
    beside = points_around(best)[-2]
    disturbance = (
        30.0
        * (best.residual - engine.residuals([(best.hypothesis, beside[None, :])])[0])
        * toy.sigma
    )
    toy.measured_rows += np.where(test, disturbance, 0.0).reshape(3, -1)
    disturbed = engine.fit([replace(best.hypothesis, start=best.x)], 0)[0]
    assert min(engine.costs(disturbed, beside[None, :])) < disturbed.cost
    predicted_with(monkeypatch, engine, disturbed, np.full(len(best.x), 9.0))
    np.testing.assert_allclose(disturbed.out_of_fold[test], disturbed.residual[test])
    assert not np.allclose(disturbed.out_of_fold[~test], disturbed.residual[~test])
