"""Tables of `vgroove bench speed` for a terminal."""

from typing import Any

from rich import box
from rich.table import Table

MAX_BUSY = 0.1  # share of the time for other programs above which wall times are marked as too long
CASES = {"slip_60": "slip 60 N m", "slope_700": "slope 700"}


def speed_tables(figures: dict[str, Any]) -> list[Table]:
    """The requirements, then each comparison, then the peers that are missing."""
    impact = [
        impact_table(figures, case)
        for case in CASES
        if any(f["case"] == case for f in figures["impact"])
    ]
    others = [
        make(figures)
        for make in (
            tolerance_table,
            lockstep_table,
            batch_table,
            growth_table,
            drive_table,
            memory_table,
        )
    ]
    return [
        asked_table(figures),
        *impact,
        *others,
        *([missing_table(figures)] if figures["missing"] else []),
    ]


RATIO = "time / plant's"  # header


def narrow(*columns: str, title: str) -> Table:
    """A table that fits a terminal of 80 columns."""
    return Table(*columns, title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)


def asked_table(figures: dict[str, Any]) -> Table:
    """The requirements with their figures."""
    title = f"{figures['cpu']}, {figures['cores']} cores, medians of {figures['repeats']}"
    table = narrow("figure", "value", "limit", "met", title=title)
    if figures["busy"] > MAX_BUSY:
        table.caption = (
            f"[red]the machine spent {100 * figures['busy']:.0f} % of the time on other programs: "
            "wall times are too long[/red]"
        )
    for a in figures["asked"]:
        met = {True: "yes", False: "[red]no[/red]", None: "peer missing"}[a["met"]]
        table.add_row(
            a["name"],
            "-" if a["value"] is None else f"{a['value']:.4g}",
            f"{a['relation']} {a['asked']:g}",
            met,
        )
    return table


def tolerance_text(figure: dict[str, Any]) -> str:
    """The relative tolerance of a solver, or its step."""
    if figure["tolerance"] is None:
        return ""
    return (
        f"{1e6 * figure['tolerance']:.3g} us"
        if figure["tolerance_is"] == "step_s"
        else f"rtol {figure['tolerance']:.3g}"
    )


def impact_table(figures: dict[str, Any], case: str) -> Table:
    """One row a solver."""
    title = f"Impact mode, full trigger, 1 s, {CASES[case]}: wall and processor time"
    table = narrow("solver", "at", "ms", "cpu ms", "head's error", RATIO, title=title)
    for f in (f for f in figures["impact"] if f["case"] == case):
        times = (f"{1e3 * f['seconds']:.2f}", f"{1e3 * f['cpu_seconds']:.2f}")
        table.add_row(f["name"], tolerance_text(f), *times, error_text(f), f"{f['ratio']:.1f}")
    step = figures["mujoco_step_s"]
    if step is not None:
        table.caption = f"MuJoCo, soft contacts, accuracy not compared: {1e6 * step:.1f} us a step"
    return table


def error_text(figure: dict[str, Any]) -> str:
    """The error of the head's angle, red where it is beyond the accuracy of the comparison."""
    error = f"{figure['head_error']:.1e}"
    return error if figure["reached"] else f"[red]{error}[/red]"


def tolerance_table(figures: dict[str, Any]) -> Table:
    """Peers at tolerances around the one at which they are timed."""
    columns = ("solver", "joint", "at", "cpu ms", "head's error", RATIO)
    table = narrow(*columns, title="Impact mode by tolerance")
    for f in figures["tolerances"]:
        cells = (f"{1e3 * f['cpu_seconds']:.2f}", error_text(f), f"{f['ratio']:.1f}")
        table.add_row(f["name"], CASES[f["case"]], tolerance_text(f), *cells)
    return table


def missing_table(figures: dict[str, Any]) -> Table:
    """Peers that this machine lacks."""
    table = narrow("missing peer", "how to install it", title="Not on this machine")
    for missing in figures["missing"]:
        table.add_row(missing["name"], missing["install"])
    return table


def lockstep_table(figures: dict[str, Any]) -> Table:
    """Solvers alone and in lock-step."""
    columns = ("joint", "solver", "alone ms", "lock-step ms", "extra")
    table = narrow(*columns, title="In lock-step with a 1 ms controller")
    for f in figures["lockstep"]:
        times = (f"{1e3 * f['alone_s']:.2f}", f"{1e3 * f['lockstep_s']:.2f}")
        table.add_row(CASES[f["case"]], f["name"], *times, f"{100 * f['extra']:.1f} %")
    return table


def batch_table(figures: dict[str, Any]) -> Table:
    """Batches of different tools."""
    columns = ("solver", "roll-outs", "threads", "per second", "idle", "head's error")
    table = narrow(*columns, title="Batch of different tools, 1 s each")
    for f in figures["batch"]:
        rates = (f"{f['per_second']:.1f}", f"{f['per_second_idle']:.1f}")
        table.add_row(
            f["name"], str(f["rollouts"]), str(f["threads"]), *rates, f"{f['head_error']:.1e}"
        )
    return table


def growth_table(figures: dict[str, Any]) -> Table:
    """Cost over the length of a run and over the size of a batch."""
    table = narrow(
        "of",
        "size",
        "ms each",
        title="Cost of a simulated second by length, of a run by batch size",
    )
    for c in figures["growth"]:
        table.add_row(
            c["of"],
            f"{c['size']:g}" + (" s" if c["of"] == "time" else ""),
            f"{1e3 * c['seconds_each']:.3f}",
        )
    return table


def drive_table(figures: dict[str, Any]) -> Table:
    """The drivetrain by every solver."""
    title = f"Drivetrain alone, {figures['drive_seconds']} s staircase, rows of 1 ms, one thread"
    table = narrow("solver", "at", "ms", "x real time", "speed error", RATIO, title=title)
    for f in figures["drive"]:
        rtol = "" if f["rtol"] is None else f"rtol {f['rtol']:g}"
        cells = (
            f"{1e3 * f['seconds']:.2f}",
            f"{f['times_real_time']:,.0f}",
            f"{f['speed_error']:.1e}",
            f"{f['ratio']:.2f}",
        )
        table.add_row(f["name"], rtol, *cells)
    return table


def memory_table(figures: dict[str, Any]) -> Table:
    """Memory over the length of the run."""
    title = "Memory of a run in a process of its own, beyond the code's"
    table = narrow("run", "length", "log MiB", "peak MiB", title=title)
    for m in figures["memory"]:
        table.add_row(m["of"], f"{m['seconds']} s", f"{m['log_mib']:.1f}", f"{m['peak_mib']:.1f}")
    return table
