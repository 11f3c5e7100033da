"""Logs as other programs write them: names, units, separators, and the formats besides the
project's own.
"""

import codecs
import csv
import gzip
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from asammdf import MDF, Signal
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from telemetry_board import ROOT
from vgroove.errors import VgrooveError
from vgroove.log import ColumnMap, Log, as_list, as_log, column_map, read_log, write_csv
from vgroove.log.column_map import NO_MAP
from vgroove.log.raw_columns import RawColumns, log_from_raw
from vgroove.log.stated_units import unit_in_name
from vgroove.log.units_of_columns import UNITS, unit_factor
from vgroove.units import RPM_PER_RAD_S
from warm_cli import warm_vgroove

PRACTICE = ROOT / "tests/data/practice/practice_002"
VGROOVE = str(Path(sys.executable).with_name("vgroove"))
FOREIGN = ("Time:ms=time_s", "U_cmd=duty", "I_motor:mA=current_a", "n:rad/s=speed_rpm")


def sample(rows: int = 80) -> Log:
    rng = np.random.default_rng(4)
    names = ("duty", "current_a", "speed_rpm")
    columns = {name: rng.uniform(-1, 1, rows).round(6) for name in names}
    return Log(np.arange(1, rows + 1) / 1000, columns, "sample")


def same(log: Log, other: Log, tolerance: float = 1e-12) -> bool:
    return bool(
        np.allclose(log.time_s, other.time_s, rtol=tolerance, atol=1e-12)
        and all(
            np.allclose(log[n], other[n], rtol=tolerance, atol=1e-12, equal_nan=True)
            for n in ("duty", "current_a", "speed_rpm")
        )
    )


def foreign(log: Log) -> dict[str, np.ndarray]:
    """The columns of a log under other names and in other units: those of FOREIGN."""
    return {
        "Time": log.time_s * 1e3,
        "U_cmd": log["duty"],
        "I_motor": log["current_a"] * 1e3,
        "n": log["speed_rpm"] / RPM_PER_RAD_S,
    }


def text_of(columns: dict[str, np.ndarray], delimiter: str = ",", point: str = ".") -> str:
    lines = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(delimiter.join(f"{value:.12g}".replace(".", point) for value in row))
    return "\n".join(lines) + "\n"


def own(log: Log) -> dict[str, np.ndarray]:
    return {"time_s": log.time_s} | log.columns


def refused(path: Path, *parts: str, columns: ColumnMap | None = None) -> None:
    with pytest.raises(VgrooveError) as caught:
        read_log(path, columns or column_map())
    for part in (path.name, *parts):
        assert part in str(caught.value), str(caught.value)


@pytest.mark.parametrize(("delimiter", "point"), [(";", ","), ("\t", ","), (";", "."), ("\t", ".")])
def test_separator_and_decimal_comma_are_recognised(
    tmp_path: Path, delimiter: str, point: str
) -> None:
    (tmp_path / "a.csv").write_text(text_of(own(sample()), delimiter, point))
    log = read_log(tmp_path / "a.csv")
    assert same(log, sample()) and log.warnings == []


@pytest.mark.parametrize("delimiter", [";", "\t", ","])
def test_quoted_cells_with_a_decimal_comma_are_numbers(tmp_path: Path, delimiter: str) -> None:
    with (tmp_path / "a.csv").open("w", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter, quoting=csv.QUOTE_ALL)
        writer.writerow(own(sample()))
        for row in zip(*own(sample()).values(), strict=True):
            writer.writerow([f"{value:.12g}".replace(".", ",") for value in row])
    assert same(read_log(tmp_path / "a.csv"), sample())


@pytest.mark.parametrize("cell", ['1"2"3', '"1""2"', '"1,2,3"', '""1'])
def test_a_quote_within_a_cell_is_no_number(tmp_path: Path, cell: str) -> None:
    lines = text_of(own(sample())).splitlines()
    lines[4] = f"0.004,{cell},1,2"
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    refused(tmp_path / "a.csv", "line 5")


def test_decimal_commas_between_commas_are_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text_of(own(sample()), ",", ","))
    refused(tmp_path / "a.csv", "line 2", "decimal comma", "semicolons")


@pytest.mark.parametrize("sign", ["#", "%"])
def test_comment_lines_are_left_out_and_lines_are_counted_with_them(
    tmp_path: Path, sign: str
) -> None:
    lines = text_of(own(sample())).splitlines()
    lines[0:0] = [f"{sign} recorded by hand, at noon", "", f"  {sign} second"]
    lines.insert(30, f"{sign} pause, here")
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    assert same(read_log(tmp_path / "a.csv"), sample())
    lines[40] = "0.5,x,1,2"
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    refused(tmp_path / "a.csv", "line 41", "column duty")


def test_a_header_in_a_comment_is_a_header(tmp_path: Path) -> None:
    text = "# made by numpy.savetxt\n# " + text_of(own(sample()))
    (tmp_path / "a.csv").write_text(text)
    assert same(read_log(tmp_path / "a.csv"), sample())


@pytest.mark.parametrize("kind", ["pandas", "R", "separator at the end"])
def test_columns_without_a_name_are_no_obstacle(tmp_path: Path, kind: str) -> None:
    lines = text_of(own(sample())).splitlines()
    if kind == "separator at the end":
        lines = [lines[0], *(line + "," for line in lines[1:])]
    else:
        first = "," + lines[0] if kind == "pandas" else lines[0]
        lines = [first, *(f"{k},{line}" for k, line in enumerate(lines[1:]))]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    assert same(read_log(tmp_path / "a.csv"), sample())


@pytest.mark.parametrize(
    "units", ["ms,mA,rad/s,", "(ms),(mA),(rad/s),(-)", "[ms],[mA],[rad/s],[1]"]
)
def test_a_line_of_units_below_the_names_is_read(tmp_path: Path, units: str) -> None:
    columns = foreign(sample())
    lines = text_of({n: columns[n] for n in ("Time", "I_motor", "n", "U_cmd")}).splitlines()
    (tmp_path / "a.csv").write_text("\n".join([lines[0], units, "", *lines[1:], ""]))
    names = [text.split("=")[0].split(":")[0] + "=" + text.split("=")[1] for text in FOREIGN]
    assert same(read_log(tmp_path / "a.csv", column_map(names)), sample(), 1e-9)


def test_a_line_of_units_may_hold_1_for_plain_numbers(tmp_path: Path) -> None:
    names, *rows = text_of(own(sample())).splitlines()
    (tmp_path / "a.csv").write_text("\n".join([names, "s,1,A,1/min", *rows]) + "\n")
    assert same(read_log(tmp_path / "a.csv"), sample())


@pytest.mark.parametrize(
    ("delimiter", "head"),
    [
        (";", ["sep=;"]),
        (",", ['"sep=,"']),
        (",", ["// logger 5"]),
        (",", ["Logger: XY12", "Serial;1234;", ""]),
        (";", ["Device;XY", "Date;2026-03-31", "Rate;1000 Hz"]),
    ],
)
def test_lines_before_the_names_are_left_out(
    tmp_path: Path, delimiter: str, head: list[str]
) -> None:
    text = "\n".join(head) + "\n" + text_of(own(sample()), delimiter)
    (tmp_path / "a.csv").write_text(text)
    log = read_log(tmp_path / "a.csv")
    count = sum(bool(line) for line in head)
    assert same(log, sample())
    assert [f"{count} lines before the names" in w for w in log.warnings] == (
        [] if "sep=" in head[0] else [True]
    )


