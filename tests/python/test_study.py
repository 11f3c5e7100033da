"""The studies by the command line, on reduced grids: laws in their JSON, tables that agree with it,
a page that a browser draws.
"""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.subplots import make_subplots

from browser import need_chromium, seen
from vgroove.html_page import Table, legend_per_panel, style, thin
from vgroove.study.step_events import event_rows
from vgroove.study.steps import largest_below
from warm_cli import Settings, warm_vgroove

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 300


def vgroove(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "vgroove.cli", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=LIMIT_S, check=False, cwd=cwd
    )


def rows_of(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / name).open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    done = vgroove("study", "steps", "--points", "9", "--repeats", "1", "-o", "out", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "Largest step of the sweep" in done.stdout and "out/steps.html" in done.stdout
    return folder / "out"


@pytest.fixture(scope="module")
def drill(steps: Path) -> dict:
    return json.loads((steps / "steps.json").read_text())["drill"]


def test_real_time_mode_is_accurate_at_every_step_size(drill: dict) -> None:
    mine = [row for row in drill["sweep"] if row["solver"] == "real_time"]
    assert {row["step_s"] for row in mine} >= {10e-6, 35e-6, 40e-6, 70e-6, 0.1}
    assert max(row["speed_error"] for row in mine) < 1e-5
    assert all(
        row["speed_s"] == row["chuck_s"] == 0.1
        for row in drill["largest"]
        if row["solver"] == "real_time"
    )


def test_each_parameter_step_admits_a_longer_euler_step(drill: dict) -> None:
    """Euler: none of 70, 40 and 35 us in parameter step 1, not 70 us in step 2, all in step 3."""
    rows = [row for row in drill["sweep"] if (row["solver"], row["mode"]) == ("euler", "pulse")]
    pulse = {
        (row["parameter_step"], round(row["step_s"] * 1e6)): row["speed_error"] for row in rows
    }
    assert all(pulse[1, us] > 0.01 for us in (35, 40, 70))
    assert pulse[2, 35] < 0.01 and pulse[2, 40] < 0.01 and pulse[2, 70] > 0.01
    assert all(pulse[3, us] < 0.01 for us in (35, 40, 70))


def test_explicit_solvers_fail_beyond_their_stability(drill: dict) -> None:
    for row in drill["largest"]:
        if row["solver"] == "real_time":
            continue
        same = [
            r
            for r in drill["sweep"]
            if all(r[k] == row[k] for k in ("mode", "parameter_step", "solver"))
        ]
        beyond = [r["chuck_error"] for r in same if r["step_s"] > 1.1 * row["stability_limit_s"]]
        assert beyond and all(error is None or error > 0.05 for error in beyond)
        assert row["chuck_s"] is None or row["chuck_s"] < row["stability_limit_s"]


def test_each_parameter_step_needs_fewer_variable_steps(drill: dict) -> None:
    for mode in ("normal", "pulse", "slipping"):
        counts = [row["steps"] for row in drill["variable"] if row["mode"] == mode]
        assert counts[0] > 1.5 * counts[1] > 2.25 * counts[2]
    events = {(r["mode"], r["parameter_step"], r["event"]): r for r in drill["events"]}
    assert all(row["smallest_after_s"] <= row["before_s"] for row in events.values())
    assert (
        events["normal", 1, "load on"]["recovery_s"] > events["normal", 3, "load on"]["recovery_s"]
    )
    assert events["pulse", 1, "drive begins"]["count"] == 11
    assert not any(event == "drive begins" for mode, _, event in events if mode != "pulse")


def test_tables_agree_with_the_json(steps: Path, drill: dict) -> None:
    largest = rows_of(steps, "steps_largest.csv")
    assert len(largest) == len(drill["largest"])
    for row, wanted in zip(largest, drill["largest"], strict=True):
        assert row["mode"] == wanted["mode"]
        value = row["behind the gear in us"]
        assert (float(value) if value else None) == (
            pytest.approx(wanted["speed_s"] * 1e6, rel=1e-5) if wanted["speed_s"] else None
        )
    timing = rows_of(steps, "steps_execution.csv")
    assert all(
        0 < float(r["mean in ns"]) <= float(r["worst in ns"]) >= float(r["99.9 % in ns"]) > 0
        for r in timing
    )


def test_a_browser_draws_the_page(steps: Path) -> None:
    text = seen(steps / "steps.html").dom
    assert len(re.findall(r'<svg[^>]*class="main-svg"', text)) >= 6  # two layers a figure
    assert (
        "step in µs" in text
        and "1 %" in text
        and "Step sizes: impact cycle and drill driver" in text
    )
    assert not re.search(r"(src|href)=['\"]https?://", text.split("<body", 1)[1])


def test_the_pages_of_a_folder_share_one_file_with_plotly(steps: Path) -> None:
    page = (steps / "steps.html").read_text()
    assert len(page) < 1e6 and re.search(r"<script src='plotly-[\d.]+\.min\.js'>", page)
    assert len(list(steps.glob("plotly-*.min.js"))) == 1


def test_each_panel_has_a_legend_of_its_own_curves() -> None:
    figure = make_subplots(rows=2, cols=1)
    for row, name in ((1, "speed"), (2, "torque"), (2, "load")):
        figure.add_trace(go.Scatter(x=[0, 1], y=[0, 1], name=name), row=row, col=1)
    legend_per_panel(style(figure, 500))
    assert [trace.legend for trace in figure.data] == ["legend", "legend2", "legend2"]
    assert all(trace.showlegend for trace in figure.data)
    assert figure.layout.legend.y > figure.layout.legend2.y


def test_a_rig_changes_the_result_and_png_is_drawn(tmp_path: Path) -> None:
    need_chromium()
    rig = ROOT / "rigs/drill_driver_high.toml"
    done = vgroove(
        "study",
        "steps",
        "--rig",
        rig,
        "--points",
        "2",
        "--repeats",
        "1",
        "--png",
        "--only",
        "drill",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    data = json.loads((tmp_path / "study/steps.json").read_text())
    assert "impact" not in data
    data = data["drill"]
    assert (
        data["parameters"]["gearbox.ratio"] == 8.75 and data["parameters"]["load.torque_nm"] == 2.0
    )
    assert (tmp_path / "study/steps.png").read_bytes().startswith(b"\x89PNG")
    assert not [p.name for p in (tmp_path / "study").iterdir() if "part" in p.name]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--rig", ROOT / "rigs/impact_driver.toml"), "drill_driver"),
        (("--rig", "absent.toml"), "absent.toml"),
        (("--rig", "mixed.toml"), "go together"),
        (("--tolerance", "1"), "--tolerance must be from"),
        (("-o", "file"), "file: this folder cannot be made"),
        (("--json", "absent/x.json"), "absent"),
    ],
)
def test_bad_input_gives_a_message_and_exit_code_2(
    tmp_path: Path, arguments: tuple, sentence: str
) -> None:
    (tmp_path / "file").write_text("")
    low = (ROOT / "rigs/drill_driver_low.toml").read_text()
    (tmp_path / "mixed.toml").write_text(low.split("[load]")[0] + '[load]\nkind = "none"\n')
    words = ("study", "steps", "--points", "2", *arguments)
    done = warm_vgroove(*words, settings=Settings(cwd=tmp_path))
    assert done.returncode == 2
    assert sentence in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("*.csv")) and not list(tmp_path.rglob("*.json"))


