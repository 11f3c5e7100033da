"""Tools of their own, from the diagnosis to the adapted firmware: drawn tools of the independent
simulator (tests/truth) are recorded in a run-up without load and on a joint that does not turn, the
logs are diagnosed with the rig of the reference tool, `vgroove adapt` makes the firmware of the
corrected rig, and torque control drives the same tool with the firmware of the reference tool, with
that of the corrected rig, and with that of the tool's true values.

`diagnosed_tools.py [--first N] [--tools N] [--drives N] [--jobs N]` prints the figures as JSON.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.progress import track

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / name) for name in ("demo", "truth")]

from bench_run import REST_S, DemoRun, record_run  # noqa: E402
from impact_cases import hidden_state  # noqa: E402
from impact_joints import Roughness, slip_torque  # noqa: E402
from impact_rigs import LOCKED_NM, ImpactRig, impact_params, reference_rig  # noqa: E402
from impact_tool import ImpactTruthTool, SlipTorque  # noqa: E402
from sealed import TOOL_NOISE  # noqa: E402

from vgroove import telemetry  # noqa: E402
from vgroove.adapt.firmware_image import map_in_flash  # noqa: E402
from vgroove.board import PERIOD_S, default_elf  # noqa: E402
from vgroove.control_bench import torque_drawn  # noqa: E402
from vgroove.control_bench.draw import (  # noqa: E402
    DRIVE,
    TOOL,
    TOOL_SHARE,
    TOOL_VALUES,
    Span,
    drawn,
)
from vgroove.control_bench.runs import pull  # noqa: E402
from vgroove.control_bench.torque import DriveEnd  # noqa: E402
from vgroove.eeprom_image import eeprom_image, mode_number  # noqa: E402
from vgroove.lockstep import LockstepOptions, Profile, steps  # noqa: E402
from vgroove.reference.rigs import with_load  # noqa: E402
from vgroove.rig import Rig, read_rig, write_rig  # noqa: E402
from vgroove.sil import SilBoard  # noqa: E402

TOOLS, DRIVES, SEED = 4, 36, 20261127
# Values that are off beside those of the controllers' bench: the geometry of groove and lug, and
# the mass of the hammer
GEOMETRY = (
    "mechanism.groove_lead_m_per_rad",
    "mechanism.lug_height_m",
    "mechanism.hammer_mass_kg",
)
KEYS = (*TOOL_VALUES, *GEOMETRY)
SPANS = {**TOOL, **{key: Span(1.0 - TOOL_SHARE, 1.0 + TOOL_SHARE) for key in GEOMETRY}}
TOLERANCE = TOOL_SHARE / 3**0.5  # standard deviation of a value that is drawn uniformly
JOINT = {"stiffness_nm_per_rad": 3000.0, "damping_nm_s_per_rad": 0.3, "loosen_ratio": 0.75}
RUNS = {
    "run_up": JOINT | {"run_torque_nm": 0.05, "slip_slope_nm_per_rad": 0.0},
    "locked": JOINT | {"run_torque_nm": LOCKED_NM, "slip_slope_nm_per_rad": 0.0},
}
# Three levels of the trigger, for 0.8 s each
PULLS, PULLED_S = (0.5, 0.7, 1.0), 0.8
REFERENCE, CORRECTED, TRUE = "reference tool", "corrected rig", "true values"
HEAD = 4  # column of the head angle among a simulator's blows
Kept = Callable[[Path, str, Callable[[], dict]], dict]  # proof.kept
Firmware = tuple[dict[str, float], bytes | None]  # parameters, torque map (None: the built-in one)


@dataclass(frozen=True)
class TrueTool:
    """A drawn tool. shares: of the reference values, and the friction of the grooves, by key."""

    number: int
    shares: Mapping[str, float]

    def on(self, load: Mapping[str, float], **values: float) -> ImpactRig:
        """The tool on a hard joint, with other values of its rig, if given."""
        rig = reference_rig("hard_joint", **load)
        own = {key: rig[key] * self.shares[key] for key in KEYS}
        return replace(rig, values=rig.values | own, pwm_hz=1.0 / PERIOD_S).with_values(**values)

    def driven(self, rig: ImpactRig, slip: SlipTorque, **start: float) -> ImpactTruthTool:
        """The simulator of the tool in lock-step with a board; start: angles and seed."""
        friction = {"groove_friction": self.shares["groove_friction"]}
        return ImpactTruthTool(slip, **(impact_params(rig) | TOOL_NOISE | friction | start))

    def true_rig(self, rig: Rig) -> Rig:
        """The rig of the reference tool with the tool's true values."""
        values = {key: rig.value(key) * self.shares[key] for key in KEYS}
        friction = {"groove_friction": {"coefficient": self.shares["groove_friction"]}}
        return rig.with_values(values).with_effects(friction)


