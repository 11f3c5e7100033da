"""`vgroove log compare`: first difference by column and time, the gap of each column, and whether
resolution or timing explains it.
"""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vgroove.errors import VgrooveError
from vgroove.log import Log, write_csv
from vgroove.log_compare import LIMITS, Comparison, compare_logs
from vgroove.log_compare.command import meets
from vgroove.log_compare.report import cause_sentence, first_sentence
from warm_cli import warm_vgroove

ROOT = Path(__file__).resolve().parents[2]
VGROOVE = [sys.executable, "-m", "vgroove.cli"]
ROWS, TICK_S = 2000, 1e-3
LSB = {"current_a": 2.0**-9, "speed_rpm": 0.5, "supply_v": 0.025}


def signals(time_s: np.ndarray) -> dict[str, np.ndarray]:
    """Smooth quantities over time, all of them changing, and a state that changes three times."""
    return {
        "duty": np.round(255 * (0.5 + 0.3 * np.sin(9.0 * time_s))) / 255,
        "current_a": 12.0 + 8.0 * np.sin(40.0 * time_s) + 3.0 * np.sin(170.0 * time_s),
        "speed_rpm": 9000.0 + 3000.0 * np.sin(11.0 * time_s),
        "supply_v": 18.0 + 0.4 * np.sin(23.0 * time_s),
        "state": np.digitize(time_s, [0.31, 0.9, 1.5]).astype(float),
    }


def log_of(time_s: np.ndarray, signal_time_s: np.ndarray | None = None, name: str = "a") -> Log:
    """A log with values on the grids of the board's columns."""
    columns = signals(time_s if signal_time_s is None else signal_time_s)
    for column, step in LSB.items():
        columns[column] = step * np.round(columns[column] / step)
    return Log(time_s, columns, name)


def board_times() -> np.ndarray:
    return TICK_S * np.arange(ROWS)


def kinds(found: Comparison) -> dict[str, str]:
    return {gap.name: gap.explanation for gap in found.signals}


def test_equal_logs_have_no_difference() -> None:
    found = compare_logs(log_of(board_times()), log_of(board_times()))
    assert found.first is None
    assert found.cause == "equal"
    assert set(kinds(found).values()) == {"equal"}
    assert found.equal_rows == ROWS


def test_one_changed_sample_is_named_by_column_and_time() -> None:
    other = log_of(board_times())
    other.columns["speed_rpm"][1234] += 700.0
    found = compare_logs(log_of(board_times()), other)
    assert found.first.time_s == pytest.approx(1.234)
    assert found.first.columns == ("speed_rpm",)
    assert found.first.kind == "other"
    assert found.cause == "input"
    assert found.equal_rows == 1234
    gap = next(g for g in found.signals if g.name == "speed_rpm")
    assert (gap.differing, gap.largest) == (1, 700.0)
    assert kinds(found)["current_a"] == "equal"


def test_an_output_that_differs_at_equal_inputs_is_the_boards() -> None:
    other = log_of(board_times())
    other.columns["duty"][800:] += 0.2
    other.columns["current_a"][801:] += 1.0
    found = compare_logs(log_of(board_times()), other)
    assert found.cause == "output"
    assert found.first.columns == ("duty",)


@pytest.mark.parametrize(
    ("output", "first", "cause"),
    [
        ("duty", "duty", "output"),  # a row's duty acted during it: its inputs came too late
        ("state", "current_a", "input"),
    ],
)
def test_the_cause_where_an_input_and_an_output_differ_in_one_row(
    output: str, first: str, cause: str
) -> None:
    other = log_of(board_times())
    other.columns[output][800] += 0.2
    other.columns["current_a"][800] += LSB["current_a"]
    found = compare_logs(log_of(board_times()), other)
    assert set(found.first.columns) == {"current_a", output}
    assert (found.first.columns[0], found.cause) == (first, cause)
    assert ("bridge command is equal" in cause_sentence(found)) == (cause == "input")


def noise_log(seed: int, rows: int, scale: float = 1.0) -> Log:
    """A log of independent random numbers in its continuous columns."""
    one, rng = log_of(board_times()), np.random.default_rng(seed)
    columns = {n: one[n][:rows].copy() for n in ("duty", "current_a", "speed_rpm")}
    for name in ("current_a", "speed_rpm"):
        columns[name] = scale * rng.standard_normal(rows)
    return replace(one, time_s=one.time_s[:rows].copy(), columns=columns)


@pytest.mark.parametrize("max_shift_s", [0.1, 0.5, 30.0])
@pytest.mark.parametrize("rows", [90, 400])
def test_logs_that_hardly_overlap_are_not_explained_by_an_offset(
    rows: int, max_shift_s: float
) -> None:
    limits = replace(LIMITS, max_shift_s=max_shift_s)
    found = compare_logs(noise_log(1, rows), noise_log(2, rows), limits)
    assert found.time_map.share == 0.0
    assert kinds(found)["current_a"] == kinds(found)["speed_rpm"] == "other"


