"""Telemetry from the firmware's C to Python's decoder: packing, schedule, commands, damage."""

import ctypes
import importlib
import itertools
import math
import random
import re
import struct
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from telemetry_board import (
    ROOT,
    Board,
    PtyBoard,
    eeprom_set,
    library,
    moving,
    struct_of,
    wait_until,
)
from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log import log_from_stream
from vgroove.serial_bus import command_message

OUTBOUND = ("FAST", "STATE", "BOOT", "PARAM", "PARAM_TABLE", "ACK", "HEALTH", "CONTROL")
INBOUND = ("SET_MODE", "PARAM_READ", "PARAM_WRITE", "DUMP", "CALIBRATE", "SETPOINT", "PROFILE")
ACK_RESULT = telemetry.database().get_message_by_name("ACK").get_signal_by_name("ack_result")
RESULT = {str(name): value for value, name in ACK_RESULT.choices.items()}


def generator() -> ModuleType:
    folder = str(ROOT / "firmware/telemetry")
    if folder not in sys.path:
        sys.path.append(folder)
    return importlib.import_module("generate")


def frames_of(data: bytes) -> list[telemetry.Frame]:
    framer = telemetry.Framer()
    frames = framer.feed(data)
    assert framer.counters.skipped_bytes == 0 and framer.held == 0
    return frames


def session_of(data: bytes) -> telemetry.Session:
    session = telemetry.Session()
    session.feed(telemetry.Framer(session.counters).feed(data))
    return session


def command_bytes(name: str, sequence: int, time_ms: int = 0, **signals: float) -> bytes:
    message = command_message(name, sequence, time_ms, **signals)
    return telemetry.frame_bytes(
        telemetry.Frame(time_ms, message.arbitration_id, bytes(message.data))
    )


@pytest.fixture(autouse=True)
def _blank_eeprom() -> None:
    eeprom_set()


