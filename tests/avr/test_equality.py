"""Native firmware and AVR give equal outputs, bit for bit, for equal inputs of their pins (the
equality test of processor-in-the-loop practice).
"""

from pathlib import Path

import numpy as np
import pytest
from builds import BUILDS, RUNS
from command_load import command_load_tape
from dead_time import DEAD_COUNTS, dead_time_tape
from equality import Difference, bridge_differences, damaged, differences, periods_of, sent_bytes
from exercise import DURATION_S, record_tape
from impact import PULLS, acted, impact_tape, random_tape
from unequal_pitches import unequal_pitches_tape

from vgroove import _core, board, lockstep, sil, telemetry
from vgroove.board import AvrBoard, BoardInputs, BoardOutputs
from vgroove.control_bench.runs import front_ends, make_tool, reference
from vgroove.log import log_from_stream

TARGETS = {name: (build.mcu, build.target) for name, build in BUILDS.items()}


@pytest.fixture(scope="module")
def tape() -> bytes:
    recorded, tool = record_tape()
    assert tool.on_ticks > 40
    assert tool.doubled > 3
    return recorded


@pytest.fixture(scope="module")
def native(tape: bytes) -> bytes:
    return sent_bytes(sil.replay(tape, target=1))


def _lines(differences_found: list[Difference]) -> str:
    return "\n".join(str(difference) for difference in differences_found)


def test_exercise_uses_every_driver(native: bytes) -> None:
    frames = telemetry.Framer().feed(native)
    states = [telemetry.decode(frame) for frame in frames if frame.id == telemetry.STATE]
    log = log_from_stream(native, "exercise")
    assert len(log) > DURATION_S * 1000 - 10
    assert (log["speed_rpm"] > 10000).any() and (log["speed_rpm"] < -5000).any()
    assert set(telemetry.OUTBOUND) == {frame.id for frame in frames}
    assert any(state["faults"] for state in states), "the over-current did not trip"
    health = [telemetry.decode(frame) for frame in frames if frame.id == telemetry.HEALTH]
    assert (
        health[-1]["missed_edges"] > 0
        and health[-1]["double_edges"] > 0
        and health[-1]["rx_errors"] > 0
    )


@pytest.mark.parametrize("target", TARGETS)
def test_native_and_avr_are_equal_bit_for_bit(
    target: str, tape: bytes, request: pytest.FixtureRequest
) -> None:
    native_equals_avr(tape, target, request)


def test_unequal_pitches_are_learned_and_identified_again() -> None:
    tape = unequal_pitches_tape()
    native = sent_bytes(sil.replay(tape, target=1))
    log = log_from_stream(native, "unequal pitches")
    time_s, speed = log["time_s"], log["speed_rpm"]
    assert abs(speed[(time_s > 2.0) & (time_s < 2.5)] - 6000).max() < 12, "learned"
    assert abs(speed[(time_s > 3.8) & (time_s < 4.19)] - 2500).max() < 5, (
        "identified after the stop"
    )


def native_equals_avr(tape: bytes, target: str, request: pytest.FixtureRequest) -> bytes:
    """Replay a tape on both and compare the undamaged bytes sent and the states of the bridge;
    returns the bytes that native sent.
    """
    mcu, number = TARGETS[target]
    native = periods_of(sil.replay(tape, target=number))
    avr = periods_of(board.replay(request.getfixturevalue(target), tape, mcu=mcu))
    native_sent, avr_sent = board.sent_bytes(native), board.sent_bytes(avr)
    found = differences(native_sent, avr_sent) + bridge_differences(native, avr)
    assert not found, "native and AVR differ:\n" + _lines(found)
    assert damaged(avr_sent) == 0
    return native_sent


@pytest.mark.parametrize("target", TARGETS)
def test_unequal_pitches_are_equal_bit_for_bit(target: str, request: pytest.FixtureRequest) -> None:
    native_equals_avr(unequal_pitches_tape(), target, request)


@pytest.mark.parametrize("target", TARGETS)
def test_commands_at_every_phase_are_equal_bit_for_bit(
    target: str, request: pytest.FixtureRequest
) -> None:
    native_equals_avr(command_load_tape(), target, request)


