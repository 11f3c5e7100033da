"""Quantities that are estimated from a log because a Hall sensor does not measure them: angles lost
at stops, missed edges, and the gain of the speed.
"""

from dataclasses import replace

import numpy as np
import pytest

from made_log import MadeLog, drive_log, rig
from vgroove.gap.residual import angle_alignment
from vgroove.gap.residual.agreement import MIN_CLIP_SIGMAS
from vgroove.gap.residual.angle_alignment import align_angles
from vgroove.gap.residual.loading import load_problem, with_clip

STOPS = [
    (0.2, 0.5),
    (0.7, 0.0),
    (1.3, 0.8),
    (1.9, 0.0),
    (2.6, 0.4),
    (3.3, 0.0),
    (4.0, 0.9),
    (5.0, 0.0),
]
COGGING = {"torque_nm": 0.002, "periods_per_rev": 1.0, "phase_rad": 0.0}


@pytest.fixture(scope="module")
def stop_and_go() -> MadeLog:
    return drive_log(rig(effects={"cogging_torque": COGGING}), levels=STOPS)


def test_angles_lost_at_stops_are_estimated(stop_and_go: MadeLog) -> None:
    problem = load_problem([stop_and_go], rig())
    phase = problem.index("effects.cogging_torque.phase_rad")
    theta = np.repeat(
        load_problem([stop_and_go], rig(effects={"cogging_torque": COGGING})).theta0[None],
        16,
        axis=0,
    )
    theta[:, phase] = np.arange(16) * np.pi / 8.0  # the first edge lies anywhere
    parts = angle_alignment.angle_stretches(problem)
    assert parts.count > 2 and problem.runs[0].pitch_rad == pytest.approx(np.pi / 2.0)
    first = parts.of == parts.reference
    best = theta[int(np.argmin([problem.gap(r, first) for r in problem.residuals(theta)]))]
    assert problem.gap(problem.residuals(best)[0]) > 1.3
    assert (
        problem.gap(problem.residuals(best, align_angles(problem, best, problem.angles))[0]) < 1.2
    )


def test_an_unknown_angle_of_the_rest_before_the_first_edge_is_estimated() -> None:
    strong = rig(effects={"cogging_torque": COGGING | {"torque_nm": 0.008}})
    problem = load_problem([drive_log(strong, levels=STOPS)], strong)
    parts, theta = angle_alignment.angle_stretches(problem), problem.theta0
    assert parts.rest.tolist() == [True] + [False] * (parts.count - 1) and parts.reference == 1
    assert parts.restart[0].tolist().count(0) == 1 and len(parts.restart[0]) > parts.count
    rest = parts.rest[parts.of]
    best = problem.gap(problem.residuals(theta)[0], rest)
    angles = problem.angles.shifted(parts.restart, np.where(parts.rest, 2.0, 0.0))
    moved = problem.residuals(theta, angles)[0]
    assert problem.gap(moved, rest) > 1.3 * best
    again = problem.residuals(theta, align_angles(problem, theta, angles))[0]
    assert problem.gap(again, rest) < 1.05 * best
    assert np.array_equal(again[~rest], moved[~rest])


def test_angles_stay_where_no_effect_follows_the_angle(stop_and_go: MadeLog) -> None:
    problem = load_problem([stop_and_go], rig())
    assert align_angles(problem, problem.theta0, problem.angles) is problem.angles


def test_best_shifts_of_a_first_order_ripple_are_the_true_ones() -> None:
    rng, shift = np.random.default_rng(3), np.pi / 2.0 * np.array([0, 2, 3, 1])
    normal = np.stack([np.diag(rng.uniform(50.0, 90.0, 2)) for _ in shift])
    true = np.array([0.8, -0.5])
    rotated = [np.array([[np.cos(d), -np.sin(d)], [np.sin(d), np.cos(d)]]) @ true for d in shift]
    ripple = angle_alignment.FirstOrderRipple(
        1.0, normal, np.stack([-n @ t for n, t in zip(normal, rotated, strict=True)])
    )
    found = ripple.best_shifts([np.pi / 2.0 * np.arange(4)] * 4)
    assert np.mod(found - shift, 2.0 * np.pi) == pytest.approx(np.zeros(4), abs=1e-9)
    assert ripple.amplitudes(found) == pytest.approx(true, rel=1e-4)
    assert ripple.gain(found) > 2.0 * ripple.gain(np.zeros(4))


def test_a_gain_of_the_speed_in_the_rig_leaves_noise_alone() -> None:
    made = drive_log(rig())
    high = replace(
        made,
        columns=made.columns
        | {"speed_rpm": np.round(2.0 * made.columns["speed_rpm"] * 1.004) / 2.0},
    )
    problem = load_problem([high], rig(effects={"speed_gain": {"relative": 0.004}}))
    assert problem.gap(problem.residuals(problem.theta0)[0]) < 1.15
    assert any("edge periods behind speed_rpm" in w for w in problem.warnings)


def test_a_fifth_of_the_edges_may_be_missing() -> None:
    """A single speed stays wrong; residuals are clipped at 10 sigma here, since the clip of a log
    so far from its rig does not hide that one.
    """
    problem = load_problem([drive_log(rig(), dropout=0.2)], rig())
    theta = np.repeat(problem.theta0[None], 2, axis=0)
    theta[1, problem.index("effects.hall_dropout.probability")] = 0.2
    rows = problem.residuals(theta)
    near = with_clip(problem, {s.column: MIN_CLIP_SIGMAS for s in problem.signals})
    before, after = (near.gap(r) for r in rows)
    assert before > 2.0 and after < 1.1
    assert problem.gap(rows[0]) > 100.0 * problem.gap(rows[1])
    assert np.count_nonzero(np.abs(rows[1]) > MIN_CLIP_SIGMAS) <= 1
    assert problem.missed_share == pytest.approx(0.2, rel=0.1)
