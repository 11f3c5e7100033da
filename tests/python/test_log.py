"""Logs of every kind are read, and each rejection of docs/spec/gap.md, section 1, is a message with
file, line and column.
"""

import csv
import os
import random
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest
from asammdf import MDF, Signal
from hypothesis import given, settings
from hypothesis import strategies as st

from telemetry_board import ROOT, Board, eeprom_set, moving
from vgroove import telemetry
from vgroove.errors import VgrooveError
from vgroove.log import (
    Log,
    can_files,
    current_is_unsigned,
    log_from_stream,
    read_log,
    write_csv,
)

PRACTICE = ROOT / "tests/data/practice/practice_001/log.csv"


def sample_log(rows: int = 200) -> Log:
    rng = np.random.default_rng(4)
    names = ("duty", "supply_v", "current_a", "speed_rpm")
    return Log(
        np.arange(1, rows + 1) / 1000, {name: rng.uniform(-1, 1, rows) for name in names}, "sample"
    )


def csv_lines(rows: int = 60) -> list[str]:
    return ["time_s,duty,current_a,speed_rpm"] + [
        f"{k / 1000:.3f},0.5,{k / 10},{k}" for k in range(1, rows + 1)
    ]


def written(path: Path, lines: list[str], end: str = "\n") -> Path:
    path.write_bytes((end.join(lines) + end).encode())
    return path


def refused(path: Path, *parts: str) -> str:
    with pytest.raises(VgrooveError) as caught:
        read_log(path)
    sentence = str(caught.value)
    for part in (path.name, *parts):
        assert part in sentence, sentence
    return sentence


def test_a_csv_is_read_column_by_column(tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "a.csv", csv_lines()))
    assert (
        len(log) == 60
        and log.time_s[0] == 0.001
        and list(log.columns) == ["duty", "current_a", "speed_rpm"]
    )
    assert log["current_a"][9] == 1.0 and log.warnings == []


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_line_ends_byte_order_mark_blanks_and_quotes_do_not_matter(
    tmp_path: Path, end: str
) -> None:
    lines = csv_lines()
    lines[0] = '\ufefftime_s, duty ,"current_a",speed_rpm'
    lines[3] = '"0.003", 0.5 ,0.3,3'
    lines.insert(10, "")
    log = read_log(written(tmp_path / "a.csv", lines, end))
    assert len(log) == 60 and log["current_a"][2] == 0.3 and log["duty"][2] == 0.5


def test_columns_in_any_order_and_unknown_ones_ignored_with_a_warning(tmp_path: Path) -> None:
    lines = [
        ",".join([cells[3], "words", cells[1], cells[0], cells[2]])
        for cells in (line.split(",") for line in csv_lines())
    ]
    lines[0] = "speed_rpm,note,duty,time_s,current_a"
    log = read_log(written(tmp_path / "a.csv", lines))
    assert log["speed_rpm"][4] == 5 and "note" not in log
    assert (
        len(log.warnings) == 1
        and "unknown column note" in log.warnings[0]
        and "a.csv" in log.warnings[0]
    )


def test_nan_and_empty_cells_are_missing_samples(tmp_path: Path) -> None:
    lines = csv_lines()
    lines[5], lines[6] = "0.005,0.5,NaN,5", "0.006,0.5,,6"
    log = read_log(written(tmp_path / "a.csv", lines))
    assert np.isnan(log["current_a"][4:6]).all() and np.isfinite(log["current_a"]).sum() == 58


