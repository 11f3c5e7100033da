"""Every C and C++ file is laid out as .clang-format says, every Python file as `ruff format` writes
it; both checks are themselves tried on a file that is not.
"""

import shutil
from pathlib import Path

import layout
import pytest

needs_clang_format = pytest.mark.skipif(
    not shutil.which("clang-format"), reason="clang-format is not installed"
)


@needs_clang_format
def test_c_files_are_formatted() -> None:
    wrong = layout.unformatted(layout.written_by_hand())
    assert not wrong, "run `python tests/lint/layout.py --fix`: " + ", ".join(wrong)


@needs_clang_format
def test_another_layout_of_c_is_caught(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.c", tmp_path / "bad.c"
    good.write_text("int f(int *a) {\n    return *a;  // why\n}\n")
    bad.write_text("int f(int* a)\n{\n  return *a;\n}\n")
    assert layout.unformatted([str(good), str(bad)]) == [str(bad)]


def test_another_layout_of_python_is_caught(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.py", tmp_path / "bad.py"
    good.write_text('A = "a"\n')
    bad.write_text("A = 'a'\n")
    assert layout.unformatted_python((str(good), str(bad))) == [str(bad)]
