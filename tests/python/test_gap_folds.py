"""Out-of-fold residuals: each block predicted without its own rows, steps that raise the cost
shortened, and the best point around the fit where no part of a step lowers it.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import Toy, fit_of
from vgroove.gap.fitting.cross_validation import MAX_SHORTENINGS, points_around, predict_held_out
from vgroove.gap.fitting.engine import Engine
from vgroove.gap.fitting.hypothesis import Fit

TORQUE = "effects.coulomb_friction.torque_nm"


def test_a_block_is_predicted_without_its_own_rows() -> None:
    spoilt = Toy({TORQUE: 0.004})
    clean = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")[1]
    shift = 300.0
    _, test = spoilt.folds[2]
    spoilt.measured_rows[1, np.unique(spoilt.row[test])] += shift
    _, dirty = fit_of(spoilt, "coulomb_friction")
    moved = (dirty.out_of_fold - clean.out_of_fold)[test & (spoilt.signal == 1)]
    np.testing.assert_allclose(moved, shift / 20.0, atol=0.3)


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
    """Where the model is nonlinear, a step without one fold may overshoot: the effect must not lose
    by that.
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
    spoilt = engine.fit([replace(best.hypothesis, start=best.x)], 0)[0]
    assert min(engine.costs(spoilt, beside[None, :])) < spoilt.cost
    predicted_with(monkeypatch, engine, spoilt, np.full(len(best.x), 9.0))
    np.testing.assert_allclose(spoilt.out_of_fold[test], spoilt.residual[test])
    assert not np.allclose(spoilt.out_of_fold[~test], spoilt.residual[~test])
