"""The soak of tests/proof/soak.py on two short pieces, one past 2^32 ms, and that each of its
checks finds what it is for.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from vgroove import telemetry
from vgroove.board import is_sent
from vgroove.log import log_from_stream

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests/proof"))

import soak  # noqa: E402

SECONDS = 9.0
GOOD = {"resets": 0, "odd_periods": 0, "stack": {"free_bytes": 900}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("soak")


@pytest.mark.parametrize("number", [4, 5])  # an impact driver past 2^32 ms, a drill driver
def test_a_piece_has_no_finding(number: int, folder: Path) -> None:
    found = soak.piece(number, folder, SECONDS)
    assert found["findings"] == []
    assert found["wraps"] == (number == 4) and found["driven_share"] > 0.2


@pytest.fixture(scope="module")
def native() -> np.ndarray:
    """Outputs of the native firmware in a piece that passes 2^32 ms."""
    _, scenario = soak.piece_scenario(4, SECONDS)
    return soak.native_run(scenario, 2**32 - round(1000 * soak.BEFORE_WRAP_S))[1]


def test_the_time_passes_2_32_ms(native: np.ndarray) -> None:
    log = log_from_stream(soak.sent_bytes(native), "native")
    assert log.time_s[0] < 2**32 / 1000 < log.time_s[-1]
    assert set(np.round(np.diff(log.time_s), 6)) == {0.001}


def changed_frame(outputs: np.ndarray, frame_id: int) -> np.ndarray:
    """Outputs in which one data bit of a frame, and its CRC, are changed."""
    data = soak.sent_bytes(outputs)
    frames = telemetry.Framer().feed(data)
    frame = [f for f in frames if f.id == frame_id][5]
    whole = telemetry.frame_bytes(frame)
    other = telemetry.frame_of(frame.time_ms, frame.id, bytes([frame.data[0] ^ 1]) + frame.data[1:])
    new = data.replace(whole, telemetry.frame_bytes(other), 1)
    copy = outputs.copy()
    used = is_sent(copy)
    bytes_ = copy["tx"].copy()
    bytes_[used] = np.frombuffer(new, np.uint8)
    copy["tx"] = bytes_
    return copy


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("bridge", "the bridges differ from period"),
        ("telemetry", "the telemetry differs"),
        ("gap", "the telemetry has gaps"),
        ("end", "the AVR ended after"),
        ("reset", "the board was reset 1 times"),
        ("stack", "only 20 bytes of the stack"),
    ],
)
def test_each_check_finds_its_error(change: str, sentence: str, native: np.ndarray) -> None:
    avr, statistics = native.copy(), GOOD
    if change == "bridge":
        avr["compare"][np.flatnonzero(avr["coast"] == 0)[100]] += 1
    elif change == "telemetry":
        avr = changed_frame(native, telemetry.STATE)
    elif change == "gap":
        at = np.flatnonzero(avr["tx_count"] > 0)[5000]
        avr["tx_count"][at] = 0
    elif change == "end":
        avr = avr[:-10]
    elif change == "reset":
        statistics = {**GOOD, "resets": 1}
    else:
        statistics = {**GOOD, "stack": {"free_bytes": 20}}
    found = soak.findings(native, avr, statistics)
    assert any(text.startswith(sentence) for text in found), found
    assert soak.findings(native, native, GOOD) == []