@pytest.mark.parametrize("content", [b"", b"\n\n", b"\xef\xbb\xbf"])
def test_rejects_an_empty_file_as_one_without_header(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    refused(tmp_path / "a.csv", "line 1", "no header")


def test_rejects_a_file_without_header(tmp_path: Path) -> None:
    refused(written(tmp_path / "a.csv", csv_lines()[1:]), "line 1, column 1", "no header")


@pytest.mark.parametrize(
    ("header", "column"),
    [
        ("t,duty,current_a,speed_rpm", "time_s"),
        ("time_s,x,y,speed_rpm", "one input of duty, voltage_v, current_a"),
        ("time_s,duty,x,y", "a measured signal"),
        ("time_s,x,current_a,y", "a measured signal"),
        ("time_s,duty,load_nm,trigger", "a measured signal"),
    ],
)
def test_rejects_a_missing_required_column(tmp_path: Path, header: str, column: str) -> None:
    refused(written(tmp_path / "a.csv", [header, *csv_lines()[1:]]), "line 1", "missing", column)


def test_rejects_a_column_that_appears_twice(tmp_path: Path) -> None:
    refused(
        written(tmp_path / "a.csv", ["time_s,duty,duty,speed_rpm", *csv_lines()[1:]]),
        "line 1",
        "duty",
        "2 times",
    )


@pytest.mark.parametrize("stamp", ["0.009", "0.008", "-1"])
def test_rejects_time_that_does_not_increase(tmp_path: Path, stamp: str) -> None:
    lines = csv_lines()
    lines[10] = f"{stamp},0.5,1,10"
    refused(written(tmp_path / "a.csv", lines), "line 11", "time_s", "does not increase")


def test_rejects_a_missing_time(tmp_path: Path) -> None:
    lines = csv_lines()
    lines[10] = ",0.5,1,10"
    refused(written(tmp_path / "a.csv", lines), "line 11", "time_s", "missing")


@pytest.mark.parametrize(
    "cell", ["abc", "1,5"[:1] + ";5", "0x10", "1_000", "--1", "1.2.3", "#N/A", "True"]
)
def test_rejects_a_non_numeric_cell(tmp_path: Path, cell: str) -> None:
    lines = csv_lines()
    lines.insert(5, "")
    lines[20] = f"0.0195,0.5,{cell},10"
    refused(written(tmp_path / "a.csv", lines), "line 21", "current_a", cell)


@pytest.mark.parametrize("cell", ["inf", "-Infinity", "1e999"])
def test_rejects_an_infinite_value(tmp_path: Path, cell: str) -> None:
    lines = csv_lines()
    lines[7] = f"0.007,0.5,1,{cell}"
    refused(written(tmp_path / "a.csv", lines), "line 8", "speed_rpm", "infinite")


@pytest.mark.parametrize("row", ["0.007,0.5,1", "0.007,0.5,1,7,8"])
def test_rejects_a_row_with_another_number_of_cells(tmp_path: Path, row: str) -> None:
    lines = csv_lines()
    lines[7] = row
    refused(written(tmp_path / "a.csv", lines), "line 8", "cells")


@pytest.mark.parametrize("cut", ["0.061,0.", "0.061,0.5,1,1", "0.061", '0.061,"'])
def test_a_last_row_without_its_line_end_is_left_out_with_a_warning(
    tmp_path: Path, cut: str
) -> None:
    """A current of 17.5 that was cut to 1 cannot be told from a current of 1."""
    (tmp_path / "a.csv").write_text("\n".join(csv_lines()) + "\n" + cut)
    log = read_log(tmp_path / "a.csv")
    assert len(log) == 60 and "line 62: is left out: its line end is missing" in log.warnings[0]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_kind_of_line_end_completes_the_last_row(tmp_path: Path, end: str) -> None:
    (tmp_path / "a.csv").write_bytes((end.join(csv_lines()) + end).encode())
    log = read_log(tmp_path / "a.csv")
    assert len(log) == 60 and log.warnings == []


@pytest.mark.parametrize(("rows", "enough"), [(49, False), (50, True)])
def test_rejects_fewer_than_50_usable_samples(tmp_path: Path, rows: int, enough: bool) -> None:
    path = written(tmp_path / "a.csv", csv_lines(rows))
    if enough:
        assert len(read_log(path)) == 50
    else:
        refused(path, "49 usable samples", "50")


def test_samples_without_input_or_without_measurement_do_not_count_as_usable(
    tmp_path: Path,
) -> None:
    lines = csv_lines(60)
    for k in range(1, 12):
        lines[k] = f"{k / 1000},,,{k}" if k % 2 else f"{k / 1000},0.5,,"
    refused(written(tmp_path / "a.csv", lines), "49 usable samples")


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"MDF     4.10    " + bytes(100), "MF4"),
        (b"LOGG" + bytes(200), "BLF"),
        (b"\x00\x01\x02time_s", "binary"),
        (b"time_s,duty\n\xff\xfe\x81", "UTF-8"),
        ("time_s,duty".encode("utf-16-le"), "binary"),
        (b"date Fri Nov 20 10:00:00.000 2026\n", "ASC"),
    ],
)
def test_rejects_a_csv_that_is_not_one(tmp_path: Path, content: bytes, why: str) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    refused(tmp_path / "a.csv", "does not match its ending .csv", why)


@pytest.mark.parametrize("ending", [".mf4", ".blf", ".asc"])
def test_rejects_a_text_with_the_ending_of_a_binary_file(tmp_path: Path, ending: str) -> None:
    refused(written(tmp_path / f"a{ending}", csv_lines()), f"does not match its ending {ending}")


