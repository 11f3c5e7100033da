"""Logs of a hammering tool with missing rows or failed sensors, and those that the diagnosis and
`vgroove log check` refuse with a sentence.
"""

import json
import warnings
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impact_logs import impact_rig, plant_log, ramp
from vgroove.errors import VgrooveError
from vgroove.gap.log_check import check_log, checked_logs
from vgroove.gap.log_check.command import fact_lines, read_tool
from vgroove.gap.log_check.facts import impact_diagnosis_s
from vgroove.gap.residual.impact.harmonics import fit_harmonics
from vgroove.gap.residual.impact.missing_rows import fills_of, run_lengths, skipped_rows
from vgroove.gap.residual.impact.problem import ImpactProblem
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection.log_content import shown_effects
from vgroove.log import Log
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import with_load
from vgroove.rig import Rig, write_rig

HAMMERS_AT_S = 0.5


@pytest.fixture(scope="module")
def whole() -> Log:
    return plant_log(impact_rig(), {}, 1, ramp(0.9, 1.6))


def begun_at(log: Log, time_s: float) -> Log:
    """The rows of a log from a time on."""
    kept = log.time_s >= time_s
    return replace(
        log, time_s=log.time_s[kept], columns={n: v[kept] for n, v in log.columns.items()}
    )


def nominal_gap(problem: ImpactProblem) -> float:
    """Gap of the rig as it is."""
    return problem.gap(problem.residuals(problem.theta0)[0])


def refuse(log: Log, rig: Rig, text: str) -> None:
    """Assert that diagnosis and check refuse a log with the same sentence."""
    with pytest.raises(VgrooveError, match=text):
        load_problem([log], rig)
    assert any(text in finding.text for finding in check_log(log, rig).findings if finding.refuses)


@pytest.mark.parametrize("columns", [(), ("speed_rpm",), ("current_a",)])
@pytest.mark.parametrize("start_s", [HAMMERS_AT_S, 0.55, 0.71, 0.9])
def test_a_log_that_begins_while_the_tool_hammers_is_refused(
    whole: Log, start_s: float, columns: tuple[str, ...]
) -> None:
    """Of a joint that tightens; the rest of a log is judged."""
    kept = {n: v for n, v in whole.columns.items() if n not in columns}
    refuse(begun_at(replace(whole, columns=kept), start_s), impact_rig(), "hammers already")


def test_a_log_may_begin_with_the_command(whole: Log) -> None:
    """A logger that the trigger starts, and a joint whose head does not turn."""
    first = begun_at(whole, 0.002)
    step = np.where(whole.time_s > 0.0, 0.9, 0.0)
    for log in (first, begun_at(plant_log(impact_rig(), {}, 2, step), 0.001)):
        assert log.columns["duty"][0] > 0.0
        assert not check_log(log, impact_rig()).refused
    locked = with_load(impact_rig(), REFERENCE_JOINTS["locked"].load)
    log = begun_at(plant_log(locked, {}, 1, ramp(0.9, 1.6)), HAMMERS_AT_S)
    assert load_problem([log], locked).n > 0


@pytest.mark.parametrize("from_s", [0.0, 0.1, 0.2, 0.8, 1.2])
def test_a_speed_that_fails_during_the_impacts_is_taken_as_missing(
    whole: Log, from_s: float
) -> None:
    """The shaft turns between blows. The rest of the log is judged as before."""
    speed = np.where(whole.time_s < from_s, whole.columns["speed_rpm"], 0.0)
    failed = replace(whole, columns=whole.columns | {"speed_rpm": speed})
    problem = load_problem([failed], impact_rig())
    assert nominal_gap(problem) < 1.2
    assert any("is taken as missing" in w or "frozen" in w for w in problem.warnings)
    late = problem.time_s[[problem.signals[k].column == "speed_rpm.level" for k in problem.signal]]
    assert (late < from_s).all() and (len(late) > 0 or from_s < 0.5)
    found = [f.text for f in check_log(failed, impact_rig()).findings]
    assert any("is taken as missing" in text or "frozen" in text for text in found)


def test_samples_that_are_missing_beside_a_failed_speed_stay_missing(whole: Log) -> None:
    lost = (whole.time_s >= 0.5) & (whole.time_s < 0.7)
    speed = np.where(whole.time_s < 1.0, whole.columns["speed_rpm"], 0.0)
    columns = whole.columns | {"speed_rpm": np.where(lost, np.nan, speed)}
    problem = load_problem([replace(whole, columns=columns)], impact_rig())
    kept = problem.time_s[[problem.signals[k].column == "speed_rpm.level" for k in problem.signal]]
    assert not ((kept > 0.5) & (kept < 0.7)).any() and nominal_gap(problem) < 1.2


@pytest.fixture(scope="module")
def whole_count(whole: Log) -> int:
    """Number of residuals of the whole log."""
    return load_problem([whole], impact_rig()).n