@pytest.mark.parametrize("target", TARGETS)
def test_small_duties_after_a_change_of_the_dead_time_are_equal_bit_for_bit(
    target: str, request: pytest.FixtureRequest
) -> None:
    native_equals_avr(dead_time_tape(), target, request)


def test_a_gate_that_the_dead_time_keeps_off_shortens_it() -> None:
    periods = periods_of(sil.replay(dead_time_tape(), target=1))
    driven = periods[periods["coast"] == 0]
    found = set(zip(driven["compare"].tolist(), driven["dead_counts"].tolist(), strict=True))
    clipped = {(compare, dead) for compare, dead in found if 0 < compare < DEAD_COUNTS // 2}
    assert len(clipped) >= 3
    for compare, dead in clipped:
        assert dead - 2 * compare in (0, 1), "the high side is off, the low side dead counts long"
    assert {dead for compare, dead in found if 30 < compare < 225} == {DEAD_COUNTS}


@pytest.mark.parametrize(("case", "target"), RUNS)
def test_each_controller_is_equal_bit_for_bit(
    case: str, target: str, request: pytest.FixtureRequest
) -> None:
    native = native_equals_avr(impact_tape(case), target, request)
    assert acted(case, log_from_stream(native, case))


@pytest.mark.parametrize(("case", "target"), RUNS)
def test_random_sensor_values_are_equal_bit_for_bit(
    case: str, target: str, request: pytest.FixtureRequest
) -> None:
    native_equals_avr(random_tape(case), target, request)


@pytest.mark.parametrize(("isr_cycles", "tick_cycles"), [(0, 260), (150, 1500), (300, 5000)])
def test_the_sent_bytes_do_not_depend_on_latencies(
    isr_cycles: int, tick_cycles: int, tape: bytes, native: bytes
) -> None:
    other = sent_bytes(sil.replay(tape, target=1, isr_cycles=isr_cycles, tick_cycles=tick_cycles))
    assert not differences(native, other), _lines(differences(native, other))


def test_one_changed_shift_in_the_avr_build_is_caught(
    broken_elf: Path, tape: bytes, native: bytes
) -> None:
    found = differences(native, sent_bytes(board.replay(broken_elf, tape[: len(tape) // 8])))
    assert found
    assert found[0].field in ("current_a", "flags", "faults", "state")
    assert "ms: native" in str(found[0])


def test_differences_name_field_and_time(native: bytes) -> None:
    frames = telemetry.Framer().feed(native)
    index = next(
        i for i, frame in enumerate(frames) if frame.id == telemetry.FAST and frame.time_ms > 700
    )
    other = frames[index]
    payload = bytes([other.data[0] ^ 1]) + other.data[1:7]
    changed = [
        *frames[:index],
        telemetry.frame_of(other.time_ms, other.id, payload),
        *frames[index + 1 :],
    ]
    found = differences(native, b"".join(telemetry.frame_bytes(frame) for frame in changed))
    assert [(difference.field, difference.time_ms) for difference in found] == [
        ("current_a", other.time_ms)
    ]


class OnePeriodACall:
    """A board without the method periods(): the lock-step loop calls it for each PWM period."""

    def __init__(self, avr: AvrBoard) -> None:
        self._avr = avr

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """The board's PWM period."""
        return self._avr.period(inputs)


def test_several_periods_a_call_give_the_bytes_of_one_a_call(uno_elf: Path) -> None:
    found = []
    for kind in (lambda avr: avr, OnePeriodACall):
        truth = _core.Truth(1)
        options = lockstep.LockstepOptions(front=front_ends(), seed=3, truth=truth)
        with AvrBoard(uno_elf, seed=3) as avr:
            tool = make_tool(reference("hard_joint", {}), 3)
            found.append((lockstep.run(kind(avr), tool, PULLS, 0.7, options), truth.rows))
    (several, several_rows), (one, one_rows) = found
    assert len(one) > 5000 and several == one
    assert np.nanmax(one_rows[:, list(_core.TRUTH_COLUMNS).index("duty")]) > 0.9, (
        "it does not drive"
    )
    assert np.array_equal(several_rows, one_rows, equal_nan=True)
