"""Logs as loggers, oscilloscopes and other programs export them: heads of several lines, comments,
names that are there twice, cells with units, dates, several devices, CAN frames of other devices.
"""

import re
from pathlib import Path

import can
import numpy as np
import pytest
from asammdf import MDF, Signal

from test_log_formats import FOREIGN, PRACTICE, foreign, own, refused, same, sample, text_of
from vgroove.errors import VgrooveError
from vgroove.gap.log_check import check_log, checked_logs
from vgroove.log import as_log, column_map, current_is_unsigned, read_log
from vgroove.log.table import standstill_offset
from vgroove.rig import read_rig

NAMES = [f"{e.split('=')[0].split(':')[0]}={e.split('=')[1]}" for e in FOREIGN]  # without units


def rows_of(columns: dict[str, np.ndarray]) -> list[list[str]]:
    """Cells of the rows of a file."""
    return [line.split(",") for line in text_of(columns).splitlines()[1:]]


def written(path: Path, rows: list[list[str]], *head: str, separator: str = ",") -> Path:
    """A file of lines before the rows, and rows."""
    lines = [*head, *(separator.join(row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def in_ms_and_ma() -> list[list[str]]:
    """Rows of time in ms, duty, current in mA and speed in rad/s: the columns of FOREIGN."""
    return rows_of(foreign(sample()))


@pytest.mark.parametrize(
    "head",
    [
        ["Time,U_cmd,I_motor,n", "ms,,mA,rad/s", "Smp,Smp,Avg,Smp"],
        ["Time,U_cmd,I_motor,n", "float,float,float,float", "ms,-,mA,rad/s"],
        ["ms,,mA,rad/s", "Time,U_cmd,I_motor,n"],
        ["type,y,y,y", "path,,Model/i,Model/n", "ms,-,mA,rad/s", "Time,U_cmd,I_motor,n"],
        ['"TOA5","CR1","12"', "Time,U_cmd,I_motor,n", "ms,,mA,rad/s", ",Smp,Avg,Smp"],
        ["Logger;;;", "Rate,500,Hz,", "", "Time,U_cmd,I_motor,n", "ms,,mA,rad/s"],
        ["Model,MSO44", "Label,duty,current,speed", "Time,U_cmd,I_motor,n", "ms,,mA,rad/s"],
    ],
)
def test_the_names_are_the_line_of_a_head_that_names_each_column(
    tmp_path: Path, head: list[str]
) -> None:
    path = written(tmp_path / "a.csv", in_ms_and_ma(), *head)
    assert same(read_log(path, column_map(NAMES)), sample(), 1e-9)


def test_lines_of_words_below_the_names_are_named_in_a_warning(tmp_path: Path) -> None:
    head = ("time_s,duty,current_a,speed_rpm", "mean,mean,rms,mean")
    log = read_log(written(tmp_path / "a.csv", rows_of(own(sample())), *head))
    assert same(log, sample())
    assert ["1 lines of words below it" in warning for warning in log.warnings] == [True]


def test_channels_may_be_named_by_numbers_above_a_line_of_units(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", in_ms_and_ma(), "x-axis,1,2,3", "ms,V,mA,rad/s")
    entries = ["x-axis=time_s", "1:1=duty", "2=current_a", "3=speed_rpm"]
    assert same(read_log(path, column_map(entries)), sample(), 1e-9)
    refused(written(path, in_ms_and_ma(), "x-axis,1,2,3"), "no header")


def test_names_in_a_comment_stand_above_rows_with_a_text(tmp_path: Path) -> None:
    rows = [[*row[:2], "base_link", *row[2:]] for row in in_ms_and_ma()]
    path = written(tmp_path / "a.csv", rows, "%Time,U_cmd,frame_id,I_motor,n")
    assert same(read_log(path, column_map(list(FOREIGN))), sample(), 1e-9)


def test_the_same_times_beside_each_signal_are_one_column(tmp_path: Path) -> None:
    rows = [[time, duty, time, current, time, n] for time, duty, current, n in in_ms_and_ma()]
    head = "Time,U_cmd,Time,I_motor,Time,n"
    path = written(tmp_path / "a.csv", rows, head)
    assert same(read_log(path, column_map(list(FOREIGN))), sample(), 1e-9)
    rows[40][4] = "40.5"
    refused(
        written(path, rows, head),
        *("line 1", "Time appears 3 times, with other values", "a name of its own"),
        columns=column_map(list(FOREIGN)),
    )


def test_names_that_a_restarted_logger_writes_again_are_left_out(tmp_path: Path) -> None:
    names, *lines = text_of(own(sample())).splitlines()
    path = tmp_path / "a.csv"
    path.write_text("\n".join([names, *lines[:30], names, *lines[30:60], names, *lines[60:], ""]))
    log = read_log(path)
    assert same(log, sample())
    assert ["line 32: holds the names again" in w and "1 others" in w for w in log.warnings] == [
        True
    ]
    path.write_text("\n".join([names, *lines, names, *lines, ""]))
    refused(path, "line 83", "goes back once", "each recording as a log of its own")


def drive(rows: int, rate: float) -> dict[str, np.ndarray]:
    """A smooth run with noise; `rate` is its angular frequency, rad a row."""
    rng, wave = np.random.default_rng(rows), np.sin(rate * np.arange(rows))
    return {
        "time_s": np.arange(1, rows + 1) / 1000,
        "duty": 0.5 * wave,
        "current_a": 5.0 * wave + rng.normal(0.0, 0.15, rows),
        "speed_rpm": 1e4 * wave + rng.normal(0.0, 3.0, rows),
    }


def in_turns(devices: int, shift_s: float, rows: int = 600) -> list[list[str]]:
    """Rows of several devices in turns, each with the name of its device."""
    runs = [rows_of(drive(rows, 0.01 * (k + 1))) for k in range(devices)]
    return [
        [f"node{k}", f"{float(time) + k * shift_s:.6f}", *others]
        for row in zip(*runs, strict=True)
        for k, (time, *others) in enumerate(row)
    ]


@pytest.mark.parametrize(("devices", "shift_s"), [(2, 0.0), (2, 0.0005), (3, 0.0001), (5, 0.0)])
def test_rows_of_several_devices_are_refused(tmp_path: Path, devices: int, shift_s: float) -> None:
    head = "node,time_s,duty,current_a,speed_rpm"
    path = written(tmp_path / "a.csv", in_turns(devices, shift_s), head)
    refused(path, "column node", "'node0', 'node1'", "several devices", "a log of its own")


@pytest.mark.parametrize("devices", [2, 3, 4])
def test_devices_in_turns_are_refused_without_their_names(tmp_path: Path, devices: int) -> None:
    rows = [row[1:] for row in in_turns(devices, 0.0001)]
    path = written(tmp_path / "a.csv", rows, "time_s,duty,current_a,speed_rpm")
    refused(path, ["second", "third", "fourth"][devices - 2], "a log of its own")


def test_a_command_in_turns_alone_is_that_of_one_device(tmp_path: Path) -> None:
    run = drive(600, 0.01)
    run["duty"] = np.arange(600) % 2 * 0.8
    (tmp_path / "a.csv").write_text(text_of(run))
    assert len(read_log(tmp_path / "a.csv")) == 600


@pytest.mark.parametrize("period", [1, 3])
@pytest.mark.parametrize("follows", ["current_a", "supply_v"])
@pytest.mark.parametrize("moves", [False, True])
def test_what_follows_an_alternating_command_is_that_of_one_device(
    tmp_path: Path, period: int, follows: str, moves: bool
) -> None:
    """A state column names the direction; the speed is constant, or changes slowly."""
    k = np.arange(600)
    sign = 1.0 - 2.0 * (k // period % 2)
    speed = np.full(600, 3000.0) + moves * 500.0 * np.sin(0.01 * k)
    columns = (sign, 1e-3 * k, 0.3 * sign, 12.0 + 4.0 * sign, speed)
    rows = [[f"{value:.10g}" for value in row] for row in zip(*columns, strict=True)]
    path = written(tmp_path / "a.csv", rows, f"direction,time_s,duty,{follows},speed_rpm")
    assert len(read_log(path)) == 600


@pytest.mark.parametrize("rate", [0.01, 0.3, 0.8])
@pytest.mark.parametrize("period", [2, 3, 7])
def test_a_counter_or_a_state_divides_no_rows_of_one_device(
    tmp_path: Path, rate: float, period: int
) -> None:
    rows = [[str(k % period), *row] for k, row in enumerate(rows_of(drive(600, rate)))]
    path = written(tmp_path / "a.csv", rows, "frame,time_s,duty,current_a,speed_rpm")
    assert len(read_log(path)) == 600


def shifted() -> list[list[str]]:
    """Rows with the duty as a pulse of 1000 to 2000 us and the current in counts around 512."""
    return [
        [time, f"{1500 + 500 * float(duty):.10g}", f"{512 + 40 * float(current):.10g}", speed]
        for time, duty, current, speed in rows_of(own(sample()))
    ]


def test_a_value_that_stands_for_zero_is_subtracted(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", shifted(), "time_s,pulse,adc,speed_rpm")
    entries = ["pulse:0.002 from 1500=duty", "adc:0.025 A from 512=current_a"]
    assert same(read_log(path, column_map(entries)), sample(), 1e-9)
    (tmp_path / "map.toml").write_text(
        'schema = "vgroove.map/1"\n[columns]\nduty = "pulse:0.002 from 1.5e3"\n'
        'current_a = { name = "adc", unit = "25 mA from 512" }\n'
    )
    assert same(read_log(path, column_map(path=tmp_path / "map.toml")), sample(), 1e-9)
    raw = read_log(path, column_map(["pulse:from 1500=duty", "adc=current_a"]))
    assert np.allclose(raw["duty"], 500 * sample()["duty"])
    with pytest.raises(VgrooveError, match="no unit of current_a"):
        column_map(["adc:counts from 512=current_a"])


def test_a_pulse_width_is_refused_with_the_option_that_subtracts_its_zero(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", shifted(), "time_s,pulse,current_a,speed_rpm")
    check = check_log(read_log(path, column_map(["pulse=duty"])))
    assert ['--map "pulse:FACTOR from ZERO=duty"' in f.text for f in check.findings if f.refuses]


def test_counts_around_the_middle_of_a_converter_are_no_unsigned_current() -> None:
    run = drive(600, 0.02)
    run["duty"][:100] = 0.0
    run["speed_rpm"][:100] *= 1e-4  # noise at rest
    run["current_a"] = 512 + 5 * np.where(np.arange(600) < 100, 0.0, run["current_a"])
    log = as_log(run)
    assert standstill_offset(log) == 512
    assert ["at standstill" in warning for warning in log.warnings] == [True]
    log = as_log({name: values[100:] for name, values in run.items()})
    assert not current_is_unsigned(log) and log.warnings == []


DATES = {
    "German": "31.03.2026 12:{:02d}:{:06.3f}",
    "German, decimal comma": "31.03.2026 12:{:02d}:{:06.3f}",
    "slashes": "2026/03/31 12:{:02d}:{:06.3f}",
    "American": "3/31/2026 11:{:02d}:{:06.3f} PM",
    "day of the month first": "31/3/2026 11:{:02d}:{:06.3f}",
    "half days": "12:{:02d}:{:06.3f} AM",
    "minutes": "{:02d}:{:06.3f}",
    "colon before the milliseconds": "12:{:02d}:{:06.3f}",
}


@pytest.mark.parametrize("form", DATES)
def test_dates_and_times_of_day_are_read_in_usual_forms(tmp_path: Path, form: str) -> None:
    stamps = [DATES[form].format(7, 59.95 + t - 60.0 * (t >= 0.05)) for t in sample().time_s]
    stamps = [
        stamp if t < 0.05 else stamp.replace("07:", "08:", 1)
        for t, stamp in zip(sample().time_s, stamps, strict=True)
    ]
    if "comma" in form:
        stamps = [stamp[:-4] + "," + stamp[-3:] for stamp in stamps]
    if "colon" in form:
        stamps = [":".join(stamp.rsplit(".", 1)) for stamp in stamps]
    rows = [[s, *row[1:]] for s, row in zip(stamps, rows_of(own(sample())), strict=True)]
    head = "time_s;duty;current_a;speed_rpm"
    log = read_log(written(tmp_path / "a.csv", rows, head, separator=";"))
    assert np.allclose(log.time_s, sample().time_s - sample().time_s[0], atol=1e-6)


@pytest.mark.parametrize("stamp", ["4/3/2026 12:00:00", "31.02.2026 12:00:00", "13:00:00 PM"])
def test_a_date_that_may_be_another_day_is_refused(tmp_path: Path, stamp: str) -> None:
    rows = [[stamp, *row[1:]] for row in rows_of(own(sample()))]
    path = written(tmp_path / "a.csv", rows, "time_s,duty,current_a,speed_rpm")
    refused(path, "line 2", "2026-03-31 12:00:00.001")


def test_cells_may_end_in_a_unit(tmp_path: Path) -> None:
    units, head = (" sec", " %", "mA", " rpm"), "Time,U_cmd,I_motor,n"
    scales = (1.0, 100.0, 1e3, 1.0)
    columns = {n: v * s for (n, v), s in zip(own(sample()).items(), scales, strict=True)}
    rows = [[c + u for c, u in zip(row, units, strict=True)] for row in rows_of(columns)]
    rows[3][2] = ""
    log = read_log(written(tmp_path / "a.csv", rows, head), column_map(NAMES))
    assert np.isnan(log["current_a"][3])
    log.columns["current_a"][3] = sample()["current_a"][3]
    assert same(log, sample(), 1e-9)
    rows[40][2] = "1.2 A"
    path = written(tmp_path / "a.csv", rows, head)
    refused(path, "line 42, column I_motor: '1.2 A' is not in mA", columns=column_map(NAMES))
    rows[0][2] = "12A"  # may be hexadecimal
    path = written(tmp_path / "a.csv", rows, head)
    refused(path, "line 2, column I_motor", "not a number", columns=column_map(NAMES))


def test_a_unit_in_the_cells_and_another_one_in_the_name_are_refused(tmp_path: Path) -> None:
    rows = [[t, duty, f"{i} mA", n] for t, duty, i, n in rows_of(own(sample()))]
    path = written(tmp_path / "a.csv", rows, "time_s,duty,I [A],speed_rpm")
    refused(path, "column I [A]", "'mA'", columns=column_map(["I [A]=current_a"]))


@pytest.mark.parametrize("cell", ["1.#QNAN", "-1.#IND", "-nan(ind)", "NAN", "-nan", "nan(0x8)"])
def test_nan_of_a_c_library_is_a_missing_sample(tmp_path: Path, cell: str) -> None:
    rows = rows_of(own(sample()))
    rows[5][2] = cell
    log = read_log(written(tmp_path / "a.csv", rows, "time_s,duty,current_a,speed_rpm"))
    assert np.isnan(log["current_a"][5]) and np.isnan(log["current_a"]).sum() == 1


def test_a_minus_sign_is_read_as_a_hyphen(tmp_path: Path) -> None:
    rows = [[cell.replace("-", "\u2212") for cell in row] for row in rows_of(own(sample()))]
    path = written(tmp_path / "a.csv", rows, "time_s,duty,current_a,speed_rpm")
    assert same(read_log(path), sample())


@pytest.mark.parametrize("cell", ["#N/A", "#NV", "#DIV/0!"])
def test_a_failed_cell_of_a_spreadsheet_is_no_comment(tmp_path: Path, cell: str) -> None:
    rows = [[speed, *others] for *others, speed in rows_of(own(sample()))]
    rows[5][0] = cell
    path = written(tmp_path / "a.csv", rows, "speed_rpm,time_s,duty,current_a")
    refused(path, f"line 7, column speed_rpm: '{cell}' is not a number")


LONG_NAMES = {
    "/motor/stamp": "time_s",
    "servo.cmd.duty": "duty",
    "Ctrl_MotCurr": "current_a",
    "axis0.encoder.vel_estimate": "speed_rpm",
    "input_voltage": "",
    "Sample": "",
}


def test_a_word_within_a_long_name_makes_it_the_nearest(tmp_path: Path) -> None:
    rows = [[*row, "12", "7"] for row in rows_of(own(sample()))]
    path = written(tmp_path / "a.csv", rows, ",".join(LONG_NAMES))
    with pytest.raises(VgrooveError, match="time_s is missing") as caught:
        read_log(path)
    for name, column in LONG_NAMES.items():
        option = f'--map "{name}:UNIT={column}"'
        assert (option in str(caught.value)) if column else (f'"{name}' not in str(caught.value))


def test_a_file_without_times_is_told_of_a_column_that_counts_rows(tmp_path: Path) -> None:
    rows = [[str(k), *row[1:]] for k, row in enumerate(rows_of(own(sample())), 1)]
    path = written(tmp_path / "a.csv", rows, "X,duty,current_a,speed_rpm")
    refused(path, "time_s is missing", '"N:0.001 s=time_s"')
    assert same(read_log(path, column_map(["X:0.001 s=time_s"])), sample())


@pytest.mark.parametrize(
    ("lines", "part"),
    [
        (['{"time_s": 0.001, "duty": 0.5, "current_a": 1}'] * 80, "JSON"),
        (["t:1,duty:0.5,current:-1.5e0"] * 80, "each cell is a name and a value (t:1)"),
        (["duty=0.5\tcurrent=1"] * 80, "each cell is a name and a value"),
    ],
)
def test_lines_that_repeat_the_names_are_refused_with_the_form(
    tmp_path: Path, lines: list[str], part: str
) -> None:
    refused(written(tmp_path / "a.csv", [], *lines), "line 1", part, "names once")


@pytest.mark.parametrize("name", ["a.dat", "a.mdf", "a.log"])
def test_the_content_of_a_file_with_another_ending_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"MDF     3.30    " + bytes(100))
    refused(tmp_path / name, "that of an .mf4 file")
    (tmp_path / "table.asc").write_text(text_of(own(sample())))
    refused(tmp_path / "table.asc", "end in .csv")


@pytest.mark.parametrize("ending", [".blf", ".asc"])
def test_frames_of_another_device_are_told_of_their_dbc(tmp_path: Path, ending: str) -> None:
    with can.Logger(tmp_path / f"a{ending}") as logger:
        for k in range(9):
            logger(can.Message(timestamp=1e9 + k / 1e3, arbitration_id=0x123, data=bytes(8)))
    refused(tmp_path / f"a{ending}", "by its own DBC", "MF4", "CSV")


def test_an_mdf_file_of_version_3_is_read_with_its_time_in_the_map(tmp_path: Path) -> None:
    log = sample()
    with MDF(version="3.30") as mdf:
        mdf.append(
            [
                Signal(log["duty"], log.time_s, name="Pwm"),
                Signal(log["current_a"] * 1e3, log.time_s, name="Curr", unit="mA"),
                Signal(log["speed_rpm"], log.time_s, name="Spd", unit="1/min"),
            ]
        )
        saved = mdf.save(tmp_path / "a.mdf")
    path = saved.rename(tmp_path / "a.mf4")
    entries = ["Pwm=duty", "Curr=current_a", "Spd=speed_rpm"]
    for times in ([], ["time=time_s"]):
        assert same(read_log(path, column_map([*entries, *times])), log, 1e-9)


@pytest.mark.parametrize(
    ("end", "column", "factor"),
    [
        *(("ms", "time_s", 1e3), ("us", "time_s", 1e6), ("msec", "time_s", 1e3)),
        *(("mA", "current_a", 1e3), ("A", "current_a", 1.0), ("dA", "current_a", 10.0)),
        *(("rad_s", "speed_rpm", np.pi / 30.0), ("rps", "speed_rpm", 1 / 60.0)),
        *(("deg_s", "speed_rpm", 6.0), ("rev_min", "speed_rpm", 1.0), ("pct", "duty", 100.0)),
        *(("min", "time_s", 1.0), ("h", "time_s", 1.0), ("da", "current_a", 1.0)),
    ],
)
def test_a_unit_at_the_end_of_a_name_is_read_with_a_warning(
    tmp_path: Path, end: str, column: str, factor: float
) -> None:
    columns = {
        f"x_{end}" if name == column else name: values * (factor if name == column else 1.0)
        for name, values in own(sample()).items()
    }
    path = tmp_path / "a.csv"
    path.write_text(text_of(columns))
    log = read_log(path, column_map([f"x_{end}={column}"]))
    assert same(log, sample(), 1e-9)
    said = "in which the name ends" in "".join(log.warnings)
    assert said == (factor != 1.0)
    stated = read_log(path, column_map([f"x_{end}:2={column}"]))
    assert "in which the name ends" not in "".join(stated.warnings)


@pytest.mark.parametrize(
    ("name", "unit", "scale"),
    [
        ("n [rad/s]", "", -np.pi / 30.0),  # the opposite sign
        ("n", "rad/s", np.pi / 30.0 / 1e3),  # read as rad/s, and a krad/s
        ("n", "0.5 rpm from 1000", 2.0 / 60.0),  # rev/s, read as rpm
    ],
)
def test_the_option_that_a_check_proposes_holds_for_the_numbers_of_the_file(
    tmp_path: Path, name: str, unit: str, scale: float
) -> None:
    log, tool = read_log(PRACTICE / "log.csv"), read_rig(PRACTICE / "rig.toml")
    columns = {"time_s": log.time_s} | log.columns
    zero = 1000.0 if "from" in unit else 0.0
    columns = {n if n != "speed_rpm" else name: v for n, v in columns.items()}
    columns[name] = log["speed_rpm"] * scale + zero
    path = tmp_path / "a.csv"
    path.write_text(text_of(columns))
    entry = f"{name}:{unit}=speed_rpm" if unit else f"{name}=speed_rpm"
    with pytest.raises(VgrooveError, match="--map") as caught:
        checked_logs([read_log(path, column_map([entry]))], tool)
    option = re.search(r'--map "([^"]*)"', str(caught.value))[1]
    mended = read_log(path, column_map([option]))
    checked_logs([mended], tool)
    assert np.allclose(mended["speed_rpm"], log["speed_rpm"], rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize(
    "text", ["time_s,duty,current_a\n", "s,A\n", "1,2,3\n", "% a,b\n% s,A\n", ",,,\n", '"\n', "a\n"]
)
def test_a_file_without_rows_is_a_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    refused(tmp_path / "a.csv", "a.csv")


@pytest.mark.parametrize("comment", ["#NAME: driver 3", "#NVM, b, c, d", "#NA,b,c,d"])
def test_a_comment_that_begins_as_a_failed_cell_is_a_comment(tmp_path: Path, comment: str) -> None:
    (tmp_path / "a.csv").write_text(f"{comment}\n{text_of(own(sample()))}")
    log = read_log(tmp_path / "a.csv")
    assert not any("before the names" in warning for warning in log.warnings)


def test_names_that_begin_with_a_digit_stand_below_a_comment_of_as_many_words(
    tmp_path: Path,
) -> None:
    first, *rows = text_of(own(sample())).splitlines()
    table = [f"{first},24V_bus", *(f"{row},24.1" for row in rows)]
    words = ", ".join(f"word {n}" for n in range(first.count(",") + 2))
    (tmp_path / "a.csv").write_text("\n".join([f"# {words}", *table]) + "\n")
    assert len(read_log(tmp_path / "a.csv")) == len(rows)