def test_rejects_an_unknown_ending_and_a_missing_file(tmp_path: Path) -> None:
    refused(written(tmp_path / "a.txt", csv_lines()), "ends in .csv")
    refused(tmp_path / "none.csv", "No such file")
    (tmp_path / "dir.csv").mkdir()
    refused(tmp_path / "dir.csv", "directory")


def test_warns_of_a_duty_in_percent(tmp_path: Path) -> None:
    lines = csv_lines()
    log = read_log(
        written(
            tmp_path / "a.csv", [lines[0], *(line.replace(",0.5,", ",50,") for line in lines[1:])]
        )
    )
    assert any("duty" in warning and "50" in warning for warning in log.warnings)


def test_recognises_an_unsigned_current_and_only_that() -> None:
    duty = np.repeat([0.8, -0.8, 0.8, 0.0], 50)
    current, speed = (
        np.repeat([5.0, -5.0, 5.0, -8.0], 50),
        np.repeat([900.0, -900.0, 900.0, 500.0], 50),
    )
    signed = Log(
        np.arange(200) / 1000, {"duty": duty, "current_a": current, "speed_rpm": speed}, "x"
    )
    unsigned = Log(signed.time_s, signed.columns | {"current_a": np.abs(current)}, "x")
    forward = Log(
        signed.time_s[:50], {name: values[:50] for name, values in unsigned.columns.items()}, "x"
    )
    assert (
        current_is_unsigned(unsigned)
        and not current_is_unsigned(signed)
        and not current_is_unsigned(forward)
    )


STAMPS = st.lists(st.floats(-2e9, 2e9), min_size=60, max_size=80, unique=True)
STEPS = st.sampled_from([1e-6, 1e-4, 1e-3, 0.1])
CLOSE = st.builds(
    lambda start, step, count: list(start + step * np.arange(count)),
    st.floats(0, 2e9),
    STEPS,
    st.integers(60, 80),
)


@given(
    STAMPS | CLOSE,
    st.lists(
        st.floats(allow_infinity=False, min_value=-1e300, max_value=1e300) | st.just(float("nan")),
        min_size=80,
    ),
)
@settings(max_examples=60, deadline=None)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, times: list[float], speeds: list[float]
) -> None:
    """Time to the last bit, whatever its origin; the rest to 12 digits."""
    path, time_s = tmp_path_factory.mktemp("log") / "a.csv", np.unique(times)
    count = len(time_s)
    if count < 60:  # steps below the resolution of the stamps
        return
    columns = {
        "duty": np.full(count, 1 / 255),
        "current_a": np.ones(count),
        "speed_rpm": np.array(speeds[:count]),
    }
    write_csv(Log(time_s, columns, "x"), path)
    back = read_log(path)
    assert np.array_equal(back.time_s, time_s)
    for name, values in columns.items():
        assert np.allclose(back[name], values, rtol=5e-12, atol=0, equal_nan=True)