def test_ctrl_c_leaves_nothing_behind(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vgroove.cli", "study", "steps", "--points", "200"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path
    ) as run:
        deadline = time.monotonic() + 60
        while not (tmp_path / "study").is_dir() and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(1.0)
        os.kill(run.pid, signal.SIGINT)
        assert run.wait(timeout=60) == 130
        assert run.stderr.read().decode().endswith("vgroove: ended by Ctrl-C.\n")
    assert list((tmp_path / "study").iterdir()) == []


def test_recovery_is_the_time_to_half_of_the_step_before() -> None:
    length = np.array([1.0, 2.0, 0.1, 0.2, 0.5, 1.5, 1.0])
    marks = ["none", "load on", "none", "none", "none", "none", "none"]
    row = event_rows(np.cumsum(length), length, marks)[0]
    assert (row["before_s"], row["smallest_after_s"]) == (2.0, 0.1)
    assert row["recovery_s"] == pytest.approx(0.1 + 0.2 + 0.5 + 1.5)
    assert event_rows(np.cumsum(length[:4]), length[:4], marks[:4])[0]["recovery_s"] is None


def test_a_longest_step_is_one_up_to_which_all_hold() -> None:
    rows = [
        {"step_s": s, "e": e} for s, e in ((1.0, 0.001), (2.0, 0.009), (3.0, 0.02), (4.0, 0.001))
    ]
    assert largest_below(rows, "e") == 2.0
    assert largest_below(rows[2:], "e") is None
    assert largest_below([{"step_s": 1.0, "e": None}], "e") is None
    assert largest_below([{"step_s": 1.0, "e": 0.01}], "e") is None


def test_thinning_keeps_the_peaks() -> None:
    t = np.linspace(0.0, 1.0, 100_001)
    y = np.sin(50 * t)
    y[54_321] = 7.0
    few, values = thin(t, y, points=1000)
    assert len(few) < 1200 and values.max() == 7.0 and few[np.argmax(values)] == t[54_321]
    assert few[0] == 0.0 and few[-1] == 1.0 and np.all(np.diff(few) > 0)


def test_a_table_has_the_same_cells_in_csv_and_html() -> None:
    table = Table("x", "T", ["a <b>", "n in s"], [["k", 1.25], ["m", None]])
    assert table.as_csv() == "a <b>,n in s\nk,1.25\nm,\n"
    assert "a &lt;b&gt;" in table.as_html() and "1.25" in table.as_html()
