"""The command of the blind sets, `gap_bench.py list|make|open|freeze FOLDER [--impact] [--set ...]
[--numbers ...]`: answers are sealed as cases are made.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import impact_assess
import impact_draw
import numpy as np
from bench_draw import Case, accepts, case_again, draw_case, ties_of
from bench_plan import REGIMES, SEED, SETS, Entry, plan
from cases import Setting, columns
from disturbances import Disturbance
from effects import split
from impact_plan import IMPACT_REGIMES, impact_plan
from responses import channels, hall_angle
from rigs import toml
from sealed import mask
from signals import Sensors

SEALED = "answers.sealed"
UNNAMED = ("none", "unlisted", "disturbances")  # kinds without true names
DISTURBED = ("disturbances", "disturbed_share")  # keys of an answer of the regime `measured`
LOST_SHARE = 0.01  # of the rows that a logger of the kind "lost" omits
FORMATS = {
    "time_s": "{:.6f}",
    "duty": "{:.4f}",
    "coast": "{:.0f}",
    "supply_v": "{:.2f}",
    "current_a": "{:.4f}",
    "speed_rpm": "{:.1f}",
    "load_nm": "{:.4f}",
    "voltage_v": "{:.3f}",
    "position_rad": "{:.6f}",
}


def log_table(setting: Setting, params: dict[str, float]) -> dict[str, np.ndarray]:
    """The columns of the log that belong to the rig's input and sensors."""
    rig, compared = setting.rig, channels(setting.rig)
    table = columns(setting, params)
    rng = np.random.default_rng([setting.seed, 17])
    angle = table.pop("angle_rad")
    if rig.input == "voltage_v":
        table["voltage_v"] = table["duty"] * rig.voltage_v + (
            0.02 * rng.standard_normal(len(angle)) if setting.seed % 2 else 0.0
        )
    if rig.input != "duty":
        del table["duty"]
    if rig.input != "duty" or rig.bus == "absent":
        del table["supply_v"]
    if "speed_rpm" not in compared:
        del table["speed_rpm"]
    if "position_rad" in compared:
        table["position_rad"] = (
            np.floor(hall_angle(angle, split(params)[0]) / rig.sensors.position_lsb_rad)
            * rig.sensors.position_lsb_rad
        )
    if setting.logger == "lost":
        here = rng.uniform(size=len(angle)) >= LOST_SHARE
        table = {name: values[here] for name, values in table.items()}
    return table


def write_log(path: Path, table: dict[str, np.ndarray]) -> None:
    texts = [
        ["" if np.isnan(v) else FORMATS[name].format(v + 0.0) for v in values]
        for name, values in table.items()
    ]
    path.write_text(
        "\n".join([",".join(table), *(",".join(row) for row in zip(*texts, strict=True))]) + "\n",
        encoding="utf-8",
    )


def write_case(case: Case, folder: Path) -> None:
    """Write log.csv and rig.toml of a case."""
    folder.mkdir(parents=True, exist_ok=True)
    write_log(folder / "log.csv", log_table(case.setting, case.params))
    (folder / "rig.toml").write_text(toml(case.setting.rig), encoding="utf-8")


def answer_of(case: Case) -> dict[str, object]:
    """The sealed answer of a case."""
    setting, rig, s = case.setting, case.setting.rig, case.setting.rig.sensors
    label = case.entry.kind if case.entry.kind in UNNAMED else "effect"
    return {
        "label": label,
        "kind": case.entry.kind,
        "regime": case.entry.regime,
        "number": case.entry.number,
        "attempt": case.attempt,
        "ids": list(case.ids),
        "accept": [accepts(i, setting) for i in case.ids] if label == "effect" else [],
        "sizes": case.sizes,
        "times_visible": case.multiples,
        "truth": case.params,
        **disturbances_of(case),
        "tool": {key: getattr(setting.tool, key.split(".")[1]) for key in rig.tolerance},
        "input": rig.input,
        "bus": rig.bus if rig.input == "duty" else "none",
        "sensor": sensor_kind(s),
        "position": s.position_lsb_rad > 0.0,
        "profile": setting.profile.name,
        "two_way": setting.profile.two_way,
        "load": rig.load == "torque",
        "logger": setting.logger,
        "seconds": setting.seconds,
        "log_hz": s.log_hz,
        "rig": rig.name,
    }


