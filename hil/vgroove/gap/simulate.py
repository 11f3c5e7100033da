"""The command `vgroove sim RIG --log LOG`: simulates a rig with the input of a log, and computes
the gap on the held-out blocks of a diagnosis.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.long_logs import is_thinned
from vgroove.gap.log_check.compared import refuse_uncompared
from vgroove.gap.residual.loading import load_problem, with_clip
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.log import Log
from vgroove.rig import Rig

SCHEMA = "vgroove.sim/1"
AS_IS = DiagnosisOptions(as_is=True)


def compute_gap(
    rig: Rig,
    logs: Sequence[Any],
    options: DiagnosisOptions = AS_IS,
    restart_s: float | None = None,
) -> tuple[dict[str, Any], Problem]:
    """Gap of a rig to logs (docs/spec/gap.md, section 5) as JSON-ready figures, and the problem
    behind them. restart_s: interval in s at which the model restarts from measured states;
    without it that of a diagnosis.
    Residuals are clipped as the rig's table [clip] states, else as computed from this rig.
    VgrooveError, unless options.as_is, where a column compares no sample.
    """
    problem = load_problem(logs, rig, restart_s, joints=options.joints)
    if rig.clip:
        problem = with_clip(problem, rig.clip)
    if not options.as_is:
        refuse_uncompared(problem)
    residual = problem.residuals(problem.theta0)[0]
    figures = {
        "schema": SCHEMA,
        "rig": rig.name,
        "logs": [str(log.source) for log in problem.logs],
        "gap": problem.gap(residual),
        "floor": problem.floor(),
        "restart_s": problem.restart_s,
        "held_out_s": problem.held_out_s,
        "by_signal": signal_figures(problem, residual),
        "warnings": list(problem.warnings),
    }
    return figures, problem


def signal_figures(problem: Problem, residual: np.ndarray) -> dict[str, dict[str, Any]]:
    """Error, floor, gap and ISO/TS 18571 rating of each judged column; residual (n,)."""
    errors, floors = problem.gap_by_signal(residual), problem.floor_by_signal()
    ratings, counted = problem.iso18571(residual), np.isfinite(problem.squared(residual))
    found = {}
    for k, s in enumerate(problem.signals):
        mask = problem.judged & (problem.signal == k)
        found[s.column] = {
            "unit": s.unit,
            "error": errors[s.column],
            "floor": floors[s.column],
            "gap": problem.gap(residual, mask),
            "iso18571": ratings[s.column],
            "samples": int(counted[mask].sum()),
            "note": s.note,
        }
    return found


def gap_table(figures: dict[str, Any]) -> Table:
    """The figures of compute_gap() as a table."""
    rig, floor = figures["rig"] or "the rig", figures["floor"]
    title = f"gap {figures['gap']:.3f} of {rig} (floor {floor:g})"
    table = Table(title=title, title_justify="left")
    for name in ("signal", "gap", "RMS error", "noise", "unit", "ISO 18571", "samples"):
        table.add_column(name, justify="left" if name in ("signal", "unit") else "right")
    for column, row in figures["by_signal"].items():
        rating = "" if row["iso18571"] is None else f"{row['iso18571']:.3f}"
        table.add_row(
            column,
            f"{row['gap']:.3f}",
            f"{row['error']:.4g}",
            f"{row['floor']:.4g}",
            row["unit"],
            rating,
            str(row["samples"]),
        )
    return table


def simulated_log(problem: Problem) -> Log:
    """The simulated rows of the one log of a problem, with the restarts of the judged gap, without
    those that a reduced log skips; VgrooveError for several logs.
    """
    if len(problem.runs) != 1:
        raise VgrooveError("-o writes one simulated log: give one --log")
    log, kind = problem.runs[0].log, problem.rig.input["kind"]
    columns: dict[str, np.ndarray] = {kind: log.columns[kind]}
    columns |= {name: log.columns[name] for name in ("load_nm", "coast") if name in log.columns}
    simulated = problem.simulated_columns()
    columns |= {name: values for name, values in simulated.items() if name not in columns}
    time_s = np.asarray(log.time_s)
    kept = ~is_thinned(log.columns, len(time_s))
    columns = {name: np.asarray(values)[kept] for name, values in columns.items()}
    return Log(time_s[kept], columns, "the simulation")
