"""The verdict of `vgroove gap diagnose`, run as a command, for the evaluations of this folder."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def command_verdict(logs: Sequence[Path], rig: Path, out: Path, timeout_s: float) -> dict[str, Any]:
    """Verdict of the command line, which writes it to the file `out`; where it reaches none within
    timeout_s, the command's message in place of the verdict.
    """
    line = [sys.executable, "-m", "vgroove.cli", "gap", "diagnose", *logs]
    line += ["--rig", rig, "--json", out]
    try:
        done = subprocess.run(
            line, capture_output=True, text=True, check=False, cwd=ROOT, timeout=timeout_s
        )
    except subprocess.TimeoutExpired:
        return {"verdict": f"no verdict within {timeout_s:g} s"}
    if done.returncode:
        return {"verdict": f"exit code {done.returncode}: {done.stderr.strip()[-200:]}"}
    return json.loads(out.read_text(encoding="utf-8"))