def disturbances_of(case: Case) -> dict[str, object]:
    """The disturbances of a case of the regime `measured`: id, size, seed, RMS gap alone; and the
    share of all in the squared gap.
    """
    if case.entry.regime != "measured":
        return {}
    rows = [
        {**asdict(d), "times_visible": gap}
        for d, gap in zip(case.setting.disturbances, case.disturbed_by, strict=True)
    ]
    return {"disturbances": rows, "disturbed_share": case.share}


def sensor_kind(s: Sensors) -> str:
    """The sensor of the speed: hall, encoder, tachometer or angle."""
    if s.hall_pulses_per_rev:
        return "hall" if s.hall_pulses_per_rev < 16 else "encoder"
    return "tachometer" if s.speed_noise_rpm else "angle"


def seal(answer: dict[str, object], name: str) -> str:
    """A line of the sealed file: name, commitment, masked answer."""
    text = json.dumps(answer, sort_keys=True).encode()
    block = 4096 if answer.get("regime") == "measured" else 1024
    text += b" " * (block - len(text) % block)  # so that the length does not reveal the answer
    commitment = hashlib.sha256(text).hexdigest()
    return f"{name} {commitment} {mask(text, key_of(name)).hex()}\n"


def key_of(name: str) -> str:
    """Key of the mask of a case's answer."""
    return f"vgroove gap bench {SEED} {name}"


def opened(path: Path) -> dict[str, dict[str, object]]:
    """All answers by case name; ValueError where a line differs from its commitment."""
    out = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        name, commitment, text = line.split(" ")
        plain = mask(bytes.fromhex(text), key_of(name))
        if hashlib.sha256(plain).hexdigest() != commitment:
            raise ValueError(f"{path}: the answer of {name} is not what was committed to")
        out[name] = json.loads(plain)
    return out


@dataclass(frozen=True)
class BlindSet:
    """A blind set: its plan by half and its regimes; `draw(entry)` gives (case, answer), the case
    is drawn again by `again(entry, answer)`; `write` and `ties` take a case.
    """

    plan: Callable
    regimes: tuple[str, ...]
    draw: Callable
    again: Callable
    write: Callable
    ties: Callable


def drawn(entry: Entry) -> tuple[Case, dict[str, object]]:
    """A case of the drivetrain and its answer."""
    case = draw_case(entry)
    return case, answer_of(case)


def drawn_impact(entry: impact_draw.ImpactEntry) -> tuple[object, dict[str, object]]:
    """A case of the impact tool and its answer."""
    case, attempt = impact_draw.draw_case(entry)
    return case, impact_draw.answer_of(entry, case, attempt)


def answered_impact(entry: impact_draw.ImpactEntry, answer: dict[str, object]) -> object:
    """The case of the impact tool of a sealed answer."""
    return impact_draw.case_again(
        entry, answer["attempt"], answer["sizes"], answer["times_visible"]
    )


def make(folder: Path, entries: list[Entry], blind: BlindSet) -> None:
    """Make the missing cases. An answer is sealed before its folder gets its name,
    and a case with a sealed answer is made by that answer.
    """
    path = folder / SEALED
    sealed = opened(path)
    for entry in entries:
        target = folder / "cases" / entry.name
        if entry.name not in sealed or not target.exists():
            answer = sealed.get(entry.name)
            case, new = (blind.again(entry, answer), None) if answer else blind.draw(entry)
            part = target.with_suffix(".part")
            blind.write(case, part)
            if new:
                append_sealed(path, new, entry.name)
            part.rename(target)
        sys.stdout.write(f"{entry.number} {entry.name}\n")
        sys.stdout.flush()


def answered_case(entry: Entry, answer: dict[str, object]) -> Case:
    """The case of a sealed answer."""
    rows = answer.get("disturbances", [])
    made = [Disturbance(d["id"], d["size"], d["seed"]) for d in rows]
    case = case_again(entry, answer["attempt"], answer["sizes"], answer["times_visible"], made)
    gaps = tuple(d["times_visible"] for d in rows)
    return replace(case, disturbed_by=gaps, share=answer.get("disturbed_share", 0.0))