def test_a_long_pause_costs_no_memory_and_one_step_of_few_levels_is_quantisation() -> None:
    a, b = log_of(board_times()), log_of(board_times())
    for log in (a, b):
        log.time_s = log.time_s + np.where(np.arange(ROWS) < 1000, 0.0, 1e9)
    a.columns["supply_v"] = 18.0 + 0.025 * (np.arange(ROWS) % 4)
    b.columns["supply_v"] = a.columns["supply_v"] + 0.025
    assert kinds(compare_logs(a, b))["supply_v"] == "quantisation"


@pytest.mark.parametrize("offset_s", [-0.3, -0.0123, 0.0, 0.0871, 0.4])
def test_an_offset_is_found_in_the_whole_range(offset_s: float) -> None:
    time_s = 1e-3 * np.arange(3000)

    def shifted(by_s: float) -> Log:
        speed = 3000.0 + 500.0 * np.sin(7.0 * (time_s - by_s)) + 90.0 * np.sin(61 * (time_s - by_s))
        return replace(log_of(board_times()), time_s=time_s, columns={"speed_rpm": speed})

    limits = replace(LIMITS, max_shift_s=0.5)
    found = compare_logs(shifted(0.0), shifted(offset_s), limits).time_map
    assert found.offset_s == pytest.approx(offset_s, abs=2e-5)


@pytest.mark.parametrize("lost", ["rows at the end", "rows at the start", "a column"])
def test_logs_of_other_rows_or_columns_are_not_equal(lost: str) -> None:
    whole = log_of(board_times())
    part = replace(whole, columns=dict(whole.columns))
    if lost == "a column":
        del part.columns["speed_rpm"]
    else:
        kept = slice(None, -7) if lost == "rows at the end" else slice(7, None)
        columns = {name: column[kept] for name, column in whole.columns.items()}
        part = replace(whole, time_s=whole.time_s[kept], columns=columns)
    assert meets(compare_logs(whole, whole), "equal")
    for pair in ((whole, part), (part, whole)):
        found = compare_logs(*pair)
        assert found.first is None and not meets(found, "equal")


def test_a_command_of_few_levels_has_no_resolution_that_explains_a_gap() -> None:
    a, b = log_of(board_times()), log_of(board_times())
    a.columns["duty"] = np.where(a.time_s < 0.5, 0.0, 0.5)
    b.columns["duty"] = np.where(a.time_s < 0.5, 0.0, 0.6)
    assert kinds(compare_logs(a, b))["duty"] == "other"


@pytest.mark.parametrize(
    ("column", "low", "high"),
    [("supply_v", 18.0, 12.0), ("trigger", 0.0, 1.0), ("estimate", 0.0, 5.0)],
)
def test_a_change_between_few_levels_is_no_resolution(column: str, low: float, high: float) -> None:
    a, b = log_of(board_times()), log_of(board_times())
    a.columns[column] = np.where(a.time_s < 0.3, low, high)
    b.columns[column] = np.where(a.time_s < 1.3, low, high)
    found = compare_logs(a, b)
    assert kinds(found)[column] == "other" and not meets(found, "explained")
    assert "quantisation)" not in first_sentence(found)


@pytest.mark.parametrize("column", ["state", "current_a"])
def test_values_of_one_log_only_are_not_explained(column: str) -> None:
    other = log_of(board_times())
    other.columns[column][10:] = np.nan
    found = compare_logs(log_of(board_times()), other)
    assert kinds(found)[column] == "other"
    json.dumps(found.as_dict(), allow_nan=False)
    assert "missing" in first_sentence(found)


@pytest.mark.parametrize(
    ("steps", "kind"), [(1.0, "quantisation"), (1.01, "other"), (2.0, "other")]
)
def test_quantisation_is_a_gap_of_one_step_at_most(steps: float, kind: str) -> None:
    rng = np.random.default_rng(1)
    other = log_of(board_times())
    other.columns["current_a"] += steps * LSB["current_a"] * rng.integers(-1, 2, ROWS)
    if steps == 1.01:  # on a grid too fine to be the resolution
        other.columns["current_a"] += 0.001 * LSB["current_a"]
    found = compare_logs(log_of(board_times()), other)
    assert kinds(found)["current_a"] == kind


def test_a_state_number_is_never_off_by_quantisation() -> None:
    other = log_of(board_times())
    other.columns["state"][700] += 1.0
    assert kinds(compare_logs(log_of(board_times()), other))["state"] == "other"


