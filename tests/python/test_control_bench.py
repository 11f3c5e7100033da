"""The controllers' bench computes the measures of docs/control_bench.md, and the controllers hold
limits on a fifth of its cells.
"""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import plotly.graph_objects as go
import pytest
from scipy import signal

from vgroove.control_bench import (
    avr,
    blows,
    blows_drawn,
    bound,
    draw,
    drill,
    scores,
    screwing,
    screwing_drawn,
    sync,
    sync_drawn,
    torque,
    torque_drawn,
    vibration,
    vibration_drawn,
)
from vgroove.control_bench.control import PARTS, Choice
from vgroove.control_bench.figures import WAVES, image_path
from vgroove.control_bench.goals import Goal
from vgroove.control_bench.jobs import PLAIN, Job, Variant, run_job, run_jobs
from vgroove.control_bench.runs import PULL_S, Run, RunPlan, pull, reference, run_plan, sil_run
from vgroove.control_bench.waves import POINTS, range_of, wave_picture
from vgroove.eeprom_image import AbsentError, eeprom_image, parameter
from vgroove.errors import VgrooveError
from vgroove.html_page import thin
from vgroove.lockstep import Profile
from vgroove.reference.joints import REFERENCE_JOINTS

ROOT = Path(__file__).resolve().parents[2]
BLOW = [
    (name, "f8")
    for name in ("time_s", "approach_rad_s", "engaged_m", "impulse_nm_s", "peak_torque_nm")
]
BLOW += [(name, "i8") for name in ("kind", "lug", "skipped")]


def struck(times: list[float], **changes: dict[int, Any]) -> np.ndarray:
    """Blows at these times with the whole lug engaged; changes: column -> {index: value}."""
    hits = np.zeros(len(times), BLOW)
    hits["time_s"], hits["engaged_m"] = times, 4.5e-3
    for column, values in changes.items():
        for at, value in values.items():
            hits[column][at] = value
    return hits


def run_of(hits: np.ndarray, rig: Any, truth: np.ndarray | None = None) -> Run:
    return Run(
        rig, SimpleNamespace(), b"", float(hits["time_s"][-1]) if len(hits) else 1.0, hits, truth
    )


def clean_of(hits: np.ndarray) -> float:
    """Share of clean blows by the bench's measure."""
    height = reference().mechanism["lug_height_m"]
    return float(scores.clean(hits[hits["kind"] < 2], height).mean())


def test_clean_blows_are_those_of_the_definition() -> None:
    regular = [0.02 * k for k in range(10)]
    assert clean_of(struck(regular)) == 1.0
    assert clean_of(struck(regular, skipped={4: 1})) == 0.9
    assert clean_of(struck(regular, engaged_m={4: 2.24e-3})) == 0.9
    assert clean_of(struck(regular, engaged_m={4: 2.26e-3})) == 1.0
    # a repeat
    assert clean_of(struck([*regular[:5], 0.089, *regular[5:]], kind={5: 1})) == pytest.approx(
        10 / 11
    )
    # a rebound belongs to its blow
    assert clean_of(struck([*regular[:5], 0.0805, *regular[5:]], kind={5: 2})) == 1.0
    late = [*regular[:9], 0.16 + 0.02 * 1.11]
    assert (
        clean_of(struck(late)) == 0.9
        and clean_of(struck([*regular[:9], 0.16 + 0.02 * 1.09])) == 1.0
    )


def test_halves_share_no_pair_and_no_seed() -> None:
    for cells in (
        sync.cells(),
        blows.cells(),
        vibration.cells(),
        screwing.cells(2),
        torque.cells(3),
        drill.cells(),
    ):
        seeds = {
            half: {c["seed"] for c in cells if c["set"] == half} for half in ("tune", "report")
        }
        assert seeds["tune"] and seeds["report"] and not seeds["tune"] & seeds["report"]
    pairs = {
        half: {(c["supply_v"], c["load"]) for c in sync.cells() if c["set"] == half}
        for half in ("tune", "report")
    }
    assert len(sync.cells()) == 72 and not pairs["tune"] & pairs["report"]
    assert len(Choice(only_fifth=True).of(sync.cells())) == 15


def test_drawn_cells_lie_in_their_ranges_and_are_stratified() -> None:
    cells = torque_drawn.cells(2)
    for half in ("tune", "report"):
        for stratum in draw.STRATA:
            here = [c for c in cells if (c["set"], c["stratum"]) == (half, stratum)]
            targets = [c["target_nm"] for c in here]
            assert sorted(targets) == sorted(2 * list(map(float, torque_drawn.TARGETS_NM)))
            for name, span in {**draw.DRIVE, **torque_drawn.SPANS}.items():
                values = np.array([c[name] for c in here])
                assert span.low <= values.min() and values.max() <= span.high, name
            supplies = np.array([c["supply_v"] for c in here])
            places = (supplies - 16.0) / 4.5 * len(here)
            assert sorted(places.astype(int)) == list(range(len(here)))


