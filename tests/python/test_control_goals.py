"""The goals of the controllers' bench can be missed: a drive that fails is counted against its
goal, and draws, intervals and options are what they state.
"""

import sys
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vgroove.cli import main
from vgroove.control_bench import (
    blows,
    blows_drawn,
    bound,
    drill,
    screwing,
    screwing_drawn,
    sync_drawn,
    torque,
    torque_adapted,
    torque_drawn,
    vibration,
    vibration_drawn,
)
from vgroove.control_bench import control as bench
from vgroove.control_bench.draw import NOMINAL
from vgroove.control_bench.jobs import run_job
from vgroove.control_bench.runs import PULL_S
from vgroove.control_bench.screwing_drawn_page import screwing_drawn_report
from vgroove.control_bench.screwing_page import screwing_report
from vgroove.control_bench.sets import SEED_BASE, seed_of
from vgroove.control_bench.torque_drawn_page import torque_drawn_report
from vgroove.control_bench.vibration_drawn_page import vibration_drawn_report
from vgroove.result_files import Report

DRAWN = {
    "torque": torque_drawn.cells(1),
    "sync": sync_drawn.cells(),
    "blows": blows_drawn.cells(),
    "screwing": screwing_drawn.cells(),
    "vibration": vibration_drawn.cells(),
    "torque of other tools": torque_adapted.cells(1),
}


def seeds_of(cells: list[dict[str, Any]]) -> set[int]:
    return {cell["seed"] for cell in cells}


def test_no_two_parts_have_the_same_draws() -> None:
    for (one, cells), (other, more) in combinations(DRAWN.items(), 2):
        assert not seeds_of(cells) & seeds_of(more), f"{one} and {other}"


@pytest.mark.parametrize("draws", [1, 40, 200])
def test_no_two_draws_of_a_matrix_have_the_same_seed(draws: int) -> None:
    for cells in (
        torque.cells(draws),
        screwing.cells(draws),
        drill.clutch_cells(draws),
        drill.lock_cells(draws),
        drill.normal_cells(draws),
    ):
        assert len(seeds_of(cells)) == len(cells)


def test_a_seed_is_refused_for_a_number_that_would_repeat_another_seed() -> None:
    assert seed_of("tune", 10**6, 1) != seed_of("tune", 10**6 + 1, 0)
    for numbers in ((0, SEED_BASE), (-1, 0), (0, -1)):
        with pytest.raises(ValueError, match="numbers of a cell"):
            seed_of("tune", *numbers)


def test_the_bound_is_compared_with_the_uncontrolled_run_of_its_own_plant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bound, "SEARCH", replace(bound.SEARCH, evaluations=0))
    cell = next(c for c in vibration.cells() if c["load"] == "hard_joint")
    jobs = [*vibration.jobs([cell]), *bound.jobs([cell])]
    found = vibration.compare([run_job(job) for job in jobs], vibration.BOUND)
    assert found["not_reached"] == 0
    assert (found["change"], found["time"]) == (0.0, 0.0), "without a search both runs are the same"


def vibration_cell(seed: int, **values: Any) -> dict[str, Any]:
    """A drawn cell of low vibration with the nominal tool."""
    drive = {"supply_v": 16.7, "trigger": 0.72, "start_rad": -1.0, "slope": 100.0, "wood": 1.1}
    cell = {"set": "report", "stratum": NOMINAL, "kind": "m10", "tool": {}, "seed": seed}
    return {**cell, **drive, **values}