@pytest.mark.parametrize("kind", ["date", "date with zone", "time of day"])
def test_dates_become_seconds_since_the_first(tmp_path: Path, kind: str) -> None:
    start = datetime(2026, 3, 31, 12, 0, 0, tzinfo=UTC)
    moments = [start + timedelta(seconds=float(t)) for t in sample().time_s]
    if kind == "time of day":
        stamps = [m.strftime("%H:%M:%S.%f") for m in moments]
    else:
        stamps = [m.isoformat(" " if kind == "date" else "T", "microseconds") for m in moments]
    lines = text_of(own(sample())).splitlines()
    rows = [s + "," + line.partition(",")[2] for s, line in zip(stamps, lines[1:], strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([lines[0], *rows]) + "\n")
    log = read_log(tmp_path / "a.csv")
    assert np.allclose(log.time_s, sample().time_s - sample().time_s[0], atol=1e-6)
    rows[5] = "31.03.26 12:00:00," + rows[5].partition(",")[2]
    (tmp_path / "a.csv").write_text("\n".join([lines[0], *rows]) + "\n")
    refused(tmp_path / "a.csv", "line 7, column time_s", "2026-03-31 12:00:00.001")


def test_an_endless_cell_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,duty,current_a\n" + "1" * 200_000 + "\n")
    refused(tmp_path / "a.csv", "is not CSV")


def with_cells(path: Path, cells: list[str], delimiter: str = ";") -> Path:
    """A file with these cells as current_a, and decimal commas elsewhere."""
    rows = [f"0,{k:03d};0,5;{cell};10" for k, cell in enumerate(cells)]
    text = "\n".join(["time_s;duty;current_a;speed_rpm", *rows]) + "\n"
    path.write_text(text)
    return path


@given(
    st.lists(st.integers(1001, 999_999), min_size=40, max_size=60, unique=True),
    st.sampled_from(",."),
)
@settings(max_examples=60, deadline=None)
def test_thousands_separators_are_refused(
    tmp_path_factory: pytest.TempPathFactory, large: list[int], separator: str
) -> None:
    path = tmp_path_factory.mktemp("thousands") / "a.csv"
    large = [*large, 2260]
    cells = [f"{value:,}".replace(",", separator) for value in [*large, *range(12, 900, 60)]]
    with_cells(path, cells)
    refused(path, "column current_a", "without thousands separators")
    with pytest.raises(VgrooveError, match="thousands"):
        read_log(path, column_map(["current_a:kA=current_a"]))
    decimals = [f"{value / 1000:.3f}".replace(".", separator) for value in [*large, *range(12, 72)]]
    assert len(read_log(with_cells(path, decimals))) == len(decimals)
    short = [f"{value / 1000:g}".replace(".", separator) for value in [*large, 1500, *range(60)]]
    assert len(read_log(with_cells(path, short))) == len(short)


@given(st.sampled_from([3, 7, 9, 11, 13]), st.sampled_from([1, 10]), st.booleans())
@settings(max_examples=40, deadline=None)
def test_decimals_without_zeros_at_their_end_are_no_thousands(
    tmp_path_factory: pytest.TempPathFactory, parts: int, first: int, comma: bool
) -> None:
    """Parts of whole numbers with four digits from 1 on, or five from 10 on: 1.143, 1.286 ... 2."""
    form = "%.4g" if first == 1 else "%.5g"
    cells = [form % (first * k / parts) for k in range(parts, 9 * parts)] * 4
    path = tmp_path_factory.mktemp("decimals") / "a.csv"
    with_cells(path, [c.replace(".", ",") for c in cells] if comma else cells)
    assert np.array_equal(read_log(path)["current_a"], np.array(cells, float))


def test_few_decimals_are_no_thousands(tmp_path: Path) -> None:
    for different, last, refuses in ((9, 0, False), (10, 0, True), (10, 5, False)):
        values = [k % (different + 1) for k in range(80)]
        cells = [f"{value},12{last}" if value else "0" for value in values]
        path = with_cells(tmp_path / "a.csv", cells)
        if refuses:
            refused(path, "thousands")
        else:
            assert read_log(path)["current_a"][1] == 1.12 + last / 1000


def test_a_long_text_beside_numbers_with_three_digits_is_a_sentence(tmp_path: Path) -> None:
    rows = [f"{k / 1000},0.5,{k % 50 + 1}.12{k % 9},10,x" for k in range(80)]
    text = "\n".join(["time_s,duty,current_a,speed_rpm,note", *rows]) + "y" * 200_000 + "\n"
    (tmp_path / "a.csv").write_text(text)
    refused(tmp_path / "a.csv", "is not CSV", "leave columns of long texts out")


@pytest.mark.parametrize("cell", ["2.268,5", "2'268", "2\u202f268", "1.234.567", "1 234.5"])
def test_a_number_with_thousands_separators_is_named(tmp_path: Path, cell: str) -> None:
    refused(with_cells(tmp_path / "a.csv", ["1,5"] * 60 + [cell]), "line 62", "thousands")


def two_times(rows: int, slow: int, ends: int | None = None) -> str:
    """A log with a second time column and its speed, which end after `slow` rows; the speed after
    `ends`.
    """
    lines = ["Time fast [s];I;duty;Time slow [s];n"]
    for k in range(rows):
        time = f"{k / 100}" if k < slow else ""
        lines.append(f"{k / 1000};{k % 7};0.5;{time};{k if k < (ends or slow) else ''}")
    return "\n".join(lines) + "\n"


def test_a_second_time_column_is_named(tmp_path: Path) -> None:
    columns = column_map(["Time fast [s]=time_s", "I=current_a", "n=speed_rpm"])
    path = tmp_path / "a.csv"
    for slow in (60, 150, 195):
        path.write_text(two_times(200, slow))
        refused(path, "column n", "Time slow [s]", "a log of their own", columns=columns)
    for text in (two_times(200, 196), two_times(200, 200, 150), two_times(200, 150, 100)):
        path.write_text(text)
        assert len(read_log(path, columns)) == 200
    path.write_text(two_times(200, 150).replace("Time slow [s]", "Torque"))
    assert len(read_log(path, columns)) == 200
    without = column_map(["Time fast [s]=time_s", "I=current_a"])
    path.write_text(two_times(200, 150))
    assert len(read_log(path, without)) == 200


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "cp1252", "latin-1", "utf-8-sig"])
def test_text_is_read_in_the_encodings_of_usual_programs(tmp_path: Path, encoding: str) -> None:
    text = "# M\u00fcller\nt [\u00b5s],duty,current_a,\u03c9 [\u00b0/s]\n"
    text = text.replace("\u03c9", "n") if encoding in ("cp1252", "latin-1") else text
    columns = own(sample()) | {"time_s": sample().time_s * 1e6}
    columns["speed_rpm"] = 6.0 * columns["speed_rpm"]
    text += text_of(columns).partition("\n")[2]
    mark = codecs.BOM_UTF16_BE if encoding == "utf-16-be" else b""
    (tmp_path / "a.csv").write_bytes(mark + text.encode(encoding))
    name = "n" if encoding in ("cp1252", "latin-1") else "\u03c9"
    entries = column_map(["t [\u00b5s]=time_s", f"{name} [\u00b0/s]=speed_rpm"])
    log = read_log(tmp_path / "a.csv", entries)
    assert same(log, sample(), 1e-9)
    assert [w.partition(": ")[2] for w in log.warnings] == (
        ["is not UTF-8: read as Windows-1252, in which byte 3 is '\u00fc'."] if name == "n" else []
    )


