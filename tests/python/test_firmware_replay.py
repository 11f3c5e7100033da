"""Replay of a log through the native firmware, and the kinds of firmware gap that it tells."""

import json
import sys
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from vgroove.cli import app
from vgroove.errors import VgrooveError
from vgroove.firmware_replay.assumed_firmware import AssumedFirmware, read_assumed_firmware
from vgroove.firmware_replay.closed_loop import WIDTHS
from vgroove.firmware_replay.delay import actuation_delay_ms
from vgroove.firmware_replay.kinds import judge_firmware
from vgroove.firmware_replay.rows import replay_rows
from vgroove.firmware_replay.search import replay
from vgroove.gap import command
from vgroove.html_page import Page
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.rig_template import template_text

FOLDER = Path(__file__).resolve().parents[1] / "firmware_gap"
if str(FOLDER) not in sys.path:
    sys.path.insert(0, str(FOLDER))

import firmware_bench  # noqa: E402
from firmware_runs import Deviation, firmware_run  # noqa: E402

SECONDS = 1.0


@cache
def board_log(deviation: str = "") -> Log:
    """Log of the duty mode on a tool of the generator, with a named deviation of the firmware."""
    entry = next(
        e for e in firmware_bench.firmware_plan("tune") if (e.kind, e.mode) == ("none", "duty")
    )
    case = firmware_bench.draw_case(entry)
    plan = replace(case.plan, seconds=SECONDS)
    run = firmware_run(case.setting.rig, {}, plan, DEVIATIONS[deviation])
    time_s = run.rows["time_s"]
    return Log(time_s, {k: v for k, v in run.rows.items() if k != "time_s"}, "board.csv")


DEVIATIONS = {
    "": Deviation(),
    "parameter": Deviation(params={"slew_per_ms_q15": 0.003}),
    "late": Deviation(late_s=4e-3),
    "build": Deviation(ceiling=0.5),
    "state": Deviation(trigger_late=9),
}


def changed(log: Log, **columns: np.ndarray) -> Log:
    """A log with other columns."""
    return replace(log, columns=log.columns | columns)


def test_every_duty_of_a_log_follows_from_its_rows() -> None:
    rows = replay_rows(board_log())
    assert np.count_nonzero(rows[:, 0] > 0) > 500
    assert replay(AssumedFirmware(), rows).row == len(rows)


@pytest.mark.parametrize("row", [400, 700])
def test_a_changed_duty_is_found_at_its_row(row: int) -> None:
    log = board_log()
    duty = log["duty"].copy()
    duty[row] -= 1.0 / 255.0
    found = replay(AssumedFirmware(), replay_rows(changed(log, duty=duty)))
    assert (found.row, found.signal) == (row, "duty")
    assert found.expected == round(255 * log["duty"][row])


def test_a_changed_state_is_found() -> None:
    log = board_log()
    state = log["state"].copy()
    state[600:] = 2.0
    found = replay(AssumedFirmware(), replay_rows(changed(log, state=state)))
    assert (found.row, found.signal) == (600, "state")


def test_a_firmware_without_deviation_has_no_gap() -> None:
    result = judge_firmware(board_log(), AssumedFirmware())
    assert result.kind == "" and result.first is None


@pytest.mark.parametrize("kind", ["parameter", "late", "build", "state"])
def test_each_kind_is_told(kind: str) -> None:
    result = judge_firmware(board_log(kind), AssumedFirmware())
    assert result.kind == kind
    if kind == "parameter":
        found = result.details["parameter"]
        assert found["name"] == "slew_per_ms_q15"
        assert found["range"][0] <= round(0.003 * 2**15) / 2**15 <= found["range"][1]
    if kind == "late":
        assert result.details["delay_s"] == pytest.approx(4e-3, abs=0.7e-3)
    if kind == "state":
        assert result.details["trigger_rows"] == pytest.approx(9, abs=1)
        assert result.first["signal"] == "trigger"


