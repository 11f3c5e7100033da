"""Measured logs with a known difference: the motion, the noise and everything that no model has are
those of the machines in tests/data, and one effect of known kind and size is added or withheld.

`altered_machines.py [--half tune|report] [--machine NAME] [--json FILE]` diagnoses every case with
the command line, prints one row each, and writes docs/results/altered_machines.json.

Either the rig lacks or misstates something that the machine has, or the log is changed as another
machine would have made it: a torque that opposes the same motion needs more current (and, with a
voltage or duty as input, more voltage over the winding), and a sensor writes other values of the
same quantity. The sizes are drawn from ranges, apart for each half; thresholds of the diagnosis are
chosen with the half `tune` only.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from command_verdict import command_verdict
from proof import RESULTS, ROOT, commit
from scipy.signal import savgol_filter

from vgroove.log import Log, read_log, write_csv
from vgroove.rig import Rig, read_rig, write_rig
from vgroove.units import RAD_S_PER_RPM

DATA = ROOT / "tests" / "data"
HALVES = {"tune": 0, "report": 1}
SEED = 20261123
TIMEOUT_S = 900.0  # of one diagnosis
SURE = 0.9  # least probability of a name that counts as sure
DRAG_SHARE = (0.25, 0.6)  # RMS of an added torque, as a share of that of the motor's torque
# a friction changes its sign over this share of the largest speed
REVERSAL_SHARE = 0.01


@dataclass(frozen=True)
class Machine:
    """A measured machine and what the fits of its folder, or its publication, say about it:
    motor: values that complete the rig; effects: those that the complete rig states; current_a:
    constant error of the measured current, which is taken away.
    """

    folder: str
    motor: dict[str, float]
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    current_a: float = 0.0


MACHINES = {
    # offset of the force: published (tests/data/emps/README.md)
    "emps": Machine("emps", {"viscous_nm_s_per_rad": 203.5, "coulomb_nm": 20.4}, {}, -3.16),
    "robotino_current": Machine(
        "real/robotino_m1_current",
        {"viscous_nm_s_per_rad": 2.23e-5, "coulomb_nm": 8.66e-3},
    ),
    "robotino_voltage": Machine(
        "real/robotino_m1_delay", {"coulomb_nm": 8.41e-3}, {"transport_delay": {"delay_s": 0.14}}
    ),
    "servo": Machine("real/servo_cogging", {"coulomb_nm": 5.5e-4}),
}
Change = Callable[["Case", np.random.Generator], "Case"]


@dataclass(frozen=True)
class Case:
    """Logs and rig of a machine, the right names (one of each group), and the size of the change.

    An empty list of groups: nothing of the catalogue is known to act beside the rig.
    """

    rig: Rig
    logs: list[Log]
    groups: list[tuple[str, ...]]
    size: float

    def named(self, names: tuple[str, ...], size: float) -> "Case":
        """The case of which one more group of names is right."""
        return replace(self, groups=[names, *self.groups], size=size)


@dataclass(frozen=True)
class Motion:
    """Speed (n,) in rad/s, angle (n,) in rad and torque of the motor (n,) in N m of a log."""

    speed: np.ndarray
    angle: np.ndarray
    torque: np.ndarray


def motion(rig: Rig, log: Log) -> Motion:
    """The motion that a log measures."""
    if "position_rad" in log:
        angle, step = log["position_rad"], float(np.median(np.diff(log.time_s)))
        window = 2 * max(2, round(0.01 / step)) + 1
        speed = savgol_filter(angle, window, 2, deriv=1) / step
    else:
        speed = log["speed_rpm"] * RAD_S_PER_RPM
        rows = np.isfinite(speed)
        speed = np.interp(log.time_s, log.time_s[rows], speed[rows])
        steps = np.diff(log.time_s, prepend=log.time_s[0])
        angle = np.cumsum(speed * steps)
    driving = input_column(rig, log)
    return Motion(speed, angle, np.nan_to_num(log[driving]) * torque_per_input(rig))


def input_column(rig: Rig, log: Log) -> str:
    """Column that drives the model."""
    return rig.input["kind"]


def torque_per_input(rig: Rig) -> float:
    """Motor's torque at rest for one unit of the column that drives the model, N m."""
    constant = rig.motor["torque_constant_nm_per_a"]
    volts = {"current_a": None, "voltage_v": 1.0, "duty": rig.supply["voltage_v"]}
    volt = volts[rig.input["kind"]]
    return constant if volt is None else constant * volt / rig.motor["resistance_ohm"]