def test_generated_files_are_those_of_the_signal_and_parameter_lists() -> None:
    run = subprocess.run(
        [sys.executable, ROOT / "firmware/telemetry/generate.py", "--check"],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout


def test_the_check_of_generated_files_detects_a_changed_one() -> None:
    generate = generator()
    for path, text in generate.outputs().items():
        assert generate.differences({path: text + "x"}), path


@pytest.mark.parametrize(
    ("entry", "new", "error"),
    [
        (r"(X\(DEAD_TIME_COUNT,.*?,\s*)2\)", "1)", "must stand before"),
        (r'(X\(HALL_PITCH_0_Q15,\s*"1",\s*)8192', "1024", "needs -32768"),
        (r"(X\(TRIP_A_Q9,.*?)28160", "TRIP", "could be read"),
    ],
)
def test_parameter_list_that_cannot_be_migrated_is_refused(
    entry: str, new: str, error: str
) -> None:
    generate = generator()
    text, count = re.subn(entry, rf"\g<1>{new}", generate.PARAM_TABLE.read_text())
    assert count == 1
    with pytest.raises(SystemExit, match=error):
        generate.read_parameters(text)


def test_check_values_of_both_crcs() -> None:
    assert telemetry.crc8(b"123456789") == 0xDF and telemetry.crc16(b"123456789") == 0x29B1


@given(st.binary(max_size=40))
def test_c_and_python_compute_the_same_crcs(data: bytes) -> None:
    lib = library()
    assert lib.shim_crc8(data, ctypes.c_uint16(len(data))) & 0xFF == telemetry.crc8(data)
    assert lib.shim_crc16(data, ctypes.c_uint16(len(data))) & 0xFFFF == telemetry.crc16(data)


def raw_values(draw: st.DrawFn, name: str) -> dict[str, int]:
    signals = [s for s in telemetry.database().get_message_by_name(name).signals if s.start != 56]
    limit = {
        s.name: (-(1 << (s.length - 1)), (1 << (s.length - 1)) - 1)
        if s.is_signed
        else (0, (1 << s.length) - 1)
        for s in signals
    }
    return {name: draw(st.integers(*bounds)) for name, bounds in limit.items()}


@given(st.data())
@settings(max_examples=200)
def test_c_packs_every_outbound_frame_as_cantools_does(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(OUTBOUND))
    message = telemetry.database().get_message_by_name(name)
    values = raw_values(data.draw, name)
    crc = next(s.name for s in message.signals if s.start == 56)
    expected = message.encode({**values, crc: 0x5A}, scaling=False, strict=False)
    buffer = ctypes.create_string_buffer(b"\xa5" * 7 + b"\x5a", 8)
    getattr(library(), f"telemetry_pack_{name.lower()}")(
        buffer, ctypes.byref(struct_of(name)(**values))
    )
    assert buffer.raw == expected


@given(st.data())
@settings(max_examples=200)
def test_c_unpacks_every_inbound_frame_as_cantools_packs_it_and_checks_the_range(
    data: st.DataObject,
) -> None:
    name = data.draw(st.sampled_from(INBOUND))
    message = telemetry.database().get_message_by_name(name)
    values = raw_values(data.draw, name)
    crc = next(s.name for s in message.signals if s.start == 56)
    packed = message.encode({**values, crc: 0}, scaling=False, strict=False)
    unpacked = struct_of(name)()
    unpack = getattr(library(), f"telemetry_unpack_{name.lower()}")
    unpack.restype = ctypes.c_bool
    fits = unpack(ctypes.byref(unpacked), packed)
    assert {key: getattr(unpacked, key) for key in values} == values
    assert fits == all(
        s.minimum <= values[s.name] <= s.maximum for s in message.signals if s.name in values
    )


@given(
    st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=20), st.sampled_from(OUTBOUND)
)
def test_many_frames_decode_as_cantools_decodes_each(payloads: list[bytes], name: str) -> None:
    frame_id = telemetry.database().get_message_by_name(name).frame_id
    frames = [telemetry.Frame(0, frame_id, data) for data in payloads]
    together = telemetry.decode_many(name, frames)
    for k, frame in enumerate(frames):
        assert {key: float(values[k]) for key, values in together.items()} == pytest.approx(
            telemetry.decode(frame), abs=1e-12
        )


@given(
    st.integers(-32768, 32767),
    st.integers(-32768, 32767),
    st.integers(-511, 511),
    st.integers(0, 1023),
    st.integers(0, 2**32 - 2),
)
def test_a_row_arrives_as_the_firmware_reported_it(
    current: int, speed: int, duty: int, supply: int, now: int
) -> None:
    board = Board(now_ms=now)
    fast = board.fast
    fast.current_a, fast.speed_rpm, fast.duty_compare, fast.supply_v = current, speed, duty, supply
    frames = frames_of(board.tick())
    assert [frame.id for frame in frames] == [telemetry.BOOT, telemetry.FAST]
    row = telemetry.decode(frames[1])
    assert frames[1].time_ms == now + 1
    assert (row["current_a"] * 512, row["speed_rpm"] * 2, row["duty_compare"]) == (
        current,
        speed,
        duty,
    )
    assert row["supply_v"] == pytest.approx(supply * 0.025)


