"""The command line imports python-can without asammdf, and still reads MF4 files of frames."""

import subprocess
import sys
from pathlib import Path

import pytest

RECORD_AND_READ = """
import sys
from vgroove.python_can import import_without_asammdf, mf4_files
import_without_asammdf()
import can
import vgroove.recorder
print(*(name in sys.modules for name in ("asammdf", "pandas")))
with mf4_files().MF4Writer(sys.argv[1]) as writer:
    writer.on_message_received(can.Message(arbitration_id=5, data=[1, 2]))
with mf4_files().MF4Reader(sys.argv[1]) as reader:
    print(*(bytes(message.data).hex() for message in reader))
"""


def output(code: str, *arguments: object) -> list[str]:
    line = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, check=True).stdout.splitlines()


def test_a_recording_command_imports_no_asammdf_and_mf4_files_of_frames_are_read(
    tmp_path: Path,
) -> None:
    assert output(RECORD_AND_READ, tmp_path / "frames.mf4") == ["False False", "0102"]


@pytest.mark.parametrize("before", ["", "import asammdf, can; "])
def test_python_can_is_whole_in_a_program_that_only_uses_the_package(before: str) -> None:
    code = before + "import vgroove.recorder, can.io.mf4; print(can.io.mf4.asammdf.__name__)"
    assert output(code) == ["asammdf"]


def test_the_command_line_leaves_asammdf_out(tmp_path: Path) -> None:
    line = [sys.executable, "-X", "importtime", "-m", "vgroove.cli", "record", tmp_path / "none"]
    done = subprocess.run([*line, "-o", tmp_path / "log.csv"], capture_output=True, text=True)
    imported = {part.rpartition("|")[2].strip() for part in done.stderr.splitlines()}
    assert done.returncode == 2
    assert "can.io.mf4" in imported and not {"asammdf.mdf", "pandas"} & imported
