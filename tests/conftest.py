"""Settings of all tests. BLAS uses one thread in each worker. Programs that a test starts receive
Ctrl-C and SIGHUP even where the shell ignores them (a job in the background, nohup). The tests of a
file run on one worker, so that its fixtures are made once. Tests marked `proof` run only with
--proof.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

# before numpy is imported: threads of BLAS beside those of the other workers only wait
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def simulated_gap(tmp_path: Path) -> Callable[[Path, Path], float]:
    """`vgroove sim` of a rig along a log, as a user runs it: (rig, log) -> gap in standard
    deviations.
    """

    def run(rig: Path, log: Path) -> float:
        out = tmp_path / "simulated_gap.json"
        command = [sys.executable, "-m", "vgroove.cli", "sim", rig, "--log", log, "--json", out]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(out.read_text())["gap"]

    return run


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --proof."""
    parser.addoption("--proof", action="store_true", help="Run the tests marked `proof` alone.")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Select the tests marked `proof` or all others. Make each file a group of `--dist loadgroup`,
    unless its tests name groups themselves: those are long and are scheduled first, so that no
    worker is idle at the end.
    """
    wanted = config.getoption("proof")
    left_out = [i for i in items if (i.get_closest_marker("proof") is not None) != wanted]
    items[:] = [i for i in items if (i.get_closest_marker("proof") is not None) == wanted]
    config.hook.pytest_deselected(items=left_out)
    items.sort(key=lambda item: item.get_closest_marker("xdist_group") is None)
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(str(item.path)))