def test_a_recording_is_written_exactly_and_stays_small(tmp_path: Path, stream: bytes) -> None:
    """Current in steps of 2^-9 A needs 11 digits up to 64 A; a row of the board's fourteen columns
    takes less than 110 bytes.
    """
    log, path = log_from_stream(stream, "stream"), tmp_path / "a.csv"
    log.columns["current_a"] = np.linspace(-32768, 32767, len(log)).round() / 512
    write_csv(log, path)
    back = read_log(path)
    assert np.array_equal(back["current_a"], log["current_a"]) and np.array_equal(
        back.time_s, log.time_s
    )
    assert np.array_equal(
        (back["duty"] * 255).round(), (log["duty"] * 255).round()
    ) and path.stat().st_size < 110 * len(log)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("old")
    monkeypatch.setattr(
        os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    with pytest.raises(VgrooveError, match="a.csv: cannot be written: No space left"):
        write_csv(sample_log(), path)
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.csv"]


def processor_time_s(work: Callable[[], object]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def test_a_large_file_is_read_at_the_cost_of_its_numbers(tmp_path: Path) -> None:
    rows, path = 100_000, tmp_path / "a.csv"
    rng = np.random.default_rng(1)
    columns = {
        "duty": np.round(rng.uniform(-1, 1, rows), 4),
        "supply_v": np.round(rng.normal(18, 0.1, rows), 2),
        "current_a": np.round(rng.normal(0, 9, rows), 2),
        "speed_rpm": np.round(rng.normal(0, 5000, rows), 1),
    }
    write_csv(Log(np.arange(1, rows + 1) / 1000, columns, "x"), path)

    def bare() -> list[list[float]]:
        with path.open(newline="") as file:
            cells = list(csv.reader(file))
        return [list(map(float, column)) for column in zip(*cells[1:], strict=True)]

    pairs = [(processor_time_s(lambda: read_log(path)), processor_time_s(bare)) for _ in range(5)]
    assert min(read / plain for read, plain in pairs) < 2.0  # measured: 0.9 to 1.5


# CAN recordings


@pytest.fixture(scope="module")
def stream() -> bytes:
    eeprom_set()
    board = Board(now_ms=123_456)
    return board.run(3000, moving(board))


def messages_of(stream: bytes) -> list[can.Message]:
    return [frame.message() for frame in telemetry.Framer().feed(stream)]


def by_python_can(path: Path, stream: bytes, skip: int = 0) -> Path:
    """A file as `can.logger` writes it."""
    with can.Logger(path) as logger:
        for message in messages_of(stream)[skip:]:
            logger(message)
    return path


@pytest.mark.parametrize("ending", [".blf", ".asc", ".mf4"])
def test_a_recording_by_python_can_gives_the_log_of_the_stream(
    tmp_path: Path, stream: bytes, ending: str
) -> None:
    log = read_log(by_python_can(tmp_path / f"a{ending}", stream))
    direct = log_from_stream(stream, "stream")
    assert len(log) == 3000 and np.allclose(
        log.time_s - log.time_s[0], direct.time_s - direct.time_s[0], rtol=0, atol=1e-9
    )
    if ending == ".blf":  # python-can's writer keeps no start time before 1990
        assert any("only time differences" in warning for warning in log.warnings)
    else:
        assert np.array_equal(log.time_s, direct.time_s) and log.warnings == []
    for name in telemetry.COLUMNS:
        assert np.array_equal(log[name], direct[name], equal_nan=True), name
    assert log.meta["parameters"]["complete"]


@pytest.mark.parametrize("ending", [".blf", ".asc", ".mf4"])
def test_a_recording_that_begins_in_the_middle_is_read_with_a_warning(
    tmp_path: Path, stream: bytes, ending: str
) -> None:
    log = read_log(by_python_can(tmp_path / f"a{ending}", stream, skip=1500))
    assert len(log) > 1000 and (log.time_s[-1] == 126.456 or ending == ".blf")
    assert any("no BOOT frame" in warning for warning in log.warnings)


@pytest.mark.parametrize("ending", [".blf", ".asc", ".mf4"])
def test_corrupt_frames_in_a_recording_are_counted_not_decoded(
    tmp_path: Path, stream: bytes, ending: str
) -> None:
    with can.Logger(tmp_path / f"a{ending}") as logger:
        for k, message in enumerate(messages_of(stream)):
            if message.arbitration_id == telemetry.FAST and k % 100 == 50:
                message.data[0] ^= 0x40
            logger(message)
    log = read_log(tmp_path / f"a{ending}")
    assert log.meta["counters"]["corrupt"] == 3000 - len(log) > 20
    assert log.meta["counters"]["lost"] == log.meta["counters"]["corrupt"]
    assert any("corrupt" in warning for warning in log.warnings)


@pytest.mark.parametrize("ending", [".blf", ".asc", ".mf4"])
def test_rejects_a_truncated_recording(tmp_path: Path, stream: bytes, ending: str) -> None:
    whole = by_python_can(tmp_path / f"a{ending}", stream)
    size = whole.stat().st_size
    for part in (0.9, 0.5, 0.1, 0.01):
        cut = tmp_path / f"cut{ending}"
        shutil.copy(whole, cut)
        os.truncate(cut, int(size * part))
        refused(cut, "damaged or truncated")


@pytest.mark.parametrize("ending", [".blf", ".asc", ".mf4"])
def test_damage_in_a_recording_is_an_error_or_a_shorter_log_never_a_wrong_one(
    tmp_path: Path, stream: bytes, ending: str
) -> None:
    whole = by_python_can(tmp_path / f"a{ending}", stream).read_bytes()
    direct = log_from_stream(stream, "stream")
    rng = random.Random(3)
    for _ in range(12):
        broken = bytearray(whole)
        for at in rng.sample(range(8, len(broken)), 20):
            broken[at] = rng.randrange(256)
        path = tmp_path / f"broken{ending}"
        path.write_bytes(broken)
        try:
            log = read_log(path)
        except VgrooveError as error:
            assert "broken" in str(error)
            continue
        rows = np.searchsorted(direct.time_s, log.time_s)
        assert np.array_equal(direct["current_a"][rows], log["current_a"])


@pytest.mark.parametrize("ending", [".blf", ".asc", ".mf4"])
def test_rejects_a_recording_of_something_else(tmp_path: Path, ending: str) -> None:
    with can.Logger(tmp_path / f"a{ending}") as logger:
        for k in range(100):
            logger(
                can.Message(
                    timestamp=1e9 + k / 1000,
                    arbitration_id=0x123,
                    data=bytes(8),
                    is_extended_id=False,
                )
            )
    refused(tmp_path / f"a{ending}", "no intact telemetry frame")


@pytest.mark.parametrize("up_ms", [5, 123_456_789, 2**32 - 1500])
def test_the_boards_time_is_recovered_from_the_crcs(up_ms: int) -> None:
    eeprom_set()
    frames = telemetry.Framer().feed(Board(now_ms=up_ms).run(3000))
    shifted = [
        frame._replace(time_ms=(frame.time_ms - frames[0].time_ms) & 0xFFFFFFFF) for frame in frames
    ]
    shifted[0] = shifted[0]._replace(data=bytes(8))
    offset = telemetry.time_offset(shifted)
    assert offset == frames[0].time_ms or (up_ms > 1 << 16 and offset < frames[0].time_ms)
    for frame in shifted[1:]:
        assert (
            telemetry.frame_crc((frame.time_ms + offset) & 0xFFFFFFFF, frame.id, frame.data)
            == frame.data[7]
        )
    assert (
        telemetry.time_offset(frames) == 0
        and telemetry.time_offset(shifted, [frames[0].time_ms]) == frames[0].time_ms
    )
    assert telemetry.time_offset([frame._replace(data=bytes(range(8))) for frame in frames]) is None


def mf4(path: Path, samples: dict[str, np.ndarray], time_s: np.ndarray) -> Path:
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(values, time_s, name=name) for name, values in samples.items()])
        mdf.save(path, overwrite=True)
    return path