# --- changes ---


def unaltered() -> Change:
    """Nothing: whatever is named besides the complete rig is a false name."""
    return lambda case, rng: case


def withheld_motor(key: str, *names: str) -> Change:
    """The rig's motor lacks a friction."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        size = case.rig.motor[key]
        return replace(case, rig=case.rig.with_values({f"motor.{key}": 0.0})).named(names, size)

    return change


def withheld_effect(name: str) -> Change:
    """The rig lacks an effect."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        rest = {k: v for k, v in case.rig.effects.items() if k != name}
        size = next(iter(case.rig.effects[name].values()))
        return replace(case, rig=replace(case.rig, effects=rest)).named((name,), size)

    return change


def misstated_motor(key: str, low: float, high: float, *names: str, signed: bool = True) -> Change:
    """The rig's motor has a value that is wrong by a factor."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        share = drawn(rng, low, high, signed)
        rig = case.rig.with_values({f"motor.{key}": case.rig.motor[key] / (1.0 + share)})
        return replace(case, rig=rig).named(names, share)

    return change


def added_torque(law: Callable[[Log, Motion], np.ndarray], *names: str) -> Change:
    """The machine has a further torque, of the shape (n,) of a law; it opposes the motion."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        share = drawn(rng, *DRAG_SHARE)
        moved = [motion(case.rig, log) for log in case.logs]
        shapes = [law(log, m) for log, m in zip(case.logs, moved, strict=True)]
        size = share * rms([m.torque for m in moved]) / rms(shapes)
        logs = [
            with_torque(case.rig, log, size * shape)
            for log, shape in zip(case.logs, shapes, strict=True)
        ]
        return replace(case, logs=logs).named(names, size)

    return change


def with_torque(rig: Rig, log: Log, torque: np.ndarray) -> Log:
    """A log of the same motion against a further torque (n,), N m."""
    columns = dict(log.columns)
    driving = input_column(rig, log)
    columns[driving] = columns[driving] + torque / torque_per_input(rig)
    if driving != "current_a" and "current_a" in columns:
        columns["current_a"] = columns["current_a"] + torque / rig.motor["torque_constant_nm_per_a"]
    if driving == "duty":
        columns["duty"] = np.clip(columns["duty"], -1.0, 1.0)
    return replace(log, columns=columns)


def scaled_column(column: str, low: float, high: float, *names: str, signed: bool = True) -> Change:
    """The sensor of a column writes values that are too large by a share."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        share = drawn(rng, low, high, signed)
        logs = [with_column(log, column, log[column] * (1.0 + share)) for log in case.logs]
        return replace(case, logs=logs).named(names, share)

    return change


def offset_column(column: str, low: float, high: float, *names: str) -> Change:
    """The sensor of a column writes values that are too large by a constant."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        size = drawn(rng, low, high, signed=True) * rms([log[column] for log in case.logs])
        logs = [with_column(log, column, log[column] + size) for log in case.logs]
        return replace(case, logs=logs).named(names, size)

    return change


def delayed_command(low_s: float, high_s: float) -> Change:
    """The machine receives its command later than it is logged."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        delay = drawn(rng, low_s, high_s)
        column = input_column(case.rig, case.logs[0])
        logs = [
            with_column(log, column, np.interp(log.time_s + delay, log.time_s, log[column]))
            for log in case.logs
        ]
        return replace(case, logs=logs).named(("transport_delay",), delay)

    return change


def filtered_speed(low_s: float, high_s: float) -> Change:
    """The speed sensor has a low pass of first order."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        lag = drawn(rng, low_s, high_s)
        logs = [
            with_column(log, "speed_rpm", low_pass(log.time_s, log["speed_rpm"], lag))
            for log in case.logs
        ]
        return replace(case, logs=logs).named(("speed_lag",), lag)

    return change


