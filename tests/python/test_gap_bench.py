"""The blind set: its plan has the cases of docs/gap_bench.md, its answers stay sealed, and its
scoring counts no wrong verdict as right.
"""

import hashlib
import json
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from truth_helpers import BY_ID, CATALOGUE, TRUTH, setting_of

import bench_draw  # isort: skip
import gap_bench  # isort: skip
import responses  # isort: skip
from bench_plan import MEASURED, MEASURED_SERIES, SETS, Entry, plan, simulated_plan  # isort: skip
from forms import FORMS, other_form  # isort: skip
from rigs import TOLERANCE  # isort: skip
from vgroove.errors import VgrooveError
from vgroove.gap_bench import cases, needs, rates, report, run, score
from vgroove.gap_bench import scored as scoring
from vgroove.gap_bench.command import Request, check_page, chosen, run_bench
from vgroove.gap_bench.report import bench_page, tables

ROOT = Path(__file__).resolve().parents[2]
# SHA-256 of names, kinds, regimes and effects of the cases of the regimes `exact` and `hard`
SIMULATED_PLANS = {
    "tune": "05deeebecd1d56b367e1cbdbd93b92b2f8aba51fa54b4e3e8cb63b31e654bc60",
    "report": "e80cce0869cae8d89baba95ce233bea2c373e7ba707332ee12686eafddd1436c",
}
R = ["bridge_resistance", "winding_resistance"]  # equivalent effects
HAMMERING = ("exact_drive_signals", "exact_bench_channels", "loose_all")


def scored(
    ids: list[str],
    verdict: str,
    selected: list[str],
    probability: float = 0.95,
    rivals: tuple[str, ...] = (),
    **answer: Any,
) -> scoring.Scored:
    """A scored case with these true ids and this verdict."""
    accept = [R if i in R else [i] for i in ids]
    kind = {0: "none", 1: "single", 2: "pair", 3: "triple"}[len(ids)]
    stated = {
        "kind": kind,
        "label": "effect" if ids else kind,
        "ids": ids,
        "accept": accept,
        "regime": "exact",
        "sizes": dict.fromkeys(ids, 1.0),
        "times_visible": dict.fromkeys(ids, 4.0),
        "seconds": 6.0,
        "number": 0,
        **answer,
    }
    stated = {
        key: ""
        for key in (
            "rig",
            "input",
            "bus",
            "sensor",
            "position",
            "profile",
            "logger",
            "log_hz",
            "load",
            "two_way",
        )
    } | stated
    effects = [{"id": i, "probability": probability, "parameters": {}} for i in selected]
    given = {
        "verdict": verdict,
        "selected": selected,
        "effects": effects,
        "indistinguishable": [{"id": i} for i in rivals],
        "gap": {"closed": 0.98, "closed_beyond_retuning": 0.9},
        "warnings": [],
    }
    return scoring.Scored(0, "x", None, stated, given, 1.0, 1.0, 100.0)


def test_plan_has_the_cases_of_the_page() -> None:
    kinds: Counter[str] = Counter()
    by_effect: Counter[str] = Counter()
    for half in SETS:
        entries = simulated_plan(half)
        kinds.update(e.kind for e in entries)
        by_effect.update(e.first for e in entries if e.kind == "single")
        assert len({e.name for e in entries}) == len(entries)
    assert min(by_effect[e.id] for e in CATALOGUE) >= 20
    assert (kinds["none"], kinds["pair"], kinds["triple"], kinds["unlisted"]) == (300, 150, 40, 100)
    assert {e.name for e in plan("tune")}.isdisjoint(e.name for e in plan("report"))


@pytest.mark.parametrize("half", SETS)
def test_the_cases_of_exact_and_hard_have_their_numbers_whatever_follows_them(half: str) -> None:
    entries = plan(half)
    simulated = [e for e in entries if e.regime != "measured"]
    rows = [[e.number, e.name, e.kind, e.regime, e.first] for e in simulated]
    assert entries[: len(rows)] == simulated
    assert [e.number for e in entries] == list(range(len(entries)))
    assert hashlib.sha256(json.dumps(rows).encode()).hexdigest() == SIMULATED_PLANS[half]


