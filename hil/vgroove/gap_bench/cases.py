"""Cases of the blind set: made and opened by the command of the generator (tests/truth), which
shares no code with this package.
"""

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vgroove.errors import VgrooveError

COMMAND = Path("tests/truth/gap_bench.py")
# Sources on which a verdict depends; their digest is called the engine in results
SOURCES = (
    "hil/vgroove/gap/**/*.py",
    "hil/vgroove/rig*.py",
    "hil/vgroove/log/*.py",
    "hil/vgroove/telemetry/*.py",
    "hil/vgroove/reference/*.py",
    "hil/vgroove/units.py",
    "hil/vgroove/array_cache.py",
    "rigs/*.toml",
    "plant/**/*.?pp",
    "hil/bindings/*.cpp",
)


@dataclass(frozen=True)
class BlindSet:
    """A half of the set; `checkout` is the folder of the project, which holds the generator.
    impact: the cases of the hammering tool.
    """

    checkout: Path
    half: str
    impact: bool = False

    @property
    def folder(self) -> Path:
        """Folder of the half's cases, answers and verdicts."""
        return self.checkout / "build" / "gapbench" / ("impact_" * self.impact + self.half)

    def start(self, action: str, numbers: Sequence[int] = (), *more: str) -> subprocess.Popen[str]:
        """Start the generator's command for the cases of these numbers; without numbers for all."""
        chosen = ["--numbers", ",".join(map(str, numbers))] if numbers else []
        script = str(self.checkout / COMMAND)
        command = [sys.executable, script, action, str(self.folder), "--set", self.half]
        tool = ["--impact"] * self.impact
        return subprocess.Popen(
            [*command, *tool, *chosen, *more],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def names(self, numbers: Sequence[int] = (), regimes: Sequence[str] = ()) -> dict[int, str]:
        """Name of each case by its number; without numbers of all cases, or of those of these
        regimes.
        """
        more = ["--regime", ",".join(regimes)] if regimes else []
        listed = json.loads(finished(self.start("list", numbers, *more)))
        return {number: name for number, name in listed}

    def make(self, numbers: Sequence[int], made: Callable[[int], None]) -> None:
        """Make the missing ones of these cases; `made` is called with each number that exists."""
        with self.start("make", numbers) as process:
            for line in process.stdout or ():
                made(int(line.split()[0]))
            error = process.stderr.read() if process.stderr else ""
        check_generator(process.returncode, error)

    def answers(self, numbers: Sequence[int], with_ties: bool = False) -> dict[str, dict[str, Any]]:
        """Opened answers by name; to be called after the verdicts."""
        if not numbers:
            return {}
        return json.loads(finished(self.start("open", numbers, *(["--ties"] * with_ties))))

    def case(self, name: str) -> Path:
        """Folder of a case: log.csv and rig.toml."""
        return self.folder / "cases" / name

    def engine(self) -> str:
        """Digest of SOURCES, under which verdicts are kept."""
        digest = hashlib.sha256()
        for pattern in SOURCES:
            for path in sorted(self.checkout.glob(pattern)):
                digest.update(path.read_bytes())
        return digest.hexdigest()[:10]


def finished(process: subprocess.Popen[str]) -> str:
    """Wait for a command and return its output; VgrooveError with its last line if it failed."""
    out, error = process.communicate()
    check_generator(process.returncode, error)
    return out


def check_generator(status: int, error: str) -> None:
    """VgrooveError with the last line of `error` where the generator's exit code is not 0."""
    if status != 0:
        lines = error.strip().splitlines()
        raise VgrooveError(f"the generator failed: {lines[-1] if lines else status}")


def find_checkout() -> Path:
    """The project's checkout: at or above the working folder, else the one from which this package
    was installed (editable). VgrooveError without one.
    """
    for start in (Path.cwd(), Path(__file__).resolve().parent):
        for folder in (start, *start.parents):
            if (folder / COMMAND).exists():
                return folder
    raise VgrooveError(
        f"the blind set needs the project's checkout: no {COMMAND} here or above "
        "(it is no part of the installed package)"
    )