@pytest.mark.parametrize(
    ("baud_select", "asked", "divider", "per_tick"),
    [(0, 1, 1, 25.0), (1, 1, 2, 11.52), (1, 5, 5, 11.52), (0, 63, 63, 25.0)],
)
def test_the_line_is_never_overfull_and_no_fast_frame_waits(
    baud_select: int, asked: int, divider: int, per_tick: float
) -> None:
    board, queued, sent = Board(asked, baud_select), 0.0, bytearray()
    each = moving(board)
    for k in range(4100):
        each(k)
        board.inputs.state.trigger = 255 * (k % 2)
        board.inputs.control.blow_count = k % 4096
        if k == 2000:
            board.receive(command_bytes("DUMP", 1))
        data = board.tick()
        queued = max(0.0, queued - per_tick) + len(data)
        assert queued <= 57 + 1e-6, f"tick {k}"
        fast = [frame for frame in frames_of(data) if frame.id == telemetry.FAST]
        assert len(fast) == ((k + 1) % divider == 0), f"tick {k}"
        sent += data
    kinds = [frame.id for frame in frames_of(bytes(sent))]
    assert (
        kinds[0] == telemetry.BOOT
        and telemetry.decode(frames_of(bytes(sent))[0])["fast_divider"] == divider
    )
    assert (
        kinds.count(telemetry.BOOT) == 2
        and kinds.count(telemetry.PARAM_TABLE) == 2
        and kinds.count(telemetry.HEALTH) == 5
    )
    assert kinds.count(telemetry.PARAM) == 2 * len(telemetry.parameter_list())
    # frames of equal priority alternate
    assert kinds.count(telemetry.STATE) == pytest.approx(
        kinds.count(telemetry.FRAME_IDS["CONTROL"]), rel=0.02, abs=1
    )
    assert len(sent) <= 4100 * per_tick + 57
    assert session_of(bytes(sent)).counters.lost == 0


def test_a_decimated_row_holds_means_and_the_last_command() -> None:
    board = Board(fast_divider=4)
    values = [(-3, 700, 10), (-2, 701, 11), (-2, 703, 12), (-3, 705, 13)]
    sent = bytearray()
    for current, supply, duty in values:
        board.fast.current_a, board.fast.supply_v, board.fast.duty_compare = current, supply, duty
        sent += board.tick()
    row = telemetry.decode(
        next(frame for frame in frames_of(bytes(sent)) if frame.id == telemetry.FAST)
    )
    assert (row["current_a"] * 512, row["duty_compare"]) == (-3, 13)  # -2.5, half away from zero
    assert row["supply_v"] == pytest.approx(702 * 0.025)  # 702.25


def test_state_goes_out_on_change_with_its_tick_and_once_a_second() -> None:
    board = Board()
    board.run(400)
    quiet = [f for f in frames_of(board.run(1000)) if f.id == telemetry.STATE]
    assert len(quiet) == 1
    board.inputs.state.state = 3
    sent = frames_of(board.run(6))
    state = next(frame for frame in sent if frame.id == telemetry.STATE)
    assert (
        telemetry.decode(state)["state"] == 3
        and telemetry.decode(state)["state_tick"] == 1401 & 0xFF
    )


