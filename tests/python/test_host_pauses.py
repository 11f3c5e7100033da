"""The host's side of real-time runs: pauses of the computer are seen and explain late steps, the
priorities of a run are taken back, stimuli drawn ahead change nothing.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from test_real_time import made_run, scenario_of
from vgroove.errors import VgrooveError
from vgroove.real_time import timing_figures, worker_priority
from vgroove.real_time.beside_program import start_beside
from vgroove.real_time.figures import late_sentence
from vgroove.real_time.frames import Drive
from vgroove.real_time.pauses import PROGRAM, Pauses, watch_pauses
from vgroove.real_time.priority import undisturbed, workers_prioritised
from vgroove.real_time.tool_ticks import ToolTicks

PAUSE_S = 0.03

# two of the tests change the same threads of the kernel
pytestmark = pytest.mark.xdist_group("kernel_workers")


def real_time_is_permitted() -> bool:
    with undisturbed() as prioritised:
        return prioritised


needs_real_time = pytest.mark.skipif(
    not real_time_is_permitted(), reason="this user may not take real-time priority"
)


@pytest.fixture
def watching() -> Iterator[subprocess.Popen[str]]:
    """A running pause_watch.py on processor 0."""
    program, first = start_beside(PROGRAM, "0")
    with program:
        assert first == "ready"
        yield program
        program.kill()


@needs_real_time
def test_a_pause_is_seen_with_its_time_and_length(watching: subprocess.Popen[str]) -> None:
    time.sleep(0.05)
    begin = time.monotonic()
    watching.send_signal(signal.SIGSTOP)
    time.sleep(PAUSE_S)
    watching.send_signal(signal.SIGCONT)
    end = time.monotonic()
    time.sleep(0.05)
    lines = watching.communicate()[0].splitlines()
    spans = [tuple(map(float, line.split())) for line in lines]
    first, last = max(spans, key=lambda span: span[1] - span[0])
    assert last - first > PAUSE_S - 2e-3
    assert begin - 2e-3 < first < begin + 2e-3
    assert end - 2e-3 < last < end + 20e-3


def watching_children() -> list[int]:
    """Process numbers of the running pause_watch.py that this process started."""
    found = []
    for number in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
        if PROGRAM.name in Path(f"/proc/{number}/cmdline").read_text():
            found.append(int(number))
    return found


@needs_real_time
def test_every_processor_is_watched_and_the_programs_end() -> None:
    with watch_pauses() as pauses:
        assert pauses is not None
        children = watching_children()
        assert len(children) == len(os.sched_getaffinity(0))
    assert watching_children() == []


def test_a_pause_explains_its_own_time_and_as_long_after_it() -> None:
    pauses = Pauses()
    pauses.spans = [(10.0, 10.008)]
    assert not pauses.explain(9.999)
    assert pauses.explain(10.0) and pauses.explain(10.0179)
    assert not pauses.explain(10.0181)
    assert pauses.worst_s() == pytest.approx(0.008)
    assert Pauses().worst_s() == 0.0


def test_late_steps_in_pauses_of_the_computer_are_told_from_the_others() -> None:
    run = made_run({700: 3, 900: 1}, 0.0)
    at_s = run.exchanges[699].received_s
    run.pauses = Pauses()
    run.pauses.spans = [(at_s - 0.004, at_s - 0.001)]
    figures = timing_figures(run)
    assert [step["pause_of_computer"] for step in figures["late_steps"]] == [True, False]
    assert figures["pauses_of_computer"]["count"] == 1
    assert "1 of them while the computer itself stood still (up to 3.0 ms)" in late_sentence(
        figures
    )


def test_without_watching_nothing_is_said_of_pauses() -> None:
    figures = timing_figures(made_run({700: 3}, 0.0))
    assert figures["pauses_of_computer"] is None
    assert "stood still" not in late_sentence(figures)


def workers() -> dict[int, int]:
    """Process number -> scheduling policy of each worker thread of the kernel."""
    found = {}
    for process in worker_priority.workers():
        with suppress(ProcessLookupError):
            found[process] = os.sched_getscheduler(process)
    return found


@needs_real_time
def test_priorities_last_as_long_as_the_run() -> None:
    before = workers()
    if not before:
        pytest.skip("this system shows no threads of the kernel")
    with workers_prioritised(), undisturbed() as prioritised:
        assert prioritised
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
        within = workers()
        changed = [process for process in before if process in within]
        assert changed
        for process in changed:
            assert within[process] == os.SCHED_FIFO
            assert os.sched_getparam(process).sched_priority == worker_priority.PRIORITY
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
    after = workers()
    assert all(after[process] == before[process] for process in before if process in after)


@pytest.mark.skipif(os.getuid() != 0, reason="only root has rights to give up")
def test_without_the_right_to_it_the_option_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    without = tmp_path / "python"
    without.write_text(
        f'#!/bin/sh\nexec setpriv --bounding-set -sys_nice -- {sys.executable} "$@"\n'
    )
    without.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(without))
    with pytest.raises(VgrooveError, match="run as root, or without"), workers_prioritised():
        pass


@needs_real_time
def test_the_priorities_are_taken_back_when_the_run_is_killed() -> None:
    before = workers()
    if not before:
        pytest.skip("this system shows no threads of the kernel")
    script = (
        "import time\nfrom vgroove.real_time.priority import workers_prioritised\n"
        "with workers_prioritised():\n    print('begun', flush=True)\n    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as run:
        assert run.stdout is not None and run.stdout.readline() == b"begun\n"
        assert os.SCHED_FIFO in workers().values()
        run.kill()
    deadline = time.monotonic() + 5.0
    while os.SCHED_FIFO in workers().values() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert os.SCHED_FIFO not in workers().values()


def test_stimuli_drawn_ahead_change_no_input() -> None:
    plain, ahead = (ToolTicks(scenario_of("impact_hard_joint", 0.2)) for _ in range(2))
    for tick in range(1, 201):
        if tick > 2:
            command = Drive(tick - 2, False, 200, 0)
            plain.add_command(command)
            ahead.add_command(command)
        assert plain.inputs(tick) == ahead.inputs(tick)
        assert plain.command_frames(tick) == ahead.command_frames(tick)
        ahead.prepare()