def vibration_rows(cells: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [run_job(job) for job in vibration_drawn.jobs(cells)]


def test_a_slow_screw_counts_in_low_vibration_and_a_joint_that_does_not_turn_is_told() -> None:
    still = {"kind": "disc_spring", "supply_v": 16.0, "trigger": 0.6}
    rows = vibration_rows([vibration_cell(1), vibration_cell(2, **still)])
    report = vibration_drawn_report(rows).data["vibration_drawn"]
    for found in report["summary"]:
        assert (found["cells"], found["without_aim"], found["judged"]) == (2, 1, 1)
        assert found["missed"] == 0 and found["change"] is not None


def test_a_run_that_misses_its_aim_misses_the_goal_of_low_vibration() -> None:
    rows = vibration_rows([vibration_cell(1)])
    for row in rows:
        if row["variant"] == "method 2":
            row.update(rms_nm=None, weighted_nm=None, impacting_nm=None, late_nm=None, time_s=None)
    report = vibration_drawn_report(rows)
    goals = {
        (goal["variant"], goal["goal"]): goal for goal in report.data["vibration_drawn"]["goals"]
    }
    missed = goals[f"method 2, {NOMINAL}", "cells above +5 % or that miss the aim"]
    assert (missed["value"], missed["met"]) == (1, False)
    assert not goals[f"method 2, {NOMINAL}", "time change, mean"]["met"]
    assert next(t for t in report.tables if t.name == "vibration_drawn_failed").rows


def torque_row(target_nm: float, error: float, reason: str = "reached") -> dict[str, Any]:
    where = {"set": "report", "stratum": NOMINAL, "tool": {}}
    return {**where, "target_nm": target_nm, "error": error, "reason": reason}


def test_a_target_without_two_reached_drives_misses_the_goal_and_is_shown() -> None:
    rows = [torque_row(50.0, 0.01), torque_row(50.0, 0.02)]
    rows += [torque_row(51.0, 0.0), torque_row(51.0, 0.2, "missed")]
    rows += [torque_row(52.0, -0.4, "missed"), torque_row(52.0, -0.5, "timeout")]
    report = torque_drawn_report(rows)
    goals = {goal["goal"]: goal for goal in report.data["torque_drawn"]["goals"]}
    assert goals["targets that miss a goal"]["value"] == 2
    assert goals["misses not reported"]["met"], "each miss is told as a miss"
    found = report.data["torque_drawn"]["summary"][0]
    assert (found["targets_not_reached"], found["targets_reached_once"]) == (1, 1)


def test_a_target_out_of_the_reach_of_the_tool_misses_the_goal() -> None:
    cell = next(c for c in DRAWN["torque"] if c["stratum"] == NOMINAL and c["set"] == "report")
    cells = [{**cell, "target_nm": 41.0, "slope": 700.0, "seed": seed} for seed in (1, 2)]
    rows = [run_job(job) for job in torque_drawn.jobs(cells)]
    assert not any(torque_drawn.reached(row) for row in rows)
    assert [target["met"] for target in torque_drawn.target_figures(rows)] == [False]


def test_the_standard_deviation_is_that_of_a_sample() -> None:
    rows = [torque_row(50.0, -0.025), torque_row(50.0, 0.025)]
    target = torque_drawn.target_figures(rows)[0]
    assert target["std"] == pytest.approx(0.025 * 2**0.5) and not target["met"]
    assert torque_drawn.compare(rows)["std"] == target["std"]


def tool_rows(tools: int, drives: int, error: float) -> list[dict[str, Any]]:
    """Drives of tools, the first of which is off by `error` in each drive."""
    return [
        {**torque_row(50.0 + drive, error if tool == 0 else 0.0), "tool": {"spring": 1.0 + tool}}
        for tool in range(tools)
        for drive in range(drives)
    ]


def test_intervals_over_tools_do_not_narrow_with_the_drives_of_each_tool() -> None:
    few, many = (torque_drawn.compare(tool_rows(18, drives, 0.2)) for drives in (1, 9))
    assert (many["missed_reported_reached"], many["units"], many["units_failed"]) == (9, 18, 1)
    for key in ("missed_reported_reached", "mean_error"):
        for side in ("low", "high"):
            assert many[f"{key}_{side}"] == pytest.approx(few[f"{key}_{side}"])
    assert many["missed_reported_reached_high"] > 0.25


def test_each_drive_of_the_nominal_tool_counts_in_the_intervals() -> None:
    found = torque_drawn.compare([torque_row(50.0, 0.0) for _ in range(162)])
    assert (found["units"], found["units_failed"]) == (162, 0)
    assert found["missed_reported_reached_high"] < 0.03


def test_the_drives_of_an_adapted_tool_are_one_unit() -> None:
    cells = [c for c in DRAWN["torque of other tools"] if c["set"] == "report"]
    sizes = {
        stratum: len(torque_drawn.units([c for c in cells if c["stratum"] == stratum]))
        for stratum in torque_adapted.STRATA
    }
    assert sizes[torque_adapted.ADAPTED] == sizes[torque_adapted.UNADAPTED] == torque_adapted.TOOLS
    assert sizes[NOMINAL] == len(torque_drawn.TARGETS_NM)


def screw_rows(screws: int, **changes: Any) -> list[dict[str, Any]]:
    """Screws of the same size with and without control; changes: of the figures of a controlled
    one.
    """
    cell = {"set": "report", "stratum": NOMINAL, "size": "m10", "wood": 0.9, "knot": False}
    drive = {"supply_v": 16.5, "trigger": 0.6, "start_rad": -1.0, "reason": 0, "faults": 0}
    done = {"rate_per_s": 40.0, "past_deg": 30.0, "blow_deg": 10.0, "seat_s": 2.0}
    row = {**cell, **drive, **done, "stripped": False, "early": False, "never": False}
    found = []
    for seed in range(screws):
        found.append({**row, "seed": seed, "variant": "without"})
        found.append({**row, "seed": seed, "variant": "screwing", **(changes if not seed else {})})
    return found


NOT_SEATED = {"past_deg": -400.0, "seat_s": None, "never": True}


@pytest.mark.parametrize(
    ("name", "report"), [("screwing", screwing_report), ("screwing_drawn", screwing_drawn_report)]
)
def test_a_screw_that_is_never_seated_misses_the_goals(name: str, report: Any) -> None:
    goals = {
        key: {goal["goal"]: goal for goal in report(rows).data[name]["goals"]}
        for key, rows in (("all", screw_rows(4)), ("never", screw_rows(4, **NOT_SEATED)))
    }
    seated, time = "screws not seated within the time", "time to seat with / without, mean"
    assert goals["all"][seated]["met"] and goals["all"][time]["value"] == 1.0
    assert (goals["never"][seated]["value"], goals["never"][seated]["met"]) == (1, False)
    assert not goals["never"][time]["met"]
    assert goals["never"][time]["value"] == pytest.approx((3 + screwing.LONGEST_S / 2.0) / 4)


def test_a_screw_that_is_never_seated_is_shown() -> None:
    report = screwing_drawn_report(screw_rows(4, **NOT_SEATED))
    failed = next(table for table in report.tables if table.name == "screwing_drawn_failed")
    assert len(failed.rows) == 1


def test_a_screw_beyond_the_power_of_the_tool_is_never_seated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(screwing, "MAX_SECONDS", 3.0)
    rig = screwing.screw("m10", 16.0, 1.25, False, 5)
    found = screwing.drive(screwing.VARIANTS[1], rig, 0.5, 5)
    assert found["never"] and found["seat_s"] is None and not found["early"]


def counted_run(struck_s: list[float], counted_s: list[float]) -> Any:
    """A drive with the plant's blows and the times at which the board counts one more."""
    held_ms = np.round(1e3 * np.array(counted_s)).astype(int)
    control = {
        "time_s": (held_ms + 11) / 1e3,
        "control_tick": held_ms % blows.TICKS_OF_BYTE,
        "blow_count": np.arange(1, len(counted_s) + 1),
    }
    hits = np.zeros(len(struck_s), [("time_s", "f8"), ("kind", "i8")])
    hits["time_s"] = struck_s
    driven_s = np.arange(PULL_S, blows.RELEASE_S + 0.025, 1e-3)
    rows = {"time_s": driven_s, "coast": np.zeros(len(driven_s))}
    found = {"control": control, "hits": hits, "struck_s": hits["time_s"], "telemetry": rows}
    return SimpleNamespace(**found, reported=np.zeros((0, 6)), faults=0)


STRUCK_S = [blows.RELEASE_S + 0.01 - 0.02 * n for n in range(60, -1, -1)]  # the last in the ramp


def test_a_blow_that_the_board_could_not_have_counted_before_the_release_is_no_error() -> None:
    counted = [time_s + 0.005 for time_s in STRUCK_S]
    for uncounted in (0, 1, 2):
        run = counted_run(STRUCK_S, counted[: len(counted) - uncounted])
        assert blows.count_figures(run)["error"] == 0, "in the ramp, or just before it"


def test_a_blow_that_is_lost_before_the_release_is_an_error() -> None:
    counted = [time_s + 0.005 for time_s in STRUCK_S]
    lost = counted[:30] + counted[31:]
    found = blows.count_figures(counted_run(STRUCK_S, lost))
    assert (found["error"], found["blows"]) == (-1, len(STRUCK_S) - 2)
    assert blows.count_figures(counted_run(STRUCK_S, counted[:-3]))["error"] == -1
    twice = sorted([*counted, 1.9])
    assert blows.count_figures(counted_run(STRUCK_S, twice))["error"] == 1


def test_the_last_blow_of_a_drawn_drive_is_not_lost_at_the_release() -> None:
    wood = {"kind": blows_drawn.WOOD, "size": "m8", "wood": 1.189, "supply_v": 20.402}
    slip = {"kind": blows_drawn.SLIP, "slip_nm": 66.464, "supply_v": 17.074}
    drives = [
        {**wood, "trigger": 0.994, "start_rad": -2.053, "seed": 1263111031},
        {**slip, "trigger": 0.984, "start_rad": -0.328, "seed": 698287558},
    ]
    found = [blows_drawn.work(blows.VARIANTS[0], tool={}, **drive) for drive in drives]
    assert [(row["error"], row["blows"] > 100) for row in found] == [(0, True), (0, True)]


class Asked(bench.Choice):
    """A choice that tells the number of cells that a part offers instead of choosing among them."""

    def of(self, cells: Any) -> Any:
        raise StopIteration(len(cells))


def cells_of(part: str, draws: int) -> int:
    with pytest.raises(StopIteration) as asked:
        bench.PARTS[part](Asked(draws=draws))
    return asked.value.value


@pytest.mark.parametrize("part", list(bench.PARTS))
def test_draws_act_on_every_part_whose_cells_are_not_fixed(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "rows_of", lambda *_: [{"map": []}])
    one, two = cells_of(part, 1), cells_of(part, 2)
    assert two == one if part in bench.FIXED_PARTS else two > one


@pytest.mark.parametrize("part", ["blows", "sync", "vibration"])
def test_draws_are_refused_for_a_part_with_fixed_cells(
    part: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--part", part, "--part", "torque_drawn", "--draws", "2", "--fifth"]
    monkeypatch.setattr(sys, "argv", ["vgroove", "bench", "control", *options])
    monkeypatch.setattr(bench, "control_bench", lambda *_: pytest.fail("it ran"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    told = " ".join(capsys.readouterr().err.split())
    assert f"--draws: the cells of {part} are fixed, without random draws" in told


def test_draws_of_all_parts_tell_which_cells_are_fixed(monkeypatch: pytest.MonkeyPatch) -> None:
    empty = Report("control", "Controllers", ["A finding."], [], [], {})
    monkeypatch.setattr(bench, "PARTS", {name: lambda _: empty for name in ("sync", "torque")})
    lines = {
        n: bench.control_bench(["sync", "torque"], bench.Choice(draws=n)).lines for n in (1, 2)
    }
    assert lines[2] == ["--draws: the cells of sync are fixed, without random draws.", *lines[1]]
