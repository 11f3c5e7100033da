"""Blind cases with the firmware in the loop, `firmware_bench.py list|make|open FOLDER [--set ...]
[--numbers ...]`: firmware gaps, plant gaps and logs without a gap, on the generator's impact tool.

A case has log.csv, rig.toml and firmware.json (the assumed mode and EEPROM parameters). The
answers are sealed as those of gap_bench.py in tests/truth; they have the label `firmware` with
`what` and `first_s`, the time of the first row that the assumed firmware does not give.
"""

import argparse
import hashlib
import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from firmware_runs import (
    COLUMNS,
    Deviation,
    FirmwarePlan,
    FirmwareRun,
    firmware_run,
    first_difference,
)

import gap_bench  # isort: skip
from bench_plan import SETS  # isort: skip
from impact_cases import ImpactSetting, effect_params  # isort: skip
from impact_effects import BY_ID, accepted  # isort: skip
from impact_profiles import draw_impact  # isort: skip
from impact_rigs import draw_impact_rig, impact_toml  # isort: skip
from impact_visible import largest, reference_of, visible_limit  # isort: skip
from signals import Sensors  # isort: skip
from vgroove.lockstep import Profile

FIRMWARE_SEED = 20261126
MODES = ("duty", "sync", "screwing", "vibration", "torque")
PULL_S = 0.25  # of the trigger: before it the board calibrates the offset of its current
SECONDS = (1.6, 2.2)
ATTEMPTS = 40
EARLIEST_S, LEAST_LEFT_S = 0.05, 0.1  # of a first difference: after the start, before the end
# Parameter -> factors of its default that are drawn, of every mode and of single ones
PARAMETERS = {
    "": {"slew_per_ms_q15": (0.4, 0.6, 1.6, 2.5), "foldback_a_q9": (0.55, 0.7)},
    "sync": {
        "sync_low_mv": (0.93, 1.06),
        "sync_depth_max_q15": (0.4, 2.0),
        "sync_current_a_q9": (0.7, 1.2),
    },
    "screwing": {"screwing_share_q15": (0.6, 1.5), "screwing_least_mv": (0.8, 1.3)},
    "vibration": {
        "vibration_approach_q15": (0.7, 1.4),
        "vibration_climb_q15": (0.7, 1.3),
        "vibration_hard_share_q15": (0.8, 1.2),
    },
    "torque": {"torque_target_nm": (0.6, 1.4)},
}
DEVIATIONS = ("parameter", "late", "build", "state")
# Effects of plant gaps that a board's log shows
PLANT_IDS = (
    "groove_friction",
    "spring_rate",
    "spring_preload",
    "lug_wear",
    "winding_resistance",
    "supply_resistance",
    "coulomb_friction",
    "torque_constant",
)
FIRMWARE_PER_MODE, PLANT_PER_MODE, NONES_PER_MODE = 4, 2, 2  # cases of a half
BOARD_SENSORS = Sensors(
    current_noise_a=0.15,
    current_lsb_a=2.0**-9,
    hall_timeout_s=0.3,
    speed_lsb_rpm=0.5,
)
# Known properties of the board, as in rigs/board_18v.toml
BOARD_EFFECTS = """[effects.dead_time]
dead_time_s = 62.5e-9
[effects.current_lag]
time_constant_s = 0.12e-3
[effects.transport_delay]
delay_s = 31.6e-6
"""


@dataclass(frozen=True)
class FirmwareEntry:
    """A case to draw: `what` is a deviation, or the effect of a plant gap."""

    set: str
    number: int
    kind: str
    mode: str
    what: str
    regime: str = "firmware"
    first: str = ""

    @property
    def name(self) -> str:
        """A hash that reveals nothing about the case."""
        text = f"{FIRMWARE_SEED} {self.set} {self.number}"
        return hashlib.sha256(text.encode()).hexdigest()[:10]