def low_pass(time_s: np.ndarray, values: np.ndarray, lag_s: float) -> np.ndarray:
    """Response (n,) of a first-order low pass to values (n,) that are held between the rows."""
    out = values.copy()
    for k in range(1, len(out)):
        if np.isfinite(values[k]) and np.isfinite(out[k - 1]):
            part = -np.expm1(-(time_s[k] - time_s[k - 1]) / lag_s)
            out[k] = out[k - 1] + part * (values[k] - out[k - 1])
    return out


def with_column(log: Log, name: str, values: np.ndarray) -> Log:
    """A log with other values (n,) of a column."""
    return replace(log, columns=log.columns | {name: values})


def drawn(rng: np.random.Generator, low: float, high: float, signed: bool = False) -> float:
    """A size, uniform over the logarithm."""
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return size * float(rng.choice((-1.0, 1.0))) if signed else size


def rms(parts: list[np.ndarray]) -> float:
    """RMS of all values of several arrays (n,); missing ones are left out."""
    values = np.concatenate(parts)
    return float(np.sqrt(np.nanmean(values**2)))


def direction(m: Motion) -> np.ndarray:
    """Sign (n,) of the speed, smooth at a reversal."""
    return np.tanh(m.speed / (REVERSAL_SHARE * np.max(np.abs(m.speed))))


def quadratic(log: Log, m: Motion) -> np.ndarray:
    return m.speed * np.abs(m.speed)


def stribeck(log: Log, m: Motion) -> np.ndarray:
    return direction(m) * np.exp(-((m.speed / (0.3 * np.max(np.abs(m.speed)))) ** 2))


def forward_only(log: Log, m: Motion) -> np.ndarray:
    return np.maximum(direction(m), 0.0)


def viscous(log: Log, m: Motion) -> np.ndarray:
    return m.speed


def warming_grease(log: Log, m: Motion) -> np.ndarray:
    return m.speed * np.exp(-log.time_s / (0.3 * log.time_s[-1]))


