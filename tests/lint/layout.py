"""Which C and C++ files clang-format would change. `python tests/lint/layout.py --fix` formats all
and drops the list of the rest.
"""

import subprocess
import sys
from pathlib import Path

import house

GENERATED = ("firmware/telemetry/telemetry_signals.", "tests/vectors/firmware_vectors.h")
LATER = Path(__file__).with_name("unformatted.txt")


def unformatted(paths: list[str]) -> list[str]:
    """Those of the files that clang-format, with the .clang-format of the tree, would write
    otherwise.
    """
    if not paths:
        return []
    command = [
        "clang-format",
        "--dry-run",
        "-Werror",
        f"--style=file:{house.ROOT}/.clang-format",
        *paths,
    ]
    done = subprocess.run(command, cwd=house.ROOT, capture_output=True, text=True, check=False)
    found = {
        line.split(":")[0]
        for line in done.stderr.splitlines()
        if "-Wclang-format-violations" in line
    }
    if done.returncode and not found:
        raise SystemExit(done.stderr)
    return sorted(found)


def written_by_hand() -> list[str]:
    """C and C++ files of the tree but the generated ones."""
    return [path for path in house.tracked_files(house.C_ENDINGS) if not path.startswith(GENERATED)]


def listed() -> list[str]:
    """Files that still wait for their first formatting; the list may only become shorter."""
    return LATER.read_text(encoding="utf-8").split() if LATER.exists() else []


def fix(paths: list[str]) -> None:
    """Format the files."""
    subprocess.run(
        ["clang-format", "-i", f"--style=file:{house.ROOT}/.clang-format", *paths],
        cwd=house.ROOT,
        check=True,
    )


if __name__ == "__main__":
    if "--fix" in sys.argv:
        fix(unformatted(written_by_hand()))
        LATER.unlink(missing_ok=True)
    raise SystemExit("\n".join(set(unformatted(written_by_hand())) - set(listed())) or 0)