def test_drawn_tools_are_nominal_or_off_in_every_value() -> None:
    cells = torque_drawn.cells(1)
    assert all(not c["tool"] for c in cells if c["stratum"] == draw.NOMINAL)
    off = [c["tool"] for c in cells if c["stratum"] == draw.OFF]
    for name in draw.TOOL_VALUES:
        shares = np.array([tool[name] for tool in off])
        assert 0.95 <= shares.min() < 0.952 and 1.048 < shares.max() <= 1.05, name
    cell = next(c for c in cells if c["stratum"] == draw.OFF)
    rig = torque_drawn.joint(cell)
    for name in draw.TOOL_VALUES:
        assert rig.value(name) == pytest.approx(reference().value(name) * cell["tool"][name])
    assert rig.value("supply.voltage_v") == cell["supply_v"]
    assert rig.value("mechanism.hammer_start_rad") == cell["start_rad"]


def test_the_halves_of_drawn_cells_share_no_value() -> None:
    cells = torque_drawn.cells(2)
    for name in ("seed", "supply_v", "slope", "start_rad"):
        halves = [{c[name] for c in cells if c["set"] == half} for half in ("tune", "report")]
        assert not halves[0] & halves[1]
        assert len(halves[0]) + len(halves[1]) == len(cells)


def test_the_same_seed_draws_the_same_bytes() -> None:
    first, second = (json.dumps(torque_drawn.cells(2)).encode() for _ in range(2))
    assert first == second
    cell = torque_drawn.cells(1)[0]
    runs = [
        sil_run(torque_drawn.joint(cell), profile=pull(cell["trigger"]), seed=cell["seed"])
        for _ in range(2)
    ]
    assert runs[0].sent == runs[1].sent


def drawn_row(target_nm: float, error: float, reason: str = "reached") -> dict[str, Any]:
    return {"target_nm": target_nm, "error": error, "reason": reason}


def test_drawn_torque_is_judged_at_each_target() -> None:
    rows = [drawn_row(50.0, 0.01), drawn_row(50.0, 0.02), drawn_row(51.0, 0.04)]
    rows += [drawn_row(52.0, 0.0), drawn_row(52.0, -0.07), drawn_row(53.0, 0.2, "missed")]
    rows += [drawn_row(54.0, 0.0, "missed")]
    targets = {t["target_nm"]: t for t in torque_drawn.target_figures(rows)}
    assert [targets[nm]["met"] for nm in (50.0, 51.0, 52.0, 53.0)] == [True, False, False, False]
    found = torque_drawn.compare(rows)
    assert (found["runs"], found["reached"], found["missed_reported_reached"]) == (7, 5, 1)
    assert (found["worst"], found["beyond_goal"], found["false_alarms"]) == (-0.07, 2, 1)
    assert found["missed_reported_reached_low"] < 1 / 7 < found["missed_reported_reached_high"]


def drawn_sync_row(seed: int, variant: str, clean: float, spread: float | None) -> dict[str, Any]:
    early = {"clean": clean, "spread": spread}
    return {"seed": seed, "variant": variant, **early, "steady_clean": 1.0, "steady_spread": 0.01}


def test_a_motion_of_period_two_is_not_in_step() -> None:
    assert sync_drawn.in_step(drawn_sync_row(1, "method 1", 1.0, 0.012))
    assert not sync_drawn.in_step(drawn_sync_row(1, "method 1", 1.0, 0.078))
    assert not sync_drawn.in_step(drawn_sync_row(1, "method 1", 0.96, 0.002))
    silent = drawn_sync_row(1, "method 1", 0.0, None)
    assert not sync_drawn.in_step(silent)
    assert sync_drawn.in_step(silent, "steady_")


def test_drawn_synchronisation_is_judged_in_each_cell() -> None:
    rows = [drawn_sync_row(n, "without", 0.9, 0.05) for n in range(3)]
    rows += [drawn_sync_row(0, "method 1", 1.0, 0.01), drawn_sync_row(1, "method 1", 1.0, 0.078)]
    rows += [drawn_sync_row(2, "method 1", 0.5, 0.2)]
    found = sync_drawn.compare(rows, "method 1")
    assert (found["cells"], found["out_of_step"], found["worse"]) == (3, 2, 1)
    assert (found["clean_worst"], found["spread_worst"]) == (0.5, 0.2)
    assert found["worst_change"] == pytest.approx(-0.4)
    assert (found["steady_out_of_step"], found["steady_clean_worst"]) == (0, 1.0)
    seeds = {
        half: {c["seed"] for c in sync_drawn.cells(4) if c["set"] == half}
        for half in ("tune", "report")
    }
    assert not seeds["tune"] & seeds["report"]