FRICTION_BY_DIRECTION = ("asymmetric_friction", "current_offset", "directional_viscous")
CHANGES: dict[str, dict[str, Change]] = {
    "emps": {
        "unaltered": unaltered(),
        "viscous_friction withheld": withheld_motor("viscous_nm_s_per_rad", "viscous_friction"),
        "coulomb_friction withheld": withheld_motor("coulomb_nm", "coulomb_friction"),
        "torque_constant misstated": misstated_motor(
            "torque_constant_nm_per_a", 0.12, 0.35, "torque_constant", "current_gain"
        ),
        "added_inertia misstated": misstated_motor(
            "inertia_kg_m2", 0.25, 0.8, "added_inertia", signed=False
        ),
        "current_offset added": offset_column("current_a", *DRAG_SHARE, *FRICTION_BY_DIRECTION),
        "transport_delay added": delayed_command(0.01, 0.04),
        "quadratic_drag added": added_torque(quadratic, "quadratic_drag"),
        "stribeck_friction added": added_torque(stribeck, "stribeck_friction"),
        "asymmetric_friction added": added_torque(forward_only, *FRICTION_BY_DIRECTION),
        "cold_grease added": added_torque(warming_grease, "cold_grease"),
    },
    "robotino_current": {
        "unaltered": unaltered(),
        "coulomb_friction withheld": withheld_motor("coulomb_nm", "coulomb_friction"),
        "viscous_friction withheld": withheld_motor("viscous_nm_s_per_rad", "viscous_friction"),
        "torque_constant misstated": misstated_motor(
            "torque_constant_nm_per_a", 0.2, 0.5, "torque_constant", "current_gain"
        ),
        "current_offset added": offset_column("current_a", *DRAG_SHARE, *FRICTION_BY_DIRECTION),
        "quadratic_drag added": added_torque(quadratic, "quadratic_drag"),
        "stribeck_friction added": added_torque(stribeck, "stribeck_friction"),
        "viscous_friction added": added_torque(viscous, "viscous_friction"),
        "asymmetric_friction added": added_torque(forward_only, *FRICTION_BY_DIRECTION),
    },
    "robotino_voltage": {
        "unaltered": unaltered(),
        "transport_delay withheld": withheld_effect("transport_delay"),
        "coulomb_friction withheld": withheld_motor("coulomb_nm", "coulomb_friction"),
        "torque_constant misstated": misstated_motor(
            "torque_constant_nm_per_a", 0.15, 0.4, "torque_constant", "speed_gain"
        ),
        "speed_gain added": scaled_column("speed_rpm", 0.1, 0.3, "speed_gain", "torque_constant"),
        "current_gain added": scaled_column("current_a", 0.5, 1.0, "current_gain", signed=False),
        "current_offset added": offset_column("current_a", 0.7, 1.4, "current_offset"),
        "speed_lag added": filtered_speed(0.1, 0.3),
        "viscous_friction added": added_torque(viscous, "viscous_friction"),
        "quadratic_drag added": added_torque(quadratic, "quadratic_drag"),
    },
    "servo": {
        "as published": unaltered(),
        "coulomb_friction withheld": withheld_motor(
            "coulomb_nm", "coulomb_friction", "dead_time", "brush_drop"
        ),
        "asymmetric_friction added": added_torque(
            forward_only, "asymmetric_friction", "coulomb_friction", "dead_time", "brush_drop"
        ),
    },
}
# effects that the machines have beside their complete rig
BESIDE: dict[str, list[tuple[str, ...]]] = {"servo": [("cogging_torque",)]}


# --- cases ---


def complete_case(name: str) -> Case:
    """A machine's logs with its complete rig."""
    machine = MACHINES[name]
    folder = DATA / machine.folder
    rig = read_rig(folder / "rig.toml")
    rig = rig.with_values({f"motor.{k}": v for k, v in machine.motor.items()})
    rig = rig.with_effects(machine.effects) if machine.effects else rig
    logs = [read_log(path) for path in sorted(folder.glob("log*.csv"))]
    if machine.current_a:
        logs = [with_column(log, "current_a", log["current_a"] - machine.current_a) for log in logs]
    return Case(rig, logs, BESIDE.get(name, []), 0.0)


def cases(half: str, only: str | None) -> list[tuple[str, str]]:
    """Names of the machine and of the change of every case."""
    return [
        (machine, change)
        for machine, changes in CHANGES.items()
        if only in (None, machine)
        for change in changes
        if half == "tune" or not is_unaltered(change)
    ]


def is_unaltered(change: str) -> bool:
    """Whether a case has no drawn size, so that both halves would hold the same."""
    return " added" not in change and " misstated" not in change


def made_case(half: str, machine: str, change: str) -> Case:
    """A case, a function of its half and names."""
    place = list(CHANGES[machine]).index(change)
    rng = np.random.default_rng([SEED, HALVES[half], list(CHANGES).index(machine), place])
    return CHANGES[machine][change](complete_case(machine), rng)


# --- diagnosis ---


def diagnose(case: Case, folder: Path) -> dict[str, Any]:
    """Verdict of the command line on a case (command_verdict), whose files go to the folder."""
    for number, log in enumerate(case.logs):
        write_csv(log, folder / f"log_{number}.csv")
    write_rig(case.rig, folder / "rig.toml")
    logs = sorted(folder.glob("log_*.csv"))
    return command_verdict(logs, folder / "rig.toml", folder / "verdict.json", TIMEOUT_S)