def test_control_goes_out_on_change_with_its_tick_and_rows_carry_it() -> None:
    board = Board()

    def each(k: int) -> None:
        control = board.inputs.control
        control.blow_count, control.stop_reason, control.estimate = (
            4000 + (k - 600) // 25 if k >= 600 else 0,
            2 * (k >= 900),
            k,
        )

    stream = board.run(1200, each)
    frames = [frame for frame in frames_of(stream) if frame.id == telemetry.FRAME_IDS["CONTROL"]]
    assert len(frames) == 1 + 24 and telemetry.decode(frames[-1])["estimate"] == 1175, (
        "a change of the estimate alone sends no frame"
    )
    log = log_from_stream(stream, "board")
    since = np.round(log.time_s * 1000).astype(int) - 1
    assert (
        log["blow_count"][100:] == np.where(since[100:] >= 600, 4000 + (since[100:] - 600) // 25, 0)
    ).all()
    assert (log["stop_reason"][100:] == np.where(since[100:] >= 900, 2, 0)).all()


def test_a_flag_of_one_tick_is_reported() -> None:
    board = Board()
    board.run(400)
    seen = set()

    def each(k: int) -> None:
        board.inputs.state.flags = 4 if k == 3 else 0
        board.inputs.state.trigger = 255 * (k % 2)

    for frame in frames_of(board.run(40, each)):
        if frame.id == telemetry.STATE:
            seen.add(telemetry.decode(frame)["flags"])
    assert seen == {0, 4}


def test_rows_carry_the_state_of_their_own_tick_though_its_frame_comes_later() -> None:
    board = Board()

    def each(k: int) -> None:
        board.inputs.state.state = 2 if k >= 700 else 1
        board.inputs.state.trigger = 200 if k >= 900 else 100

    log = log_from_stream(board.run(1500, each), "board")
    known = np.isfinite(log["state"])
    expected = np.where(log.time_s >= 0.701, 2, 1)
    assert known[-1400:].all() and (log["state"][known] == expected[known]).all()
    assert log["trigger"][-700:] == pytest.approx(
        np.where(log.time_s[-700:] >= 0.901, 200, 100) / 255
    )


def test_a_recording_has_every_parameter_and_their_crc() -> None:
    session = session_of(Board().run(400))
    expected = {k: p.default for k, p in enumerate(telemetry.parameter_list())}
    assert session.parameters == expected and session.table["table_status"] == 1
    assert session.boot["build_hash"] == 0xABCDEF


def test_a_dump_with_a_missing_or_changed_parameter_is_not_taken_for_complete() -> None:
    frames = frames_of(Board().run(400))
    third = next(
        k for k, frame in enumerate(frames) if frame.id == telemetry.PARAM and frame.data[0] == 3
    )
    missing, changed = telemetry.Session(), telemetry.Session()
    missing.feed(frames[:third] + frames[third + 1 :])
    other = telemetry.frame_of(
        frames[third].time_ms, telemetry.PARAM, frames[third].data[:2] + b"\1\2\0\0" + b"\0"
    )
    changed.feed([*frames[:third], other, *frames[third + 1 :]])
    assert missing.table is None and changed.table is None


def test_an_unknown_protocol_is_an_error() -> None:
    boot = telemetry.frame_of_signals(
        "BOOT", 5, protocol_version=9, duty_full_scale=255, fast_divider=1
    )
    with pytest.raises(VgrooveError, match="sends telemetry protocol 9, this vgroove decodes 2"):
        telemetry.Session().feed([boot])


@pytest.mark.parametrize(
    ("command", "idle", "result"),
    [
        (command_bytes("DUMP", 1), True, "ok"),
        (command_bytes("PARAM_READ", 1, read_index=3), True, "ok"),
        (command_bytes("PARAM_READ", 1, read_index=200), True, "unknown_index"),
        (command_bytes("PARAM_WRITE", 1, write_index=12, write_value=5000), True, "ok"),
        (command_bytes("PARAM_WRITE", 1, write_index=12, write_value=5001), True, "out_of_range"),
        (
            command_bytes("PARAM_WRITE", 1, write_index=12, write_value=50 + 65536),
            True,
            "out_of_range",
        ),
        (command_bytes("PARAM_WRITE", 1, write_index=12, write_value=50), True, "ok"),
        (command_bytes("PARAM_WRITE", 1, write_index=12, write_value=49), True, "out_of_range"),
        (command_bytes("PARAM_WRITE", 1, write_index=12, write_value=-1), True, "out_of_range"),
        (command_bytes("PARAM_WRITE", 1, write_index=99, write_value=0), True, "unknown_index"),
        (command_bytes("PARAM_WRITE", 1, write_index=12, write_value=500), False, "not_now"),
        (command_bytes("DUMP", 1)[:17] + b"\x00" + b"\xbb", True, "bad_crc"),
        (telemetry.frame_bytes(telemetry.frame_of(0, 999, bytes(7))), True, "unknown_id"),
        (telemetry.frame_bytes(telemetry.frame_of(0, 515 + 65536, bytes(7))), True, "unknown_id"),
    ],
)
def test_every_command_is_answered_with_its_result(command: bytes, idle: bool, result: str) -> None:
    board = Board()
    before = list(board.store.value)
    board.receive(command)
    sent = b"".join(board.tick(idle) for _ in range(30))
    acks = [telemetry.decode(frame) for frame in frames_of(sent) if frame.id == telemetry.ACK]
    assert [ack["ack_result"] for ack in acks] == [RESULT[result]]
    assert (
        acks[0]["ack_sequence"] == command[16]
        and acks[0]["ack_command"] == struct.unpack_from("<H", command, 6)[0]
    )
    changed = list(board.store.value) != before
    assert changed == (
        result == "ok" and b"\x02\x02" in command[6:8] and list(board.store.value)[12] in (5000, 50)
    )


def test_the_same_command_sent_again_is_answered_again_but_not_executed_again() -> None:
    board = Board()
    write = command_bytes("PARAM_WRITE", 7, 100, write_index=12, write_value=600)
    for data in (
        write,
        write,
        command_bytes("PARAM_WRITE", 8, 150, write_index=12, write_value=700),
        write,
    ):
        board.receive(data)
        board.run(20)
    assert board.results == [("executed", 0), ("answered", 0), ("executed", 0), ("executed", 0)]
    assert board.store.value[12] == 600


def test_a_read_is_answered_by_the_parameter_and_an_ack() -> None:
    board = Board()
    board.run(400)
    board.receive(command_bytes("PARAM_READ", 9, read_index=7))
    frames = [
        frame for frame in frames_of(board.run(30)) if frame.id in (telemetry.PARAM, telemetry.ACK)
    ]
    assert sorted(frame.id for frame in frames) == [telemetry.PARAM, telemetry.ACK]
    assert (
        telemetry.decode(next(f for f in frames if f.id == telemetry.PARAM))["param_value"] == 25600
    )


@given(st.lists(st.binary(max_size=30), min_size=1, max_size=6), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_commands_are_found_between_any_garbage(garbage: list[bytes], rng: random.Random) -> None:
    board = Board()
    stream = b""
    for k, noise in enumerate(garbage):
        noise = bytes(rng.choice((0xAA, 0x08, 0xBB, byte)) for byte in noise)
        stream += noise + command_bytes("PARAM_READ", k, time_ms=k, read_index=k)
    board.receive(stream + bytes(20))
    board.run(400)
    assert [kind for kind, _ in board.results].count("executed") == len(garbage)


def test_a_frame_that_begins_inside_a_damaged_one_is_found() -> None:
    outer = b"\xaa" + bytes(4) + b"\x08" + bytes(9)
    board = Board()
    board.receive(outer + command_bytes("PARAM_READ", 4, time_ms=0xBB0000, read_index=2))
    board.run(20)
    assert board.results == [("answered", RESULT["bad_crc"]), ("executed", RESULT["ok"])]
    framer, inner = telemetry.Framer(), telemetry.frame_of(0xBB0000, telemetry.FAST, bytes(7))
    assert framer.feed(outer + telemetry.frame_bytes(inner)) == [inner]
    assert (framer.counters.corrupt, framer.counters.skipped_bytes) == (1, len(outer))


def error_syndromes() -> list[int]:
    """Syndrome: change of the CRC by each single flipped bit of id, time, data and CRC."""
    base = telemetry.crc8(bytes(15))
    flips = [
        telemetry.crc8(bytes(1 << (b % 8) if k == b // 8 else 0 for k in range(15))) ^ base
        for b in range(120)
    ]
    return flips + [1 << bit for bit in range(8)]


def test_the_crc_detects_every_error_of_one_to_three_bits_that_leaves_the_id_known() -> None:
    syndromes = error_syndromes()
    missed = [
        pair
        for pair in itertools.combinations(range(128), 2)
        if syndromes[pair[0]] == syndromes[pair[1]]
    ]
    assert all(pair[0] < 32 for pair in missed), "an undetected pair must touch the id"
    for first, _ in missed:
        ids = [frame_id ^ (1 << first) for frame_id in telemetry.OUTBOUND]
        assert not set(ids) & telemetry.OUTBOUND
    # The polynomial holds the factor x + 1: each syndrome has an odd number of ones, so the sum of
    # an odd number of them is never 0.
    assert all(syndrome.bit_count() % 2 == 1 for syndrome in syndromes)


def test_of_the_errors_of_four_bits_one_in_127_passes_as_the_page_states() -> None:
    pairs = [a ^ b for a, b in itertools.combinations(error_syndromes(), 2)]
    alike = np.bincount(pairs)
    # each set of four is three pairs of pairs
    passing = sum(count * (count - 1) // 2 for count in alike.tolist()) / 3
    assert 127 * passing / math.comb(128, 4) == pytest.approx(1, abs=0.02)
    page = (ROOT / "docs/telemetry.md").read_text()
    for rate, stated in ((1e-6, "3.8e8 years"), (1e-4, "3.8 years"), (1e-3, "3.8 hours")):
        undetected = (
            sum(math.comb(128, k) * rate**k * (1 - rate) ** (128 - k) for k in range(4, 129, 2))
            / 127
        )
        hours = 1 / (undetected * 1000) / 3600
        value, unit = stated.split()
        assert stated in page and hours / (8766 if unit == "years" else 1) == pytest.approx(
            float(value), rel=0.03
        )


def test_the_crc_detects_every_burst_of_up_to_eight_bits() -> None:
    order = [8 * (b // 8) + 7 - b % 8 for b in range(120)] + [120 + 7 - b for b in range(8)]
    syndromes = [error_syndromes()[b] for b in order]
    for start in range(128):
        for pattern in range(1, 256, 2):
            bits = [start + k for k in range(8) if pattern >> k & 1]
            if bits[-1] < 128:
                total = 0
                for bit in bits:
                    total ^= syndromes[bit]
                assert total, (start, pattern)


def damaged(data: bytes, rng: random.Random, rate: float) -> bytes:
    """Data with bits flipped, bytes lost and inserted, and parts cut, each at `rate` per byte."""
    out = bytearray()
    skip = 0
    for byte in data:
        if skip:
            skip -= 1
            continue
        kind = rng.random()
        if kind < rate:
            byte ^= 1 << rng.randrange(8)
        elif kind < 2 * rate:
            continue
        elif kind < 3 * rate:
            out.append(rng.choice((0xAA, 0xBB, rng.randrange(256))))
        elif kind < 3.1 * rate:
            skip = rng.randrange(1, 400)
        out.append(byte)
    return bytes(out)


@pytest.mark.parametrize("rate", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("seed", range(3))
def test_counts_of_a_damaged_stream_add_up_and_no_wrong_frame_is_accepted(
    rate: float, seed: int
) -> None:
    board = Board()
    clean = board.run(6000, moving(board))
    sent = {f.time_ms: f for f in frames_of(clean) if f.id == telemetry.FAST}
    broken = clean[:38] + damaged(clean[38:], random.Random(seed), rate)
    session, framer = telemetry.Session(), telemetry.Framer()
    session.counters = framer.counters
    for at in range(0, len(broken), 777):
        session.feed(framer.feed(broken[at : at + 777]))
    counters = session.counters
    got = [(time_ms, frame) for time_ms, frame in session._fast]
    assert all(sent[time_ms] == frame for time_ms, frame in got)
    assert counters.fast == len(got) and counters.fast + counters.lost == got[-1][0] - got[0][0] + 1
    assert (
        counters.bytes == len(broken) == 19 * counters.frames + counters.skipped_bytes + framer.held
    )
    assert counters.lost > 0 and not session.restarted and counters.not_sent == 0


def test_a_whole_stream_has_no_losses_however_it_is_cut() -> None:
    board, rng = Board(), random.Random(1)
    clean = board.run(500, moving(board))
    session, framer, at = telemetry.Session(), telemetry.Framer(), 0
    while at < len(clean):
        step = rng.randrange(1, 60)
        session.feed(framer.feed(clean[at : at + step]))
        at += step
    assert (
        framer.counters.skipped_bytes == framer.counters.corrupt == session.counters.lost == 0
        and len(session._fast) == 500
    )


def test_time_goes_on_when_the_boards_clock_wraps() -> None:
    board = Board(now_ms=2**32 - 300)
    log = log_from_stream(board.run(1000, moving(board)), "board")
    assert (
        len(log) == 1000
        and np.allclose(np.diff(log.time_s), 0.001)
        and log.meta["counters"]["lost"] == 0
    )


def test_a_restart_ends_the_run_but_not_before_its_parameters_are_known() -> None:
    first, second = Board(), Board()
    late = session_of(first.run(1000, moving(first)) + second.run(500, moving(second)))
    assert late.restarted and late.counters.restarts == 1 and len(late._fast) == 1000
    first, second = Board(), Board()
    early = session_of(first.run(30, moving(first)) + second.run(500, moving(second)))
    assert not early.restarted and len(early._fast) == 500 and early.table is not None


def test_a_single_frame_from_another_time_is_rejected() -> None:
    board = Board()
    frames = frames_of(board.run(1000, moving(board)))
    stray = telemetry.frame_of(3_000_000, telemetry.FAST, bytes(7))
    session = telemetry.Session()
    session.feed([*frames[:700], stray, *frames[700:]])
    assert (
        session.counters.corrupt == 1 and session.counters.lost == 0 and len(session._fast) == 1000
    )


def test_python_can_reads_the_undamaged_stream(tmp_path: Path) -> None:
    target = tmp_path / "can.asc"
    board = PtyBoard()
    command = [
        sys.executable,
        "-m",
        "can.logger",
        "-i",
        "serial",
        "-c",
        board.port,
        "-f",
        str(target),
        "--bus-kwargs",
        "baudrate=250000",
    ]
    logger = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    # bytes are sent once the port is open and flushed: python-can needs the first byte of a frame
    wait_until(target.exists, f"{target} appears")
    with board:
        wait_until(lambda: target.stat().st_size > 100_000, f"{target} grows")
        logger.send_signal(2)
        assert logger.wait(90) == 0, logger.stderr.read()
    messages = list(can.LogReader(target))
    fast = [m for m in messages if m.arbitration_id == telemetry.FAST]
    counters = [m.data[6] >> 4 for m in fast]
    assert len(fast) > 500 and all((b - a) % 16 == 1 for a, b in itertools.pairwise(counters))


def test_a_restart_after_final_rows_ends_the_run_and_no_time_goes_back() -> None:
    first, second = Board(), Board()
    frames = frames_of(first.run(1000, moving(first)) + second.run(500, moving(second)))
    lost = [f for f in frames if f.id != telemetry.PARAM_TABLE]  # no dump is complete
    for needs_boot in (True, False):
        session, times = telemetry.Session(needs_boot=needs_boot), []
        for k in range(0, len(lost), 50):
            session.feed(lost[k : k + 50])
            times += session.take_rows(session.ready_until())["time_s"].tolist()
        times += session.take_rows()["time_s"].tolist()
        assert np.all(np.diff(times) > 0.0)
        assert session.restarted is not needs_boot
        assert len(times) == session.counters.fast == (500 if needs_boot else 1000)
    late = telemetry.Session()
    late.feed(lost[:1])
    late.last_ms += 6000  # long after the start
    assert not late.may_start_over
    known = telemetry.Session()
    known.feed(frames[:900])
    assert known.table is not None
    known.feed([frames[0]._replace(time_ms=frames[899].time_ms + 1)])  # the answer to a DUMP
    assert known.table is None and not known.may_start_over
