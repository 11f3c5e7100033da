"""Limits and outputs of `vgroove gap diagnose` and `vgroove gap batch` in pipelines."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from vgroove.errors import VgrooveError
from vgroove.gap.cases import Case, CaseResult, junit_text
from vgroove.output import write_all


def vgroove(*arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "vgroove.cli", *arguments]
    return subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)


def test_a_limit_that_decides_nothing_is_refused() -> None:
    done = vgroove(*"gap diagnose none.csv --rig none.toml --fail-above nan".split())
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "--fail-above must be a gap of 0 or more" in done.stderr


def test_junit_is_xml_whatever_an_error_says() -> None:
    case = Case("a\x01<b>\n\u00b0", [], Path("rig.toml"))
    text = junit_text([CaseResult(case, 1.0, None, "bad \x00 \ud800 name")], None)
    (error,) = ElementTree.fromstring(text.encode()).iter("error")
    assert error.get("message") == "bad ? ? name"


def test_nothing_is_on_standard_output_when_a_file_cannot_be_written(
    tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    with pytest.raises(VgrooveError, match="none/a.csv: cannot be written"):
        write_all([(Path("-"), "json"), (tmp_path / "none" / "a.csv", "rows")])
    assert capfdbinary.readouterr().out == b""