@pytest.mark.parametrize("half", SETS)
def test_the_regime_with_disturbances_has_the_cases_of_the_page(half: str) -> None:
    every = [e for e in plan(half) if e.regime == "measured"]
    size = sum(MEASURED.values())
    assert size >= 200 and len(every) == MEASURED_SERIES * size
    for first in range(0, len(every), size):
        entries = every[first : first + size]
        assert Counter(e.kind for e in entries) == MEASURED
        assert {e.first for e in entries if e.kind == "single"} == {e.id for e in CATALOGUE}
        assert {e.kind for e in entries[:20]} == set(MEASURED)


def test_the_first_cases_of_the_plan_are_of_all_kinds() -> None:
    first = Counter(e.kind for e in plan("tune")[:120])
    assert set(first) == {"single", "none", "pair", "triple", "unlisted"}
    assert 40 <= first["single"] <= 90


def test_sealed_answers_can_be_neither_read_nor_changed(tmp_path: Path) -> None:
    line = gap_bench.seal({"ids": ["brush_drop"]}, "abc")
    path = tmp_path / "answers.sealed"
    path.write_text(line)
    assert "brush" not in line and bytes("brush", "ascii").hex() not in line
    assert len(line) == len(gap_bench.seal({"ids": []}, "abc"))
    assert gap_bench.opened(path) == {"abc": {"ids": ["brush_drop"]}}
    at = line.rindex(" ") + 5
    path.write_text(line[:at] + ("0" if line[at] != "0" else "1") + line[at + 1 :])
    with pytest.raises(ValueError, match="abc"):
        gap_bench.opened(path)