@pytest.mark.parametrize("constant_ms", [0.7, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("late_ms", [0.0, 1.5, 3.0])
def test_a_slow_current_sensor_is_no_late_bridge(constant_ms: float, late_ms: float) -> None:
    """The current of the released drive stays for the delay and falls, or decays in the sensor."""
    begin, row = 500, np.arange(600)
    since = np.maximum(row + np.array([[0.0], [1.0]]) - begin - 1e-3, 0.0)
    if late_ms:
        flowed = np.minimum(since, late_ms)
    else:
        flowed = constant_ms * (1.0 - np.exp(-since / constant_ms))
    current = 20.0 * np.where(row < begin, 1.0, flowed[1] - flowed[0])
    noise = 0.15 * np.random.default_rng(1).standard_normal(len(row))
    columns = {
        "duty": np.where(row < begin, 0.8, 0.0),
        "coast": np.where(row < begin, 0.0, 1.0),
        "current_a": current + noise,
        "supply_v": np.full(len(row), 18.0),
    }
    found = actuation_delay_ms(Log(1e-3 * row, columns, "made"))
    assert found == pytest.approx(max(late_ms - 0.2, 0.0), abs=0.1)


def test_the_first_tick_of_a_build_is_where_its_duty_is_limited() -> None:
    log = board_log("build")
    result = judge_firmware(log, AssumedFirmware())
    limited = np.flatnonzero(np.round(255 * log["duty"]) == round(0.5 * 255))
    assert 0 <= result.first["time_s"] - log.time_s[limited[0]] < 2.5e-3


BAD_LOGS: dict[str, tuple[Callable[[Log], Log], str]] = {
    "no state": (
        lambda log: replace(log, columns={k: v for k, v in log.columns.items() if k != "state"}),
        "the column state is missing",
    ),
    "rate": (lambda log: replace(log, time_s=2.0 * log.time_s), "a row per tick of 1 ms"),
    "start": (lambda log: replace(log, time_s=log.time_s + 5.0), "from the start of the board"),
    "filtered": (lambda log: changed(log, duty=0.999 * log["duty"]), "no multiple of 1/255"),
    "missing": (
        lambda log: changed(log, current_a=np.where(log.time_s > 0.5, np.nan, 0.0)),
        "current_a in every row",
    ),
}


@pytest.mark.parametrize("name", BAD_LOGS)
def test_other_logs_are_refused_with_a_sentence(name: str) -> None:
    change, sentence = BAD_LOGS[name]
    with pytest.raises(VgrooveError, match=sentence):
        replay_rows(change(board_log()))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "no JSON file"),
        ('{"modes": 1}', "unknown key modes"),
        ('{"mode": "fast"}', "no mode fast"),
        ('{"params": {"slew": 1}}', "no parameter slew"),
        ('{"params": {"foldback_a_q9": 900}}', "foldback_a_q9 is"),
        ('{"params": {"foldback_a_q9": "x"}}', "is no number"),
        ('{"params": {"foldback_a_q9": NaN}}', "is no number"),
        ('{"params": {"foldback_a_q9": 1e999}}', "is no number"),
    ],
)
def test_a_wrong_firmware_file_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "firmware.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(VgrooveError, match=sentence):
        read_assumed_firmware(path)


def written(folder: Path, log: Log) -> tuple[Path, Path]:
    """Files of a log and of the assumed firmware."""
    names = ["duty", "coast", "current_a", "speed_rpm", "supply_v", "trigger", "state"]
    table = np.stack([log[name] for name in ("time_s", *names)], axis=1)
    path, assumed = folder / "log.csv", folder / "firmware.json"
    np.savetxt(path, table, "%.10g", ",", header=",".join(("time_s", *names)), comments="")
    assumed.write_text('{"mode": "duty"}', encoding="utf-8")
    return path, assumed


def test_the_command_writes_the_section(tmp_path: Path) -> None:
    path, assumed = written(tmp_path, board_log("late"))
    out = tmp_path / "out.json"
    arguments = ["gap", "firmware", str(path), "--firmware", str(assumed), "--json", str(out)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0 and "ms late" in done.output
    section = json.loads(out.read_text(encoding="utf-8"))
    assert section["schema"] == "vgroove.firmware/2" and section["verdict"] == "firmware"
    assert section["logs"][0]["kind"] == "late"


class NoGap:
    """A verdict in place of a diagnosis, which takes minutes, and its corrected rig."""

    warnings: tuple[str, ...] = ()

    def corrected_rig(self) -> Rig:
        free = rig_from_dict(tomllib.loads(template_text("free")), "test")
        return free.with_values({"motor.resistance_ohm": 1.5 * free.value("motor.resistance_ohm")})

    def as_dict(self) -> dict[str, str]:
        return {"schema": "vgroove.gap/1", "verdict": "none"}

    def summary(self) -> list[str]:
        return ["none"]

    def page(self, names: list[str]) -> Page:
        return Page("gap", f"Gap of {names[0]}", [], [])


def test_a_diagnosis_adds_the_section(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "_diagnosed", lambda *_: NoGap())
    path, assumed = written(tmp_path, board_log())
    rig, out = tmp_path / "rig.toml", tmp_path / "out.json"
    rig.write_text(template_text("free"), encoding="utf-8")
    page = tmp_path / "out.html"
    arguments = ["gap", "diagnose", str(path), "--rig", str(rig), "--json", str(out)]
    arguments += ["--html", str(page)]
    done = CliRunner().invoke(app, [*arguments, "--firmware", str(assumed)])
    assert done.exit_code == 0 and "gives every duty" in done.output
    verdict = json.loads(out.read_text(encoding="utf-8"))
    assert verdict["verdict"] == "none" and verdict["firmware"]["verdict"] == "none"
    loop = verdict["firmware"]["logs"][0]["closed_loop"]
    assert loop["nominal"]["time_s"] > 0.25 and loop["corrected"]["signal"] in WIDTHS
    assert "closed loop with the rig" in page.read_text(encoding="utf-8")
    assert "<td>as assumed</td>" in page.read_text(encoding="utf-8")
    CliRunner().invoke(app, arguments)
    assert "as assumed" not in page.read_text(encoding="utf-8")
    assert "firmware" not in json.loads(out.read_text(encoding="utf-8"))
