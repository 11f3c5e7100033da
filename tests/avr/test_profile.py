"""The duty profile commanded by the host: limited by the trigger, ended 50 ms after its last frame,
and equal on the AVR bit for bit.
"""

from pathlib import Path

import numpy as np
import pytest
from budget import TICK_CYCLES_MAX
from equality import differences, sent_bytes
from profile_run import BEGIN_S, LASTS_S, profile_tape

from vgroove import board, sil, telemetry
from vgroove.board import read_statistics
from vgroove.log import Log, log_from_stream

TARGETS = {"uno_elf": ("atmega328p", 1), "mega_elf": ("atmega2560", 2)}


@pytest.fixture(scope="module")
def tape() -> bytes:
    return profile_tape()


@pytest.fixture(scope="module")
def log(tape: bytes) -> Log:
    return log_from_stream(sent_bytes(sil.replay(tape, target=1)), "profile")


def _duty_at(log: Log, time_s: float) -> float:
    row = int(np.searchsorted(log.time_s, time_s))
    return float("nan") if log["coast"][row] else float(log["duty"][row])


def test_the_stairs_are_driven_within_the_trigger(log: Log) -> None:
    assert _duty_at(log, BEGIN_S + 0.15) == pytest.approx(0.25, abs=0.005)
    assert _duty_at(log, BEGIN_S + 0.31) == pytest.approx(0.5, abs=0.005)
    assert _duty_at(log, BEGIN_S + 0.47) == pytest.approx(0.7, abs=0.02), "limited by the trigger"
    assert np.isnan(_duty_at(log, BEGIN_S + 0.62))
    assert _duty_at(log, BEGIN_S + 0.78) == pytest.approx(0.25, abs=0.005)


def test_the_drive_ends_50_ms_after_the_last_frame_until_the_release(log: Log) -> None:
    last_s = BEGIN_S + LASTS_S - 0.02
    held = (log.time_s > last_s) & (log.time_s < 1.4)
    ends_s = log.time_s[held][np.argmax(log["coast"][held] > 0)]
    assert 0.05 < ends_s - last_s < 0.08, "50 ms plus the time to read a command"
    assert (log["coast"][(log.time_s > ends_s) & (log.time_s < 1.4)] > 0).all()
    assert _duty_at(log, 1.8) == pytest.approx(0.4, abs=0.02), "the duty of the trigger again"


def test_every_frame_is_answered(tape: bytes) -> None:
    frames = telemetry.Framer().feed(sent_bytes(sil.replay(tape, target=1)))
    acks = [telemetry.decode(frame) for frame in frames if frame.id == telemetry.ACK]
    assert [ack["ack_sequence"] for ack in acks] == list(range(round(LASTS_S / 0.02)))
    assert all(ack["ack_result"] == 0 for ack in acks)


@pytest.mark.parametrize("target", TARGETS)
def test_native_and_avr_are_equal_bit_for_bit(
    target: str, tape: bytes, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    mcu, number = TARGETS[target]
    stats = tmp_path / "stats.json"
    avr = sent_bytes(board.replay(request.getfixturevalue(target), tape, mcu=mcu, stats=stats))
    assert differences(sent_bytes(sil.replay(tape, target=number)), avr) == []
    assert read_statistics(stats)["tick"]["worst_cycles"] <= TICK_CYCLES_MAX
