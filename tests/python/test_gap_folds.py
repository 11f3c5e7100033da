"""What the folds predict: blocks unseen, steps that go astray shortened, and a fit of its own where
no part of the step holds.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import Toy, fit_of
from vgroove.gap.fitting.cross_validation import SHORTER, near, predict_held_out
from vgroove.gap.fitting.fit import Engine, Fit

TORQUE = "effects.coulomb_friction.torque_nm"


def test_a_held_out_block_is_predicted_without_having_been_seen() -> None:
    spoilt = Toy({TORQUE: 0.004})
    clean = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")[1]
    shift = 300.0
    _, test = spoilt.folds[2]
    spoilt.measured_rows[1, np.unique(spoilt.row[test])] += shift
    _, dirty = fit_of(spoilt, "coulomb_friction")
    moved = (dirty.held - clean.held)[test & (spoilt.signal == 1)]
    np.testing.assert_allclose(moved, shift / 20.0, atol=0.3)


def settled_by(
    monkeypatch: pytest.MonkeyPatch, engine: Engine, one: Fit, step: np.ndarray
) -> list[np.ndarray]:
    """Settle with this step in every fold; the residuals after each shortened step."""
    one.exact = False
    monkeypatch.setattr(Engine, "fold_steps", lambda _self, _one: np.tile(step, (4, 1)))
    predict_held_out(engine, [one])
    return engine.residuals([(one.hypothesis, one.x + 0.3**k * step) for k in range(SHORTER + 1)])


def test_a_folds_step_that_makes_its_own_rows_worse_is_shortened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the model bends, the step that leaves a fold out may go astray: it must not be held
    against the effect.
    """
    engine, best = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")
    beside = engine.fit([replace(best.hypothesis, start=best.x - 0.36)], 0)[0]
    rows = settled_by(monkeypatch, engine, beside, np.full(len(best.x), 0.36 / 0.3**SHORTER))
    np.testing.assert_allclose(beside.held, rows[-1])
    assert not np.allclose(beside.held, rows[0])


@pytest.mark.parametrize("off", [-1, 0, 1])
def test_a_fold_that_no_part_of_its_step_makes_better_takes_the_best_point_around(
    monkeypatch: pytest.MonkeyPatch, off: int
) -> None:
    """From a fit one difference's step off the best one the folds find back to it, none of them
    asking the block that it predicts.
    """
    engine, best = fit_of(Toy({TORQUE: 0.004}), "coulomb_friction")
    step = np.array(
        [c.step_at(float(x)) for c, x in zip(best.hypothesis.coordinates, best.x, strict=True)]
    )
    beside = engine.fit([replace(best.hypothesis, start=best.x + off * step)], 0)[0]
    settled_by(monkeypatch, engine, beside, np.full(len(best.x), 9.0))
    np.testing.assert_allclose(beside.held, best.residual, atol=1e-6)


def test_the_block_has_no_say_in_the_point_that_predicts_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A block that asks so loudly for a point beside the fit that all rows prefer it: the other
    folds go there, its own does not.
    """
    toy = Toy({TORQUE: 0.004})
    engine, best = fit_of(toy, "coulomb_friction")
    _, test = toy.folds[1]
    beside = near(best)[-2]
    told = (
        30.0
        * (best.residual - engine.residuals([(best.hypothesis, beside[None, :])])[0])
        * toy.sigma
    )
    toy.measured_rows += np.where(test, told, 0.0).reshape(3, -1)
    spoilt = engine.fit([replace(best.hypothesis, start=best.x)], 0)[0]
    assert min(engine.costs(spoilt, beside[None, :])) < spoilt.cost
    settled_by(monkeypatch, engine, spoilt, np.full(len(best.x), 9.0))
    np.testing.assert_allclose(spoilt.held[test], spoilt.residual[test])
    assert not np.allclose(spoilt.held[~test], spoilt.residual[~test])
