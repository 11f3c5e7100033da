"""The demo: the firmware's ELF drives a tool with a sealed effect, its telemetry is recorded and
diagnosed, and then the sealed effect is compared with the verdict.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(HERE.parent / "truth")]

from bench_run import drive_run, impact_run, record_run  # noqa: E402
from sealed import draw_sealed, open_sealed  # noqa: E402
from sealed_impact import draw_sealed_impact  # noqa: E402

from vgroove.board import default_elf  # noqa: E402
from vgroove.lockstep import Progress  # noqa: E402

# Progress is shown every 16384 PWM periods (0.5 s); the loop reports it every 512 periods.
PROGRESS_PERIODS, REPORT_PERIODS = 16384, 512


def say(text: str = "") -> None:
    """Print a line immediately."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def show_progress(now: Progress) -> None:
    """Show the simulated time in one line that is overwritten, on terminals only."""
    if sys.stdout.isatty() and now.periods % PROGRESS_PERIODS < REPORT_PERIODS:
        sys.stdout.write(f"\r  {now.time_s:5.1f} s simulated, {len(now.sent)} bytes of telemetry ")
        sys.stdout.flush()


# Tool of the demo -> its rig, what draws it, and its run
TOOLS = {
    "drive": ("rig.toml", draw_sealed, drive_run),
    "impact": ("rig_impact.toml", draw_sealed_impact, impact_run),
}


def diagnose(log: Path, rig: str, folder: Path) -> dict:
    """Run `vgroove gap diagnose` as a user does, print its output and return its verdict."""
    verdict = folder / "verdict.json"
    command = [sys.executable, "-m", "vgroove.cli", "gap", "diagnose", str(log)]
    command += ["--rig", str(HERE / rig), "--json", str(verdict)]
    command += ["--html", str(folder / "report.html")]
    command += ["--out-rig", str(folder / "rig_corrected.toml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(
            f"vgroove gap diagnose ended with {done.returncode}: {done.stderr.strip()}"
        )
    say("".join(f"  {line}\n" for line in done.stdout.strip().splitlines()).rstrip("\n"))
    return json.loads(verdict.read_text(encoding="utf-8"))


def is_right(verdict: dict, answer: dict) -> bool:
    """Whether the verdict is of the sealed kind and, for effects, names each sealed effect or one
    that is indistinguishable from it, and no other effect.
    """
    if answer["label"] != "effect":
        return verdict["verdict"] == answer["label"]
    accepted = answer["accept"]
    named = verdict["selected"]
    return (
        verdict["verdict"] == "effect"
        and len(named) == len(accepted)
        and all(set(ids) & set(named) for ids in accepted)
    )


def answer_in_words(answer: dict) -> str:
    """The sealed answer in words."""
    if answer["label"] == "none":
        return "none: the tool is the nominal one"
    name = answer["ids"][0] if answer["ids"] else f"outside the catalogue ({answer['what']})"
    numbers = ", ".join(f"{key} = {value:.5g}" for key, value in answer["params"].items())
    return f"{name}, {answer['times_visible']:.1f} times the visible limit ({numbers})"


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    """Options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--tool",
        choices=list(TOOLS),
        default="impact",
        help="impact tool in a joint, or drivetrain alone",
    )
    parser.add_argument(
        "--elf", type=Path, default=default_elf("uno"), help="firmware of the ATmega328P"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=None,
        help="folder for log, verdict and report; default runs/demo_TOOL_SEED",
    )
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> int:
    """Run the demo; returns 0 when it reached its end. demo.json in its folder states whether the
    verdict was right.
    """
    args = parse_arguments(arguments)
    folder = args.out or ROOT / "runs" / f"demo_{args.tool}_{args.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    rig, draw, run = TOOLS[args.tool]
    sealed = draw(args.seed, folder)
    say(f"1  A tool is drawn by seed {args.seed}. Its effect is sealed; SHA-256 of the")
    say(f"   answer:\n  {sealed.commitment}")
    say("2  The ELF runs cycle by cycle on a simulated ATmega328P and drives that tool; python-can")
    say("   records its RS232 from a pty.")
    recorded = record_run(args.elf, sealed.tool, folder, run(args.seed), show_progress)
    say("\r" + "\n".join(f"  {line}" for line in recorded.summary.splitlines()))
    say("3  Where does this log depart from the nominal simulation, and which effect is missing?")
    verdict = diagnose(recorded.log, rig, folder)
    answer = open_sealed(sealed.path, sealed.commitment)
    right = is_right(verdict, answer)
    gap = verdict["gap"]
    say(f"4  The seal is opened: {answer_in_words(answer)}")
    named = f"{verdict['verdict']} {' '.join(verdict['selected'])}"
    gaps = f"before {gap['before']:.2f}, after {gap['after']:.2f}, floor {gap['floor']:.2f}"
    took = f"{time.monotonic() - begin:.0f} s"
    say(f"  verdict {named}: {'RIGHT' if right else 'WRONG'}; gap {gaps}; {took}")
    paths = {"log": recorded.log, "json": folder / "verdict.json", "plot": folder / "report.html"}
    for name, path in paths.items():
        say(f"  {name:5}{path}")
    result = {
        "seed": args.seed,
        "right": right,
        "verdict": verdict["verdict"],
        "selected": verdict["selected"],
        "gap": gap,
        "truth": answer,
    }
    (folder / "demo.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except (RuntimeError, FileNotFoundError) as error:
        sys.stderr.write(f"demo: {error}\n")
        sys.exit(1)