def scored(case: Case, verdict: dict[str, Any]) -> dict[str, Any]:
    """What is kept of a verdict, and how its names compare with the right ones. first: the first
    name is right; complete: every right name and no other; sure_and_wrong: a wrong name of a
    probability of SURE or more.
    """
    selected = verdict.get("selected", [])
    right = {name for group in case.groups for name in group}
    named = verdict["verdict"] in ("effect", "partial")
    found = [bool(set(group) & set(selected)) for group in case.groups]
    probability = {e["id"]: e["probability"] for e in verdict.get("effects", [])}
    return {
        "truth": [list(group) for group in case.groups],
        "size": round(case.size, 8),
        "verdict": verdict["verdict"],
        "selected": {name: probability.get(name) for name in selected},
        "indistinguishable": [r["id"] for r in verdict.get("indistinguishable") or []],
        "gap": {k: verdict.get("gap", {}).get(k) for k in ("before", "after", "closed")},
        "first": named and bool(selected) and selected[0] in right,
        "complete": (named and all(found) and set(selected) <= right)
        if case.groups
        else verdict["verdict"] in ("none", "unlisted"),
        "sure_and_wrong": named
        and any(i not in right and (probability.get(i) or 0.0) >= SURE for i in selected),
    }


def kept_rows(path: Path, half: str, machine: str | None) -> list[dict[str, Any]]:
    """Rows of the other machines that the file has of the same half, where one machine is run."""
    if machine is None or not path.exists():
        return []
    kept = json.loads(path.read_text(encoding="utf-8"))
    return [row for row in kept["cases"] if kept["half"] == half and row["machine"] != machine]


def summary(half: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates over the cases in which something is known to act."""
    changed = [row for row in rows if row["truth"]]
    return {
        "commit": commit(),
        "command": f"python tests/proof/altered_machines.py --half {half}",
        "half": half,
        "of": len(changed),
        "first": sum(row["first"] for row in changed),
        "complete": sum(row["complete"] for row in changed),
        "sure_and_wrong": sum(row["sure_and_wrong"] for row in rows),
        "cases": rows,
    }


def main() -> None:
    """Diagnose the cases and write the result after each of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--half", choices=HALVES, default="report")
    parser.add_argument("--machine", choices=MACHINES)
    parser.add_argument("--case", help="only changes with this text in their names")
    parser.add_argument("--json", type=Path, default=RESULTS / "altered_machines.json")
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    others = kept_rows(args.json, args.half, args.machine)
    for machine, change in cases(args.half, args.machine):
        if args.case and args.case not in change:
            continue
        case, start = made_case(args.half, machine, change), time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            row = scored(case, diagnose(case, Path(folder)))
        seconds = round(time.perf_counter() - start, 1)
        rows.append({"machine": machine, "change": change, **row, "seconds": seconds})
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(
            json.dumps(summary(args.half, others + rows), indent=1) + "\n", encoding="utf-8"
        )
        sys.stdout.write(one_line(rows[-1]) + "\n")
        sys.stdout.flush()
    totals = summary(args.half, rows)
    sys.stdout.write(
        f"{totals['of']} cases: first name right {totals['first']}, exactly right "
        f"{totals['complete']}, sure and wrong {totals['sure_and_wrong']}\n"
    )


def one_line(row: dict[str, Any]) -> str:
    """A case and its verdict."""
    mark = "right" if row["complete"] else "first" if row["first"] else "wrong"
    names = ", ".join(f"{i} {p or 0.0:.2f}" for i, p in row["selected"].items())
    rivals = f" or {', '.join(row['indistinguishable'])}" if row["indistinguishable"] else ""
    gap = row["gap"]
    closed = f"{gap['before'] or 0.0:.3g} -> {gap['after'] or 0.0:.3g}"
    return (
        f"{mark}  {row['machine']}, {row['change']} ({row['size']:.3g}): {row['verdict']} "
        f"{names}{rivals}; gap {closed}; {row['seconds']:.0f} s"
    )


if __name__ == "__main__":
    main()
