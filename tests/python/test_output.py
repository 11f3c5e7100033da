"""Files that are written: whole or not at all, and refused before the work if they could not be
written.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from vgroove.errors import VgrooveError
from vgroove.html_page import Table
from vgroove.output import check_outputs, replacing, write_text
from vgroove.terminal import print_line
from warm_cli import warm_vgroove

ROOT = Path(__file__).resolve().parents[2]


def test_what_is_written_replaces_the_old_file_and_keeps_its_permissions(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(0o640)
    write_text(path, "new \N{DEGREE SIGN}\n")
    assert (
        path.read_bytes() == b"new \xc2\xb0\n"
        and path.stat().st_mode & 0o777 == 0o640
        and os.listdir(tmp_path) == ["a.txt"]
    )


@pytest.mark.parametrize("text", ["virtual:x: no answer", "log[b].csv", "C:a:b [red]x[/red]"])
def test_a_text_on_the_terminal_is_printed_as_it_is(text: str) -> None:
    console = Console(width=200)
    with console.capture() as captured:
        print_line(console, text)
    assert captured.get() == f"{text}\n"
    with console.capture() as captured:
        console.print(Table("t", text, [text, "x"], [[text, 1.0]]).as_rich())
    assert captured.get().count(text) == 3


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "real" / "a.txt")
    write_text(tmp_path / "link.txt", "text")
    assert (tmp_path / "link.txt").is_symlink() and (
        tmp_path / "real" / "a.txt"
    ).read_text() == "text"


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as file:
        file.write(b"half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_a_device_is_written_in_place() -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "from pathlib import Path; from vgroove.output import check_outputs, write_text;"
            "check_outputs([Path('/dev/stdout')]); write_text('/dev/stdout', 'seen')",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    write_text("/dev/null", "unseen")
    assert (
        done.stdout == "seen"
        and Path("/dev/stdout").is_symlink()
        and Path("/dev/null").is_char_device()
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "folder"),
        ("/", "folder"),
        (".", "folder"),
        ("folder", "folder"),
        ("none/a.json", "none does not exist"),
        ("file/a.json", "file does not exist"),
        ("x" * 300 + ".json", "cannot be written"),
        ("a\0b", "not the name of a file"),
        ("/proc/a.json", "cannot be written"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    path = tmp_path / name if name.strip("./") and not name.startswith("/") else Path(name)
    with pytest.raises(VgrooveError, match=words):
        check_outputs([None, path])
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").touch()
    (tmp_path / "same.csv").symlink_to(tmp_path / "log.csv")
    (tmp_path / "b").mkdir()
    with pytest.raises(VgrooveError, match="given twice"):
        check_outputs([tmp_path / "a.json", tmp_path / "b" / ".." / "a.json"])
    with pytest.raises(VgrooveError, match="given twice"):
        check_outputs([tmp_path / "same.csv"], [tmp_path / "log.csv"])
    check_outputs(
        [Path("/dev/null"), Path("/dev/null"), tmp_path / "a.json"], [tmp_path / "log.csv"]
    )


def vgroove(*arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "vgroove.cli", *arguments]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=30, check=False)


# Commands with their options that name a file to write. Outputs are checked first, so that the
# inputs need not exist.
COMMANDS = [
    ("gap diagnose none.csv --rig none.toml", ("--json", "--html", "--out-rig")),
    ("gap emps .", ("--json",)),
    ("sim none.toml --log none.csv", ("--json", "-o")),
    ("sim scenarios/spin_up.toml", ("--json", "-o")),
    ("run scenarios/spin_up.toml --on avr", ("--stats",)),
    ("run scenarios/spin_up.toml", ("--eeprom",)),
    ("bench speed", ("--json",)),
]


@pytest.mark.parametrize(
    ("command", "option"),
    [(command, option) for command, options in COMMANDS for option in options],
)
def test_every_command_refuses_before_the_work(tmp_path: Path, command: str, option: str) -> None:
    for name in ("/", str(tmp_path), str(tmp_path / "none" / "out")):
        run = vgroove if name == "/" and option == dict(COMMANDS)[command][0] else warm_vgroove
        done = run(*command.split(), option, name)
        assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
        assert (
            done.stderr.startswith(f"vgroove: {name}: cannot be written: ")
            and len(done.stderr.splitlines()) == 1
        )
        assert done.stdout == ""


@pytest.mark.parametrize("command", ["run scenarios/spin_up.toml", "record no_such_port"])
def test_a_log_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, command: str
) -> None:
    (tmp_path / "dir.csv").mkdir()
    for name in (tmp_path / "dir.csv", tmp_path / "none" / "run.csv"):
        done = warm_vgroove(*command.split(), "-o", str(name))
        assert (
            done.returncode == 2
            and done.stderr.startswith(f"vgroove: {name}: cannot be written: ")
            and done.stdout == ""
        )