def drawn_tools(count: int) -> list[TrueTool]:
    """`count` tools by Latin hypercube sampling."""
    return [TrueTool(n, shares) for n, shares in enumerate(drawn(SPANS, count, (SEED,)))]


def record(tool: TrueTool, name: str, folder: Path) -> Path:
    """The log of one of RUNS: the ELF on the simulated ATmega drives the tool, and its telemetry is
    recorded from a pseudo-terminal.
    """
    begin = [REST_S + n * PULLED_S for n in range(len(PULLS))]
    travel = [(0.0, 0.0), (REST_S, 0.0)]
    for time_s, level in zip(begin, PULLS, strict=True):
        travel += [(time_s, level), (time_s + PULLED_S, level)]
    seed = SEED + 10 * tool.number + list(RUNS).index(name)
    rig = tool.on(RUNS[name])
    angles, roughness = hidden_state(rig, seed)
    driven = tool.driven(rig, slip_torque(rig, {}, roughness), seed=seed + 1.0, **angles)
    run = DemoRun(Profile(travel=travel), travel[-1][0], seed)
    folder.mkdir()
    return record_run(default_elf("uno"), driven, folder, run, lambda _: None).log


def vgroove(*arguments: str | Path) -> None:
    """Run a command as a user does; RuntimeError with what it printed where it fails."""
    command = [sys.executable, "-m", "vgroove.cli", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"vgroove {arguments[0]} ended with {done.returncode}: {done.stderr}")


def diagnosed(tool: TrueTool, rig: Rig, folder: Path) -> tuple[Rig, dict[str, Any]]:
    """The corrected rig that the diagnosis of the tool's logs writes, and its verdict in short."""
    assumed = replace(
        with_load(rig, hard_joint("locked")), tolerance=dict.fromkeys(KEYS, TOLERANCE)
    )
    write_rig(assumed, folder / "rig.toml")
    logs, joints = [], []
    for name in RUNS:
        joint = folder / f"{name}.toml"
        numbers = (f"{key} = {value}" for key, value in RUNS[name].items())
        joint.write_text("\n".join(["[load]", 'kind = "hard_joint"', *numbers]) + "\n")
        logs.append(record(tool, name, folder / name))
        joints += ["--joint", joint]
    corrected, verdict = folder / "corrected.toml", folder / "verdict.json"
    begin = time.monotonic()
    given = ["gap", "diagnose", *logs, "--rig", folder / "rig.toml", *joints]
    vgroove(*given, "--json", verdict, "--out-rig", corrected)
    seconds = time.monotonic() - begin
    found = json.loads(verdict.read_text(encoding="utf-8"))
    short = {"verdict": found["verdict"], "selected": found["selected"]}
    gap = {key: round(found["gap"][key], 3) for key in ("before", "retuned", "after")}
    return read_rig(corrected), {**short, **gap, "seconds": round(seconds)}


def hard_joint(name: str) -> dict[str, Any]:
    """The section [load] of one of RUNS."""
    return {"kind": "hard_joint", **RUNS[name]}


def adapted(rig: Rig, folder: Path) -> Firmware:
    """Parameters and torque map of the firmware that `vgroove adapt` writes for a rig."""
    folder.mkdir()
    write_rig(rig, folder / "rig.toml")
    elf, result = folder / "vgroove.elf", folder / "adapt.json"
    vgroove("adapt", folder / "rig.toml", "-o", elf, "--json", result, "--drives", "0")
    found = json.loads(result.read_text(encoding="utf-8"))
    return {row["name"]: row["value"] for row in found["parameters"]}, map_in_flash(elf)


def drive(tool: TrueTool, cell: Mapping[str, float], seed: int, firmware: Firmware) -> dict:
    """One tightening: target, error of the torque that the joint holds, and the stop reason, as
    torque_drawn.work.
    """
    target = float(int(cell["target_nm"]))
    load = RUNS["locked"] | {"run_torque_nm": 0.3, "slip_slope_nm_per_rad": cell["slope"]}
    rig = tool.on(load, supply__voltage_v=cell["supply_v"])
    turn = target / cell["slope"]
    rough = {
        "joint_friction": cell["joint_friction"] - 1.0,
        "knot_nm": cell["rough_share"] * target,
        "knot_from_rad": cell["rough_at"] * turn,
        "knot_to_rad": (cell["rough_at"] + torque_drawn.ROUGH_WIDTH) * turn,
    }
    slip = slip_torque(rig, rough, Roughness(0.0, 1.0, seed))
    driven = tool.driven(rig, slip, seed=seed + 1.0, hammer_start_rad=cell["start_rad"])
    parameters, torque_map = firmware
    mode = {"torque_target_nm": target, "mode": mode_number(torque_drawn.CONTROLLER.mode)}
    ended, limit = DriveEnd(), torque_drawn.MAX_SECONDS
    with SilBoard(eeprom=eeprom_image({**parameters, **mode}), torque_map=torque_map) as board:
        pulled = pull(cell["trigger"])
        for now in steps(board, driven, pulled, limit, LockstepOptions(seed=seed)):
            if ended(driven, now):
                break
    error = held_nm(driven, slip) / target - 1.0
    return {"target_nm": target, "error": error, "reason": stop_reason(bytes(now.sent))}