def test_damaged_text_is_refused_whatever_its_encoding(tmp_path: Path) -> None:
    text = "# M\u00fcller\n" + text_of(own(sample()))
    (tmp_path / "a.csv").write_bytes(text.encode("utf-16")[:-1])
    refused(tmp_path / "a.csv", "damaged UTF-16")
    (tmp_path / "a.csv").write_bytes(text.encode("cp1252").replace(b"M", b"\x81"))
    refused(tmp_path / "a.csv", "byte 2 is not UTF-8", "save")
    (tmp_path / "a.csv").write_bytes(text.encode().replace(b"0.001,", b"0.0\xb01,"))
    refused(tmp_path / "a.csv", "line 3, column time_s")


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda t: np.round(t, 2), "more digits"),
        (lambda t: np.where(t > 0.04, t - 0.03, t), "a log of its own"),
        (lambda t: np.where(t == 0.04, 0.039, t), "delete the rows"),
    ],
)
def test_times_that_do_not_increase_have_a_mend(
    tmp_path: Path, change: Callable, part: str
) -> None:
    columns = own(sample())
    (tmp_path / "a.csv").write_text(text_of(columns | {"time_s": change(columns["time_s"])}))
    refused(tmp_path / "a.csv", "time does not increase", part)


def with_times(stamps: list[str]) -> str:
    names, *rows = text_of(own(sample())).splitlines()
    lines = [s + "," + row.partition(",")[2] for s, row in zip(stamps, rows, strict=False)]
    return "\n".join([names, *lines]) + "\n"


@given(
    st.sampled_from([("us", 32), ("ms", 32), ("ms", 16), ("ns", 32)]),
    st.integers(1, 79),
    st.integers(1, 50_000),
)
@settings(max_examples=60, deadline=None)
def test_a_counter_that_begins_again_goes_on(clock: tuple, at: int, ticks: int) -> None:
    unit, bits = clock
    step = ticks % 100 + 1 if bits == 16 else ticks
    count = 2**bits - at * step + np.arange(80) * step
    log = as_log(own(sample()) | {"time_s": count % 2**bits}, column_map([f"time_s:{unit}=time_s"]))
    tick_s = unit_factor(unit, "time_s")
    assert np.allclose(np.diff(log.time_s), step * tick_s, rtol=1e-4)
    assert [f"once, after 2^{bits} ticks" in warning for warning in log.warnings] == [True]
    later = np.where(np.arange(80) < at, count, count % 2**bits + 4 * step + 1)
    with pytest.raises(VgrooveError, match="goes back once"):
        as_log(own(sample()) | {"time_s": later % 2**bits}, column_map([f"time_s:{unit}=time_s"]))


def of_day(seconds: np.ndarray) -> list[str]:
    start = datetime(2026, 3, 31, tzinfo=UTC)
    return [(start + timedelta(seconds=float(t))).strftime("%H:%M:%S.%f") for t in seconds]


def test_times_of_day_go_on_after_midnight(tmp_path: Path) -> None:
    seconds = 86_399.98 + sample().time_s
    (tmp_path / "a.csv").write_text(with_times(of_day(seconds % 86_400.0)))
    log = read_log(tmp_path / "a.csv")
    assert np.allclose(log.time_s, sample().time_s - sample().time_s[0], atol=2e-6)
    assert "begins again once, after a day" in log.warnings[0]


@given(st.integers(1, 15), st.floats(0.1, 5.0))
@example(1, 1.4977850480957535)  # pauses of equal length differ by the rounding of the stamps
@settings(max_examples=30, deadline=None)
def test_a_pause_at_midnight_is_one_of_the_rows(
    tmp_path_factory: pytest.TempPathFactory, burst: int, pause_s: float
) -> None:
    seconds = np.arange(80) * 0.02 + np.arange(80) // 5 * pause_s
    since = seconds - seconds[5 * burst] + 0.3 * pause_s
    path = tmp_path_factory.mktemp("pause") / "a.csv"
    path.write_text(with_times(of_day(since % 86_400.0)))
    assert np.allclose(read_log(path).time_s, seconds, atol=4e-6)


@given(st.sampled_from([1e-6, 1e-3]), st.integers(1, 79), st.floats(0.001, 0.5))
@settings(max_examples=30, deadline=None)
def test_a_counter_of_32_bits_in_seconds_goes_on(tick_s: float, at: int, step_s: float) -> None:
    period_s = 2.0**32 * tick_s
    time_s = (period_s + (np.arange(80) - at + 0.5) * step_s) % period_s
    log = as_log(own(sample()) | {"time_s": time_s})
    assert np.allclose(np.diff(log.time_s), step_s, atol=1e-6)
    assert ["begins again once, after 2^32" in warning for warning in log.warnings] == [True]