def test_a_case_is_the_same_whenever_it_is_made(tmp_path: Path) -> None:
    entry = next(e for e in plan("tune") if e.kind == "none")
    for folder in ("a", "b"):
        gap_bench.make(tmp_path / folder, [entry], gap_bench.DRIVETRAIN) if (
            tmp_path / folder
        ).mkdir() is None else None
    names = ["answers.sealed", *(f"cases/{entry.name}/{n}" for n in ("log.csv", "rig.toml"))]
    assert all(
        (tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names
    )
    assert sorted(p.name for p in (tmp_path / "a" / "cases" / entry.name).iterdir()) == [
        "log.csv",
        "rig.toml",
    ]


@pytest.mark.parametrize("effect_id", sorted(FORMS))
def test_other_forms_differ_from_the_effect_by_less_than_the_effect_itself(effect_id: str) -> None:
    profile = {"load": "load_steps", "two_way": "reversals", "slow": "crawl", "": "staircase"}[
        BY_ID[effect_id].needs
    ]
    setting = setting_of(profile, seconds=3.0)
    size = (0.2 if effect_id == "current_saturation" else 0.03) * BY_ID[effect_id].top(setting.rig)
    made = bench_draw.effect_params(setting, effect_id, size)
    level = bench_draw.level_of(setting)
    other = other_form(effect_id, setting.tool, made, level, np.random.default_rng(1))
    if effect_id == "hall_dropout":
        assert other["hall_burst"] > 0.0
        return
    log = responses.noiseless_log(setting, other)
    left, whole = responses.measured(log) - responses.modelled(log, made), responses.deviation(log)
    assert responses.clipped_rms(left) > 1e-3
    assert responses.clipped_rms(left) < responses.clipped_rms(whole)


def test_retuning_removes_what_the_tolerances_explain_and_leaves_the_rest() -> None:
    setting = setting_of("staircase", seconds=3.0)
    setting = replace(setting, rig=replace(setting.rig, tolerance=TOLERANCE))
    within, beyond = ({"coulomb_nm": setting.rig.coulomb_nm * (1.0 + part)} for part in (0.05, 0.6))
    assert bench_draw.gap_left(setting, within) < 0.1
    assert bench_draw.gap_left(setting, beyond) > 1.0
    assert bench_draw.gap_left(setting, {"brush_drop_v": 0.5}) > 1.0
    near, above, below = (
        {"resistance_ohm": setting.rig.resistance_ohm * (1.0 + 0.02 * sigmas)}
        for sigmas in (2.5, 10.0, -10.0)
    )
    assert bench_draw.gap_left(setting, near) < 0.5
    assert min(bench_draw.gap_left(setting, above), bench_draw.gap_left(setting, below)) > 1.0


def test_a_tolerated_key_is_fitted_under_its_prior_from_the_rigs_value() -> None:
    one, nothing = np.ones((1, 1)), np.zeros((1, 0))
    for tool_sigmas, left in ((0.0, 0.5), (1.0, 1.0), (-1.0, 0.0)):
        found = responses.fit(np.ones(1), one, np.array([tool_sigmas]), nothing, np.zeros(0))[1]
        assert found == pytest.approx(left, abs=1e-3)


def test_indistinguishable_effects_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    setting = setting_of("staircase", seconds=1.5)
    entry = Entry("tune", 0, "single", "exact", "winding_resistance")
    ids, sizes = ("supply_gain",), {"supply_gain": 0.004}
    clear = bench_draw.Case(
        entry, setting, ids, sizes, {"supply_gain": 3.0}, {"supply_gain": 0.004}
    )
    assert bench_draw.ties_of(clear) == []
    same = replace(
        clear,
        ids=("bridge_resistance",),
        sizes={"bridge_resistance": 0.02},
        params={"bridge_resistance_ohm": 0.02},
    )
    assert bench_draw.ties_of(same) == []  # equivalent effects are no tie: either name is right
    monkeypatch.setattr(bench_draw, "accepts", lambda effect_id, setting: [effect_id])
    assert bench_draw.ties_of(same) == [["winding_resistance"]]


def test_a_case_is_made_again_from_its_found_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = next(
        e
        for e in plan("tune")
        if e.kind == "single" and e.first == "current_offset" and e.regime == "hard"
    )
    row = {
        "half": "tune",
        "number": entry.number,
        "attempt": 3,
        "ids": ["current_offset"],
        "sizes": {"current_offset": 0.5},
        "multiples": {"current_offset": 2.0},
        "ties": [],
    }
    case = gap_bench.frozen_case(row)
    assert (
        case.params == {"current_offset_a": 0.5}
        and case.setting.seed == gap_bench.frozen_case(row).setting.seed
    )
    keys = [key.split(".")[1] for key in case.setting.rig.tolerance]
    assert keys and all(
        getattr(case.setting.tool, key) != getattr(case.setting.rig, key) for key in keys
    )
    with pytest.raises(ValueError, match="freeze"):
        gap_bench.frozen_case(row | {"ids": ["brush_drop"]})


@pytest.mark.parametrize("kind", ["duty", "voltage_v", "current_a"])
def test_the_model_of_the_tool_itself_leaves_nothing(kind: str) -> None:
    for bus in ("modelled", "measured") if kind == "duty" else ("absent",):
        setting = setting_of("staircase", seconds=1.5, input=kind, bus=bus)
        log = responses.noiseless_log(setting, {})
        assert responses.clipped_rms(responses.deviation(log)) < (
            0.35 if kind == "current_a" else 0.15
        )
        compared = {
            "duty": {
                "modelled": ("current_a", "supply_v", "speed_rpm"),
                "measured": ("current_a", "speed_rpm"),
            },
            "voltage_v": {"absent": ("current_a", "speed_rpm")},
            "current_a": {"absent": ("speed_rpm",)},
        }[kind][bus]
        assert responses.channels(setting.rig) == compared
        table = gap_bench.log_table(setting, {})
        assert {"duty": "duty", "voltage_v": "voltage_v", "current_a": "current_a"}[kind] in table
        assert ("duty" in table) == (kind == "duty")


def test_the_table_of_needs_replaces_the_text_between_its_marks() -> None:
    counted = needs.count_needs(
        [
            scored(
                ["brush_drop"],
                "effect",
                names,
                input="duty",
                bus="absent",
                sensor="hall",
                two_way=False,
                load=True,
                profile="hand",
            )
            for names in (["brush_drop"], ["dead_time"])
        ]
    )
    page = report.between(
        "before\n<!--needs-->\nold\n<!--end of needs-->\nafter\n",
        "needs",
        needs.needs_table(counted),
    )
    row = next(line for line in page.splitlines() if line.startswith("| `brush_drop`"))
    assert [cell.strip() for cell in row.strip("|").split("|")][1:4] == ["1/2", ".", "."]
    assert "old" not in page and page.startswith("before") and page.endswith("after\n")
    with pytest.raises(ValueError, match="needs"):
        report.between("no marks", "needs", "")


def test_the_page_shows_the_committed_figures() -> None:
    results = ROOT / "docs" / "results" / "gap_bench.json"
    if not results.exists():
        pytest.skip("no run of the blind set is committed")
    page = (ROOT / "docs" / "gap_bench.md").read_text(encoding="utf-8")
    assert report.renewed(page, json.loads(results.read_text(encoding="utf-8"))) == page


def test_intervals_of_shares_are_wilsons() -> None:
    assert rates.wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert rates.wilson(98, 100) == pytest.approx((0.9300, 0.9945), abs=1e-4)


def test_only_true_names_are_right() -> None:
    assert scored(["brush_drop"], "effect", ["brush_drop"]).right
    assert scored(["winding_resistance"], "effect", ["bridge_resistance"]).right
    assert scored([], "none", []).right
    assert not scored(["brush_drop"], "effect", ["dead_time"]).right
    assert not scored(["brush_drop"], "none", []).right
    assert not scored([], "effect", ["brush_drop"]).right
    assert not scored(["brush_drop", "current_lag"], "effect", ["brush_drop"]).right
    assert not scored(
        ["brush_drop", "current_lag"], "effect", ["brush_drop", "current_lag", "speed_gain"]
    ).right
    extra = scored(["brush_drop"], "effect", ["brush_drop", "speed_gain"])
    assert extra.right and not extra.complete and extra.sure_and_wrong


def test_a_partial_verdict_is_judged_by_its_names() -> None:
    assert scored(["brush_drop"], "partial", ["brush_drop"]).right
    assert scored(["winding_resistance"], "partial", ["bridge_resistance"]).complete
    assert scored(["brush_drop", "current_lag"], "partial", ["current_lag", "brush_drop"]).right
    assert not scored(["brush_drop", "current_lag"], "partial", ["brush_drop"]).right
    assert not scored([], "partial", ["brush_drop"]).right
    unlisted = scored([], "partial", ["brush_drop"], kind="unlisted", label="unlisted")
    assert not unlisted.right and unlisted.sure_and_wrong
    imitated = scored(["brush_drop"], "partial", ["dead_time"])
    assert not imitated.right and imitated.sure_and_wrong
    assert not scored(["brush_drop"], "partial", ["dead_time"], 0.8).sure_and_wrong


@pytest.mark.parametrize(
    ("outcome", "names", "right"),
    [
        ("none", [], True),
        ("unlisted", [], True),
        ("effect", ["brush_drop"], False),
        ("partial", ["brush_drop"], False),
        ("ambiguous", ["brush_drop"], False),
        ("failed", [], False),
    ],
)
def test_beside_disturbances_alone_nothing_may_be_named(
    outcome: str, names: list[str], right: bool
) -> None:
    answer = {"kind": "disturbances", "label": "disturbances", "regime": "measured"}
    case = scored([], outcome, names, **answer)
    assert case.right is right
    assert case.names_something is bool(names)


def test_figures_of_the_regime_with_disturbances() -> None:
    measured = {"regime": "measured", "disturbances": [{"id": "slips", "times_visible": 0.5}]}
    alone = measured | {"kind": "disturbances", "label": "disturbances"}
    pair = ["brush_drop", "current_lag"]
    table = [
        scored(["brush_drop"], "effect", ["brush_drop"]),
        scored(["brush_drop"], "partial", ["brush_drop", "speed_gain"], 0.6, **measured),
        scored(["brush_drop"], "partial", ["dead_time"], 0.95, **measured),
        scored(pair, "partial", [*pair, "speed_gain"], 0.6, **measured),
        scored([], "unlisted", [], **alone),
        scored([], "partial", ["brush_drop"], 0.6, **alone),
    ]
    figures = {"set": "tune", "engine": "0", "cases": 6} | score.score(table)
    found = figures["rates"]["measured"]
    hits = {key: (found[key]["hits"], found[key]["of"]) for key in report.MEASURED}
    assert hits == {
        "single": (1, 2),
        "single_alone": (0, 2),
        "pair_both_named": (1, 1),
        "pair": (0, 1),
        "sure_and_wrong": (1, 5),
        "disturbances": (1, 2),
        "disturbances_named": (1, 2),
    }
    bins = figures["calibration_by_regime"]
    assert (bins["exact"][-1]["of"], bins["measured"][-1]["of"]) == (1, 1)
    names = [table.name for table in tables(figures)]
    assert {"measured", "calibration_regimes"} <= set(names)
    assert "measured" not in score.score(table[:1])["rates"]
    json.dumps(figures)


def test_a_tie_is_right_only_where_there_is_one() -> None:
    tie = scored(
        ["brush_drop"], "ambiguous", ["dead_time"], rivals=("brush_drop",), ties=[["dead_time"]]
    )
    assert tie.right
    assert not scored(
        ["brush_drop"], "ambiguous", ["brush_drop"], rivals=("dead_time",), ties=[]
    ).right
    assert not scored(
        ["brush_drop"], "ambiguous", ["dead_time"], rivals=("speed_gain",), ties=[["dead_time"]]
    ).right


def test_figures_count_the_cases(tmp_path: Path) -> None:
    table = [
        scored(["brush_drop"], "effect", ["brush_drop"]),
        scored(["brush_drop"], "effect", ["dead_time"]),
        scored(["brush_drop"], "ambiguous", ["brush_drop"], 0.6, ("dead_time",)),
        scored([], "effect", ["dead_time"], 0.7),
    ]
    figures = {"set": "tune", "engine": "0", "cases": 4} | score.score(table)
    counted = figures["rates"]
    assert (counted["exact"]["single"]["hits"], counted["exact"]["single"]["of"]) == (1, 3)
    assert (
        counted["sure_and_wrong"]["hits"],
        counted["false_alarms"]["hits"],
        counted["ambiguous_though_separable"]["hits"],
    ) == (1, 1, 1)
    assert counted["exact"]["single_listed_first"]["hits"] == 2
    top = figures["calibration"][-1]
    assert (top["hits"], top["of"]) == (1, 2)
    assert ("brush_drop", "effect dead_time", 1) in figures["confusion"]
    json.dumps(figures)
    assert tables(figures) and "Calibration" in bench_page(figures)


@pytest.mark.parametrize(
    ("rows", "size"),
    [
        ([(2.0, False), (3.0, True), (5.0, True)], 3.0),
        ([(2.0, True), (3.0, False)], None),
        ([], None),
    ],
)
def test_power_is_the_size_from_which_on_nearly_all_are_right(
    rows: list[tuple[float, bool]], size: float | None
) -> None:
    assert score.power_size(rows) == size


def test_without_its_effect_any_name_is_wrong_and_sure_ones_are_counted() -> None:
    gone = [
        replace(scored(["brush_drop"], outcome, names), without="brush_drop")
        for outcome, names in (
            ("unlisted", []),
            ("ambiguous", ["dead_time"]),
            ("effect", ["dead_time"]),
            ("none", []),
        )
    ]
    assert score.removed(gone)["not named wrongly"]["hits"] == 2
    assert score.removed(gone)["named with 90 % and wrong"]["hits"] == 1


@pytest.mark.parametrize(
    ("ties", "named", "right"),
    [
        ([["speed_gain", "added_inertia"]], ["added_inertia", "speed_gain"], True),
        ([["speed_gain", "added_inertia"]], ["speed_gain"], False),
        ([["speed_gain", "clock_skew"]], ["speed_gain", "clock_skew"], False),
        ([], ["added_inertia", "speed_gain"], False),
    ],
)
def test_a_special_case_that_is_tied_with_the_truth_is_right(
    ties: list[list[str]], named: list[str], right: bool
) -> None:
    assert scored(["speed_gain", "coupler_compliance"], "effect", named, ties=ties).right is right


def test_a_delayed_speed_column_is_late_by_whole_rows() -> None:
    answer = {
        "sizes": {"speed_lag": 2.4e-5, "dead_time": 1e-6},
        "log_hz": 1000.0,
        "truth": {"speed_delay_s": 2.4e-5},
    }
    assert scoring.true_parameter(answer, "speed_lag") == pytest.approx(1e-3)
    lagged = answer | {"truth": {"speed_lag_s": 2.4e-5}}
    assert scoring.true_parameter(lagged, "speed_lag") == 2.4e-5


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        (Request("tune", without=["viscous"]), "no effect has this id; the nearest is viscous_fr"),
        (Request("tune", count=3, fifth=True), "--count and --fifth: give one of them"),
        (Request("tune", fifth=True, numbers=[1]), "--fifth and --number: give one of them"),
    ],
)
def test_a_choice_without_effect_is_refused(request_: Request, sentence: str) -> None:
    with pytest.raises(VgrooveError, match=sentence):
        run_bench(request_, Console(quiet=True))