def held_nm(driven: ImpactTruthTool, slip: SlipTorque) -> float:
    """Slip torque of the joint at the head angle after the last blow, N m."""
    blows = driven.blows()
    angle = blows[-1, HEAD] if len(blows) else 0.0
    angles = slip.first_rad + slip.step_rad * np.arange(len(slip.forward_nm))
    return float(np.interp(angle, angles, slip.forward_nm))


def stop_reason(sent: bytes) -> str:
    """The last stop reason of a drive's telemetry."""
    session = telemetry.Session()
    session.feed(telemetry.Framer().feed(sent))
    reasons = session.take_rows()["stop_reason"]
    last = int(reasons[np.isfinite(reasons)][-1])
    return telemetry.value_table("CONTROL", "stop_reason")[last]


def drives(tool: TrueTool, firmware: Firmware, count: int, jobs: int) -> list[dict[str, Any]]:
    """The same `count` drawn drives of a tool for each firmware."""
    cells = drawn({**DRIVE, **torque_drawn.SPANS}, count, (SEED, tool.number, 1))
    seeds = [SEED + 1000 * tool.number + n for n in range(count)]
    with ProcessPoolExecutor(jobs) as pool:
        return list(pool.map(partial(drive, tool, firmware=firmware), cells, seeds))


def chain(tool: TrueTool, count: int, jobs: int) -> dict[str, Any]:
    """Diagnosis, values and drives of one tool."""
    rig = read_rig(TESTS / "demo" / "rig_impact.toml")
    with TemporaryDirectory() as name:
        folder = Path(name)
        corrected, verdict = diagnosed(tool, rig, folder)
        true = tool.true_rig(with_load(rig, hard_joint("locked")))
        firmwares = {
            REFERENCE: ({}, None),
            CORRECTED: adapted(corrected, folder / "corrected"),
            TRUE: adapted(true, folder / "true"),
        }
    return {
        "tool": tool.number,
        "shares": {key: round(share, 4) for key, share in tool.shares.items()},
        "corrected": {key: round(corrected.value(key) / rig.value(key), 4) for key in KEYS},
        "diagnosis": verdict,
        "drives": {name: drives(tool, fw, count, jobs) for name, fw in firmwares.items()},
    }


def summary(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Figures of torque_drawn.compare of each firmware over all tools, each tool as one unit of the
    intervals, and the tools one by one without their single drives.
    """
    compared, tools = {}, []
    for name in (REFERENCE, CORRECTED, TRUE):
        compared[name] = torque_drawn.compare(
            [{**row, "tool": one["shares"]} for one in found for row in one["drives"][name]]
        )
    for one in found:
        each = {name: torque_drawn.compare(rows) for name, rows in one["drives"].items()}
        kept = ("reached", "beyond_goal", "missed_reported_reached", "mean_error", "std", "worst")
        short = {name: {key: of.get(key) for key in kept} for name, of in each.items()}
        tools.append({**one, "drives": short})
    return {
        "drives_of_a_tool": compared[TRUE]["runs"] // len(found),
        "all": compared,
        "tools": tools,
    }


def diagnosed_tools(folder: Path, jobs: int, kept: Kept) -> dict[str, Any]:
    """The figures of all tools; finished tools are kept in a folder."""
    found = []
    for tool in track(drawn_tools(TOOLS), "tools"):
        work = partial(chain, tool, DRIVES, jobs)
        found.append(kept(folder, f"diagnosed_tool_{tool.number}", work))
    return summary(found)


def main() -> int:
    """Print the figures of the chosen tools."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="number of the first tool")
    parser.add_argument("--tools", type=int, default=TOOLS)
    parser.add_argument("--drives", type=int, default=DRIVES, help="of each tool and firmware")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    chosen = drawn_tools(TOOLS)[options.first : options.first + options.tools]
    if not chosen:
        parser.error(f"there are {TOOLS} tools: --first is 0 to {TOOLS - 1}")
    found = [chain(tool, options.drives, options.jobs) for tool in chosen]
    sys.stdout.write(json.dumps(summary(found), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