@pytest.mark.parametrize(
    ("stamps", "part"),
    [
        (of_day((46_799.97 + np.arange(80) / 1000 - 3600.0) % 43_200.0 + 3600.0), "of 12 hours"),
        ([f"12:00:{k // 1000:02d}.{k % 1000}" for k in range(60, 140)], "goes back once"),
        ([f"12:00:{k // 200:02d}.{k % 200}" for k in range(0, 800, 5)], "leading zeros"),
        ([f"12:00:{k // 200:02d}.{k % 200}" for k in range(0, 1600, 3)], "leading zeros"),
        ([f"{k / 200 % 1:.3f}" for k in range(300)], "part of a second"),
        ([f"{k % 60}" for k in range(80)], "part of a minute"),
        ([f"{80 - k}" for k in range(80)], "most rows"),
    ],
)
def test_a_clock_that_goes_back_is_named(tmp_path: Path, stamps: list[str], part: str) -> None:
    rows = sample(len(stamps))
    text = text_of(own(rows)).splitlines()
    lines = [s + "," + row.partition(",")[2] for s, row in zip(stamps, text[1:], strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([text[0], *lines]) + "\n")
    refused(tmp_path / "a.csv", "time does not increase", part)


@pytest.mark.parametrize("first", ["a{}", "2026-03-31 12:00:{}", "{}"])
def test_row_names_have_no_name(tmp_path: Path, first: str) -> None:
    names, *rows = text_of(own(sample(50))).splitlines()
    lines = [f"{first.format(k + 10)},{row}" for k, row in enumerate(rows)]
    (tmp_path / "a.csv").write_text("\n".join([names, *lines]) + "\n")
    assert same(read_log(tmp_path / "a.csv"), sample(50))


@pytest.mark.parametrize("first", ["100.25,", "0.001,", "2.0,"])
def test_a_cell_more_than_names_is_no_index(tmp_path: Path, first: str) -> None:
    names, *rows = text_of(own(sample())).splitlines()
    (tmp_path / "a.csv").write_text("\n".join([names, *(first + row for row in rows)]) + "\n")
    refused(tmp_path / "a.csv", "line 2: has 5 cells, the header has 4", "Give each column a name")


@pytest.mark.parametrize("names", ["Time;U_cmd;I_motor;n", "# Time;U_cmd;I_motor;n"])
@pytest.mark.parametrize("units", ["#ms;1;mA;rad/s", "# ms;-;mA;rad/s", "%ms;;mA;rad/s"])
def test_units_in_a_comment_below_the_names_are_read(
    tmp_path: Path, names: str, units: str
) -> None:
    rows = text_of(foreign(sample()), ";").splitlines()[1:]
    (tmp_path / "a.csv").write_text("\n".join([names, units, *rows]) + "\n")
    plain = ["Time=time_s", "U_cmd=duty", "I_motor=current_a", "n=speed_rpm"]
    assert same(read_log(tmp_path / "a.csv", column_map(plain)), sample(), 1e-9)


def test_a_line_of_units_may_begin_with_percent(tmp_path: Path) -> None:
    columns = {"duty": sample()["duty"] * 100.0} | own(sample())
    columns["duty"] = sample()["duty"] * 100.0
    names, *rows = text_of(columns).splitlines()
    (tmp_path / "a.csv").write_text("\n".join([names, "%,s,A,rpm", *rows]) + "\n")
    assert same(read_log(tmp_path / "a.csv"), sample(), 1e-9)


def test_bytes_0_at_the_end_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(text_of(own(sample(400))).encode() + bytes(4096))
    log = read_log(tmp_path / "a.csv")
    assert len(log) == 400 and "4096 bytes 0" in log.warnings[0]


def test_a_file_with_too_few_columns_names_those_it_has(tmp_path: Path) -> None:
    names, *rows = [line.partition(",")[2] for line in text_of(own(sample())).splitlines()]
    (tmp_path / "a.csv").write_text("\n".join([names, *rows]) + "\n")
    refused(tmp_path / "a.csv", "time_s is missing", "besides current_a, duty, speed_rpm")


def test_units_in_the_names_are_read_and_an_option_replaces_them(tmp_path: Path) -> None:
    columns = foreign(sample())
    columns["I (mA)"], columns["t [ms]"] = columns.pop("I_motor"), columns.pop("Time")
    (tmp_path / "a.csv").write_text(text_of(columns))
    rest = ["U_cmd=duty", "n:rad/s=speed_rpm", "t [ms]=time_s"]
    assert same(
        read_log(tmp_path / "a.csv", column_map([*rest, "I (mA)=current_a"])), sample(), 1e-9
    )
    log = read_log(tmp_path / "a.csv", column_map([*rest, "I (mA):A=current_a"]))
    assert np.allclose(log["current_a"], sample()["current_a"] * 1e3)


def test_a_compressed_csv_is_read_and_a_damaged_one_refused(tmp_path: Path) -> None:
    whole = gzip.compress(text_of(own(sample())).encode())
    (tmp_path / "a.csv.gz").write_bytes(whole)
    assert same(read_log(tmp_path / "a.csv.gz"), sample())
    (tmp_path / "a.csv.gz").write_bytes(whole[: len(whole) // 2])
    refused(tmp_path / "a.csv.gz", "damaged or truncated gzip")
    (tmp_path / "a.csv.gz").write_text(text_of(own(sample())))
    refused(tmp_path / "a.csv.gz", "does not match its ending .csv.gz")


def test_a_map_names_columns_and_units(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text_of(foreign(sample()), ";", ","))
    assert same(read_log(tmp_path / "a.csv", column_map(FOREIGN)), sample(), 1e-9)


def test_a_mapping_file_does_the_same_and_options_replace_its_entries(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(
        'schema = "vgroove.map/1"\n[columns]\ntime_s = "Time:ms"\nduty = "U_cmd"\n'
        'current_a = { name = "I_motor", unit = "A" }\nspeed_rpm = "n:rad/s"\n'
    )
    columns = column_map(["I_motor:mA=current_a"], tmp_path / "map.toml")
    assert set(columns.entries) == set(column_map(FOREIGN).entries)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('schema = "vgroove.map/2"', "schema"),
        ('schema = "vgroove.map/1"\ncolumn = 1', "column"),
        ('schema = "vgroove.map/1"\n[columns]\ncurent_a = "I"', "current_a"),
        ('schema = "vgroove.map/1"\n[columns]\ncurrent_a = 3', "columns.current_a"),
        ('schema = "vgroove.map/1"\n[columns]\ncurrent_a = "I:mV"', "no unit of current_a"),
        ('schema = "vgroove.map/1"\ntime_base = 3', "time_base"),
        ("schema =", "is not TOML"),
    ],
)
def test_a_wrong_mapping_file_is_refused(tmp_path: Path, text: str, part: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(VgrooveError, match=part) as caught:
        column_map((), tmp_path / "map.toml")
    assert "map.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("current_a", "NAME=COLUMN"),
        ("=current_a", "NAME=COLUMN"),
        ("I=curent_a", "near are current_a"),
        ("I:mV=current_a", "no unit of current_a"),
        ("Dev1:AI0=current_a", '"Dev1:AI0:=current_a"'),
    ],
)
def test_a_wrong_map_option_is_refused(text: str, part: str) -> None:
    with pytest.raises(VgrooveError) as caught:
        column_map([text])
    assert part in str(caught.value)
    with pytest.raises(VgrooveError, match="given twice"):
        column_map(["a=duty", "b=duty"])


def test_a_name_with_a_colon_ends_in_one(tmp_path: Path) -> None:
    columns = foreign(sample())
    columns["Dev1:AI0"] = columns.pop("I_motor") / 1e3
    (tmp_path / "a.csv").write_text(text_of(columns))
    given = [t for t in FOREIGN if "I_motor" not in t] + ["Dev1:AI0:=current_a"]
    assert same(read_log(tmp_path / "a.csv", column_map(given)), sample(), 1e-9)


def test_a_missing_column_is_reported_with_the_nearest_names(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text_of(foreign(sample())))
    refused(tmp_path / "a.csv", "time_s is missing", "Time: if", '--map "Time:UNIT=time_s"')
    refused(tmp_path / "a.csv", '--map "I_motor:UNIT=current_a" --map "n:UNIT=speed_rpm"')
    refused(
        tmp_path / "a.csv",
        "one input of duty",
        "I_motor",
        columns=column_map(["Time:ms=time_s"]),
    )
    refused(
        tmp_path / "a.csv",
        "has no column 'I_mot'",
        "nearest are I_motor",
        columns=column_map(["I_mot=current_a"]),
    )


def test_a_mapped_column_replaces_one_of_the_same_name(tmp_path: Path) -> None:
    columns = own(sample()) | {"raw": sample()["current_a"] * 2.0}
    (tmp_path / "a.csv").write_text(text_of(columns))
    log = read_log(tmp_path / "a.csv", column_map(["raw=current_a"]))
    assert np.allclose(log["current_a"], sample()["current_a"] * 2.0)
    assert any("current_a is ignored" in warning for warning in log.warnings)


CASES = [
    (column, unit, f)
    for column, own_unit in (
        ("time_s", "s"),
        ("current_a", "A"),
        ("supply_v", "V"),
        ("speed_rpm", "rpm"),
        ("position_rad", "rad"),
        ("load_nm", "Nm"),
        ("hammer_mm", "mm"),
        ("duty", ""),
    )
    for unit, f in UNITS[own_unit].items()
]


@given(st.sampled_from(CASES), st.floats(1e-6, 1e6), st.booleans())
@settings(max_examples=200, deadline=None)
def test_a_number_before_a_unit_multiplies_it(case: tuple, number: float, minus: bool) -> None:
    column, unit, factor = case
    assert unit_factor(unit, column) == factor
    sign = -1.0 if minus else 1.0
    text = f"{'-' if minus else ''}{number!r} {unit}"
    assert unit_factor(text, column) == pytest.approx(sign * number * factor)
    assert unit_factor(f"-{unit or 1}", column) == pytest.approx(-factor)


def test_units_are_those_of_physics() -> None:
    assert unit_factor("rad/s", "speed_rpm") == pytest.approx(60 / (2 * np.pi))
    assert unit_factor("deg/s", "speed_rpm") == pytest.approx(1 / 6)
    assert unit_factor("°", "position_rad") == pytest.approx(np.pi / 180)
    assert unit_factor("N mm", "load_nm") == 1e-3 and unit_factor("µs", "time_s") == 1e-6
    assert unit_factor("lbf·in", "load_nm") == pytest.approx(0.112985, rel=1e-5)
    assert unit_factor("ft-lb", "load_nm") == pytest.approx(1.355818, rel=1e-6)
    assert unit_factor("ozf in", "load_nm") == pytest.approx(7.06155e-3, rel=1e-5)
    assert unit_factor("rad·s⁻¹", "speed_rpm") == unit_factor("rad/s", "speed_rpm")
    assert unit_factor("5.6 rpm", "speed_rpm") == 5.6 and unit_factor("-1", "duty") == -1.0


UNKNOWN_UNITS = [
    ("current_a", "10mA", '"I [10mA]:10mA=current_a"'),
    ("current_a", "A rms", '"I [A rms]:FACTOR A=current_a"'),
    ("current_a", "Arms", '"I [Arms]:FACTOR A=current_a"'),
    ("current_a", "mV", '"I [mV]:FACTOR A=current_a"'),
    ("current_a", "20 A", '"I [20 A]:A=current_a"'),
    ("current_a", "filtered mA", '"I [filtered mA]:FACTOR A=current_a"'),
    ("current_a", "LSB", '"I [LSB]:FACTOR A=current_a"'),
    ("speed_rpm", "counts/s", '"I [counts/s]:FACTOR rpm=speed_rpm"'),
    ("speed_rpm", "erpm", '"I [erpm]:FACTOR rpm=speed_rpm"'),
    ("speed_rpm", "el. Hz", '"I [el. Hz]:FACTOR rpm=speed_rpm"'),
    ("load_nm", "kgf·m", '"I [kgf·m]:FACTOR Nm=load_nm"'),
    ("position_rad", "rad s^-1", '"I [rad s^-1]:FACTOR rad=position_rad"'),
    ("duty", "V", '"I [V]:FACTOR=duty"'),
    ("duty", "10%", '"I [10%]:10%=duty"'),
    ("time_s", "ticks", '"I [ticks]:FACTOR s=time_s"'),
    ("current_a", "1/10 A", '"I [1/10 A]:FACTOR A=current_a"'),
    ("position_rad", "Grad", '"I [Grad]:FACTOR rad=position_rad"'),
    ("position_rad", "inc", '"I [inc]:FACTOR rad=position_rad"'),
    ("load_nm", "lbs", '"I [lbs]:FACTOR Nm=load_nm"'),
]
REMARKS = {
    "current_a": "raw|filtered|M1|left|1|phase A|A/D|W|d|q|in|max|min|10kHz|25 degC|A side|V1|a",
    "speed_rpm": "motor shaft|output|12V|rpm motor|I/O|on/off|min|2",
    "duty": "0..255|2|-|1 kHz|PWM|open/closed",
    "time_s": "UTC|abs|since start|s since start",
}


def with_name(column: str, name: str) -> dict[str, np.ndarray]:
    """The columns of the sample log with the values of a column, of the current where there is no
    such one, under a name.
    """
    columns = own(sample())
    return {name: columns.pop(column, columns["current_a"])} | columns


@pytest.mark.parametrize(("column", "unit", "option"), UNKNOWN_UNITS)
def test_a_unit_that_is_not_known_is_refused_with_the_option(
    tmp_path: Path, column: str, unit: str, option: str
) -> None:
    (tmp_path / "a.csv").write_text(text_of(with_name(column, f"I [{unit}]")))
    plain = column_map([f"I [{unit}]={column}"])
    refused(tmp_path / "a.csv", f"not read in {unit!r}", f"--map {option}", columns=plain)
    stated = column_map([option.strip('"').replace("FACTOR", "0.5")])
    assert column in read_log(tmp_path / "a.csv", stated)


@pytest.mark.parametrize("column", REMARKS)
def test_a_bracket_that_is_no_unit_is_a_remark(tmp_path: Path, column: str) -> None:
    for text in REMARKS[column].split("|"):
        (tmp_path / "a.csv").write_text(text_of(with_name(column, f"I [{text}]")))
        log = read_log(tmp_path / "a.csv", column_map([f"I [{text}]={column}"]))
        assert same(log, sample()), text


SPELLINGS = {
    ("time_s", 1.0): "sec.|secs|Sek.|[s]",
    ("time_s", 1e-3): "milliseconds|msec.",
    ("time_s", 60.0): "minutes|min.",
    ("time_s", 3600.0): "hours",
    ("duty", 1.0): "Unitless|dimensionless|[-]|[1]|(none)",
    ("duty", 0.01): "pct|%|percent|Proz.",
    ("load_nm", 1.0): "N-m|Newton metre|newton-meters|N.m",
    ("load_nm", 1.355818): "ft lbs|ft-lb|lbs-ft",
    ("load_nm", 0.1129848): "in lbs|in-lbf",
    ("load_nm", 0.0980665): "kgcm|kg-cm",
    ("current_a", 1.0): "Amperes|[A]|(A)|（A）|A.",
    ("current_a", 1e-3): "mAmp|milliamps",
    ("speed_rpm", 1.0): "Rpm.|Upm|[RPM]|U/min",
    ("position_rad", np.pi / 180): "degs|deg.",
    ("position_rad", 2 * np.pi): "revs|rotations",
}


@pytest.mark.parametrize(("column", "factor"), SPELLINGS)
def test_units_are_read_as_people_spell_them(column: str, factor: float) -> None:
    columns = own(sample()) | {"position_rad": np.arange(80.0), "load_nm": np.arange(80.0)}
    for text in SPELLINGS[column, factor].split("|"):
        log = log_from_raw(RawColumns("a", list(columns), columns.get, {column: text}), NO_MAP)
        assert np.allclose(log[column], columns[column] * factor, rtol=1e-6), text
        assert log.warnings == []


@pytest.mark.parametrize(
    ("column", "unit", "factor"),
    [
        ("state", "enum", 1.0),
        ("mode", "bool", 1.0),
        ("coast", "flag", 1.0),
        ("coast", "%", 0.01),
        ("blow_count", "blows", 1.0),
        ("blow_period_ms", "s", 1e3),
        ("blow_period_ms", "ticks", 1.0),
    ],
)
def test_the_unit_of_a_column_that_a_diagnosis_does_not_need_is_none(
    tmp_path: Path, column: str, unit: str, factor: float
) -> None:
    values, log = np.arange(80.0), sample()
    signals = [Signal(v, log.time_s, name=n) for n, v in log.columns.items()]
    named = Signal(values, log.time_s, name=column, unit=unit)
    read = read_log(mf4(tmp_path / "a.mf4", [[*signals, named]]))
    assert np.allclose(read[column], values * factor) and read.warnings == []
    (tmp_path / "a.csv").write_text(text_of(own(log) | {f"{column} [{unit}]": values}))
    read = read_log(tmp_path / "a.csv", column_map([f"{column} [{unit}]={column}"]))
    assert np.allclose(read[column], values * factor) and read.warnings == []


@pytest.mark.parametrize(
    ("name", "column", "warns"),
    [
        *[("pos [U]", "position_rad", True), ("speed (el.)", "speed_rpm", True)],
        *[("n [RPM]/1000", "speed_rpm", True), ("I [raw]", "current_a", True)],
        *[("n [x10]", "speed_rpm", True), ("n [100]", "speed_rpm", True)],
        *[("I [M1]", "current_a", False), ("I [filtered]", "current_a", False)],
        *[("I (phase A)", "current_a", False), ("axis[0].I", "current_a", False)],
        *[("I [A] (raw)", "current_a", False), ("I [-]", "current_a", False)],
    ],
)
def test_brackets_that_are_read_as_a_remark_are_named(
    tmp_path: Path, name: str, column: str, warns: bool
) -> None:
    (tmp_path / "a.csv").write_text(text_of(with_name(column, name)))
    warnings = read_log(tmp_path / "a.csv", column_map([f"{name}={column}"])).warnings
    said = f"the brackets of {name!r} are read as a remark, the unit as"
    assert [said in warning for warning in warnings if "ignored" not in warning] == [True] * warns
    stated = read_log(tmp_path / "a.csv", column_map([f"{name}:2={column}"])).warnings
    assert not [warning for warning in stated if "remark" in warning]


def test_a_first_row_with_a_text_column_is_no_line_of_units(tmp_path: Path) -> None:
    names, *rows = text_of(own(sample())).splitlines()
    text = "\n".join([f"{names},phase", "0,1,1,1,A", *(f"{row},A" for row in rows)])
    (tmp_path / "a.csv").write_text(text + "\n")
    assert len(read_log(tmp_path / "a.csv")) == 81
    (tmp_path / "a.csv").write_text(text.replace("\n0,1", "\n1,1").replace("0.0", "1.0") + "\n")
    assert read_log(tmp_path / "a.csv").time_s[0] == 1.0


@given(
    st.sampled_from([case for case in CASES if case[1] not in ("", "1")]),
    st.sampled_from(["filtered", "raw", "motor 2", "side"]),
)
@settings(max_examples=200, deadline=None)
def test_each_unit_is_read_from_brackets_and_before_a_remark(case: tuple, remark: str) -> None:
    column, unit, factor = case
    written = (
        f"[{unit}]",
        f"({unit})",
        f"（{unit}）",
        f"[{unit} {remark}]",
        f"[{unit}] ({remark})",
    )
    for text in written:
        found = unit_in_name(f"I {text}", column)
        assert found and found.factor == factor, text
    assert unit_in_name(f"I [20 {unit}]", column).factor is None


def test_a_unit_in_the_name_and_another_one_below_it_are_refused(tmp_path: Path) -> None:
    columns = own(sample()) | {"I [A]": sample()["current_a"] * 1e3}
    names, *rows = text_of(columns).splitlines()
    for units, refuses in (("s,1,A,rpm,mA", True), ("s,1,A,rpm,A", False), ("s,,,,", False)):
        (tmp_path / "a.csv").write_text("\n".join([names, units, *rows]) + "\n")
        if refuses:
            said = ("'A'", "'mA'", '--map "I [A]:A=current_a"')
            refused(tmp_path / "a.csv", *said, columns=column_map(["I [A]=current_a"]))
        else:
            read_log(tmp_path / "a.csv", column_map(["I [A]=current_a"]))
    mended = read_log(tmp_path / "a.csv", column_map(["I [A]:mA=current_a"]))
    assert same(mended, sample(), 1e-9)


# MF4


def mf4(path: Path, groups: list[list[Signal]]) -> Path:
    with MDF(version="4.10") as mdf:
        for signals in groups:
            mdf.append(signals)
        mdf.save(path, overwrite=True)
    return path


def test_an_mf4_with_other_names_its_own_units_and_a_group_a_signal_is_read(tmp_path: Path) -> None:
    log = sample(400)
    slow = slice(None, None, 4)
    path = mf4(
        tmp_path / "a.mf4",
        [
            [Signal(log["current_a"] * 1e3, log.time_s, name="I_motor", unit="mA")],
            [Signal(log["speed_rpm"][slow], log.time_s[slow], name="n", unit="1/min")],
            [Signal(log["duty"][slow], log.time_s[slow], name="U_cmd")],
        ],
    )
    refused(path, "one input of duty", "I_motor", "--map")
    back = read_log(path, column_map(["I_motor=current_a", "n=speed_rpm", "U_cmd=duty"]))
    assert len(back) == 400 and np.allclose(back["current_a"], log["current_a"])
    own_s = log.time_s[slow]
    within = back.time_s <= own_s[-1]
    line = np.interp(back.time_s, own_s, log["speed_rpm"][slow])
    assert np.allclose(back["speed_rpm"][within], line[within])
    assert np.isnan(back["speed_rpm"][~within]).all()  # no line beyond the last sample
    held = log["duty"][slow][np.searchsorted(own_s, back.time_s, side="right") - 1]
    assert np.allclose(back["duty"], held)
    assert any("resampled" in warning and "n, U_cmd" in warning for warning in back.warnings)


def test_a_command_holds_for_an_interval_after_its_last_sample(tmp_path: Path) -> None:
    log = sample(400)
    early = slice(0, 201, 20)
    path = mf4(
        tmp_path / "a.mf4",
        [
            [Signal(log["current_a"], log.time_s, name="current_a")],
            [Signal(log["duty"][early], log.time_s[early], name="duty")],
        ],
    )
    missing = np.isnan(read_log(path)["duty"])
    assert not missing[:220].any() and missing[221:].all()


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize("unit", ["us", "ms"])
def test_a_counter_with_sign_goes_on(bits: int, unit: str) -> None:
    half, step = 2 ** (bits - 1), 7
    ticks = half + step * (np.arange(80) - 40)
    signed = (ticks + half) % (2 * half) - half
    table = {name: values for name, values in own(sample()).items() if name != "time_s"}
    log = as_log(table | {"t": signed.astype(float)}, column_map([f"t:{unit}=time_s"]))
    scale = {"us": 1e-6, "ms": 1e-3}[unit]
    assert np.allclose(np.diff(log.time_s), step * scale)
    assert any("begins again once" in warning for warning in log.warnings)


def test_a_column_named_by_a_number_is_mapped() -> None:
    columns = own(sample())
    table = {name: values for name, values in columns.items() if name != "duty"}
    log = as_log(table | {1: columns["duty"]}, column_map(["1=duty"]))
    assert np.array_equal(log["duty"], columns["duty"])


def test_a_parquet_column_that_is_there_twice_is_named(tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names = ["time_s", "duty", "duty"]
    table = arrow.Table.from_arrays([arrow.array([0.0, 1.0])] * 3, names=names)
    parquet.write_table(table, tmp_path / "a.parquet")
    refused(tmp_path / "a.parquet", "has the column duty twice")


def test_the_time_base_can_be_declared(tmp_path: Path) -> None:
    log, slow = sample(400), slice(None, None, 4)
    path = mf4(
        tmp_path / "a.mf4",
        [
            [Signal(log["current_a"], log.time_s, name="current_a", unit="A")],
            [Signal(log["speed_rpm"][slow], log.time_s[slow], name="speed_rpm")],
            [Signal(log["duty"], log.time_s, name="duty")],
        ],
    )
    back = read_log(path, ColumnMap((), "speed_rpm"))
    assert np.array_equal(back.time_s, log.time_s[slow])
    assert np.allclose(back["current_a"], log["current_a"][slow])
    with pytest.raises(VgrooveError, match="time_base; the nearest are speed_rpm"):
        read_log(path, ColumnMap((), "speed"))


def test_the_time_of_the_groups_may_be_named_in_the_map(tmp_path: Path) -> None:
    log = sample()
    path = mf4(
        tmp_path / "a.mf4",
        [[Signal(v, log.time_s * 1e3, name=n) for n, v in log.columns.items()]],
    )
    assert same(read_log(path, column_map(["time:ms=time_s"])), log)
    with pytest.raises(VgrooveError, match="duty is no time of a channel group"):
        read_log(path, column_map(["duty=time_s", "duty=duty"]))


def test_a_hole_in_a_channel_stays_a_hole(tmp_path: Path) -> None:
    log = sample(400)
    kept = np.r_[0:100, 200:400]
    path = mf4(
        tmp_path / "a.mf4",
        [
            [Signal(log["duty"], log.time_s, name="duty")],
            [Signal(log["current_a"][kept], log.time_s[kept], name="current_a")],
        ],
    )
    missing = np.isnan(read_log(path)["current_a"])
    assert missing[100:200].all() and not missing[:100].any() and not missing[200:].any()


def test_an_unknown_unit_of_a_channel_is_refused(tmp_path: Path) -> None:
    log = sample()
    path = mf4(
        tmp_path / "a.mf4",
        [[Signal(log[n], log.time_s, name=n, unit="furlong") for n in log.columns]],
    )
    refused(path, "not read in 'furlong'", '--map "duty:FACTOR=duty"')
    stated = [f"{n}:2 {u}={n}" for n, u in (("current_a", "A"), ("speed_rpm", "rpm"), ("duty", ""))]
    assert np.allclose(read_log(path, column_map(stated))["current_a"], 2.0 * log["current_a"])


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("s", 1.0), ("", 1.0)])
def test_the_unit_of_the_times_of_a_group_is_read(tmp_path: Path, unit: str, factor: float) -> None:
    log = sample()
    signals = [Signal(v, log.time_s * factor, name=n) for n, v in log.columns.items()]
    with MDF(version="4.10") as mdf:
        mdf.append(signals)
        (master,) = (c for c in mdf.groups[0].channels if c.channel_type in (2, 3))
        master.unit = unit
        mdf.save(tmp_path / "a.mf4", overwrite=True)
    read = read_log(tmp_path / "a.mf4")
    assert same(read, log) and read.read_from == {"time_s": "time"}
    stated = read_log(tmp_path / "a.mf4", column_map([f"time:{unit or 's'}=time_s"]))
    assert same(stated, log)


