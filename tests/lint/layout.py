"""Which files a formatter would change: clang-format for C and C++, ruff for Python.
`python tests/lint/layout.py --fix` formats all of them.
"""

import subprocess
import sys

import rules

GENERATED = ("firmware/telemetry/telemetry_signals.", "tests/vectors/firmware_vectors.h")
STYLE = f"--style=file:{rules.ROOT}/.clang-format"
RUFF = [sys.executable, "-m", "ruff", "format"]


def unformatted(paths: list[str]) -> list[str]:
    """Those of the C and C++ files that clang-format would write in another way."""
    if not paths:
        return []
    command = ["clang-format", "--dry-run", "-Werror", STYLE, *paths]
    done = subprocess.run(command, cwd=rules.ROOT, capture_output=True, text=True, check=False)
    found = {
        line.split(":")[0]
        for line in done.stderr.splitlines()
        if "-Wclang-format-violations" in line
    }
    if done.returncode and not found:
        raise SystemExit(done.stderr)
    return sorted(found)


def unformatted_python(paths: tuple[str, ...] = (".",)) -> list[str]:
    """Those of the Python files that `ruff format` would write in another way."""
    command = [*RUFF, "--diff", *paths]
    done = subprocess.run(command, cwd=rules.ROOT, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise SystemExit(done.stderr)
    start = "+++ "
    return sorted(
        line.removeprefix(start) for line in done.stdout.splitlines() if line.startswith(start)
    )


def written_by_hand() -> list[str]:
    """C and C++ files of the tree but the generated ones."""
    return [path for path in rules.tracked_files(rules.C_ENDINGS) if not path.startswith(GENERATED)]


def fix() -> None:
    """Format all files."""
    paths = unformatted(written_by_hand())
    if paths:
        subprocess.run(["clang-format", "-i", STYLE, *paths], cwd=rules.ROOT, check=True)
    subprocess.run([*RUFF, "."], cwd=rules.ROOT, check=True)


if __name__ == "__main__":
    if "--fix" in sys.argv:
        fix()
    raise SystemExit("\n".join([*unformatted(written_by_hand()), *unformatted_python()]) or 0)