@pytest.mark.parametrize(
    "seed", [pytest.param(s, marks=pytest.mark.proof if s > 3 else ()) for s in range(10)]
)
def test_missing_rows_and_samples_make_no_gap(whole: Log, whole_count: int, seed: int) -> None:
    """At drawn places: whole rows are missing, or the samples of some columns."""
    rng = np.random.default_rng(seed)
    start_s = rng.uniform(0.02, 1.4)
    missing = (whole.time_s >= start_s) & (whole.time_s < start_s + rng.uniform(0.003, 0.3))
    if seed % 2:
        columns = {n: v[~missing] for n, v in whole.columns.items()}
        log = replace(whole, time_s=whole.time_s[~missing], columns=columns)
    else:
        measured = ("current_a", "speed_rpm", "supply_v")
        some = rng.permutation(measured)[: rng.integers(1, 4)]
        empty = {n: np.where(missing, np.nan, whole.columns[n]) for n in some}
        log = replace(whole, columns=whole.columns | empty)
    problem = load_problem([log], impact_rig())
    assert nominal_gap(problem) < 1.15
    assert problem.n > 0.5 * whole_count


def test_single_missing_samples_are_interpolated_in_log_and_simulation(whole: Log) -> None:
    """A tenth of the rows; windows with longer holes, by chance, are left out."""
    rng = np.random.default_rng(1)
    columns = {
        n: np.where((n != "duty") & (rng.random(len(v)) < 0.1), np.nan, v)
        for n, v in whole.columns.items()
    }
    problem = load_problem([replace(whole, columns=columns)], impact_rig())
    assert nominal_gap(problem) < 1.2


def test_columns_of_every_third_row_are_filled_in_the_simulation_too(whole: Log) -> None:
    """A straight line over two rows flattens the peaks of log and simulation alike; the error of a
    simulation without it is 1.9.
    """
    known = np.arange(len(whole.time_s)) % 3 == 0
    columns = {
        n: v if n == "duty" else np.where(known, v, np.nan) for n, v in whole.columns.items()
    }
    assert nominal_gap(load_problem([replace(whole, columns=columns)], impact_rig())) < 1.4


@pytest.mark.parametrize(("start_s", "end_s"), [(0.08, 0.2), (0.1, 0.25), (0.12, 0.18)])
def test_the_run_up_after_missing_rows_is_not_judged(
    whole: Log, start_s: float, end_s: float
) -> None:
    """The command rises on a path that the log does not hold."""
    kept = (whole.time_s < start_s) | (whole.time_s >= end_s)
    columns = {n: v[kept] for n, v in whole.columns.items()}
    log = replace(whole, time_s=whole.time_s[kept], columns=columns)
    assert nominal_gap(load_problem([log], impact_rig())) < 1.2


def test_a_filled_column_is_that_of_numpy() -> None:
    time_s = np.array([0.0, 1.0, 2.0, 3.5, 4.0, 5.0])
    column = np.array([np.nan, 2.0, np.nan, np.nan, 6.0, np.nan])
    fill = fills_of(time_s, {"a": column, "b": np.ones(6), "c": np.full(6, np.nan)})
    assert set(fill) == {"a"}
    other = np.arange(12.0).reshape(2, 6) ** 2
    known = np.isfinite(column)
    expected = [np.interp(time_s, time_s[known], row[known]) for row in other]
    np.testing.assert_allclose(fill["a"].filled(other), expected)
    for rows in (2, 4, 5):  # the first rows of a log: what ends beyond them stays as it is
        left = np.array(expected if rows > 4 else other)[:, 1 : min(rows, 5)]
        np.testing.assert_allclose(fill["a"].filled(other[:, :rows])[:, 1:], left)


@given(
    lost=st.lists(st.sampled_from([0, 0, 0, 0, 1, 2, 7]), min_size=12, max_size=40),
    late=st.lists(st.floats(-0.2, 0.2), min_size=41, max_size=41),
)
def test_rows_are_missing_where_the_stamps_skip_them_not_where_they_scatter(
    lost: list[int], late: list[float]
) -> None:
    """Where fewer than half of the intervals skip rows, no two in a row do, and stamps are late or
    early by at most a fifth of an interval.
    """
    skips = [n if k % 3 == 1 else 0 for k, n in enumerate(lost)]
    time_s = np.concatenate([[0.0], np.cumsum([1.0 + n for n in skips])])
    stamps = time_s + np.array(late[: len(time_s)])
    assert skipped_rows(np.diff(time_s)).tolist() == skips
    found = skipped_rows(np.diff(stamps))
    assert (found[np.array(skips) == 0] == 0).all()


def test_scattered_stamps_of_a_complete_log_insert_nothing() -> None:
    late = 0.3 * np.random.default_rng(1).choice([0.0, 1.0], 2000, p=[0.9, 0.1])
    assert not skipped_rows(np.diff(np.arange(2000) + late)).any()


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_the_length_of_a_run_is_counted_in_each_of_its_rows(mask: list[bool]) -> None:
    runs = [list(group) for _, group in groupby(mask)]
    expected = [len(run) * value for run in runs for value in run]
    assert run_lengths(np.array(mask)).tolist() == expected


