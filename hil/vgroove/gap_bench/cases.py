"""Cases of the blind set as the bench gets them: made and opened by the generator's own command,
which shares nothing with this package.
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
SOURCES = (
    "hil/vgroove/gap/*.py",
    "hil/vgroove/rig.py",
    "hil/vgroove/log/*.py",
    "hil/vgroove/telemetry/*.py",
    "plant/*.?pp",
    "hil/bindings/*.cpp",
)


@dataclass(frozen=True)
class BlindSet:
    """A half of the set in its folder; `checkout` holds the generator."""

    checkout: Path
    half: str

    @property
    def folder(self) -> Path:
        return self.checkout / "build" / "gapbench" / self.half

    def ask(self, what: str, numbers: Sequence[int], *more: str) -> subprocess.Popen[str]:
        """Start the generator's command."""
        command = [
            sys.executable,
            str(self.checkout / COMMAND),
            what,
            str(self.folder),
            "--set",
            self.half,
            "--numbers",
            ",".join(map(str, numbers)),
            *more,
        ]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def names(self, numbers: Sequence[int]) -> dict[int, str]:
        """Name of each case by its number; without numbers all."""
        rows = json.loads(
            finished(self.ask("list", numbers)) if numbers else finished(self.ask_all())
        )
        return {number: name for number, name in rows}

    def ask_all(self) -> subprocess.Popen[str]:
        command = [
            sys.executable,
            str(self.checkout / COMMAND),
            "list",
            str(self.folder),
            "--set",
            self.half,
        ]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def make(self, numbers: Sequence[int], tell: Callable[[int], None]) -> None:
        """Make the cases that are not there yet; tells each number when it is."""
        with self.ask("make", numbers) as process:
            for line in process.stdout or ():
                tell(int(line.split()[0]))
            error = process.stderr.read() if process.stderr else ""
        if process.returncode != 0:
            raise VgrooveError(
                f"the generator failed: {error.strip().splitlines()[-1] if error.strip() else process.returncode}"
            )

    def answers(self, numbers: Sequence[int], with_ties: bool = False) -> dict[str, dict[str, Any]]:
        """Opened answers by name, after the verdicts."""
        return (
            json.loads(finished(self.ask("open", numbers, *(["--ties"] if with_ties else []))))
            if numbers
            else {}
        )

    def case(self, name: str) -> Path:
        return self.folder / "cases" / name

    def engine(self) -> str:
        """Digest of the sources that a verdict depends on."""
        digest = hashlib.sha256()
        for pattern in SOURCES:
            for path in sorted(self.checkout.glob(pattern)):
                digest.update(path.read_bytes())
        return digest.hexdigest()[:10]


def finished(process: subprocess.Popen[str]) -> str:
    """What a command printed; VgrooveError with its last line when it failed."""
    out, error = process.communicate()
    if process.returncode != 0:
        raise VgrooveError(
            f"the generator failed: {error.strip().splitlines()[-1] if error.strip() else process.returncode}"
        )
    return out


def find_checkout() -> Path:
    """The checkout that holds the generator: the working folder or one above it, else where this
    package was installed from (editable).
    """
    for start in (Path.cwd(), Path(__file__).resolve().parent):
        for folder in (start, *start.parents):
            if (folder / COMMAND).exists():
                return folder
    raise VgrooveError(
        f"the blind set needs the project's checkout: no {COMMAND} here or above (it is no part of the installed package)"
    )