def test_an_mf4_with_channels_named_as_log_columns_is_read(tmp_path: Path) -> None:
    log = sample_log()
    back = read_log(mf4(tmp_path / "a.mf4", log.columns | {"extra": np.zeros(200)}, log.time_s))
    assert np.array_equal(back.time_s, log.time_s) and np.array_equal(
        back["speed_rpm"], log["speed_rpm"]
    )
    assert [w for w in back.warnings if "extra" in w]


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (
            lambda s, t: ({k: v for k, v in s.items() if k == "duty"}, t),
            ("missing", "measured signal"),
        ),
        (lambda s, t: ({k: v[:49] for k, v in s.items()}, t[:49]), ("49 usable samples",)),
        (
            lambda s, t: (s | {"speed_rpm": np.where(np.arange(200) == 7, np.inf, 1.0)}, t),
            ("sample 8", "speed_rpm", "infinite"),
        ),
        (
            lambda s, t: (s, np.where(np.arange(200) == 7, t[6], t)),
            ("sample 8", "time_s", "does not increase"),
        ),
        (lambda s, t: ({"x": s["duty"]}, t), ("missing", "one input of duty", "of the file are x")),
    ],
)
def test_rejects_in_an_mf4_what_it_rejects_in_a_csv(
    tmp_path: Path, change: Callable, parts: tuple[str, ...]
) -> None:
    log = sample_log()
    refused(mf4(tmp_path / "a.mf4", *change(log.columns, log.time_s)), *parts)


def test_practice_log_is_read_without_warnings() -> None:
    log = read_log(PRACTICE)
    assert (
        len(log) == 6000
        and log.warnings == []
        and list(log.columns) == ["duty", "supply_v", "current_a", "speed_rpm"]
    )


@pytest.mark.parametrize("without_boot", [False, True])
def test_of_a_can_file_with_two_runs_the_longer_one_is_read(without_boot: bool) -> None:
    short, long = Board(), Board()
    frames = telemetry.Framer().feed(short.run(300, moving(short)))
    second = telemetry.Framer().feed(long.run(900, moving(long)))
    if without_boot:  # its first frames were lost
        second = [f for f in second if f.id == telemetry.FAST]
    run, left_out = can_files._longest_run([*frames, *second])
    assert (run.counters.fast, left_out) == (900, 300)
    assert run.counters.corrupt == 0


@pytest.mark.parametrize("day", ["Die Dez 1 10:00:00.123 2026", "Tue Feb 30 10:00:00.123 2026"])
def test_an_asc_file_with_a_date_of_another_language_is_refused_only_for_its_content(
    day: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.asc"
    path.write_text(
        f"date {day}\nbase hex  timestamps absolute\nBegin Triggerblock {day}\n"
        " 0.000000 Start of measurement\nEnd TriggerBlock\n"
    )
    with pytest.raises(VgrooveError, match="telemetry"):
        read_log(path)