def test_a_channel_in_two_groups_is_named(tmp_path: Path) -> None:
    log = sample()
    path = mf4(
        tmp_path / "a.mf4",
        [
            [Signal(v, log.time_s, name=n) for n, v in log.columns.items()],
            [Signal(log["current_a"][::2] * 2.0, log.time_s[::2], name="current_a")],
        ],
    )
    read = read_log(path)
    assert same(read, log)
    assert [w for w in read.warnings if "2 groups have a channel current_a" in w]


# MAT, Parquet, tables


def test_a_mat_file_of_version_5_is_read(tmp_path: Path) -> None:
    log = sample()
    savemat(tmp_path / "a.mat", own(log) | {"note": "by hand", "k": 3.0})
    assert same(read_log(tmp_path / "a.mat"), log)
    savemat(tmp_path / "b.mat", {"run": {"data": foreign(log)}}, oned_as="column")
    assert same(read_log(tmp_path / "b.mat", column_map(FOREIGN)), log, 1e-9)


@pytest.mark.parametrize("count", [1, 3])
def test_a_structure_with_time_of_simulink_is_read(count: int, tmp_path: Path) -> None:
    log = sample()
    kind = [("values", object), ("dimensions", object), ("label", object), ("blockName", object)]
    signals = np.zeros((1, 3), dtype=kind)
    texts = (("I", "tool/Motor/Scope"), ("", "tool/Speed in rpm"), ("", ""))
    names = ("current_a", "speed_rpm", "duty")
    for k, (name, (label, block)) in enumerate(zip(names, texts, strict=True)):
        signals[0, k] = (log[name][:, None], 1.0, label, block)
    if count == 1:
        signals = signals[:, :1].copy()
        signals[0, 0]["values"] = np.stack([log[name] for name in names], axis=1)
    out = {"time": log.time_s[:, None], "signals": signals, "blockName": "tool/Scope"}
    savemat(tmp_path / "a.mat", {"ScopeData": out})
    columns = ("I", "Speed in rpm", "signal_3") if count == 3 else ("I_1", "I_2", "I_3")
    maps = [f"{column}={name}" for column, name in zip(columns, names, strict=True)]
    back = read_log(tmp_path / "a.mat", column_map(["time:s=time_s", *maps]))
    assert same(back, replace(log, columns={name: log[name] for name in names}))