def drawn_blows_row(error: int, blows_per_min: float = 2400.0) -> dict[str, Any]:
    repeats = {"repeats": 10, "repeats_reported": 8, "repeats_right": 6}
    return {"blows": 100, "error": error, "blows_per_min": blows_per_min, **repeats}


def test_drawn_blow_counts_are_judged_in_each_cell() -> None:
    rows = [drawn_blows_row(error) for error in (0, 1, -1, 2, -20)]
    found = blows_drawn.compare([*rows, drawn_blows_row(50, blows_per_min=900.0)])
    assert (found["cells"], found["failures"], found["worst"]) == (5, 2, 0.2)
    assert found["failures_low"] < 0.4 < found["failures_high"]
    assert (found["precision"], found["recall"]) == (0.75, 0.6)


def test_the_joints_of_drawn_blow_counts_are_those_of_the_table() -> None:
    cells = blows_drawn.cells(20)
    assert {cell["kind"] for cell in cells} == {"slip", "hard joint", "wood"}
    assert {cell["size"] for cell in cells} == {"m6", "m8", "m10"}
    for cell in cells:
        load = blows_drawn.rig_of(cell).load
        if cell["kind"] == "slip":
            assert load["run_torque_nm"] == cell["slip_nm"]
        elif cell["kind"] == "hard joint":
            assert load["slip_slope_nm_per_rad"] == cell["slope"]
        else:
            nominal = REFERENCE_JOINTS[cell["size"]].load["end_nm"]
            assert load["end_nm"] == pytest.approx(cell["wood"] * nominal)


def screw_row(seed: int, variant: str, **figures: Any) -> dict[str, Any]:
    cell = {"size": "m6", "supply_v": 17.0 + seed, "wood": 1.1, "trigger": 0.9, "knot": False}
    done = {"rate_per_s": 40.0, "past_deg": 30.0, "blow_deg": 10.0, "seat_s": 2.0}
    ends = {"stripped": False, "early": False, "never": False}
    return {"seed": seed, "variant": variant, **cell, **done, **ends, **figures}


def test_drawn_screws_are_compared_pair_by_pair() -> None:
    rows = [screw_row(n, "without") for n in range(3)]
    rows += [screw_row(0, "screwing", rate_per_s=20.0, seat_s=4.0)]
    rows += [screw_row(1, "screwing", rate_per_s=30.0, seat_s=6.0, stripped=True, past_deg=95.0)]
    rows += [screw_row(2, "screwing", rate_per_s=25.0, seat_s=5.0, early=True, past_deg=-90.0)]
    found = screwing_drawn.compare(rows, "screwing")
    assert found["rate_change_soft"] == pytest.approx(-0.375)
    assert found["rate_low"] < -0.375 < found["rate_high"]
    assert (found["stripped"], found["early"]) == (1, 1)
    assert found["stripped_low"] < 1 / 3 < found["stripped_high"]
    assert found["time_ratio"] == pytest.approx(2.5)
    assert found["time_group"] == pytest.approx(3.0), "the mean of 17.5 to 19 V"


def test_drawn_screws_have_every_size_with_and_without_knot() -> None:
    cells = screwing_drawn.cells(12)
    assert {(c["size"], c["knot"]) for c in cells} == {
        (size, knot) for size in screwing.SIZES for knot in (False, True)
    }
    knots = [c for c in cells if c["knot"]]
    assert all("wood_knot" in screwing_drawn.rig_of(c).effects for c in knots[:4])


def vibration_row(seed: int, variant: str, rms_nm: float | None, volt: float) -> dict[str, Any]:
    cell = {"seed": seed, "variant": variant, "supply_v": volt, "trigger": 1.0}
    time_s = None if rms_nm is None else 0.5
    return {**cell, "aim_rad": 1.0, "rms_nm": rms_nm, "late_nm": rms_nm, "time_s": time_s}


def test_drawn_vibration_is_judged_in_each_cell() -> None:
    rows = [vibration_row(n, "without", 1.0, 15.0 + n) for n in range(4)]
    after = (1.2, 0.8, 0.6, None)
    rows += [vibration_row(n, "method 1", rms, 15.0 + n) for n, rms in enumerate(after)]
    found = vibration_drawn.compare(rows, "method 1")
    assert (found["cells"], found["judged"], found["missed"], found["above"]) == (4, 4, 1, 2)
    assert found["change"] == pytest.approx(-0.4 / 3)
    assert found["worst"] == pytest.approx(0.2)
    assert found["above_low"] < 1 / 2 < found["above_high"]
    assert found["time_most"] == pytest.approx(vibration_drawn.LONGEST_S / 0.5 - 1.0)
    assert (found["full_cells"], found["full_change"]) == (2, pytest.approx(-0.3))


