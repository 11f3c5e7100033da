"""Share of the firmware-gap cases that are told rightly, `firmware_score.py FOLDER [--set ...]
[--json FILE]`: the folder is one that firmware_bench.py has made.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import firmware_bench

import gap_bench  # isort: skip
from bench_plan import SETS  # isort: skip
from vgroove.eeprom_image import parameter
from vgroove.firmware_replay.assumed_firmware import read_assumed_firmware
from vgroove.firmware_replay.kinds import FirmwareResult, judge_firmware
from vgroove.gap_bench.rates import wilson
from vgroove.log import read_log

PROOF = Path(__file__).resolve().parents[1] / "proof"
TICK_S = 5e-4  # half a row


def in_range(found: dict[str, Any], value: float) -> bool:
    """Whether the range of a found parameter holds the stored integer of a value."""
    scale = 2 ** parameter(found["name"]).q
    low, high = (round(end * scale) for end in found["range"])
    return low <= round(value * scale) <= high


def outcome(answer: dict[str, Any], result: FirmwareResult) -> dict[str, Any]:
    """What a case is, what the replay finds, and whether kind, tick and parameter are right."""
    kinds = answer["accept_what"] or [""]
    firmware = answer["kind"] == "firmware"
    tick = firmware and bool(result.first)
    tick = tick and abs(result.first["time_s"] - answer["first_s"]) < TICK_S
    found, true = result.details.get("parameter"), answer["deviation"]["params"]
    named = found is not None and found["name"] in true
    return {
        "case": answer["kind"],
        "mode": answer["mode"],
        "what": answer["what"],
        "found": result.kind,
        "told": bool(result.kind) == firmware,
        "right": result.kind in kinds,
        "tick": tick,
        "parameter": found and found["name"],
        "parameter_right": named,
        "value_right": named and in_range(found, true[found["name"]]),
    }


def share(flags: list[bool]) -> dict[str, Any]:
    """Hits of a list with their Wilson interval."""
    hits, count = sum(flags), len(flags)
    return {"hits": hits, "of": count, "ci95": list(wilson(hits, count))}


def figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares of the outcomes of a half."""
    firmware = [row for row in rows if row["case"] == "firmware"]
    others = [row for row in rows if row["case"] != "firmware"]
    plants = [row for row in rows if row["case"] == "single"]
    parameters = [row for row in firmware if row["what"] == "parameter"]
    return {
        "firmware_told_from_plant": share([row["told"] for row in rows]),
        "kind_right": share([row["right"] for row in rows]),
        "kind_right_of_firmware_gaps": share([row["right"] for row in firmware]),
        "tick_exact": share([row["tick"] for row in firmware]),
        "parameter_named": share([row["parameter_right"] for row in parameters]),
        "value_within_range": share([row["value_right"] for row in parameters]),
        "called_firmware_without_one": share([not row["told"] for row in others]),
        "plant_gaps_called_firmware": share([not row["told"] for row in plants]),
    }


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", dest="half", choices=SETS, default="tune")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    entries = firmware_bench.firmware_plan(args.half)
    answers = gap_bench.show(args.folder, entries, False, firmware_bench.FIRMWARE)
    rows = []
    for name, answer in answers.items():
        case = args.folder / "cases" / name
        log, assumed = read_log(case / "log.csv"), read_assumed_firmware(case / "firmware.json")
        rows.append(outcome(answer, judge_firmware(log, assumed)))
    sys.path.insert(0, str(PROOF))
    from proof import commit

    command = f"python tests/firmware_gap/firmware_score.py FOLDER --set {args.half}"
    result = {"commit": commit(), "command": command, "set": args.half, **figures(rows)}
    text = json.dumps(result | {"cases": rows}, indent=1) + "\n"
    if args.json:
        args.json.write_text(text, encoding="utf-8")
    sys.stdout.write(json.dumps(figures(rows), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