def firmware_plan(half: str) -> list[FirmwareEntry]:
    """The cases of a half in a random order."""
    rows, shift = [], SETS.index(half)
    for m, mode in enumerate(MODES):
        rows += [("firmware", mode, DEVIATIONS[n % 4]) for n in range(FIRMWARE_PER_MODE)]
        for n in range(PLANT_PER_MODE):
            which = (m * PLANT_PER_MODE + n + 3 * shift) % len(PLANT_IDS)
            rows.append(("single", mode, PLANT_IDS[which]))
        rows += [("none", mode, "")] * NONES_PER_MODE
    order = np.random.default_rng([FIRMWARE_SEED, shift]).permutation(len(rows))
    return [FirmwareEntry(half, n, *rows[k]) for n, k in enumerate(order)]


@dataclass(frozen=True)
class FirmwareCase:
    """A drawn case with its run, effect, deviation, and the time of the first difference."""

    entry: FirmwareEntry
    setting: ImpactSetting
    plan: FirmwarePlan
    deviation: Deviation
    sizes: dict[str, float]
    multiples: dict[str, float]
    params: dict[str, float]
    run: FirmwareRun
    first_s: float | None
    attempt: int


def draw_deviation(entry: FirmwareEntry, rng: np.random.Generator) -> Deviation:
    """The deviation of a firmware gap."""
    if entry.kind != "firmware":
        return Deviation()
    if entry.what == "late":
        return Deviation(late_s=float(rng.uniform(1.5e-3, 8e-3)))
    if entry.what == "build":
        most = 0.6 if entry.mode == "torque" else 0.92  # the torque mode drives at about half
        return Deviation(ceiling=float(rng.uniform(0.6, 1.0)) * most)
    if entry.what == "state":
        return Deviation(trigger_late=int(rng.integers(2, 12)))
    choices = PARAMETERS[""] | PARAMETERS.get(entry.mode, {})
    name = str(rng.choice(sorted(choices)))
    from vgroove.telemetry import parameter_list

    default = next(p.default / 2**p.q for p in parameter_list() if p.name == name)
    return Deviation(params={name: default * float(rng.choice(choices[name]))})


def draw_trigger(seconds: float, rng: np.random.Generator) -> Profile:
    """The trigger is pulled over a short ramp, to the end or to a part, and may be released."""
    level = float(rng.choice([1.0, 1.0, rng.uniform(0.85, 1.0)]))
    ramp = float(rng.uniform(0.02, 0.15))
    points = [(0.0, 0.0), (PULL_S, 0.0), (PULL_S + ramp, level)]
    if rng.uniform() < 0.5:
        end = seconds - float(rng.uniform(0.25, 0.4))
        points += [(end, level), (end + 0.03, 0.0)]
    return Profile(travel=points)


def draw_case(entry: FirmwareEntry) -> FirmwareCase:
    """The case of an entry, a function of the entry alone."""
    for attempt in range(ATTEMPTS):
        case = attempt_case(entry, attempt)
        if case:
            return case
    raise RuntimeError(f"{entry}: no case in {ATTEMPTS} draws")


def attempt_case(
    entry: FirmwareEntry, attempt: int, sizes: dict[str, float] | None = None
) -> FirmwareCase | None:
    """One attempt; None where the deviation or the effect is not visible. Known `sizes` save the
    search for them.
    """
    rng = np.random.default_rng([FIRMWARE_SEED, SETS.index(entry.set), entry.number, attempt])
    joint = "wood_screw" if entry.mode == "screwing" else str(rng.choice(["locked", "hard_joint"]))
    rig = draw_impact_rig(joint, rng, pwm_hz=31372.5, sensors=BOARD_SENSORS)
    rig = rig.with_values(supply__voltage_v=max(rig["supply.voltage_v"], 17.5))
    seconds = round(float(rng.uniform(*SECONDS)), 2)
    seed = int(rng.integers(1, 2**31))
    plan = FirmwarePlan(entry.mode, {}, draw_trigger(seconds, rng), seconds, seed)
    profile = replace(draw_impact("plain", seconds, False, rng), name=entry.mode)
    setting = ImpactSetting(rig, rig, profile, seconds, seed)
    deviation = draw_deviation(entry, rng)
    multiples: dict[str, float] = {}
    if entry.kind == "single" and sizes is None:
        sizes, multiples = draw_sizes(setting, entry.what, rng)
        if not sizes:
            return None
    params = effect_params(setting, entry.what, sizes[entry.what]) if sizes else {}
    run = firmware_run(rig, params, plan, deviation)
    first_s = first_difference(run, plan, deviation) if entry.kind == "firmware" else None
    late = first_s is None or not EARLIEST_S < first_s < seconds - LEAST_LEFT_S
    if entry.kind == "firmware" and late:
        return None
    return FirmwareCase(
        entry, setting, plan, deviation, sizes or {}, multiples, params, run, first_s, attempt
    )