@pytest.mark.parametrize(("offset_s", "drift"), [(0.003, 0.0), (-0.0074, 0.0), (0.002, 2e-3)])
def test_offset_and_drift_of_the_clocks_are_found(offset_s: float, drift: float) -> None:
    time_s = board_times()
    # what A shows at t, B shows at t + offset + drift (t - middle)
    middle_s = time_s[-1] / 2
    seen_s = middle_s + (time_s - middle_s - offset_s) / (1.0 + drift)
    found = compare_logs(log_of(time_s), log_of(time_s, seen_s, "b"))
    assert found.time_map.offset_s == pytest.approx(offset_s, abs=2e-5)
    assert found.time_map.drift == pytest.approx(drift, abs=3e-5)
    assert found.time_map.share > 0.97
    assert kinds(found)["current_a"] == kinds(found)["speed_rpm"] == "timing"
    state = next(g for g in found.signals if g.name == "state")
    assert state.explanation == "timing"
    assert abs(offset_s) - 2e-3 < state.worst_shift_s < abs(offset_s) + 4e-3


def test_an_offset_outside_the_searched_range_is_not_used() -> None:
    time_s = board_times()
    later = log_of(time_s, time_s - 0.05, "b")
    narrow = replace(LIMITS, max_shift_s=0.005)
    assert compare_logs(log_of(time_s), later, narrow).time_map.share == 0.0
    assert compare_logs(log_of(time_s), later).time_map.offset_s == pytest.approx(0.05, abs=2e-5)


def test_noise_is_explained_by_nothing() -> None:
    other = log_of(board_times())
    other.columns["current_a"] += np.random.default_rng(2).normal(0.0, 1.0, ROWS)
    found = compare_logs(log_of(board_times()), other)
    assert found.time_map.share == 0.0
    assert kinds(found)["current_a"] == "other"


def test_rows_without_a_partner_are_counted() -> None:
    keep = np.ones(ROWS, bool)
    keep[[10, 500, 501]] = False
    other = log_of(board_times()[keep])
    found = compare_logs(log_of(board_times()), other)
    assert (found.pairs.only_a, found.pairs.only_b) == (3, 0)
    assert set(kinds(found).values()) == {"equal"}


def test_a_value_that_is_missing_in_one_log_differs() -> None:
    a, b = log_of(board_times()), log_of(board_times())
    for log in (a, b):
        log.columns["supply_v"][:5] = np.nan
    b.columns["supply_v"][5] = np.nan
    gap = next(g for g in compare_logs(a, b).signals if g.name == "supply_v")
    assert (gap.differing, gap.missing) == (1, 1)
    assert gap.first_s == pytest.approx(0.005)


def test_other_sampling_instants_are_interpolated() -> None:
    other_s = 0.0004 + 0.7e-3 * np.arange(int(ROWS / 0.7) - 2)
    found = compare_logs(log_of(board_times()), log_of(other_s, None, "b"))
    assert found.pairs.interpolated
    assert "bit for bit" not in first_sentence(found)
    still = replace(log_of(other_s), columns={"duty": np.zeros(len(other_s))})
    both = compare_logs(replace(log_of(board_times()), columns={"duty": np.zeros(ROWS)}), still)
    assert both.first is None and "bit for bit" not in first_sentence(both)
    gap = next(g for g in found.signals if g.name == "current_a")
    assert 0.0 < gap.largest < 0.05
    assert next(g for g in found.signals if g.name == "state").worst_shift_s < 1.001e-3


@pytest.mark.parametrize(("begin_s", "end_s"), [(0.0, 0.0105), (1.9, 2.0)])
def test_a_value_that_is_missing_in_both_logs_is_not_made_up(begin_s: float, end_s: float) -> None:
    a, b = log_of(board_times()), log_of(board_times()[:-1] + 0.4e-3)
    for log in (a, b):
        missing = (log.time_s >= begin_s) & (log.time_s < end_s)
        log.columns["trigger"] = np.where(missing, np.nan, 0.5)
    found = compare_logs(a, b)
    assert found.pairs.interpolated
    trigger = next(g for g in found.signals if g.name == "trigger")
    assert (trigger.explanation, trigger.missing) == ("equal", 0)


def test_a_hole_of_one_log_is_not_filled_by_a_straight_line() -> None:
    other_s = board_times() + 0.4e-3
    log = log_of(other_s[(other_s < 0.5) | (other_s > 1.0)], None, "b")
    found = compare_logs(log_of(board_times()), log)
    for name in ("current_a", "speed_rpm", "supply_v", "state"):
        gap = next(g for g in found.signals if g.name == name)
        assert 495 <= gap.missing <= 502 and gap.explanation == "other"
        assert gap.largest < {"current_a": 0.05, "speed_rpm": 1.0, "supply_v": 0.026}.get(name, 1.5)


