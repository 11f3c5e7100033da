"""The tool in real time against a board, compared with the same run in lock-step: timing of the
exchange, execution time of the tool's step, and where the logs first differ.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove import lockstep
from vgroove.html_page import Picture, Table, style, table_from_dicts, thin
from vgroove.log import Log, log_from_stream
from vgroove.log_compare import Comparison, compare_logs
from vgroove.log_compare.report import first_sentence
from vgroove.progress import Tick
from vgroove.real_time import RealTimeRun, SerialLink, run_in_real_time, timing_figures
from vgroove.real_time.simulated_board import PacedBoard, real_time_elf
from vgroove.real_time.tool_ticks import ToolTicks
from vgroove.result_files import Report
from vgroove.scenario import Scenario, command_messages, make_plant
from vgroove.sil import SilBoard
from vgroove.study.fixed_point import drill_scenario, impact_scenario

KICKBACK_NM = 40.0
COLOURS = {"lock-step": "#00798c", "real time": "#d1495b"}
DASHES = {"lock-step": "solid", "real time": "dot"}
SHOWN = {"current_a": "current in A", "speed_rpm": "speed in rpm", "duty": "duty"}


def scenarios(tool: str) -> Iterator[tuple[str, Scenario]]:
    """The runs of a tool: the impact tool on each kind of joint, the drill driver under load and
    with a jammed bit.
    """
    if tool == "drill":
        yield "drill, load of 6 N m", drill_scenario("drill_driver_low", 6.0, 1.0, 18.0, 1)
        yield "drill, kickback", drill_scenario("drill_driver_low", KICKBACK_NM, 1.0, 18.0, 1)
        return
    for joint in ("hard_joint", "disc_spring", "m10"):
        yield f"impact, {joint}", impact_scenario(0, joint, 1.0, 18.0, 1)


@contextmanager
def _port(tool: str, port: str | None, pace: float) -> Iterator[str]:
    if port is not None:
        yield port
        return
    with PacedBoard(real_time_elf(tool), pace) as board:
        yield board.port


def in_lockstep(scenario: Scenario) -> Log:
    """The log of the native firmware."""
    line = lockstep.Script(command_messages(scenario.commands))
    options = lockstep.LockstepOptions(front=scenario.front_ends(), line=line, seed=scenario.seed)
    tool = make_plant(scenario.tool, scenario.seed)
    data = lockstep.run(SilBoard(), tool, scenario.profile, scenario.duration_s, options)
    return log_from_stream(data, "lock-step")


def in_real_time(scenario: Scenario, port: str) -> RealTimeRun:
    """The run against a board."""
    run, link = RealTimeRun(), SerialLink(port)
    try:
        run_in_real_time(link, ToolTicks(scenario), round(1000 * scenario.duration_s), run)
    finally:
        link.close()
    return run


def run_row(name: str, run: RealTimeRun, found: Comparison) -> dict[str, Any]:
    """Figures of one run."""
    figures = timing_figures(run)
    times = {
        f"{key}_{name_of}": 1e3 * figures[f"{key}_s"][quantile]
        for key in ("jitter", "step")
        for name_of, quantile in (("median", "median"), ("p999", "99.9 %"), ("worst", "worst"))
    }
    return {
        "run": name,
        "ticks": figures["exchanges"],
        **times,
        "latency": figures["latency_ticks"]["median"],
        "late": len(figures["late_steps"]),
        "held_ms": figures["held_ticks"],
        "damaged": figures["frames_damaged"],
        "safe": len(run.safe_ticks),
        "drift_ppm": figures["clock"]["drift_ppm"],
        "equal_rows": found.equal_rows,
        "rows": len(found.pairs.time_s),
        "first_difference": first_sentence(found),
    }


def hil_study(
    tools: tuple[str, ...], port: str | None, pace: float, seconds: float | None, tick: Tick
) -> Report:
    """The runs of the tools; `seconds`: another length of each run. `tick` is called once a run."""
    rows, pictures = [], []
    for tool in tools:
        with _port(tool, port, pace) as device:
            for name, scenario in scenarios(tool):
                scenario = replace(scenario, duration_s=seconds or scenario.duration_s)
                run = in_real_time(scenario, device)
                log = log_from_stream(bytes(run.telemetry), "real time")
                found = compare_logs(in_lockstep(scenario), log)
                rows.append(run_row(name, run, found))
                pictures.append(_picture(name, found))
                tick(name)
    lines = [f"{row['run']}: {row['first_difference']}" for row in rows]
    title = "Hardware in the loop in real time against lock-step"
    data = {"pace": pace, "port": port or "simulated ATmega328P", "rows": rows}
    return Report("hil", title, lines, [_table(rows)], pictures, data)


def _table(rows: list[dict[str, Any]]) -> Table:
    columns = [
        ("run", "run"),
        ("ticks", "ticks"),
        ("jitter in ms, median", "jitter_median"),
        ("99.9 %", "jitter_p999"),
        ("worst", "jitter_worst"),
        ("tool's step in ms, median", "step_median"),
        ("99.9 % ", "step_p999"),
        ("worst ", "step_worst"),
        ("latency in ticks", "latency"),
        ("late steps", "late"),
        ("waited in ms", "held_ms"),
        ("damaged frames", "damaged"),
        ("bridge opened", "safe"),
        ("equal rows before the first difference", "equal_rows"),
        ("rows", "rows"),
    ]
    return table_from_dicts("runs", "Runs in real time", columns, rows)


def _picture(name: str, found: Comparison) -> Picture:
    figure = make_subplots(rows=len(SHOWN), cols=1, shared_xaxes=True, vertical_spacing=0.05)
    for row, (column, text) in enumerate(SHOWN.items(), 1):
        curves = [side[column] for side in (found.pairs.a, found.pairs.b)]
        time_s, *thinned = thin(found.pairs.time_s, *curves)
        for (label, colour), values in zip(COLOURS.items(), thinned, strict=True):
            line = {"color": colour, "width": 1.2, "dash": DASHES[label]}
            trace = go.Scatter(x=time_s, y=values, name=label, line=line, showlegend=row == 1)
            figure.add_trace(trace, row=row, col=1)
        figure.update_yaxes(title_text=text, row=row, col=1)
    figure.update_xaxes(title_text="time in s", row=len(SHOWN))
    note = "Lock-step: native firmware. Real time: the board."
    return Picture(name, style(figure, 620), note)