def draw_sizes(
    setting: ImpactSetting, effect_id: str, rng: np.random.Generator
) -> tuple[dict[str, float], dict[str, float]]:
    """(size, multiple of the visible limit) of a plant gap, by its visibility at plain duty; empty
    where it is not visible.
    """
    sign = float(rng.choice([-1.0, 1.0])) if BY_ID[effect_id].signed else 1.0
    multiple = float(np.exp(rng.uniform(np.log(2.0), np.log(10.0))))
    limit = visible_limit(reference_of(setting), effect_id, sign)
    top = largest(setting, effect_id, sign)
    if limit is None or 2.0 * limit > top:
        return {}, {}
    multiple = min(multiple, top / limit)
    return {effect_id: sign * limit * multiple}, {effect_id: multiple}


def write_case(case: FirmwareCase, folder: Path) -> None:
    """Write log.csv, rig.toml and firmware.json of a case."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = case.run.rows
    names = [name for name in COLUMNS if name in rows]
    lines = [",".join(f"{rows[name][n]:.10g}" for name in names) for n in range(len(rows["duty"]))]
    (folder / "log.csv").write_text("\n".join([",".join(names), *lines]) + "\n", encoding="utf-8")
    text = impact_toml(case.setting.rig) + BOARD_EFFECTS
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    assumed = {"mode": case.plan.mode, "params": dict(case.plan.params)}
    (folder / "firmware.json").write_text(json.dumps(assumed) + "\n", encoding="utf-8")


def answer_of(case: FirmwareCase) -> dict[str, object]:
    """The sealed answer of a case."""
    entry = case.entry
    plant = entry.kind == "single"
    accept = ["late", "transport_delay"] if entry.what == "late" else [entry.what]
    return {
        "label": "effect" if plant else entry.kind,
        "kind": entry.kind,
        "regime": entry.regime,
        "number": entry.number,
        "attempt": case.attempt,
        "ids": [entry.what] if plant else [],
        "accept": [accepted(BY_ID[entry.what])] if plant else [],
        "sizes": case.sizes,
        "times_visible": case.multiples,
        "truth": case.params,
        "what": entry.what if entry.kind == "firmware" else "",
        "accept_what": accept if entry.kind == "firmware" else [],
        "deviation": asdict(case.deviation),
        "first_s": case.first_s,
        "mode": entry.mode,
        "joint": "locked" if case.setting.rig.locked else case.setting.rig.joint,
        "seconds": case.plan.seconds,
    }


def drawn(entry: FirmwareEntry) -> tuple[FirmwareCase, dict[str, object]]:
    """A case and its answer."""
    case = draw_case(entry)
    return case, answer_of(case)


def again(entry: FirmwareEntry, answer: dict[str, object]) -> FirmwareCase:
    """The case of a sealed answer."""
    return attempt_case(entry, answer["attempt"], answer["sizes"])


FIRMWARE = gap_bench.BlindSet(
    firmware_plan, ("firmware",), drawn, again, write_case, lambda case: []
)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("list", "make", "open"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", dest="half", choices=SETS, default="tune")
    parser.add_argument("--numbers", default="all", help="numbers with commas")
    args = parser.parse_args(arguments)
    entries = firmware_plan(args.half)
    if args.numbers != "all":
        entries = [entries[int(n)] for n in args.numbers.split(",") if n]
    args.folder.mkdir(parents=True, exist_ok=True)
    if args.what == "make":
        gap_bench.make(args.folder, entries, FIRMWARE)
    elif args.what == "open":
        answers = gap_bench.show(args.folder, entries, False, FIRMWARE)
        sys.stdout.write(json.dumps(answers) + "\n")
    else:
        sys.stdout.write(json.dumps([[e.number, e.name] for e in entries]) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