def test_pauses_longer_than_the_log_are_refused(whole: Log) -> None:
    later = np.where(whole.time_s > 1.0, whole.time_s + 100.0, whole.time_s)
    refuse(replace(whole, time_s=later), impact_rig(), "keep one run of the tool")


def test_a_column_that_never_changes_causes_a_warning(whole: Log) -> None:
    stuck = replace(whole, columns=whole.columns | {"current_a": np.full(len(whole.time_s), 3.0)})
    text = "the column current_a reads 3 throughout"
    assert any(text in warning for warning in load_problem([stuck], impact_rig()).warnings)
    (found,) = (f for f in check_log(stuck, impact_rig()).findings if text in f.text)
    assert found.warns and not found.refuses


@pytest.mark.parametrize(
    ("count", "seconds", "refused"), [(7.0, 0.2, False), (8.0, 0.2, True), (18.0, 1.6, False)]
)
def test_blows_in_the_log_of_a_rig_without_a_mechanism_are_refused(
    whole: Log, count: float, seconds: float, refused: bool
) -> None:
    """As many as a tool that hammers makes; a firmware counts a few at steps of the current."""
    drive, driven = impact_rig("impact_driver_drive"), whole.time_s < seconds
    blows = np.floor(count * np.linspace(0.0, 1.0, len(driven)))
    duty = np.where(driven, whole.columns["duty"], 0.0)
    log = replace(whole, columns=whole.columns | {"blow_count": blows, "duty": duty})
    found = [f for f in check_log(log, drive).findings if "the tool hammers" in f.text]
    assert bool(found) is refused
    if refused:
        with pytest.raises(VgrooveError, match="the tool hammers"):
            checked_logs([log], drive)


def test_too_few_rows_are_told_with_their_interval(whole: Log) -> None:
    slow = replace(
        whole, time_s=whole.time_s[::10], columns={n: v[::10] for n, v in whole.columns.items()}
    )
    refuse(slow, impact_rig(sensors__log_hz=100), "one every 10 ms")


def test_a_log_whose_own_joint_turns_freely_is_diagnosed(whole: Log) -> None:
    """No torque of the joint scales a knot; the effects are those of the logs' joints."""
    tightened, free = impact_rig(), with_load(impact_rig(), {"kind": "none"})
    log = plant_log(free, {}, 1, ramp(0.9, 1.6))
    problem = load_problem([log], tightened, joints=[free])
    assert not {"wood_knot", "thread_friction"} & {
        e.id for e in shown_effects(problem, frozenset())
    }
    both = load_problem([whole, log], free, joints=[tightened, free])
    assert "thread_friction" in {e.id for e in shown_effects(both, frozenset())}


def test_a_simulation_that_diverges_writes_no_warning() -> None:
    rng = np.random.default_rng(1)
    problem = load_problem([plant_log(impact_rig(), {}, 1, ramp(0.9, 1.6))], impact_rig())
    reader = problem.runs[0].reader
    found = fit_harmonics(rng.standard_normal((2, 1, 80)), np.ones(2), 1e-3, np.array([30.0]), 4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        left = reader._turn(replace(found, amplitude=np.full_like(found.amplitude, np.inf)))
    assert np.isnan(left).all()


def test_the_stated_time_of_a_diagnosis_grows_with_the_length_of_the_log() -> None:
    """Between the measured times of logs of one effect (facts.py), of 1.7 and of 2.7 s."""
    assert 29.0 <= impact_diagnosis_s(1.7) <= 38.0 and 35.0 <= impact_diagnosis_s(2.7) <= 48.0
    assert impact_diagnosis_s(8.0) - impact_diagnosis_s(4.0) == pytest.approx(36.0)


def test_the_check_of_a_log_takes_its_own_joint(tmp_path: Path) -> None:
    """A log that begins amid the blows is refused on the rig's joint, which turns, and not on a
    locked one.
    """
    load = REFERENCE_JOINTS["locked"].load
    begun = begun_at(plant_log(with_load(impact_rig(), load), {}, 1, ramp(0.9, 1.6)), HAMMERS_AT_S)
    rig_path, joint_path = tmp_path / "rig.toml", tmp_path / "joint.toml"
    write_rig(impact_rig(), rig_path)
    lines = [f"{key} = {json.dumps(value)}" for key, value in load.items()]
    joint_path.write_text("\n".join(['schema = "vgroove.rig/1"', "[load]", *lines]))
    assert check_log(begun, read_tool(rig_path, None)).refused
    assert not check_log(begun, read_tool(rig_path, joint_path)).refused
    with pytest.raises(VgrooveError, match="--joint needs --rig"):
        read_tool(None, joint_path)


def test_the_check_of_a_hammering_log_states_the_time_of_its_diagnosis(whole: Log) -> None:
    facts = check_log(whole, impact_rig()).facts
    assert facts.diagnosis_s == impact_diagnosis_s(facts.duration_s)
    assert facts.diagnosis_longer in fact_lines(facts)[2]
    assert check_log(whole).facts.diagnosis_s < 10.0
