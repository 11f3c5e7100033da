"""The blind set's own command, `gap_bench.py list|make|open FOLDER [--set ...] [--numbers ...]`:
answers are sealed as cases are made.
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path

import numpy as np
from bench_draw import Case, accepts, case_again, draw_case, ties_of
from bench_plan import SEED, SETS, Entry, plan
from cases import Setting, columns
from effects import split
from responses import channels, hall_angle
from rigs import toml
from sealed import mask
from signals import Sensors

SEALED = "answers.sealed"
LOST = 0.01  # share of the rows that a logger of the kind "lost" never wrote
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
    """The log's columns as the rig's input and sensors ask for them."""
    rig, judged = setting.rig, channels(setting.rig)
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
    if "speed_rpm" not in judged:
        del table["speed_rpm"]
    if "position_rad" in judged:
        table["position_rad"] = (
            np.floor(hall_angle(angle, split(params)[0]) / rig.sensors.position_lsb_rad)
            * rig.sensors.position_lsb_rad
        )
    if setting.logger == "lost":
        here = rng.uniform(size=len(angle)) >= LOST
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
    """log.csv and rig.toml, nothing else."""
    folder.mkdir(parents=True, exist_ok=True)
    write_log(folder / "log.csv", log_table(case.setting, case.params))
    (folder / "rig.toml").write_text(toml(case.setting.rig), encoding="utf-8")


def answer_of(case: Case) -> dict[str, object]:
    """What is sealed about a case."""
    setting, rig, s = case.setting, case.setting.rig, case.setting.rig.sensors
    label = case.entry.kind if case.entry.kind in ("none", "unlisted") else "effect"
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
        "tool": {key: getattr(setting.tool, key.split(".")[1]) for key in rig.tolerance},
        "input": rig.input,
        "bus": rig.bus if rig.input == "duty" else "none",
        "sensor": sensor_word(s),
        "position": s.position_lsb_rad > 0.0,
        "profile": setting.profile.name,
        "two_way": setting.profile.two_way,
        "load": rig.load == "torque",
        "logger": setting.logger,
        "seconds": setting.seconds,
        "log_hz": s.log_hz,
        "rig": rig.name,
    }


def sensor_word(s: Sensors) -> str:
    """What measures the speed."""
    if s.hall_pulses_per_rev:
        return "hall" if s.hall_pulses_per_rev < 16 else "encoder"
    return "tachometer" if s.speed_noise_rpm else "angle"


def seal(answer: dict[str, object], name: str) -> str:
    """A line of the sealed file: name, commitment, masked answer."""
    text = json.dumps(answer, sort_keys=True).encode()
    text += b" " * (1024 - len(text) % 1024)
    commitment = hashlib.sha256(text).hexdigest()
    return f"{name} {commitment} {mask(text, key_of(name)).hex()}\n"


def key_of(name: str) -> str:
    return f"vgroove gap bench {SEED} {name}"


def opened(path: Path) -> dict[str, dict[str, object]]:
    """All answers by case name; ValueError when a line is not what was committed to."""
    out = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        name, commitment, text = line.split(" ")
        plain = mask(bytes.fromhex(text), key_of(name))
        if hashlib.sha256(plain).hexdigest() != commitment:
            raise ValueError(f"{path}: the answer of {name} is not what was committed to")
        out[name] = json.loads(plain)
    return out


def make(folder: Path, entries: list[Entry]) -> None:
    """Make the cases that are missing; each one's answer is sealed before its folder gets its name,
    and what is sealed is made as it is.
    """
    path = folder / SEALED
    here = opened(path)
    for entry in entries:
        target = folder / "cases" / entry.name
        if entry.name not in here or not target.exists():
            a = here.get(entry.name)
            case = (
                case_again(entry, a["attempt"], a["sizes"], a["times_visible"])
                if a
                else draw_case(entry)
            )
            fresh = target.with_suffix(".part")
            write_case(case, fresh)
            if entry.name not in here:
                with path.open("a", encoding="utf-8") as file:
                    file.write(seal(answer_of(case), entry.name))
            fresh.rename(target)
        sys.stdout.write(f"{entry.number} {entry.name}\n")
        sys.stdout.flush()


def freeze(folder: Path, entries: list[Entry]) -> list[dict[str, object]]:
    """What makes sealed cases again without their search, ties included: for sets that stand in the
    repository.
    """
    known = show(folder, entries, with_ties=True)
    rows = []
    for entry in entries:
        answer = known[entry.name]
        rows.append(
            {
                "half": entry.set,
                **{key: answer[key] for key in ("number", "attempt", "ids", "sizes", "ties")},
                "multiples": answer["times_visible"],
            }
        )
    return rows


def thawed(row: dict[str, object]) -> Case:
    """The case of a row of `freeze`; ValueError when the generator would draw another."""
    case = case_again(
        plan(row["half"])[row["number"]], row["attempt"], row["sizes"], row["multiples"]
    )
    if list(case.ids) != row["ids"]:
        raise ValueError(
            f"case {row['number']} of {row['half']} holds {case.ids}, not {row['ids']}: "
            "freeze it again"
        )
    return case


def show(folder: Path, entries: list[Entry], with_ties: bool) -> dict[str, object]:
    """Answers of the entries; with ties as far as they are asked for, which are kept beside the
    sealed file.
    """
    here = opened(folder / SEALED)
    out = {entry.name: here[entry.name] for entry in entries if entry.name in here}
    kept = folder / "ties.sealed"
    known = opened(kept)
    for entry in entries if with_ties else []:
        if entry.name not in known and entry.name in out:
            a = out[entry.name]
            known[entry.name] = {
                "ties": ties_of(case_again(entry, a["attempt"], a["sizes"], a["times_visible"]))
            }
            with kept.open("a", encoding="utf-8") as file:
                file.write(seal(known[entry.name], entry.name))
    return {name: answer | known.get(name, {}) for name, answer in out.items()}


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("list", "make", "open", "freeze"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", dest="half", choices=SETS, default="tune")
    parser.add_argument("--numbers", default="all", help="numbers with commas")
    parser.add_argument(
        "--ties",
        action="store_true",
        help="open: say also who cannot be told from the truth in principle",
    )
    parser.add_argument(
        "--kinds", action="store_true", help="list: with kinds and ids, for people only"
    )
    args = parser.parse_args(arguments)
    entries = plan(args.half)
    entries = (
        entries
        if args.numbers == "all"
        else [entries[int(n)] for n in args.numbers.split(",") if n]
    )
    args.folder.mkdir(parents=True, exist_ok=True)
    if args.what == "make":
        make(args.folder, entries)
    elif args.what == "freeze":
        sys.stdout.write(json.dumps(freeze(args.folder, entries), indent=1) + "\n")
    elif args.what == "open":
        sys.stdout.write(json.dumps(show(args.folder, entries, args.ties)) + "\n")
    else:
        rows = [
            [e.number, e.name, *([e.kind, e.regime, e.first] if args.kinds else [])]
            for e in entries
        ]
        sys.stdout.write(json.dumps(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