def test_the_joints_of_drawn_vibration_are_those_of_the_table() -> None:
    cells = vibration_drawn.cells(10)
    assert {cell["kind"] for cell in cells} == set(vibration_drawn.KINDS)
    for cell in cells:
        load = vibration_drawn.rig_of(cell).load
        if cell["kind"] == "hard_joint":
            assert load["slip_slope_nm_per_rad"] == cell["slope"]
        elif cell["kind"] != "disc_spring":
            nominal = REFERENCE_JOINTS[cell["kind"]].load["seat_nm"]
            assert load["seat_nm"] == pytest.approx(cell["wood"] * nominal)


def housing_run(wave: Any, seconds: float = 3.0) -> Run:
    time_s = np.arange(1, round(seconds * 32000) + 1) / 32000
    rows = np.zeros((len(time_s), 8))
    rows[:, 0], rows[:, 6] = time_s, wave(time_s)
    return run_of(struck([0.1]), reference(), rows)


@pytest.mark.parametrize(("hz", "gain"), [(2.0, 0.0), (50.0, 1.0), (300.0, 1.0), (4000.0, 0.0)])
def test_vibration_is_the_rms_in_the_band(hz: float, gain: float) -> None:
    found = scores.vibration(
        housing_run(lambda t: 5.0 + np.sqrt(2.0) * np.sin(2 * np.pi * hz * t)), 1.0, 3.0
    )
    assert found["rms_nm"] == pytest.approx(gain, abs=0.02)


WEIGHTS = [
    (6.3, 0.727),
    (8.0, 0.873),
    (16.0, 0.896),
    (31.5, 0.519),
    (63.0, 0.258),
    (125.0, 0.127),
    (500.0, 0.0314),
]


@pytest.mark.parametrize(("hz", "weight"), WEIGHTS)
def test_weighting_is_that_of_iso_5349(hz: float, weight: float) -> None:
    # ISO 5349-1, table A.2
    _, response = signal.sosfreqz(scores.hand_arm_filter(), [hz], fs=scores.HOUSING_HZ)
    assert abs(response[0]) == pytest.approx(weight, rel=0.02)


def test_ripple_does_not_depend_on_earlier_samples() -> None:
    run = housing_run(
        lambda t: np.where(t < 1.0, 0.0, 6.0 + np.sqrt(2.0) * np.sin(2 * np.pi * 100 * t))
    )
    assert scores.ripple(run, 1.0005, 3.0) == pytest.approx(1.0, abs=0.03)
    assert scores.vibration(run, 1.0005, 1.5)["rms_nm"] > 1.2  # with the jump


def test_work_is_the_integral_of_the_slip_torque() -> None:
    rows = np.zeros((3, 8))
    rows[:, 0], rows[:, 4] = (0.0, 0.5, 1.0), (0.0, 0.1, 0.3)
    run = run_of(struck([0.1]), reference("hard_joint"), rows)
    assert scores.tightening_work(run, 0.5, 1.0) == pytest.approx(0.2 * (0.3 + 700 * 0.2))
    assert scores.tightening_work(run_of(struck([0.1]), reference("locked"), rows), 0.5, 1.0) == 0.0


def test_a_goal_is_met_up_to_its_limit() -> None:
    assert Goal("m", "all", "x", 0.5, 0.5).met and not Goal("m", "all", "x", 0.51, 0.5).met
    assert (
        Goal("m", "all", "x", 0.97, 0.97, at_most=False).met
        and not Goal("m", "all", "x", 0.96, 0.97, at_most=False).met
    )
    assert not Goal("m", "all", "x", None, 0.5).met


def test_parameters_go_into_the_eeprom() -> None:
    run = sil_run(reference(), params={"FOLDBACK_A": 20.5, "stall_ms": 400}, duration_s=0.8)
    values = run.session.parameters
    names = [
        entry.name for entry in __import__("vgroove.telemetry", fromlist=["x"]).parameter_list()
    ]
    assert run.session.table["table_status"] == 0
    assert (
        values[names.index("foldback_a_q9")] == 20.5 * 512
        and values[names.index("stall_ms")] == 400
    )
    assert run.faults == 0 and len(run.hits) > 5 and run.truth_rows is None
    with pytest.raises(VgrooveError, match="stall_ms is 50 to 5000"):
        eeprom_image({"stall_ms": 20})
    with pytest.raises(AbsentError):
        parameter("no_such")
    with pytest.raises(AbsentError, match="has no mode polish"):
        sil_run(reference(), mode="polish")


