"""The board's clock from the low byte of its tick counter: waits of any length are resolved."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vgroove.real_time import Exchange, RealTimeRun, timing_figures
from vgroove.real_time.board_clock import SAFE_TICKS, BoardClock
from vgroove.real_time.frames import TICK_S, Drive

LINE_S = 4e-4  # of the host's clock, in one direction
STEP_S = 1e-4


@dataclass(frozen=True)
class Stop:
    """The host stands still for `ms` of the board's clock: before it reads the answer of a tick, or
    between reading it and sending the inputs that follow.
    """

    tick: int
    ms: int
    before_reading: bool


class Answer(NamedTuple):
    """A tick of the simulated exchange, and when the board's clock began it (ticks)."""

    drive: Drive
    waited: bool
    sent_s: float
    received_s: float
    ticks: int


def exchange(pace: float, stops: list[Stop], count: int) -> Iterator[Answer]:
    """Simulate the exchange: a tick begins at the first tick of the board's timer at which its
    inputs, sent after the answer of the tick before the last one, have arrived.
    """
    sent, ticks, host_s = {1: 0.0, 2: 0.0}, 200, 0.0
    for tick in range(1, count + 1):
        arrived = -int(-(sent[tick] + LINE_S) * pace // TICK_S) + 200
        begun, ticks = ticks, max(ticks + 1, arrived)
        stop_s = {
            stop.before_reading: stop.ms * TICK_S / pace for stop in stops if stop.tick == tick
        }
        host_s = max(host_s + stop_s.get(True, 0.0), (ticks - 200) * TICK_S / pace + LINE_S)
        received_s = host_s
        host_s += STEP_S + stop_s.get(False, 0.0)
        sent[tick + 2] = host_s
        drive = Drive(tick, False, 0, 0, clock_tick=ticks % 256)
        yield Answer(drive, ticks - begun > SAFE_TICKS, sent[tick], received_s, ticks)


STOPS = st.lists(
    st.builds(Stop, st.integers(40, 400), st.integers(1, 3000), st.booleans()), max_size=6
)


@settings(deadline=None)
@given(st.sampled_from([0.05, 0.2, 0.3, 0.7, 1.0, 1.5]), STOPS)
def test_waits_of_any_length_are_resolved(pace: float, stops: list[Stop]) -> None:
    clock, found, expected = BoardClock(), [], []
    for answer in exchange(pace, stops, 420):
        drive, waited, sent_s, received_s, ticks = answer
        found.append(round(clock.seconds(drive, waited, sent_s, received_s) / TICK_S))
        expected.append(ticks)
    assert found == [ticks - expected[0] for ticks in expected]


@pytest.mark.parametrize("before_reading", [True, False])
def test_the_figures_hold_a_wait_of_450_ms(before_reading: bool) -> None:
    clock, run = BoardClock(), RealTimeRun()
    for answer in exchange(0.3, [Stop(200, 450, before_reading)], 1000):
        drive, waited, sent_s, received_s, _ = answer
        board_s = clock.seconds(drive, waited, sent_s, received_s)
        run.exchanges.append(Exchange(drive.tick, received_s, sent_s, STEP_S, board_s))
    figures = timing_figures(run)
    assert figures["held_ticks"] == pytest.approx(450, abs=3)
    assert [step["tick"] for step in figures["late_steps"]] == [202]
    assert figures["latency_ticks"]["worst"] == pytest.approx(450, abs=4)
    assert 1.0 / (1.0 + figures["clock"]["drift"]) == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize("lost", [300, 450])
def test_a_wait_is_resolved_where_the_frame_of_the_opened_bridge_was_lost(lost: int) -> None:
    clock = BoardClock()
    for answer in exchange(1.0, [Stop(200, lost, True)], 210):
        drive, _, sent_s, received_s, ticks = answer
        board_s = clock.seconds(drive, False, sent_s, received_s)
    assert round(board_s / TICK_S) == ticks - 201
