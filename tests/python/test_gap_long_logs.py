"""Long logs: the stretches that excite differently are judged, the rest is skipped while its heat
and charge go on; a time range chooses rows.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner

from made_log import MadeLog, drive_log, rig
from vgroove import _core, cli
from vgroove.errors import VgrooveError
from vgroove.gap import DiagnosisOptions, diagnose
from vgroove.gap.catalogue import CATALOGUE
from vgroove.gap.cleaning.long_logs import (
    BUS_A,
    LIMITS,
    SQUARE_A2,
    farthest_first,
    is_thinned,
    reduce_log,
    reduce_long_logs,
    rows_each,
    stretch_features,
)
from vgroove.gap.cleaning.lost_rows import insert_lost_rows
from vgroove.gap.cleaning.time_range import TimeRange
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.restarts import RESTART
from vgroove.log import Log, read_log, write_csv

RATE = 1000  # rows per second
TRUE = {"viscous_friction": {"nm_s_per_rad": 2.5e-6}}


def synthetic(seconds: int, reversals: tuple[int, ...] = ()) -> Log:
    """A log at constant speed but for a reversal of 1 s at each of some times in s."""
    rng, time_s = np.random.default_rng(1), np.arange(1, seconds * RATE + 1) / RATE
    duty = np.full(len(time_s), 0.6)
    for at in reversals:
        duty[at * RATE : (at + 1) * RATE] = -0.4
    noise = rng.standard_normal((2, len(time_s)))
    columns = {
        "duty": duty,
        "current_a": 5.0 * duty + 0.1 * noise[0],
        "speed_rpm": 9000.0 * duty + 5.0 * noise[1],
    }
    return Log(time_s, columns, "steady")


def judged_s(log: Log) -> set[int]:
    """Whole seconds of which a log holds every row."""
    times = log.time_s[~is_thinned(log.columns, len(log))]
    second, count = np.unique(np.ceil(times - 1e-9).astype(int) - 1, return_counts=True)
    return set(second[count == RATE].tolist())


def test_short_reversals_in_a_steady_log_are_chosen() -> None:
    log = synthetic(400, reversals=(150, 303))
    reduced = reduce_log(log, rig(), 24_000)
    assert {0, 1, 150, 303} <= judged_s(reduced)
    assert len(reduced) < 24_000 and reduced.time_s[-1] == log.time_s[-1]
    assert "steady: 21000 of 400000 rows are judged, in 7 stretches" in reduced.warnings[-1]


def test_the_farthest_of_three_groups_comes_next() -> None:
    features = np.array([[0.0], [0.1], [5.0], [5.1], [2.0], [0.05]])
    assert farthest_first(features, 3).tolist() == [0, 3, 4]
    assert sorted(farthest_first(features, 10).tolist()) == list(range(6))


def test_noise_alone_makes_no_stretch_differ() -> None:
    steady = stretch_features(synthetic(80), 4 * RATE)[:, 1:]
    reversing = stretch_features(synthetic(80, reversals=(41,)), 4 * RATE)[:, 1:]
    # a 1 % quantile of 4000 samples scatters by 0.06 sigma, over 20 stretches by 0.05 of the span
    assert np.ptp(steady, axis=0).max() < 0.1
    assert np.linalg.norm(reversing[10] - reversing[0]) > 1.5


@pytest.mark.parametrize(
    ("lengths", "expected"),
    [((10, 20), 20), ((100,), 60), ((100, 10), 50), ((100, 100), 30), ((100, 50, 10), 25)],
)
def test_logs_share_the_rows(lengths: tuple[int, ...], expected: int) -> None:
    limit = rows_each(lengths, 60)
    assert limit == expected and sum(min(n, limit) for n in lengths) <= 60


def test_logs_up_to_the_limit_are_left_alone() -> None:
    log = synthetic(10)
    assert reduce_long_logs([log, log], rig(), 20_000)[1] is log
    assert len(reduce_long_logs([log, log], rig(), 19_999)[1]) < 10_000


def test_thinned_rows_hold_means_and_no_measured_value() -> None:
    log = synthetic(400, reversals=(150,))
    reduced = reduce_log(log, rig(), 24_000)
    thinned = is_thinned(reduced.columns, len(reduced))
    assert 0 < thinned.sum() <= LIMITS.thinned_share * 24_000
    assert all(np.isnan(reduced[name][thinned]).all() for name in log.columns)
    assert np.isnan(reduced[SQUARE_A2][~thinned]).all()
    assert np.allclose(reduced[SQUARE_A2][thinned], 9.01, rtol=0.01)
    assert np.allclose(reduced[BUS_A][thinned], 1.8, rtol=0.01)


def test_thinned_rows_are_no_lost_rows() -> None:
    reduced = reduce_log(synthetic(400, reversals=(150,)), rig(), 24_000)
    assert insert_lost_rows(reduced, rig()) is reduced


def test_skipped_rows_heat_and_drain_as_simulated_ones() -> None:
    """A constant duty for 100 s: simulated, and with the middle 80 s skipped in rows of 1 s."""
    tool = rig().with_effects(
        {
            "winding_heating": {"kelvin_per_joule": 0.02, "cooling_s": 60.0},
            "supply_droop": {
                "volt_per_coulomb": 0.01,
                "polarisation_ohm": 0.02,
                "polarisation_s": 9.0,
            },
        }
    )
    fine = np.arange(0, 10_001) * 0.01
    whole = simulated(tool, fine)
    kept = (fine <= 10.0) | (fine > 90.0) | (np.arange(10_001) % 100 == 0)
    skipped = (fine[kept] > 10.0) & (fine[kept] <= 90.0)
    current = np.interp(fine[kept] - 0.5, fine, whole["current_a"])
    means = {
        "skipped_a2": np.where(skipped, current**2, np.nan),
        "skipped_bus_a": np.where(skipped, 0.6 * current, np.nan),
    }
    part = simulated(tool, fine[kept], **means)
    for name in ("current_a", "supply_v", "speed_rad_s"):
        late = fine[kept] > 91.0
        assert np.allclose(part[name][late], whole[name][kept][late], rtol=2e-3), name
    cold = simulated(tool, fine[:1000])
    assert abs(whole["supply_v"][-1] / cold["supply_v"][-1] - 1.0) > 0.03


def simulated(tool, time_s: np.ndarray, **means: np.ndarray) -> dict[str, np.ndarray]:
    """Simulation of a tool at a duty of 0.6 from rest, each column (rows,)."""
    log = _core.LogInput(time_s, "duty", np.full(len(time_s), 0.6), **means)
    rows = _core.simulate_log(log, tool.parameters()[None], np.zeros(1, int), np.zeros((1, 3)))
    return {name: values[0] for name, values in rows.items()}


def long_drive(seconds: float) -> MadeLog:
    """A drive with an effect: 4 s of steps, then a constant duty with two further groups of
    steps.
    """
    steps = [(0.0, 0.2), (0.5, 0.9), (1.2, 0.6)]
    levels = [(0.3, 0.35), (1.0, 0.8), (1.8, 0.5), (2.4, 1.0), (4.0, 0.6)]
    levels += [(share * seconds + t, level) for share in (0.4, 0.7) for t, level in steps]
    return drive_log(rig().with_effects(TRUE), seconds=seconds, levels=levels)


def test_a_reduced_log_is_judged_in_its_stretches_alone() -> None:
    made = long_drive(60.0)
    reduced = reduce_log(Log(made.time_s, made.columns, "made"), rig(), 24_000)
    problem = load_problem([reduced], rig())
    run = problem.runs[0]
    thinned = is_thinned(run.log.columns, len(run.log.time_s))
    assert thinned.any() and not thinned[problem.row].any()
    assert not any("holes" in warning or "clock" in warning for warning in problem.warnings)
    times = run.log.time_s[~thinned]
    for begin, end in problem.held_out_s[0]:
        assert np.any((times > begin) & (times <= end))
    assert {0, 1, 2, 3} == set(np.unique(problem.fold).tolist())
    true = rig().with_effects(TRUE).parameters()
    assert problem.gap(problem.residuals(true)[0]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("limit", [12_000, pytest.param(24_000, marks=pytest.mark.proof), 36_000])
def test_the_stretches_have_restarts_as_in_a_short_log(limit: int) -> None:
    """However far the thinned rows between them are apart."""
    made = long_drive(60.0)
    reduced = reduce_log(Log(made.time_s, made.columns, "made"), rig(), limit)
    problem = load_problem([reduced], rig())
    run = problem.runs[0]
    kept = ~is_thinned(run.log.columns, len(run.log.time_s))
    steps = np.diff(run.log.time_s)[kept[1:] & kept[:-1]]
    restarts_per_s = np.count_nonzero(kept[run.restarts.rows]) / steps.sum()
    assert np.ptp(steps) < 1e-6 and problem.restart_s == RESTART.nominal_s
    assert 0.9 < restarts_per_s * RESTART.nominal_s < 1.4  # with one more after each hole


@pytest.mark.proof
def test_a_long_log_gets_the_name_of_its_beginning() -> None:
    made = long_drive(300.0)
    log = Log(made.time_s, made.columns, "made")
    assert len(log) == 300_001
    kept = {"viscous_friction", "coulomb_friction", "torque_constant", "winding_heating"}
    options = DiagnosisOptions(without=[e.id for e in CATALOGUE if e.id not in kept])
    short = diagnose([log], rig(), replace(options, to_s=8.0))
    long = diagnose([reduce_log(log, rig(), 16_000)], rig(), options)
    assert long.selected == short.selected == ["viscous_friction"]
    value = long.effects[0].parameters["nm_s_per_rad"]
    assert value.ci95[0] < 2.5e-6 < value.ci95[1]


def test_a_time_range_keeps_the_rows_within() -> None:
    log = synthetic(10)
    part = TimeRange(2.0, 3.0).select(log)
    assert part.time_s[0] == 2.0 and part.time_s[-1] == 3.0 and len(part) == 1001
    assert TimeRange(9.5).select(log).time_s[-1] == 10.0
    assert TimeRange(to_s=0.5).select(log).time_s[0] == 0.001
    assert TimeRange().select(log) is log


@pytest.mark.parametrize("ends", [(float("nan"), None), (0.0, float("nan"))])
def test_an_end_of_a_time_range_that_is_no_number_is_refused(ends: tuple) -> None:
    with pytest.raises(VgrooveError, match="times in s, not nan"):
        TimeRange(*ends)


def test_an_empty_time_range_is_refused_with_the_range_of_the_log() -> None:
    with pytest.raises(VgrooveError, match="--from must be below --to"):
        TimeRange(3.0, 3.0)
    with pytest.raises(VgrooveError, match="steady: 0 rows.*from 0.001 s to 10 s"):
        TimeRange(20.0).select(synthetic(10))
    with pytest.raises(VgrooveError, match="from 1 s to 0 s is empty"):
        diagnose([synthetic(10)], rig(), DiagnosisOptions(from_s=1.0, to_s=0.0))


def test_the_command_judges_the_range_alone(tmp_path: Path) -> None:
    made = drive_log(rig(), seconds=4.0)
    write_csv(Log(made.time_s + 100.0, made.columns, "x"), tmp_path / "log.csv")
    assert read_log(tmp_path / "log.csv").time_s[0] == 100.0
    (tmp_path / "rig.toml").write_text(tomli_w.dumps(rig().as_dict()))
    arguments = ["sim", str(tmp_path / "rig.toml"), "--log", str(tmp_path / "log.csv")]
    done = CliRunner().invoke(
        cli.app,
        [*arguments, "--from", "101", "--to", "103", "-o", str(tmp_path / "sim.csv")],
        catch_exceptions=False,
    )
    assert done.exit_code == 0
    time_s = read_log(tmp_path / "sim.csv").time_s
    assert time_s[0] == 101.0 and time_s[-1] == 103.0
    verdict = diagnose(
        [tmp_path / "log.csv"],
        rig(),
        replace(DiagnosisOptions(), from_s=101.0, to_s=103.0),
    )
    held = verdict.gap.held_out_s[0]
    assert held[0][0] >= 101.0 and held[-1][1] <= 103.0


@pytest.mark.parametrize("signed", [True, False])
def test_a_current_without_sign_drains_the_battery_in_both_directions(signed: bool) -> None:
    time_s = np.arange(1, 1001 * RATE) / RATE
    duty = np.where(time_s % 20.0 < 10.0, 0.6, -0.6)
    size = 5.0 + 0.1 * np.random.default_rng(0).standard_normal(len(time_s))
    current = np.sign(duty) * size if signed else size
    log = Log(time_s, {"duty": duty, "current_a": current, "speed_rpm": 8000.0 * duty}, "log")
    (found,) = reduce_long_logs([log], rig(sensors={"log_hz": RATE}))
    delivered = found[BUS_A][np.isfinite(found[BUS_A])]
    assert len(delivered) > 100 and np.allclose(delivered, 3.0, atol=0.2)
