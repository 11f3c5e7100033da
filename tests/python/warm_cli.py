"""The command line in a process that is forked from one that has imported its modules: half a
second less than a start of the interpreter. Each command is also started by `python -m` in a test.
"""

import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

MODULES = [
    "vgroove.cli",
    "vgroove.run",
    "vgroove.gap.command",
    "vgroove.gap.simulate",
    "vgroove.gap.page",
    "scipy.ndimage",
    "scipy.special",
]


@dataclass(frozen=True)
class Settings:
    """Of a command: its folder, its environment, and the size in bytes above which a file fails as
    on a full disk.
    """

    cwd: Path = field(default_factory=Path.cwd)
    environment: dict[str, str] = field(default_factory=lambda: dict(os.environ))
    limit: int | None = None


@cache
def _server() -> multiprocessing.context.ForkServerContext:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(MODULES)
    return context


def _main(line: Sequence[str], output: Path, errors: Path, settings: Settings) -> None:
    """Become the command: its arguments, streams, folder and limit."""
    for path, number in ((output, 1), (errors, 2)):
        os.dup2(os.open(path, os.O_WRONLY), number)
    sys.stdout, sys.stderr = (open(n, "w", closefd=False) for n in (1, 2))
    os.environ.clear()
    os.environ.update(settings.environment)
    os.chdir(settings.cwd)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if settings.limit is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (settings.limit, settings.limit))
    sys.argv = ["vgroove", *line]
    from vgroove.cli import main

    main()


def warm_vgroove(
    *arguments: object, settings: Settings | None = None, timeout: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run the command line; TimeoutExpired where it has not ended after `timeout` seconds."""
    line = list(map(str, arguments))
    with tempfile.TemporaryDirectory() as folder:
        output, errors = Path(folder) / "output", Path(folder) / "errors"
        output.touch()
        errors.touch()
        process = _server().Process(
            target=_main, args=(line, output, errors, settings or Settings())
        )
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(line, timeout)
        texts = output.read_text(), errors.read_text()
        return subprocess.CompletedProcess(line, process.exitcode, *texts)