@pytest.mark.parametrize("change", ["time", "columns"])
def test_logs_with_nothing_in_common_are_refused(change: str) -> None:
    other = log_of(board_times() + (100.0 if change == "time" else 0.0))
    if change == "columns":
        other.columns = {"position_rad": other["speed_rpm"], "voltage_v": other["supply_v"]}
    with pytest.raises(VgrooveError, match="no (common time|column in common)"):
        compare_logs(log_of(board_times()), other)


@pytest.mark.parametrize(("factor", "ratio"), [(1e3, "1000"), (60.0, "60"), (37.0, "")])
def test_logs_of_which_few_rows_are_compared_carry_a_warning(factor: float, ratio: str) -> None:
    time_s = board_times()
    plain, longer = log_of(time_s), log_of(factor * time_s, time_s)
    for pair in ((plain, longer), (longer, plain)):
        (warning,) = compare_logs(*pair).warnings
        assert f"of {ROWS} in A and {ROWS} in B" in warning
        assert (f"a ratio near {ratio}:" in warning) == bool(ratio)
        assert ("--map" in warning) == bool(ratio)


def test_logs_of_other_rates_and_the_greater_part_of_a_log_carry_no_warning() -> None:
    time_s = board_times()
    for other in (time_s[::20], time_s[: ROWS // 5], time_s + 0.4e-3):
        assert compare_logs(log_of(time_s), log_of(other)).warnings == ()


def test_a_log_in_ms_is_named_before_the_findings(tmp_path: Path) -> None:
    time_s = board_times()
    write_csv(log_of(time_s), tmp_path / "s.csv")
    write_csv(log_of(1e3 * time_s, time_s), tmp_path / "ms.csv")
    files = (tmp_path / "s.csv", tmp_path / "ms.csv")
    outputs = ("--json", tmp_path / "gap.json", "--html", tmp_path / "gap.html")
    done = warm_vgroove("log", "compare", *files, *outputs)
    (warning,) = json.loads((tmp_path / "gap.json").read_text())["warnings"]
    assert "one of the time columns seems not to be in s" in warning
    assert (
        done.stdout.startswith("Only 2 rows take part")
        and "Only 2 rows take part" in (tmp_path / "gap.html").read_text()
    )
    text = files[1].read_text().replace("time_s", "Time", 1)
    files[1].write_text(text)
    mapped = warm_vgroove("log", "compare", *files, "--map", "Time:ms=time_s")
    assert mapped.stdout.startswith(f"{ROWS} rows of equal time"), mapped.stderr


def test_native_and_avr_runs_of_a_scenario_are_equal(tmp_path: Path) -> None:
    scenario = tmp_path / "short.toml"
    text = (ROOT / "scenarios/impact_hard_joint.toml").read_text()
    scenario.write_text(
        text.replace("../rigs", str(ROOT / "rigs")).replace("duration_s = 2.0", "duration_s = 0.7")
    )
    for on in ("sil", "avr"):
        done = warm_vgroove("run", scenario, "--on", on, "-o", tmp_path / f"{on}.csv")
        assert done.returncode == 0, done.stderr
    logs = (tmp_path / "sil.csv", tmp_path / "avr.csv")
    done = warm_vgroove(
        "log", "compare", *logs, "--require", "equal", "--html", tmp_path / "page.html"
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "equal bit for bit" in done.stdout
    assert "equal bit for bit" in (tmp_path / "page.html").read_text()


def test_the_command_writes_json_and_page_and_its_code_follows_require(tmp_path: Path) -> None:
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    time_s = board_times()
    write_csv(log_of(time_s), a)
    write_csv(log_of(time_s, time_s - 0.003), b)
    outputs = ("--json", tmp_path / "gap.json", "--html", tmp_path / "gap.html")
    done = warm_vgroove("log", "compare", a, b, *outputs, "--require", "explained")
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "gap.json").read_text())
    assert data["schema"] == "vgroove.log_compare/1"
    assert data["clock"]["offset_s"] == pytest.approx(0.003, abs=1e-5)
    assert data["columns"]["current_a"]["explanation"] == "timing"
    assert "3.000 ms later" in (tmp_path / "gap.html").read_text()
    assert warm_vgroove("log", "compare", a, b, "--require", "equal").returncode == 3
    cold = [*VGROOVE, "log", "compare", a, b]
    assert subprocess.run(cold, capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [(("--require", "same"), "equal or explained"), (("--max-shift", "-1"), "from 0 to 3600 s")],
)
def test_unusable_options_are_named(
    options: tuple[str, ...], sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    write_csv(log_of(board_times()), path)
    done = warm_vgroove("log", "compare", path, path, *options)
    assert done.returncode == 2
    assert sentence in done.stderr