def test_a_page_that_cannot_be_filled_is_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(VgrooveError, match="cannot be read"):
        check_page(tmp_path / "page")
    (tmp_path / "page").write_text("<!--needs-->\n<!--end of needs-->\n")
    with pytest.raises(VgrooveError, match="the mark <!--figures--> is missing"):
        check_page(tmp_path / "page")
    check_page(ROOT / "docs/gap_bench.md")


def test_cases_are_chosen_by_the_options() -> None:
    hundred = list(range(100))
    assert chosen(hundred, Request("tune", fifth=True)) == list(range(20))
    assert chosen(hundred, Request("tune", count=3)) == [0, 1, 2]
    assert chosen(hundred, Request("tune", numbers=[7, 7, 2])) == [2, 7]
    with pytest.raises(VgrooveError, match="100"):
        chosen(hundred, Request("tune", numbers=[100]))


def test_an_interrupted_run_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blind, diagnosed = cases.BlindSet(tmp_path, "tune"), []

    def diagnose_in_own_process(case: Path, without: str | None) -> dict[str, Any]:
        diagnosed.append((case.name, without))
        return {
            "verdict": {"verdict": "none"},
            "seconds": 1.0,
            "cpu_seconds": 1.0,
            "memory_mib": 1.0,
        }

    monkeypatch.setattr(run, "diagnose_in_own_process", diagnose_in_own_process)
    for engine, without in (
        ("a", None),
        ("a", None),
        ("b", None),
        ("a", "brush_drop"),
        ("a", "brush_drop"),
    ):
        assert run.kept_verdict(blind, engine, 7, "abc", without)["number"] == 7
    assert diagnosed == [("abc", None), ("abc", None), ("abc", "brush_drop")]


