"""The clip of a gap's residuals (docs/spec/gap.md, section 5): where it lies, that every model of a
log has the same, and that `vgroove sim` computes the figures of a diagnosis again.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from made_log import MadeLog, drive_log, rig
from vgroove.gap import DiagnosisOptions, Verdict, diagnose
from vgroove.gap.catalogue import CATALOGUE
from vgroove.gap.residual.agreement import clip_sigmas
from vgroove.gap.residual.loading import load_problem, with_clip
from vgroove.gap.simulate import compute_gap
from vgroove.rig import read_rig, write_rig

LEVELS = [(0.2, 0.4), (0.8, 0.9), (1.4, 0.5)]
MIN_CLIP = 10.0
# only these are tried, so that a diagnosis lasts a second
TRIED = ("coulomb_friction", "current_gain")
OPTIONS = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in TRIED])


def log_with(**effects: dict[str, float]) -> MadeLog:
    """A log of 2 s of a tool with effects that its rig lacks."""
    return drive_log(rig(effects=effects), seconds=2.0, levels=LEVELS)


@pytest.fixture(scope="module")
def far_log() -> MadeLog:
    """A log far from the rig: much friction, and a wrong scale of the current."""
    return log_with(coulomb_friction={"torque_nm": 0.05}, current_gain={"relative": -0.2})


@pytest.fixture(scope="module")
def verdict(far_log: MadeLog) -> Verdict:
    """The diagnosis of that log."""
    return diagnose([far_log], rig(), OPTIONS)


@pytest.mark.parametrize(
    ("scale", "clip"), [(0.0, 10.0), (0.5, 10.0), (1.0, 10.0), (3.0, 30.0), (200.0, 2000.0)]
)
def test_the_clip_is_ten_times_the_larger_of_one_and_the_errors_quantile(
    scale: float, clip: float
) -> None:
    """Magnitudes whose 95 % quantile is 1.96 are those of unit noise."""
    size = np.full(1000, 0.1)
    size[-100:] = 1.96
    assert clip_sigmas(scale * size) == pytest.approx(clip)


def test_a_twentieth_of_large_errors_does_not_move_the_clip() -> None:
    size = np.concatenate([np.full(960, 1.0), np.full(40, 1e4)])
    assert clip_sigmas(size) == MIN_CLIP
    assert clip_sigmas(np.zeros(0)) == MIN_CLIP


def test_each_signal_has_a_clip_from_its_own_judged_samples(far_log: MadeLog) -> None:
    problem = load_problem([far_log], rig())
    size = np.abs(problem.residuals(problem.theta0)[0])
    assert len(problem.clip) == len(problem.signals) == 3
    for k, clip in enumerate(problem.clip):
        mine = (problem.signal == k) & problem.judged & ~(problem.censored & (size == 0.0))
        wanted = MIN_CLIP * max(1.0, float(np.quantile(size[mine], 0.95)) / 1.96)
        assert clip == pytest.approx(wanted)
    assert max(problem.clip) > 3.0 * MIN_CLIP > min(problem.clip) == MIN_CLIP


def test_a_gap_clips_each_residual_at_its_signals_clip(far_log: MadeLog) -> None:
    problem = load_problem([far_log], rig())
    assert problem.gap(np.full(problem.n, 1e6)) == pytest.approx(
        np.sqrt(np.mean(problem.clip[problem.signal[problem.judged]] ** 2))
    )
    below = np.full(problem.n, 0.99 * MIN_CLIP)
    assert problem.gap(below) == pytest.approx(0.99 * MIN_CLIP)


def test_errors_in_units_are_not_clipped(far_log: MadeLog) -> None:
    problem = load_problem([far_log], rig())
    errors = problem.gap_by_signal(np.full(problem.n, 1e4))
    for signal in problem.signals:
        sigma = problem.sigma[problem.signal == problem.signals.index(signal)]
        assert errors[signal.column] == pytest.approx(
            1e4 * float(np.sqrt(np.mean(sigma**2))), rel=0.01
        )


def test_before_and_after_have_the_same_clip(verdict: Verdict, far_log: MadeLog) -> None:
    """Of the corrected rig alone the clip would be 10 in each signal."""
    clip = {name: one.clip for name, one in verdict.gap.by_signal.items()}
    assert max(clip.values()) > 3.0 * MIN_CLIP
    corrected = verdict.corrected_rig()
    assert corrected.clip == pytest.approx(clip, rel=1e-5)
    own = load_problem([far_log], replace(corrected, clip={}))
    assert max(own.clip) < 1.5 * MIN_CLIP


def test_the_simulation_uses_a_stated_clip_and_computes_one_where_none_is_stated(
    far_log: MadeLog,
) -> None:
    stated = rig().with_clip({"current_a": 12.0, "speed_rpm": 40.0})
    _, problem = compute_gap(stated, [far_log])
    _, computed = compute_gap(rig(), [far_log])
    columns = [signal.column for signal in problem.signals]
    clip = dict(zip(columns, problem.clip, strict=True))
    assert (clip["current_a"], clip["speed_rpm"]) == (12.0, 40.0)
    assert clip["supply_v"] == dict(zip(columns, computed.clip, strict=True))["supply_v"]


def test_a_diagnosis_ignores_a_stated_clip(verdict: Verdict, far_log: MadeLog) -> None:
    stated = rig().with_clip({"current_a": 12.0, "speed_rpm": 12.0})
    assert diagnose([far_log], stated, OPTIONS).as_dict() == verdict.as_dict()
    assert with_clip(load_problem([far_log], rig()), stated.clip).clip[0] == 12.0


def test_refit_and_before_are_the_gaps_of_the_simulation(
    verdict: Verdict, far_log: MadeLog, tmp_path: Path
) -> None:
    """The corrected rig is written and read again."""
    gap = verdict.gap
    assert verdict.selected and gap.refit < 0.3 * gap.before
    path = tmp_path / "corrected.toml"
    write_rig(verdict.corrected_rig(), path)
    assert "[clip]" in path.read_text(encoding="utf-8")
    figures: dict[str, Any] = compute_gap(read_rig(path), [far_log])[0]
    assert figures["gap"] == pytest.approx(gap.refit, rel=0.01)
    assert compute_gap(rig(), [far_log])[0]["gap"] == pytest.approx(gap.before, rel=1e-3)
    assert gap.refit <= gap.after * 1.01