def test_other_tools_scatter_by_a_tenth_and_the_reference_tool_does_not() -> None:
    nominal = sync.CellTool(18.5, "locked", None).rig()
    drawn = [sync.CellTool(18.5, "locked", seed).rig() for seed in range(60)]
    for name in sync.TOOL_PARAMETERS:
        shares = [rig.value(name) / nominal.value(name) for rig in drawn]
        assert 0.9 <= min(shares) < 0.93 and 1.07 < max(shares) <= 1.1
    again = sync.CellTool(18.5, "locked", 5).rig()
    assert drawn[5].value("motor.resistance_ohm") == again.value("motor.resistance_ohm")
    assert all("tool" not in cell for cell in sync.cells()) and all(
        cell["tool"] == cell["seed"] for cell in sync.other_cells()
    )


def test_a_cell_that_is_not_clean_has_a_reason() -> None:
    cell = {
        "set": "tune",
        "supply_v": 16.0,
        "load": "slip_60",
        "trigger": 0.6,
        "seed": 3,
        "tool": None,
    }
    rows = [
        {**cell, "variant": "method 1", "clean": 0.96, "duty": 1.0},
        {**cell, "variant": "method 2", "clean": 0.97, "duty": 1.0},
    ]
    assert [row["variant"] for row in sync.unclean(rows)] == ["method 1"] and len(
        sync.search_jobs(rows)
    ) == 1
    for best, duty, words in (
        (0.9, 1.0, "no constant duty"),
        (0.98, 1.0, "full duty"),
        (0.98, 0.9, "the controller's"),
    ):
        searched = [
            {**cell, "tool": 4, "best_clean": 1.0, "best_duty": 0.5},
            {**cell, "best_clean": best, "best_duty": 0.8},
        ]
        assert sync.with_reason({**rows[0], "duty": duty}, searched)["reason"].startswith(words)


def test_the_search_finds_a_duty_that_is_clean_where_the_trigger_is_not() -> None:
    cell = {"supply_v": 18.5, "load": "slip_60", "seed": 3}
    assert sync.work(PLAIN, trigger=0.725, **cell)["clean"] < 0.97
    found = sync.search_work(PLAIN, tool=None, **cell)
    assert (
        found["best_clean"] >= 0.97
        and sync.work(PLAIN, trigger=found["best_duty"], **cell)["clean"] == found["best_clean"]
    )


def test_an_absent_controller_is_reported_not_run() -> None:
    row = run_job(Job(sync.work, Variant("method 9", "polish"), sync.cells()[0]))
    assert (
        row["variant"] == "method 9"
        and "has no mode polish" in row["absent"]
        and "clean" not in row
    )


def test_the_operator_releases_the_trigger_after_the_seat() -> None:
    run = screwing.plain_run(screwing.screw("m6", 18.5, 0.75, False, 3), 1.0, 3)
    seated = screwing.passing_s(run, run.seat_rad)
    closed = run.truth["time_s"][~np.isnan(run.truth["duty"])]
    assert closed[-1] - seated == pytest.approx(screwing.RELEASE_S, abs=0.03)
    figures = screwing.screw_figures(run)
    assert (
        not figures["early"]
        and figures["past_deg"] > 0
        and figures["seat_s"] == pytest.approx(seated - PULL_S)
    )


def test_screws_scatter_by_their_limits() -> None:
    rigs = [screwing.screw("m8", 18.5, 1.25, True, seed) for seed in range(200)]
    starts = np.array([rig.load["start_nm"] for rig in rigs]) / (0.9 * 1.25)
    assert starts.mean() == pytest.approx(1.0, abs=0.04) and starts.std() == pytest.approx(
        0.15, abs=0.03
    )
    assert {rig.load["seat_nm"] for rig in rigs} == {22 * 1.25}
    assert all(
        0 < rig.effects["wood_knot"]["from_rad"] < 2 * np.pi * (26 - rig.load["from_turns"])
        for rig in rigs
    )


def test_joints_scatter_by_a_tenth() -> None:
    rigs = [torque.joint(240.0, seed) for seed in range(100)]
    for values, middle in (
        ([r.load["slip_slope_nm_per_rad"] for r in rigs], 240.0),
        ([r.supply["voltage_v"] for r in rigs], 18.5),
        ([r.motor["resistance_ohm"] for r in rigs], 0.19),
    ):
        share = np.array(values) / middle
        assert 0.9 <= share.min() < 0.92 and 1.08 < share.max() <= 1.1


def test_the_map_names_blow_and_step() -> None:
    found = {
        "slope": 120.0,
        "time_s": np.array([0.1, 0.12, 0.14]),
        "torque_nm": np.array([30.0, 50.0, 52.0]),
    }
    rows = {target: torque.map_row(found, target) for target in (40.0, 51.0, 60.0)}
    assert (rows[40.0]["blow"], rows[40.0]["kind"]) == (2, "too fast") and rows[40.0][
        "step"
    ] == pytest.approx(0.5)
    assert (rows[51.0]["blow"], rows[51.0]["kind"]) == (3, "in reach")
    assert (rows[60.0]["blow"], rows[60.0]["kind"]) == (None, "out of reach")