def test_a_failed_diagnosis_is_a_failed_case(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,duty\n0.1,0\n")
    (tmp_path / "rig.toml").write_text("schema = 'vgroove.rig/1'\n")
    found = run.diagnose_in_own_process(tmp_path, None)
    assert (
        found["verdict"]["verdict"] == "failed" and "exit code 2" in found["verdict"]["warnings"][0]
    )
    assert found["memory_mib"] > 10.0 and found["cpu_seconds"] > 0.0


def test_without_a_checkout_the_error_names_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cases, "__file__", str(tmp_path / "cases.py"))
    with pytest.raises(VgrooveError, match="checkout"):
        cases.find_checkout()


def test_the_generator_lists_nothing_but_numbers_and_names(tmp_path: Path) -> None:
    command = [sys.executable, TRUTH / "gap_bench.py", "list", tmp_path, "--numbers", "0,1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert [len(row) for row in json.loads(done.stdout)] == [2, 2]


def test_the_generator_lists_the_cases_of_a_regime(tmp_path: Path) -> None:
    command = [sys.executable, TRUTH / "gap_bench.py", "list", tmp_path, "--regime", "measured"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    numbers = [number for number, _ in json.loads(done.stdout)]
    simulated = len(simulated_plan("tune"))
    assert numbers == list(range(simulated, simulated + MEASURED_SERIES * sum(MEASURED.values())))


def test_the_rates_of_a_hammering_tool_are_apart_by_regime_and_bench_channels() -> None:
    table = [
        scored(["lug_wear"], "effect", ["lug_wear"], bench=False),
        scored(["lug_wear"], "effect", ["spring_rate"], bench=False),
        scored(["lug_wear"], "effect", ["lug_wear"], bench=True),
        scored([], "none", [], bench=True, regime="loose"),
        scored(["lug_wear"], "none", [], bench=False, regime="loose"),
        scored(["lug_wear"], "none", []),  # a case of the drivetrain
    ]
    found = score.rates(table)
    hits = {key: (found[key]["hits"], found[key]["of"]) for key in found if key in HAMMERING}
    assert hits == dict(zip(HAMMERING, ((1, 2), (1, 1), (1, 2)), strict=True))