@pytest.mark.parametrize("kind", ["struct", "matrix"])
def test_other_structs_with_a_field_signals_are_read_by_their_fields(
    kind: str, tmp_path: Path
) -> None:
    log, names = sample(), ("current_a", "speed_rpm", "duty")
    if kind == "struct":
        signals, columns = {name: log[name] for name in names}, names
    else:
        signals = np.stack([log[name] for name in names], axis=1)
        columns = tuple(f"signals_{k}" for k in (1, 2, 3))
    savemat(tmp_path / "a.mat", {"data": {"time": log.time_s, "signals": signals}})
    maps = [f"{column}={name}" for column, name in zip(columns, names, strict=True)]
    back = read_log(tmp_path / "a.mat", column_map(["time:s=time_s", *maps]))
    assert same(back, replace(log, columns={name: log[name] for name in names}))


def test_a_mat_file_of_version_7_3_is_read(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    log, path = sample(), tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("run")
        for name, values in foreign(log).items():
            group[name] = values[None, :]
        text = file.create_dataset("note", data=np.array([[72], [105]], np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(head.ljust(512, b"\0") + path.read_bytes()[512:])
    assert same(read_log(path, column_map(FOREIGN)), log, 1e-9)


def test_a_parquet_file_is_read_with_its_missing_values(tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    log = sample()
    log.columns["current_a"][5] = np.nan
    table = pa.table(own(log) | {"note": ["x"] * len(log)})
    current = pa.array(log["current_a"], mask=np.isnan(log["current_a"]))
    table = table.set_column(table.column_names.index("current_a"), "current_a", current)
    parquet.write_table(table, tmp_path / "a.parquet")
    back = read_log(tmp_path / "a.parquet")
    assert same(back, log) and any("note" in warning for warning in back.warnings)


@pytest.mark.parametrize(("name", "head"), [("a.mat", b"MATLAB 5.0"), ("a.parquet", b"PAR1")])
def test_a_damaged_file_is_a_sentence(tmp_path: Path, name: str, head: bytes) -> None:
    if name == "a.parquet":
        pytest.importorskip("pyarrow")
    (tmp_path / name).write_bytes(head + bytes(range(200)))
    refused(tmp_path / name, "damaged or truncated")


def test_a_mat_file_of_version_4_is_named(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", own(sample()), format="4")
    refused(tmp_path / "a.mat", "version 5 or later", '"-v7"')


@pytest.mark.parametrize(
    ("module", "name"), [("pyarrow", "a.parquet"), ("h5py", "a.mat")], ids=["pyarrow", "h5py"]
)
def test_a_missing_package_is_named_with_the_command(
    tmp_path: Path, module: str, name: str
) -> None:
    head = {"a.parquet": b"PAR1", "a.mat": b"MATLAB 7.3 MAT-file"}[name]
    (tmp_path / name).write_bytes(head + bytes(200))
    code = (
        f"import sys; sys.modules[{module!r}] = None\n"
        "from vgroove.cli import main\n"
        f"sys.argv = ['vgroove', 'log', 'check', {str(tmp_path / name)!r}]\nmain()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "pip install 'vgroove[formats]'" in done.stderr, done.stderr


TABLES: dict[str, Callable[[dict], object]] = {
    "a dict": lambda columns: columns,
    "a dict of lists": lambda columns: {n: list(v) for n, v in columns.items()},
    "a DataFrame": pd.DataFrame,
    "a DataFrame with the time as index": lambda c: pd.DataFrame(c).set_index(next(iter(c))),
    "a structured array": lambda c: np.rec.fromarrays(list(c.values()), names=list(c)),
}


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_of_python_is_a_log(kind: str) -> None:
    log = sample()
    assert same(as_log(TABLES[kind](own(log))), log)
    assert same(as_log(TABLES[kind](foreign(log)), column_map(FOREIGN)), log, 1e-9)
    assert len(as_list(TABLES[kind](own(log)))) == 1


def test_dates_with_a_time_zone_decimals_and_numbers_as_names_are_read() -> None:
    log = sample()
    start = pd.Timestamp("2026-03-31 12:00", tz="Europe/Berlin")
    frame = pd.DataFrame(own(log))
    frame["time_s"] = start + pd.to_timedelta(log.time_s, unit="s")
    frame["current_a"] = [Decimal(repr(value)) for value in log["current_a"].tolist()]
    later = replace(log, time_s=log.time_s - log.time_s[0])
    read = as_log(frame)
    assert np.allclose(read.time_s, later.time_s, atol=1e-6)
    assert np.array_equal(read["current_a"], log["current_a"])
    numbered = pd.DataFrame(np.stack(list(own(log).values()), 1))
    names = [f"{k}={name}" for k, name in enumerate(own(log))]
    assert same(as_log(numbered, column_map(names)), log)


def test_a_unit_of_dates_is_refused(tmp_path: Path) -> None:
    dates = pd.Timestamp("2026-03-31") + pd.to_timedelta(sample().time_s, unit="s")
    stated = column_map(["time_s:ms=time_s"])
    for stamps in (dates, dates.tz_localize("Europe/Berlin")):
        frame = pd.DataFrame(own(sample()) | {"time_s": stamps})
        with pytest.raises(VgrooveError, match='dates, which have no unit: say --map "time_s='):
            as_log(frame, stated)
    (tmp_path / "a.csv").write_text(with_times([date.isoformat(" ") for date in dates]))
    refused(tmp_path / "a.csv", "which have no unit", columns=stated)
    assert len(read_log(tmp_path / "a.csv")) == 80


def test_a_table_that_is_no_log_is_refused() -> None:
    with pytest.raises(VgrooveError, match="a DataFrame or a dict of arrays"):
        as_log(3)
    with pytest.raises(VgrooveError, match="current_a has 3 samples"):
        as_log(own(sample()) | {"current_a": np.zeros(3)})
    with pytest.raises(VgrooveError, match="column duty: its samples are not numbers"):
        as_log(own(sample()) | {"duty": ["x"] * 80})
    assert as_list([1, 2]) == [1, 2] and as_list("a.csv") == ["a.csv"]


def test_pandas_is_not_imported() -> None:
    code = "import vgroove.log, vgroove.gap.stages, sys; assert 'pandas' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_command_that_reads_logs_takes_the_map(tmp_path: Path) -> None:
    log = read_log(PRACTICE / "log.csv")
    path, rig, out = tmp_path / "a.csv", PRACTICE / "rig.toml", tmp_path / "out.json"
    short = replace(
        log,
        time_s=log.time_s[:800],
        columns={n: log[n][:800] for n in ("duty", "current_a", "speed_rpm")},
    )
    path.write_text(text_of(foreign(short), ";", ","))
    write_csv(short, tmp_path / "own.csv")
    maps = [part for text in FOREIGN for part in ("--map", text)]

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [VGROOVE, *map(str, arguments)], capture_output=True, text=True, check=False
        )

    for command in (("log", "check", path, "--rig", rig), ("sim", rig, "--log", path)):
        assert run(*command).returncode == 2
        done = warm_vgroove(*command, *maps, "--json", out)
        assert done.returncode == 0, done.stderr
    gap = json.loads(out.read_text())["gap"]
    own_file = warm_vgroove("sim", rig, "--log", tmp_path / "own.csv", "--json", out)
    assert own_file.returncode == 0
    assert gap == pytest.approx(json.loads(out.read_text())["gap"], rel=1e-6)
    done = warm_vgroove("gap", "diagnose", path, "--rig", rig, *maps, "--json", out)
    assert done.returncode == 0 and json.loads(out.read_text())["schema"] == "vgroove.gap/1"


def test_a_large_file_costs_little_more_than_its_numbers(tmp_path: Path) -> None:
    """A million rows and five columns take 1.3 s of processor time."""
    rows = 100_000
    table = np.random.default_rng(1).normal(0.0, 5.0, (rows, 4)).round(2)
    columns = dict(zip(("duty", "supply_v", "current_a", "speed_rpm"), table.T, strict=True))
    write_csv(Log(np.arange(1, rows + 1) / 1000, columns, "x"), tmp_path / "a.csv")
    taken = []
    for _ in range(3):
        begin = time.process_time()
        read_log(tmp_path / "a.csv")
        taken.append(time.process_time() - begin)
    assert min(taken) < 0.25


def test_the_mapping_file_of_the_page_is_one(tmp_path: Path) -> None:
    page = (ROOT / "docs/input_format.md").read_text()
    (text,) = re.findall(r'```toml\n(schema = "vgroove.map/1".*?)```', page, re.DOTALL)
    (tmp_path / "map.toml").write_text(text)
    columns = column_map((), tmp_path / "map.toml")
    assert columns.time_base == "I_motor" and len(columns.entries) == 3
    for option in re.findall(r'--map "([^"]+)"', page):
        assert column_map([option]).entries