def test_a_target_reported_as_missed_is_no_error() -> None:
    cell = {"target_nm": 100.0, "slope": 60.0, "variant": "torque", "seed": 1}
    rows = [{**cell, "torque_nm": t, "reason": "reached"} for t in (98.0, 102.0)] + [
        {**cell, "torque_nm": 70.0, "reason": "missed"}
    ]
    found = torque.cell_figures(rows, 100.0, 60.0, "torque")
    assert (found["refused_or_missed"], found["mean_error"]) == (1, pytest.approx(0.0)) and found[
        "std"
    ] == pytest.approx(0.02 * 2**0.5)


def test_the_plain_shape_is_the_uncontrolled_tool() -> None:
    rig, aim = reference("hard_joint", supply_v=18.5), 0.1
    plain = bound.shaped_figures(bound.Task(rig, aim, 1), bound.START)
    board = sil_run(rig, duration_s=PULL_S + 0.6, truth_every=1, profile=pull(), noise=False)
    assert plain["rms_nm"] == pytest.approx(vibration.run_figures(board, aim)["rms_nm"], rel=0.25)


def texts_of(figure: go.Figure) -> set[str]:
    """Titles and annotations of a figure."""
    axes = [axis.title.text for axis in (*figure.select_xaxes(), *figure.select_yaxes())]
    return {
        " ".join(text.split())
        for text in [*axes, *(note.text for note in figure.layout.annotations)]
        if text
    }


@pytest.mark.parametrize("part", list(WAVES))
def test_the_command_makes_the_figures_of_the_pages(part: str) -> None:
    wave = WAVES[part]()
    figure = wave_picture(wave).figure
    shown = ElementTree.fromstring(
        image_path(ROOT / "docs" / "images", wave).read_text(encoding="utf-8")
    )
    texts = {
        " ".join("".join(e.itertext()).split()) for e in shown.iter() if e.tag.endswith("text")
    }
    assert texts_of(figure) <= texts, (
        f"make it again: vgroove bench figures docs/images --part {part}"
    )
    curves = [trace for trace in figure.data if trace.mode == "lines"]
    drawn = [e.get("d", "") for e in shown.iter() if e.get("class") == "js-line"]
    # a gap makes two lines of one
    assert len([d for d in drawn if d]) >= len(curves) == len(wave.drives) * len(wave.panels)
    assert min(len(np.unique(curve.y)) for curve in curves) > 1


def test_a_figures_curve_keeps_its_peak() -> None:
    time = np.linspace(0.0, 1.0, 20_001)
    value = np.where(np.arange(len(time)) == 7777, 5.0, np.sin(time))
    assert max(thin(time, value, points=POINTS)[1]) == 5.0
    assert range_of([0.2, 1.0]) == (0.0, pytest.approx(1.064)) and range_of([900.0, 1000.0])[
        0
    ] == pytest.approx(892.0)


def reported_blows(times_s: list[float], repeats: int = 0, lugs: int = 1) -> np.ndarray:
    """Rows of Run.reported with a running period of 25 ms."""
    return np.array([(t, lugs, repeats, 0.025, 0.025, 0.02) for t in times_s])


