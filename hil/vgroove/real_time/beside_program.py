"""Small programs that run beside the exchange while it lasts; they end when their standard input is
closed, and thus also with this process.
"""

import subprocess
import sys
from pathlib import Path


def start_beside(program: Path, *arguments: str) -> tuple[subprocess.Popen[str], str]:
    """Start a Python program of the standard library; returns it and its first line, empty where it
    has none. `communicate()` ends it.
    """
    started = subprocess.Popen(
        [sys.executable, "-I", "-S", str(program), *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    first = "" if started.stdout is None else started.stdout.readline()
    return started, first.strip()
