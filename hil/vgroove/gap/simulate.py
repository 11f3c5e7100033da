"""vgroove sim RIG --log LOG: drives a rig with a log's input and says how far the log is from it,
on the blocks that a diagnosis judges.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from vgroove.errors import VgrooveError
from vgroove.gap.residual.channels import RAD_S_TO_RPM
from vgroove.gap.residual.problem import Problem, load_problem
from vgroove.log import Log, write_csv
from vgroove.rig import Rig

SCHEMA = "vgroove.sim/1"


def compute_gap(
    rig: Rig, logs: Sequence[Any], restart_s: float = 0.25
) -> tuple[dict[str, Any], Problem]:
    """Gap of a rig to logs as the gap contract's section 5 defines it, as JSON-ready figures, and
    the problem behind them.
    """
    problem = load_problem(logs, rig, restart_s=restart_s)
    residual = problem.residuals(problem.theta0)[0]
    errors, floors, ratings = (
        problem.gap_by_signal(residual),
        problem.floor_by_signal(),
        problem.iso18571(residual),
    )
    judged = [problem.judged & (problem.signal == k) for k in range(len(problem.signals))]
    counted = np.isfinite(problem.squared(residual))
    by_signal = {
        s.column: {
            "unit": s.unit,
            "error": errors[s.column],
            "floor": floors[s.column],
            "gap": problem.gap(residual, mask),
            "iso18571": ratings[s.column],
            "samples": int(counted[mask].sum()),
            "note": s.note,
        }
        for s, mask in zip(problem.signals, judged, strict=True)
    }
    figures = {
        "schema": SCHEMA,
        "rig": rig.name,
        "logs": [str(getattr(log, "source", "")) for log in problem.logs],
        "gap": problem.gap(residual),
        "floor": problem.floor(),
        "restart_s": problem.restart_s,
        "held_out_s": problem.held_out_s,
        "by_signal": by_signal,
        "warnings": problem.warnings,
    }
    return figures, problem


def gap_table(figures: dict[str, Any]) -> Table:
    """The figures of judge() as a table."""
    table = Table(
        title=f"gap {figures['gap']:.3f} of {figures['rig'] or 'the rig'} (floor {figures['floor']:g})",
        title_justify="left",
    )
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


def write_simulation(problem: Problem, path: str | Path) -> None:
    """Write the simulated rows of the one log of a problem as a log CSV, restarted as judged."""
    if len(problem.runs) != 1:
        raise VgrooveError("-o writes one simulated log: give one --log")
    run, rows = problem.runs[0], problem.simulate(problem.theta0)[0]
    kind = problem.rig.input["kind"]
    columns: dict[str, np.ndarray] = {kind: run.log.columns[kind]}
    columns |= {
        name: run.log.columns[name] for name in ("load_nm", "coast") if name in run.log.columns
    }
    simulated = {
        "current_a": rows["current_a"][0],
        "supply_v": rows["supply_v"][0],
        "speed_rpm": rows["speed_measured_rad_s"][0] * RAD_S_TO_RPM,
        "position_rad": rows["angle_measured_rad"][0],
    }
    columns |= {name: values for name, values in simulated.items() if name not in columns}
    write_csv(Log(np.asarray(run.log.time_s), columns, "the simulation"), path)