def test_repeats_are_compared_from_blow_to_blow() -> None:
    blows_s = np.array([1.0, 1.025, 1.05])
    reported = reported_blows([1.01, 1.03, 1.06], repeats=1)
    again = np.array([1.012, 1.04, 1.045])
    assert blows.repeat_figures(reported, blows_s, again) == {
        "repeats": 3,
        "repeats_reported": 3,
        "repeats_right": 2,
    }
    # of each lug
    one = blows.repeat_figures(reported_blows([1.01], 1, 2), blows_s, again)
    assert one["repeats_reported"] == 2
    assert blows.repeat_figures(reported, blows_s, np.zeros(0))["repeats_right"] == 0
    row = {"repeats": 100, "repeats_reported": 100, "repeats_right": 90}
    assert blows.repeats_right(row) and not blows.repeats_right({**row, "repeats_right": 89})
    assert not blows.repeats_right({**row, "repeats_reported": 106}) and blows.repeats_right(
        {**row, "repeats_reported": 105}
    )
    few = blows.FEW_REPEATS
    assert blows.repeats_right({"repeats": few, "repeats_reported": few, "repeats_right": 0})
    assert not blows.repeats_right(
        {"repeats": few + 1, "repeats_reported": few, "repeats_right": few // 2}
    )


def test_periods_are_compared_after_the_settling() -> None:
    times = list(np.arange(0.3, 2.0, 0.025))
    found = blows.period_figures(reported_blows(times), np.array(times))
    assert found["period_error"] == pytest.approx(0.0, abs=1e-9) and found[
        "spread"
    ] == pytest.approx(0.0, abs=1e-9)
    assert found["spread_reported"] == pytest.approx(0.02)
    assert blows.period_figures(reported_blows(times), 1.02 * np.array(times))[
        "period_error"
    ] == pytest.approx(1 - 1 / 1.02)
    assert blows.period_figures(reported_blows(times[:20]), np.array(times))["period_error"] is None


def test_workers_give_what_one_process_gives() -> None:
    jobs = sync.jobs(sync.cells()[:3], [PLAIN])
    assert run_jobs(jobs, lambda words: None, "", workers=2) == run_jobs(
        jobs, lambda words: None, "", workers=1
    )


def test_kept_figures_are_read_for_the_same_cells_only(tmp_path: Any) -> None:
    done: list[int] = []

    def work(variant: Variant, *, n: int) -> dict:
        done.append(n)
        return {"figure": 0.1 * n}

    def run(numbers: list[int]) -> list[dict]:
        return run_jobs(
            [Job(work, PLAIN, {"n": n}) for n in numbers],
            lambda words: None,
            "part",
            workers=1,
            keep=tmp_path,
        )

    first = run(list(range(120)))
    assert first[7] == {"variant": "without", "n": 7, "figure": 0.1 * 7} and done == list(
        range(120)
    )
    (tmp_path / "part_50.json").unlink()  # as after an interruption
    assert run(list(range(120))) == first and done[120:] == list(range(50, 100))
    assert [row["n"] for row in run(list(range(1, 60)))] == list(range(1, 60)) and len(
        done
    ) == 170 + 59


def test_the_subset_on_the_elf_has_every_controller_and_every_end() -> None:
    cases = [case for part in avr.CASES.values() for case in part]
    assert {case.mode for case in cases} == {
        "duty",
        "sync",
        "screwing",
        "vibration",
        "torque",
        "drill",
    }
    assert {case.ends for case in cases} == {
        "none",
        "seated",
        "reached",
        "missed",
        "unreachable",
        "clutch",
        "kickback",
    }


@pytest.mark.parametrize(
    "case", [case for part in avr.CASES.values() for case in part], ids=lambda case: case.name
)
def test_the_elf_makes_the_same_decisions(case: avr.Case) -> None:
    row = avr.differing(case)
    assert row["equal"], row
    assert row["rows"] > 980 * case.seconds and row["frames"] >= 1


def test_an_end_that_is_not_the_expected_one_is_no_equal_decision() -> None:
    row = avr.differing(
        avr.Case(
            "refused",
            "torque",
            reference,
            {"torque_target_nm": 120.0},
            seconds=0.5,
            ends="unreachable",
        )
    )
    assert (
        row["differ"] == row["frames_differ"] == 0 and row["reason"] == "none" and not row["equal"]
    )


FIFTH = Choice(only_fifth=True, workers=1)


@pytest.fixture(scope="module")
def fifth() -> Any:
    """The fifth of each part, run at its first use."""
    found: dict[str, dict] = {}

    def part(name: str) -> dict:
        if name not in found:
            found[name] = PARTS[name](FIFTH).data[name]
        return found[name]

    return part


def summary(part: dict, variant: str) -> dict:
    """A variant's figures over all cells of the fifth; skips where the controller is absent."""
    rows = [row for row in part["summary"] if row["variant"] == variant and row["set"] == "all"]
    if not rows:
        pytest.skip(f"{variant} is absent from this firmware")
    return rows[-1]


@pytest.mark.parametrize("method", ["method 1", "method 2"])
def test_fifth_of_synchronisation(fifth: Any, method: str) -> None:
    found = summary(fifth("sync"), method)
    assert (
        found["clean"] >= 0.97 > found["clean_before"]
        and found["unclean_ratio"] <= 0.5
        and found["worse_cells"] == 0
    )


@pytest.mark.parametrize("method", ["method 1", "method 2"])
def test_fifth_of_low_vibration(fifth: Any, method: str) -> None:
    found = summary(fifth("vibration"), method)
    assert (
        found["change"] <= -0.1
        and found["worst"] <= 0.03
        and found["time_most"] <= 0.05
        and found["not_reached"] == 0
    )


@pytest.mark.parametrize("supply_v", [16.25, 16.45, 16.7])
def test_a_hard_joint_between_the_supplies_of_the_matrix_vibrates_no_more(supply_v: float) -> None:
    rows = [
        vibration.work(variant, supply_v=supply_v, load="hard_joint", seed=7)
        for variant in vibration.VARIANTS
    ]
    for row in rows[1:]:
        assert (
            row["rms_nm"] <= 1.03 * rows[0]["rms_nm"] and row["time_s"] <= 1.05 * rows[0]["time_s"]
        )


def test_fifth_of_blow_detection(fifth: Any) -> None:
    for source in ("by speed", "by current"):
        found = summary(fifth("blows"), source)
        off = found["cells"] - found["cells_within"]
        assert (
            found["cells"] > 20
            and found["error_of_all"] <= 0.01
            and off <= (0 if source == "by speed" else 2)
        )
        assert (
            found["precision"] >= 0.85 and found["recall"] >= 0.9 and found["period_error"] <= 0.015
        )


@pytest.mark.proof
def test_fifth_of_precise_screwing(fifth: Any) -> None:
    found, plain = summary(fifth("screwing"), "screwing"), summary(fifth("screwing"), "without")
    assert found["size"] == plain["size"] == "all"
    assert (
        found["past_deg_median"] <= 45.0 < plain["past_deg_median"]
        and found["stripped"] <= 0.15 * plain["stripped"]
    )
    assert found["rate_change_soft"] <= -0.32 and found["time_ratio"] <= 2.6 and found["early"] <= 2


@pytest.mark.proof
def test_fifth_of_torque_control(fifth: Any) -> None:
    plain = summary(fifth("torque"), torque.FIXED_COUNT)
    found = summary(fifth("torque"), "torque")
    assert (
        found["cells"] == plain["cells"] > 5
        and found["cells_met"] >= 1
        and found["std_rms"] <= 0.08
    )


def test_fifth_of_torque_control_on_drawn_cells(fifth: Any) -> None:
    found = summary(fifth("torque_drawn"), draw.NOMINAL)
    assert found["runs"] >= 50 and abs(found["mean_error"]) <= 0.01
    assert found["missed_reported_reached"] == 0


def test_fifth_of_precise_screwing_on_drawn_screws(fifth: Any) -> None:
    found = summary(fifth("screwing_drawn"), "screwing")
    assert found["stratum"] == "both" and found["screws"] >= 20
    assert found["stripped"] <= 1 and found["early"] <= 1
    assert found["rate_change_soft"] <= -0.2 and found["time_ratio"] <= 3.0


@pytest.mark.proof  # in `make test` the same controllers on a fifth of the matrix
@pytest.mark.parametrize("method", ["method 1", "method 2"])
def test_fifth_of_low_vibration_on_drawn_cells(fifth: Any, method: str) -> None:
    found = summary(fifth("vibration_drawn"), method)
    assert found["cells"] >= 8 and found["change"] < 0.0 and found["time"] <= 0.05


@pytest.mark.parametrize("gear", list(drill.GEARS))
@pytest.mark.parametrize("reverse", [0.0, 1.0])
def test_a_jam_opens_the_bridge_in_both_directions(gear: str, reverse: float) -> None:
    load = ((0.0, 0.0), (0.8, 0.0), (0.805, 1.5 * drill.stall_nm(gear, 18.0)))
    profile = Profile(travel=drill.pulled(1.0), reverse=((0.0, reverse),), load_nm=load)
    params = drill.drill_params(gear)
    plan = RunPlan(profile, drill.CONTROLLER.mode, params, 1.0, 3, truth_every=4)
    run = run_plan(drill.drill_rig(gear, 18.0), plan)
    first_s, final_s = drill.opened_s(run, 0.8)
    assert torque.reason_of(run) == "kickback" and first_s - 0.8 <= 0.03 and final_s - 0.8 <= 0.03
    assert np.sign(run.truth["speed_rad_s"][run.truth["time_s"] < 0.8][-1]) == 1.0 - 2.0 * reverse


def test_a_jam_early_in_a_coast_of_pulse_mode_keeps_the_bridge_open() -> None:
    load = ((0.0, 0.0), (0.6, 0.0), (0.65, 6.0))
    rig, params = drill.drill_rig("low", 20.5), drill.drill_params("low", pulse=True)
    profile = Profile(travel=drill.pulled(1.0), load_nm=load)
    plan = RunPlan(profile, drill.CONTROLLER.mode, params, 1.0, 3, truth_every=4)
    free = run_plan(rig, plan).truth
    is_open = np.isnan(free["duty"]) & (free["time_s"] > 0.75)
    jam_s = free["time_s"][np.flatnonzero(is_open[1:] & ~is_open[:-1])[0]] + 0.005
    jam = (*load, (jam_s, 6.0), (jam_s + 0.005, 1.5 * drill.stall_nm("low", 20.5)))
    run = run_plan(rig, replace(plan, profile=replace(profile, load_nm=jam)))
    assert torque.reason_of(run) == "kickback" and drill.opened_s(run, jam_s)[1] < jam_s


def test_fifth_of_the_drill_driver(fifth: Any) -> None:
    goals = {goal["goal"]: goal for goal in fifth("drill")["goals"] if goal["set"] == "all"}
    if not goals:
        pytest.skip("the drill driver is absent from this firmware")
    assert (
        goals["locks that the bridge did not open on"]["met"]
        and goals["lock to the bridge open for good in ms, most"]["met"]
    )
