"""`vgroove bench trap`: the true motion obeys its equation, and the diagnosis names the friction
that the model lacks.
"""

import numpy as np
import pytest

from vgroove.bench import trap


def test_truth_is_the_joints_equation() -> None:
    """Away from standstill J w' = torque - damping w - Coulomb sign(w); at rest a torque below the
    friction moves nothing.
    """
    step = 1.0 / trap.LOG_HZ
    time_s = step * np.arange(1, 201)
    motion = trap.simulate_motion(time_s, np.full(200, 0.1))
    rest = (
        (0.1 - trap.COULOMB) / trap.DAMPING * (1.0 - np.exp(-time_s * trap.DAMPING / trap.INERTIA))
    )
    assert motion.speed_rad_s == pytest.approx(rest, rel=1e-4)
    assert not trap.simulate_motion(time_s, np.full(200, 0.99 * trap.COULOMB)).speed_rad_s.any()


def test_the_friction_is_named_and_the_damping_kept() -> None:
    seen = trap.measured(trap.simulate_motion(*trap.excitation(3, trap.TRAIN_S, trap.TRAIN_NM)), 3)
    new = trap.simulate_motion(*trap.excitation(1003, trap.NEW_S, trap.NEW_NM))
    answer = trap.own_answer(seen, new)
    assert answer.printed_result.startswith("The missing effect is coulomb friction:")
    assert answer.damping == pytest.approx(
        trap.DAMPING, rel=0.02
    ) and answer.friction_nm == pytest.approx(trap.COULOMB, rel=0.02)
    assert answer.speed_error < 0.003


def test_missing_peers_are_named_with_how_to_get_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(trap.importlib, "import_module", absent)
    found, missing = trap.peers()
    assert not found
    assert [(m.name, m.install) for m in missing] == [(p.name, p.install) for p in trap.PEERS]