def append_sealed(path: Path, answer: dict[str, object], name: str) -> None:
    """Append an answer to a sealed file."""
    with path.open("a", encoding="utf-8") as file:
        file.write(seal(answer, name))


def freeze(folder: Path, entries: list[Entry]) -> list[dict[str, object]]:
    """What frozen_case needs to make the sealed cases again without the search for their sizes, and
    their ties: rows of tests/truth/fixed_cases.json.
    """
    answers = show(folder, entries, True, DRIVETRAIN)
    rows = []
    for entry in entries:
        answer = answers[entry.name]
        rows.append(
            {
                "half": entry.set,
                **{key: answer[key] for key in ("number", "attempt", "ids", "sizes", "ties")},
                "multiples": answer["times_visible"],
                **{key: answer[key] for key in DISTURBED if key in answer},
            }
        )
    return rows


def frozen_case(row: dict[str, object]) -> Case:
    """The case of a row of `freeze`; ValueError where the generator draws other effects."""
    entry = plan(row["half"])[row["number"]]
    case = answered_case(entry, {**row, "times_visible": row["multiples"]})
    if list(case.ids) != row["ids"]:
        raise ValueError(
            f"case {row['number']} of {row['half']} has {case.ids}, not {row['ids']}: "
            "freeze it again"
        )
    return case


def show(folder: Path, entries: list[Entry], with_ties: bool, blind: BlindSet) -> dict[str, object]:
    """Answers of the entries, with the ties that are known; with_ties computes the missing ones,
    which are kept in a sealed file of their own.
    """
    sealed = opened(folder / SEALED)
    out = {entry.name: sealed[entry.name] for entry in entries if entry.name in sealed}
    kept = folder / "ties.sealed"
    ties = opened(kept)
    for entry in entries if with_ties else []:
        if entry.name not in ties and entry.name in out:
            ties[entry.name] = {"ties": blind.ties(blind.again(entry, out[entry.name]))}
            append_sealed(kept, ties[entry.name], entry.name)
    return {name: answer | ties.get(name, {}) for name, answer in out.items()}


DRIVETRAIN = BlindSet(plan, REGIMES, drawn, answered_case, write_case, ties_of)
IMPACT = BlindSet(
    impact_plan,
    IMPACT_REGIMES,
    drawn_impact,
    answered_impact,
    impact_draw.write_case,
    impact_assess.ties_of,
)


def parser_of_options() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("list", "make", "open", "freeze"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--impact", action="store_true", help="the cases of the impact tool")
    parser.add_argument("--set", dest="half", choices=SETS, default="tune")
    parser.add_argument("--numbers", default="all", help="numbers with commas")
    parser.add_argument(
        "--regime",
        default="all",
        help="regimes with commas: exact, hard, measured; of the impact tool exact, loose",
    )
    parser.add_argument(
        "--ties",
        action="store_true",
        help="open: with the effects that cannot be distinguished from the truth",
    )
    parser.add_argument(
        "--kinds",
        action="store_true",
        help="list: with kinds and ids, which the bench must not read",
    )
    return parser


def main(arguments: list[str]) -> int:
    parser = parser_of_options()
    args = parser.parse_args(arguments)
    blind = IMPACT if args.impact else DRIVETRAIN
    entries = blind.plan(args.half)
    if args.numbers != "all":
        entries = [entries[int(n)] for n in args.numbers.split(",") if n]
    if args.regime != "all":
        wanted = args.regime.split(",")
        if unknown := sorted(set(wanted) - set(blind.regimes)):
            parser.error(f"no regime {unknown[0]}")
        entries = [entry for entry in entries if entry.regime in wanted]
    args.folder.mkdir(parents=True, exist_ok=True)
    if args.what == "make":
        make(args.folder, entries, blind)
    elif args.what == "freeze":
        if args.impact:
            parser.error("only cases of the drivetrain are frozen")
        sys.stdout.write(json.dumps(freeze(args.folder, entries), indent=1) + "\n")
    elif args.what == "open":
        sys.stdout.write(json.dumps(show(args.folder, entries, args.ties, blind)) + "\n")
    else:
        rows = [
            [e.number, e.name, *([e.kind, e.regime, e.first] if args.kinds else [])]
            for e in entries
        ]
        sys.stdout.write(json.dumps(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
